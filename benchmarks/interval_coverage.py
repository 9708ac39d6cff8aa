"""How often nominal 95 % intervals cover the truth; writes docs/evidence/coverage.md.

    python benchmarks/interval_coverage.py [--records 400] [--processes 2]

Records of the ARMAX(7,6,7,3) truth, estimated at its orders: the intervals of all parameters, of
the natural frequencies and damping ratios, and of the gain of the frequency response on a grid.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from evidence import write_section
from numpy.typing import NDArray
from scipy.signal import lfilter

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from evopem import SearchSettings, estimate  # noqa: E402
from evopem.models.response_tables import NORMAL_95, response_interval  # noqa: E402
from evopem.synthesis import true_model  # noqa: E402

NOISES = ("Gaussian", "heavy-tailed")
FREQUENCIES = np.linspace(1.0, 49.0, 25)
WARM_UP = 2000
NOISE_RATIO = 0.1
# At the true orders a few descents find the optimum; the intervals do not depend on the way there.
SEARCH = {
    4500: SearchSettings(mu=4, lambda_=4, nu=4, evaluations=1),
    500: SearchSettings(mu=4, lambda_=4, nu=4, evaluations=2500),
}


def innovations(noise: str, generator: np.random.Generator, samples: int) -> NDArray[np.float64]:
    """Unit-variance innovations; heavy-tailed: Student's t with 3 degrees of freedom."""
    if noise == "Gaussian":
        return generator.standard_normal(samples)
    return generator.standard_t(3.0, samples) / np.sqrt(3.0)


def covered(seed: int, samples: int, noise: str, objective: str) -> NDArray[np.float64]:
    """Share of the parameters whose interval covers; whether that of each mode's frequency and of
    each mode's damping ratio does; share of the gains."""
    truth = true_model()
    sequence = np.random.SeedSequence(seed, spawn_key=(samples, NOISES.index(noise)))
    generator = np.random.default_rng(sequence)
    total = samples + WARM_UP
    u = generator.standard_normal(total)
    clean = truth.simulate(u)
    e = NOISE_RATIO * np.std(clean[WARM_UP:]) * innovations(noise, generator, total)
    y = clean + lfilter(truth.C, truth.A, e)
    settings = replace(SEARCH[samples], objective=objective)
    found = estimate(u[WARM_UP:], y[WARM_UP:], truth.orders, 100.0, settings=settings).model
    assert found.covariance is not None
    errors = np.abs(found.parameters - truth.parameters)
    parameters = np.mean(errors < NORMAL_95 * np.sqrt(np.diag(found.covariance)))
    modes = [
        min(found.modes(), key=lambda mode: abs(mode.frequency_hz - true.frequency_hz))
        for true in truth.modes()
    ]
    pairs = list(zip(modes, truth.modes(), strict=True))
    frequencies = [
        abs(m.frequency_hz - t.frequency_hz) < NORMAL_95 * m.frequency_se_hz for m, t in pairs
    ]
    dampings = [abs(m.damping_ratio - t.damping_ratio) < NORMAL_95 * m.damping_se for m, t in pairs]
    lower, upper = (each[:, 0, 0] for each in response_interval(found, FREQUENCIES)[:2])
    gain = np.abs(truth.frequency_response(FREQUENCIES)[:, 0, 0])
    gains = np.mean((lower < gain) & (gain < upper))
    return np.array([parameters, *frequencies, *dampings, gains])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=400)
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    modes = len(true_model().modes())
    rows = []
    with ProcessPoolExecutor(arguments.processes) as pool:
        for samples in (4500, 500):
            for noise in NOISES:
                by_objective = []
                for objective in ("quadratic", "absolute"):
                    run = partial(covered, samples=samples, noise=noise, objective=objective)
                    shares = np.array(list(pool.map(run, range(arguments.records), chunksize=10)))
                    frequencies, dampings = shares[:, 1 : 1 + modes], shares[:, 1 + modes : -1]
                    # The first mode is the one with the longest time constant.
                    columns = [shares[:, 0], frequencies, dampings, shares[:, -1]]
                    columns += [frequencies[:, 0], dampings[:, 0]]
                    by_objective.append([f"{100 * np.mean(column):.1f}" for column in columns])
                cells = ["/".join(pair) for pair in zip(*by_objective, strict=True)]
                rows.append([str(samples), noise, *cells])
                print(rows[-1], flush=True)
    write_section(
        "coverage",
        "One recording",
        f"{arguments.records} records a row of ARMAX(7,6,7,3), innovations 10 % of the output, "
        "Gaussian or Student's t with 3 degrees of freedom, true orders;\nquadratic/absolute "
        "objective. Standard errors 0.3 to 0.8, of the last columns up to 1.7: a record of 500 "
        "samples (5 s)\nhardly sees this mode's time constant of 3.26 s. Orders are given: "
        "coverage after a choice is [lower](structures.md#intervals-after-the-choice-of-orders).",
        "benchmarks/interval_coverage.py",
        (
            *("samples", "noise", "parameters", "frequencies", "damping ratios", "gain"),
            *("5.36 Hz: frequency", "damping"),
        ),
        rows,
    )


if __name__ == "__main__":
    main()
