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
from numpy.typing import NDArray
from scipy.signal import lfilter

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from evopem import SearchSettings, estimate  # noqa: E402
from evopem.models.response_tables import NORMAL_95, gain_band  # noqa: E402
from evopem.synthesis.armax import true_model  # noqa: E402

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
    y = clean + lfilter(truth.c, truth.a, e)
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
    lower, upper = gain_band(found, FREQUENCIES)
    gain = np.abs(truth.frequency_response(FREQUENCIES)[:, 0, 0])
    gains = np.mean((lower < gain) & (gain < upper))
    return np.array([parameters, *frequencies, *dampings, gains])


def percent(shares: NDArray[np.float64]) -> str:
    """Mean over the records, and its standard error."""
    error = 100.0 * np.std(shares, ddof=1) / np.sqrt(len(shares))
    return f"{100.0 * np.mean(shares):.1f} ± {error:.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=400)
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    lines = [
        "# Coverage of the 95 % intervals",
        "",
        f"Written by `python benchmarks/interval_coverage.py`: {arguments.records} records of the",
        "ARMAX(7,6,7,3) truth for each row, innovations 10 % of the output, estimated at the true",
        "orders. Shares in percent, with their own standard error over the records; heavy-tailed",
        "is Student's t with 3 degrees of freedom.",
        "",
        "| samples | noise | objective | parameters | frequencies | damping ratios | gain |",
        "|---|---|---|---|---|---|---|",
    ]
    by_mode = [
        "",
        "## By mode",
        "",
        "The time constant of a mode is 1/(ζω); records of 500 samples last 5 s. A mode that the",
        "record sees for one or two of its time constants has intervals that are too short.",
        "",
        "| samples | noise | objective | mode | time constant | frequency | damping ratio |",
        "|---|---|---|---|---|---|---|",
    ]
    modes = true_model().modes()
    with ProcessPoolExecutor(arguments.processes) as pool:
        for samples in (4500, 500):
            for noise in NOISES:
                for objective in ("quadratic", "absolute"):
                    run = partial(covered, samples=samples, noise=noise, objective=objective)
                    shares = np.array(list(pool.map(run, range(arguments.records), chunksize=10)))
                    of_frequencies = shares[:, 1 : 1 + len(modes)]
                    of_dampings = shares[:, 1 + len(modes) : -1]
                    columns = [
                        shares[:, 0],
                        of_frequencies.mean(axis=1),
                        of_dampings.mean(axis=1),
                        shares[:, -1],
                    ]
                    cells = " | ".join(percent(column) for column in columns)
                    row = f"| {samples} | {noise} | {objective} | {cells} |"
                    for k, mode in enumerate(modes):
                        rate = 2.0 * np.pi * mode.frequency_hz * mode.damping_ratio
                        by_mode.append(
                            f"| {samples} | {noise} | {objective} | {mode.frequency_hz:.2f} Hz "
                            f"| {1.0 / rate:.2f} s | {percent(of_frequencies[:, k])} "
                            f"| {percent(of_dampings[:, k])} |"
                        )
                    lines.append(row)
                    print(row, flush=True)
    target = ROOT / "docs" / "evidence" / "coverage.md"
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text("\n".join([*lines, *by_mode]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
