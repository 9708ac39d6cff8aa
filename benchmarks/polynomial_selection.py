"""Coverage of 95 % intervals after the orders were chosen; its section of docs/evidence.

    python benchmarks/polynomial_selection.py [--records 60] [--processes 2]

Records of known truths of each structure.  BIC chooses among all combinations of the true orders,
one less and one more of the plant's and of the noise's; the intervals of the chosen model are those
that the package states, which take the chosen orders for given.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "workflow" / "scripts"), str(ROOT / "tests")]

from covariances import response_standard_errors  # noqa: E402
from evidence import write_section  # noqa: E402
from polynomial_structures import TRUTHS, named  # noqa: E402
from simulated_records import polynomial_record  # noqa: E402

from evopem import PolynomialModel, SearchSettings, estimate  # noqa: E402
from evopem.config.settings import ScoringWindow  # noqa: E402
from evopem.models.modes import Mode  # noqa: E402

Array = NDArray[np.float64]

ONE = np.ones(1)
STRUCTURES = ("arx", "armax", "ararx", "ararmax", "oe", "bj")
SETTINGS = SearchSettings(objective="quadratic", mu=4, lambda_=4, nu=4, evaluations=500)
SAMPLES, NOISE = 1000, 20.0
FREQUENCIES = np.linspace(0.02, 0.48, 24)
NORMAL_95 = 1.959963984540054
PLANT, NOISE_ORDERS = ("na", "nb", "nf"), ("nc", "nd")


def truth_of(structure: str) -> PolynomialModel:
    if structure == "armax":
        arx = TRUTHS["arx"]
        return PolynomialModel(arx.A, arx.B, np.array([1.0, 0.5, 0.2]), ONE, ONE, 1)
    return TRUTHS[structure]


def candidates(structure: str) -> list[dict[str, int]]:
    """The true orders, with -1, 0 and 1 added to the plant's and to the noise's."""
    true = named(truth_of(structure).orders)
    noisy = any(name in true for name in NOISE_ORDERS)
    return [
        {
            name: order + (plant if name in PLANT else 0) + (noise if name in NOISE_ORDERS else 0)
            for name, order in true.items()
        }
        for plant in (-1, 0, 1)
        for noise in ((-1, 0, 1) if noisy else (0,))
    ]


def chosen_model(structure: str, u: Array, y: Array) -> PolynomialModel:
    """The model with the smallest BIC, all compared on the same residuals."""
    window = ScoringWindow(12, 12)
    general = "general" if structure == "armax" else structure  # one type of model for all
    found = [
        estimate(u, y, orders, structure=general, settings=SETTINGS, window=window)
        for orders in candidates(structure)
    ]
    return min(found, key=lambda one: one.criteria.bic).model


def nearest(modes: list[Mode], true: Mode) -> Mode | None:
    near = [mode for mode in modes if abs(mode.frequency_hz - true.frequency_hz) < 0.05]
    return min(near, key=lambda m: abs(m.frequency_hz - true.frequency_hz), default=None)


def covered(structure: str, seed: int) -> tuple[str, Array]:
    """The orders chosen, and shares of intervals that cover: frequencies, dampings, gain, phase."""
    truth = truth_of(structure)
    sequence = np.random.SeedSequence(seed, spawn_key=(STRUCTURES.index(structure),))
    u, y, _ = polynomial_record(truth, SAMPLES, NOISE, np.random.default_rng(sequence))
    model = chosen_model(structure, u, y)
    frequencies, dampings = [], []
    for true in truth.modes():
        mode = nearest(model.modes(), true)
        if mode is None:
            frequencies.append(False)
            dampings.append(False)
            continue
        width = NORMAL_95 * mode.frequency_se_hz
        frequencies.append(abs(mode.frequency_hz - true.frequency_hz) < width)
        width = NORMAL_95 * mode.damping_se
        dampings.append(abs(mode.damping_ratio - true.damping_ratio) < width)

    def response(one: PolynomialModel) -> Array:
        logarithm = np.log(one.frequency_response(FREQUENCIES))
        return np.stack([logarithm.real, logarithm.imag])

    errors = response(model) - response(truth)
    errors[1] = np.angle(np.exp(1j * errors[1]))
    inside = np.abs(errors) < NORMAL_95 * response_standard_errors(model, response)
    shares = [np.mean(frequencies), np.mean(dampings), *np.mean(inside, axis=1)]
    return str(tuple(named(model.orders).values())), np.array(shares)


def limited(structure: str, seed: int) -> tuple[str, Array]:
    with threadpool_limits(limits=1, user_api="blas"):
        return covered(structure, seed)


def percent(shares: Array) -> str:
    """Mean over the records, and its standard error."""
    error = 100.0 * np.std(shares, ddof=1) / np.sqrt(len(shares))
    return f"{100.0 * np.mean(shares):.1f} ± {error:.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=60)
    parser.add_argument("--processes", type=int, default=2)
    chosen = parser.parse_args()
    rows = []
    with ProcessPoolExecutor(chosen.processes) as pool:
        for structure in STRUCTURES:
            found = list(pool.map(partial(limited, structure), range(chosen.records)))
            shares = np.array([share for _, share in found])
            orders = Counter(order for order, _ in found)
            true = orders[str(tuple(named(truth_of(structure).orders).values()))]
            cells = [percent(column).replace(" ", "") for column in shares.T]
            rows.append([structure, f"{true}/{chosen.records}", *cells])
            print(rows[-1], orders, flush=True)
    write_section(
        "structures",
        "Intervals after the choice of orders",
        f"{chosen.records} records of {SAMPLES} samples a structure, noise {NOISE:g} %; BIC chose "
        "among the true orders and one less and one more. Coverage of 95 % intervals ±\nstandard "
        "error; a mode that was not found counts as not covered.",
        "benchmarks/polynomial_selection.py",
        ("structure", "true orders", "frequency", "damping", "gain", "phase"),
        rows,
    )


if __name__ == "__main__":
    main()
