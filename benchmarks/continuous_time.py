"""Compare estimates in continuous time; docs/evidence/structures.md has the results.

    python benchmarks/continuous_time.py [--records 200] [--write]

The system of Rao and Garnier, ``(-6400 s + 1600) / (s^4 + 5 s^3 + 408 s^2 + 416 s + 1600)``, under
a pseudo-random binary sequence, sampled every 10 ms, with white noise of 10 dB: output error in s
from this package, the simplified refined instrumental variable method (SRIVC: Young & Jakeman
1980), written here, and a sampled output-error model of the order that is converted, its relative
degree of 3 enforced.  SRIVC starts from a state-variable filter at 25 rad/s, output error from
poles of another system.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.signal import cont2discrete, lfilter, max_len_seq

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "workflow" / "scripts"))

from evidence import write_section

from evopem import Recording, SearchSettings, estimate
from evopem.estimation.continuous import Path as ContinuousPath
from evopem.estimation.continuous import estimate_continuous

RATE, SAMPLES = 100.0, 3069
NUM, DEN = np.array([-6400.0, 1600.0]), np.array([1.0, 5.0, 408.0, 416.0, 1600.0])
TRUTH = np.r_[NUM, DEN[1:]]
START = np.array([-1.0 + 1.0j, -1.0 - 1.0j, -5.0 + 9.0j, -5.0 - 9.0j])
HALF_WIDTH = 1.96
ITERATIONS = 200


def response(num, den, u, method="zoh"):
    """Of a transfer function to a held input from rest, (N,)."""
    above, below, _ = cont2discrete((num, den), 1.0 / RATE, method=method)
    return lfilter(np.ravel(above), below, u)


def record(number: int) -> tuple[np.ndarray, np.ndarray]:
    """Input and noisy output."""
    u = 2.0 * np.repeat(max_len_seq(10)[0], 3)[:SAMPLES] - 1.0
    generator = np.random.default_rng(np.random.SeedSequence(31, spawn_key=(number,)))
    clean = response(NUM, DEN, u)
    noise = np.std(clean) / np.sqrt(10.0)
    return u, clean + noise * generator.standard_normal(SAMPLES)


def filtered(den, signal, method):
    """s^4 ... s^0 times a signal, through 1 / den."""
    return [response(np.eye(5)[k], den, signal, method) for k in range(5)]


def srivc(u, y):
    """``[num, den[1:]]`` with standard errors, or None where it does not converge."""
    den, theta, instruments = np.poly(np.full(4, -25.0)), None, None
    for _ in range(ITERATIONS):
        of_u, of_y = filtered(den, u, "zoh"), filtered(den, y, "foh")
        rows = np.column_stack([of_u[3], of_u[4], *(-column for column in of_y[1:])])
        if theta is not None:
            simulated = response(theta[:2], den, u)
            of_x = filtered(den, simulated, "foh")
            instruments = np.column_stack([of_u[3], of_u[4], *(-column for column in of_x[1:])])
        z = rows if instruments is None else instruments
        new = np.linalg.solve(z.T @ rows, z.T @ of_y[0])
        den = np.r_[1.0, new[2:]]
        poles = np.roots(den)
        if np.any(poles.real > 0.0):  # mirrored, as usual
            den = np.real(np.poly(-np.abs(poles.real) + 1j * poles.imag))
        if theta is not None and np.allclose(new, theta, rtol=1e-5):
            errors = y - response(new[:2], den, u)
            covariance = np.var(errors) * np.linalg.inv(z.T @ z)
            return new, np.sqrt(np.diag(covariance))
        theta = new
    return None


def direct(u, y):
    """The same by output error in s."""
    model = estimate_continuous(Recording(u, y, RATE), [ContinuousPath(2)], START)
    return of_path(model.transfer_function())


def converted(u, y):
    """The same of a sampled model."""
    settings = SearchSettings(objective="quadratic")
    found = estimate(u, y, {"nb": 4, "nf": 4, "nk": 1}, RATE, structure="oe", settings=settings)
    return of_path(found.model.to_continuous().transfer_function().with_relative_degree(3))


def of_path(path):
    errors = path.standard_errors()
    return np.r_[path.num[3:], path.den[1:]], errors[3:]


METHODS = {
    "output error in s": direct,
    "SRIVC": srivc,
    "sampled output error, converted": converted,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--converted", type=int, default=5, help="of ten records")
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    found = {name: [] for name in METHODS}
    for number in range(arguments.records):
        u, y = record(number)
        for name, method in METHODS.items():
            if method is not converted or number % 10 < arguments.converted:
                found[name].append(method(u, y))
        if (number + 1) % 10 == 0:
            print(number + 1, *table(found), sep="\n", flush=True)
            if arguments.write:
                write(found, number + 1)


def write(found, records: int) -> None:
    """Write the results so far into the evidence."""
    text = (
        "The system of Rao and Garnier, 3069 samples a record, 10 dB of white noise: root mean"
        " square errors of the coefficients in percent of the truth, the share of 95 % intervals"
        " that cover it, and records without an estimate."
    )
    columns = ("method", "records", "b₁", "b₀", "a₃", "a₂", "a₁", "a₀", "covered", "failed")
    command = f"benchmarks/continuous_time.py --records {records} --write"
    write_section("structures", "Continuous time", text, command, columns, table(found))


def table(found):
    """Rows of cells."""
    rows = []
    for name, results in found.items():
        kept = [result for result in results if result is not None]
        if not kept:
            continue
        values, errors = (np.array(part) for part in zip(*kept, strict=True))
        sizes = 100.0 * np.sqrt(np.mean((values / TRUTH - 1.0) ** 2, axis=0))
        covered = np.abs(values - TRUTH) < HALF_WIDTH * errors
        share, spread = 100.0 * covered.mean(), 100.0 * covered.mean(axis=1).std()
        cells = [f"{size:.2f}" for size in sizes]
        share_cell = f"{share:.1f} ± {spread / np.sqrt(len(kept)):.1f} %"
        rows.append((name, str(len(results)), *cells, share_cell, str(len(results) - len(kept))))
    return rows


if __name__ == "__main__":
    main()
