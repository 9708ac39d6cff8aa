"""One model from several recordings: errors and interval coverage against one long recording.

    PYTHONPATH=workflow/scripts python benchmarks/pooled_recordings.py

Writes a section of docs/evidence/coverage.md.  Each recording has its own level and its own initial
state: every second one begins while the response to earlier inputs and noise still lasts.  Models
are estimated at the true orders, by a descent from the truth.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parent))

from evidence import write_section

from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.polynomial_estimate import describe
from evopem.estimation.prediction_errors import prediction_errors
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import descended
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording, Segment

PLANT, NUMERATOR = np.array([1.0, -1.5, 0.8]), np.array([1.0, 0.5])
ONE = np.ones(1)
TRUTHS = {
    "ARMAX(2,2,2,1)": PolynomialModel(
        PLANT, NUMERATOR, np.array([1.0, -0.5, 0.2]), nk=1, structure="armax"
    ),
    "BJ(2,1,1,2,1)": PolynomialModel(
        ONE, NUMERATOR, np.array([1.0, 0.6]), np.array([1.0, -0.7]), PLANT, 1, structure="bj"
    ),
    "OE(2,2,1)": PolynomialModel(ONE, NUMERATOR, F=PLANT, C=ONE, nk=1, structure="oe"),
}
LENGTHS = ((600,), (150, 150, 150, 150), (100, 300, 80, 120), (150,))
NOISE, LEVELS, BEFORE = 0.5, 10.0, 30


def recordings(truth: PolynomialModel, lengths: tuple[int, ...], seed: int) -> list[Segment]:
    """Recordings of one system with levels and states of their own."""
    generator = np.random.default_rng([7, seed])
    found = []
    for number, length in enumerate(lengths):
        before = BEFORE * (number % 2)
        level = LEVELS * generator.standard_normal()
        u, e = generator.standard_normal((2, length + before))
        y = lfilter(truth.delayed_b(), truth.plant_denominator, u)
        y = y + NOISE * lfilter(truth.C, truth.noise_denominator, e) + level
        found.append(Segment(u[before:], y[before:], number))
    return found


def estimated(truth: PolynomialModel, stretches: list[Segment]) -> PolynomialModel:
    """The optimum next to the truth, with its covariance."""
    orders = truth.orders
    window = ScoringWindow(orders.first_residual, orders.first_residual)
    settings = SearchSettings(objective="quadratic")
    data = Recording(stretches[0].input, stretches[0].output, 1.0).with_segments(stretches)
    errors = prediction_errors(data, orders, settings, window, True)
    problem = PolynomialProblem(errors, [truth], own_starts=False)
    return describe(errors, descended(problem, problem.starts()[0]), 1.0).model


def cell(truth: PolynomialModel, lengths: tuple[int, ...], records: int) -> str:
    """Spread of the estimates of the poles, and the share of intervals with the truth."""
    models = [estimated(truth, recordings(truth, lengths, seed)) for seed in range(records)]
    deviations = np.array([model.parameters - truth.parameters for model in models])
    errors = np.array([model.parameter_standard_errors() for model in models])
    spread = np.sqrt(np.mean(deviations**2, axis=0))
    share = 100.0 * np.mean(np.abs(deviations) < 1.96 * errors)
    poles = spread[:2] if truth.orders.na else spread[-2:]
    return f"{1e3 * np.mean(poles):.2f}, {share:.1f}"


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=200)
    arguments = parser.parse_args()
    rows = []
    for name, truth in TRUTHS.items():
        rows.append([name, *(cell(truth, each, arguments.records) for each in LENGTHS)])
        print(rows[-1], flush=True)
    write_section(
        "coverage",
        "Several recordings",
        f"{arguments.records} data sets a cell, each recording with its own level and initial "
        "state: root mean square error × 10³ of the coefficients of the poles, and\ncoverage "
        "(standard error about 0.9). Errors shrink with the pooled length.",
        "benchmarks/pooled_recordings.py",
        ("truth", *("+".join(map(str, each)) for each in LENGTHS)),
        rows,
    )


if __name__ == "__main__":
    main()
