"""Expected evaluations, their intervals, and what is made of them."""

import numpy as np
import pandas as pd
import pytest

from evopem.fletcher_powell.claims import claims
from evopem.fletcher_powell.function import instance
from evopem.fletcher_powell.statistics import (
    comparison,
    expected_evaluations,
    minima_table,
    progress,
    resampled,
    spent,
    summary_table,
)


def runs_of(algorithm, evaluations, found, study="scale", dimension=100):
    """Runs that made half of their evaluations as values and half as analytic gradients."""
    evaluations, found = np.asarray(evaluations), np.asarray(found)
    missing = np.where(found, evaluations, None)
    return pd.DataFrame(
        {
            "study": study,
            "algorithm": algorithm,
            "instance": "seed-1",
            "dimension": dimension,
            "gradient": "analytic",
            "run": range(len(evaluations)),
            "budget": 10**6,
            "evaluations": evaluations,
            "values": evaluations // 2,
            "gradients": evaluations // 2,
            "best": np.where(found, 1e-8, 1e3),
            "P": np.where(found, -8.0, 3.0),
            "success_evaluations": pd.array(missing, dtype="Int64"),
            "success_values": pd.array(np.where(found, evaluations // 2, None), dtype="Int64"),
            "success_gradients": pd.array(np.where(found, evaluations // 2, None), dtype="Int64"),
        }
    )


def test_failed_runs_are_paid_for_by_those_that_succeed():
    runs = runs_of("hybrid", [100, 200, 1000], [True, True, False])
    found = np.array([True, True, False])
    assert expected_evaluations(spent(runs, "own"), found) == 650
    assert spent(runs, "differences").tolist() == [50 * 101, 100 * 101, 500 * 101]
    assert expected_evaluations(np.array([5.0]), np.array([False])) == np.inf


def test_the_bootstrap_interval_covers_as_often_as_it_says():
    """Restarts of probability p and cost 1 + failure cost have a known expectation."""
    generator = np.random.default_rng(1)
    p, cost, budget, covered = 0.6, 100.0, 300.0, 0
    truth = cost + budget * (1 - p) / p
    for _ in range(150):
        found = generator.random(60) < p
        evaluations = np.where(found, generator.uniform(0.5, 1.5, 60) * cost, budget)
        low, high = np.quantile(resampled(evaluations, found, generator), [0.025, 0.975])
        covered += low <= truth <= high
    assert 0.88 <= covered / 150 <= 0.99


def test_a_ratio_has_an_interval_and_needs_successes():
    generator = np.random.default_rng(2)
    half = runs_of("hybrid", generator.integers(900, 1100, 40), [True] * 40)
    whole = runs_of("multi-start", generator.integers(1800, 2200, 40), [True] * 40)
    found = comparison(pd.concat([half, whole]), "scale", 100, "hybrid", "multi-start")
    assert found["low"] < found["ratio"] < found["high"]
    assert found["ratio"] == pytest.approx(0.5, rel=0.05)
    never = runs_of("multi-start", [10, 10], [False, False])
    assert comparison(pd.concat([half, never]), "scale", 100, "hybrid", "multi-start") is None


def test_claims_can_fail():
    def verdict(ours, theirs, word):
        runs = pd.concat(
            [
                runs_of("hybrid", ours, [True] * len(ours)),
                runs_of("multi-start", theirs, [True] * len(theirs)),
                runs_of("hybrid-best", theirs, [True] * len(theirs)),
            ]
        )
        made = claims(summary_table(runs), runs)
        return next(claim.holds for claim in made if word in claim.statement)

    many = [100, 110, 90, 105, 95] * 4
    assert verdict(many, [300] * 20, "at most half") is True
    assert verdict(many, [150] * 20, "at most half") is False
    assert verdict(many, [150] * 20, "the best") is True
    assert verdict(many, many, "the best") is None
    assert verdict([150] * 20, many, "the best") is False


def test_progress_has_a_floor():
    assert progress([1e-8, 0.0, 100.0]).tolist() == pytest.approx([-8.0, -30.0, 2.0])


def test_the_minima_of_two_variables_are_distinct_and_alpha_is_one_of_them():
    minima = minima_table("seed-1")
    points = minima[["x1", "x2"]].to_numpy()
    assert len(minima) < 10
    assert minima["f"].is_monotonic_increasing
    at_alpha = np.max(np.abs(points - instance("seed-1", 2).alpha), axis=1) < 1e-6
    assert at_alpha.sum() == 1
    assert np.all(minima["f"][at_alpha] < 1e-9)
    for row in points:
        assert np.sum(np.max(np.abs(points - row), axis=1) < 1e-3) == 1
