"""The automatic recipe on records of each structure: what it chooses, and what its intervals cover.

    PYTHONPATH=workflow/scripts python benchmarks/automatic_structures.py --records 15

Records of known truths, identified with nothing but input and output given.  The frequency response
of the chosen model is compared with the truth's, and with that of a model of the true structure and
orders, estimated from the same samples: a ratio of 1 is as near as one can hope for.  The 95 %
intervals of gain and phase take everything that was decided for given.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from covariances import response_standard_errors
from numpy.typing import NDArray
from polynomial_selection import FREQUENCIES, NORMAL_95, truth_of
from simulated_records import polynomial_record
from threadpoolctl import threadpool_limits

import evopem
from evopem import PolynomialModel, Results, StateSpaceModel
from evopem.automatic.fit import NOISE_RADIUS, PLANT_RADIUS, fit
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import covariance_of
from evopem.signals.recording import Segment

Array = NDArray[np.float64]

STRUCTURES = ("fir", "arx", "armax", "ararx", "ararmax", "oe", "bj")
SAMPLES, NOISE = 1000, 20.0
# A frequency response as near to the truth as that of the true structure and orders.
AS_NEAR = 1.1


class Outcome(NamedTuple):
    """What one record gave.

    Attributes
    ----------
    structure, model : str
    ratio : float
        Error of the frequency response, over that of a model of the true structure and orders.
    gain, phase : float
        Shares of the frequencies whose intervals cover the truth; NaN without intervals.
    true_gain, true_phase : float
        The same for the model of the true structure and orders.
    failed : tuple of str
        Checks that stay failed.
    """

    structure: str
    model: str
    ratio: float
    gain: float
    phase: float
    true_gain: float
    true_phase: float
    failed: tuple[str, ...]


def record_of(structure: str, seed: int) -> tuple[Array, Array]:
    """Input and output of one record."""
    sequence = np.random.SeedSequence(seed, spawn_key=(STRUCTURES.index(structure), 17))
    u, y, _ = polynomial_record(
        truth_of(structure), SAMPLES, NOISE, np.random.default_rng(sequence)
    )
    return u, y


def judged(structure: str, seed: int, found: Results) -> Outcome:
    """Compare a model with the truth, and with a fit of the true orders."""
    truth, stretches = truth_of(structure), [Segment(*record_of(structure, seed))]
    true_orders = fit(stretches, truth.orders, models=[truth]).model
    ratio = _distance(found.model, truth) / _distance(true_orders, truth)
    errors = PolynomialErrors(
        stretches, truth.orders, "quadratic", PLANT_RADIUS, NOISE_RADIUS, True
    )
    point = errors.completed_by_states(true_orders.parameters)
    covariance = covariance_of(errors, point, errors.residuals(point))
    own = _covered(found.model, truth)
    of_true = _covered(replace(true_orders, covariance=covariance), truth)
    failed = tuple(each.name for each in found.checks if each.passed is False)
    record = found.results.model
    return Outcome(record.structure, record.text, float(ratio), *own, *of_true, failed)


def _covered(
    model: PolynomialModel | StateSpaceModel, truth: PolynomialModel
) -> tuple[float, float]:
    """Shares of the frequencies whose 95 % intervals of gain and of phase cover the truth."""
    if model.covariance is None:
        return np.nan, np.nan
    difference = _logarithm(model) - _logarithm(truth)
    difference[1] = np.angle(np.exp(1j * difference[1]))
    inside = np.abs(difference) < NORMAL_95 * response_standard_errors(model, _logarithm)
    gain, phase = np.mean(inside.reshape(2, -1), axis=1)
    return float(gain), float(phase)


def _logarithm(model: PolynomialModel | StateSpaceModel) -> Array:
    logarithm = np.log(model.frequency_response(FREQUENCIES))
    return np.stack([logarithm.real, logarithm.imag])


def _distance(model: PolynomialModel | StateSpaceModel, truth: PolynomialModel) -> float:
    response = truth.frequency_response(FREQUENCIES)
    return float(np.linalg.norm(model.frequency_response(FREQUENCIES) - response))


def identified(structure: str, seed: int) -> Outcome:
    """Identify one record and judge the model."""
    u, y = record_of(structure, seed)
    found = evopem.identify(u, y, 1.0, validation=(u, y), show_progress=False)
    with threadpool_limits(limits=1, user_api="blas"):
        return judged(structure, seed, found)


def row(structure: str, outcomes: list[Outcome]) -> str:
    """A row of the table."""
    right = [each.structure == structure for each in outcomes]
    near = [own or each.ratio <= AS_NEAR for own, each in zip(right, outcomes, strict=True)]
    ratios = np.array([each.ratio for each in outcomes])
    chosen = ", ".join(
        f"{name} {count}" for name, count in Counter(e.structure for e in outcomes).most_common()
    )
    kinds = ("gain", "phase", "true_gain", "true_phase")
    covered = " | ".join(
        f"{100.0 * np.nanmean([getattr(each, kind) for each in outcomes]):.1f}" for kind in kinds
    )
    return (
        f"| {structure} | {len(outcomes)} | {chosen} | {100.0 * np.mean(right):.0f} "
        f"| {100.0 * np.mean(near):.0f} | {np.median(ratios):.2f} | {ratios.max():.2f} "
        f"| {covered} | {np.mean([len(e.failed) for e in outcomes]):.2f} |"
    )


HEADER = (
    "| truth | records | chosen | right, % | right or as near, % | median ratio | largest "
    "| gain covered, % | phase covered, % | gain, true orders | phase, true orders "
    "| failed checks |"
)


def main() -> None:
    """Print a row for each structure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=15)
    parser.add_argument("--only", default="", help="structures whose name contains this")
    arguments = parser.parse_args()
    print(HEADER)
    print("|---" * 12 + "|")
    for structure in STRUCTURES:
        if arguments.only not in structure:
            continue
        begun = time.process_time()
        outcomes = [identified(structure, seed) for seed in range(arguments.records)]
        print(row(structure, outcomes), f"{time.process_time() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main()
