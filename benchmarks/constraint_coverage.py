"""Coverage of 95 % intervals under constraints whose bounds are the truth's own numbers.

Run from the project folder: PYTHONPATH=workflow/scripts python benchmarks/constraint_coverage.py
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from evidence import write_section
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from simulated_records import polynomial_record

from evopem import Constraints, SearchSettings, estimate
from evopem.models.polynomial import PolynomialModel

RECORDS, SAMPLES, NOISE = 100, 600, 20.0
ONE = np.ones(1)
POLE = 0.92 * np.exp(0.6j)
TRUTH = PolynomialModel(
    ONE,
    np.array([1.0, 0.6]),
    np.array([1.0, 0.5, 0.2]),
    ONE,
    np.poly([POLE, POLE.conjugate()]).real,
    1,
)
GAIN = float(TRUTH.B[0].sum() / TRUTH.F[0].sum())
MODE = TRUTH.modes()[0]
CASES = {
    "damping at least": Constraints(min_damping_ratio=MODE.damping_ratio),
    "static gain at most": Constraints(static_gain_bounds=(None, GAIN)),
    "static gain given": Constraints(static_gain=GAIN),
}


def covered(constraints: Constraints, seed: int) -> tuple[bool, NDArray[np.float64]]:
    """Whether a constraint is active, and which intervals of free coefficients hold the truth."""
    u, y, _ = polynomial_record(TRUTH, SAMPLES, NOISE, np.random.default_rng(5000 + seed))
    found = estimate(
        u,
        y,
        (2, 2, 0, 2, 1),
        structure="bj",
        settings=SearchSettings(objective="quadratic", evaluations=1000),
        constraints=constraints,
    )
    assert found.model.covariance is not None
    assert found.constraints is not None
    errors = found.model.parameters - TRUTH.parameters
    deviations = np.sqrt(np.diag(found.model.covariance.matrix))
    free = deviations > 1e-9
    inside = np.where(free, np.abs(errors) <= 1.96 * deviations, np.nan)
    return bool(found.constraints.active), inside


def main() -> None:
    rows = []
    for name, constraints in CASES.items():
        results = [covered(constraints, seed) for seed in range(RECORDS)]
        chosen = [inside for active, inside in results if active]
        shares = np.array([np.nanmean(inside) for inside in chosen])
        error = float(np.std(shares)) / np.sqrt(len(shares))
        count = sum(active for active, _ in results)
        rows.append([name, str(count), f"{100 * np.mean(shares):.1f}±{100 * error:.1f}"])
        print(rows[-1], flush=True)
    write_section(
        "coverage",
        "Under constraints",
        f"{RECORDS} records of {SAMPLES} samples of a Box-Jenkins model, noise {NOISE:.0f} %; each "
        "bound is the truth's own number, so that an inequality is active on\nabout half of the "
        "records. Coverage of the free coefficients where it is active.",
        "benchmarks/constraint_coverage.py",
        ("constraint", "active on", "coverage"),
        rows,
    )


if __name__ == "__main__":
    main()
