"""Expected evaluations to success, their intervals, and the hypotheses tested with them."""

import numpy as np
import pandas as pd
import pytest

from evopem.files.json_form import load, save
from fletcher_powell.experiments import Case
from fletcher_powell.function import instance
from fletcher_powell.hypotheses import Hypothesis, evaluate_hypotheses
from fletcher_powell.runs import Run, curve_grid, run_cases
from fletcher_powell.statistics import (
    compare,
    expected_evaluations,
    minima_table,
    progress,
    resampled,
    runs_table,
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


def test_expected_evaluations_count_the_failed_runs():
    runs = runs_of("hybrid", [100, 200, 1000], [True, True, False])
    found = np.array([True, True, False])
    assert expected_evaluations(spent(runs, "own"), found) == 650
    assert spent(runs, "differences").tolist() == [50 * 101, 100 * 101, 500 * 101]
    assert expected_evaluations(np.array([5.0]), np.array([False])) == np.inf


def test_the_bootstrap_interval_has_its_nominal_coverage():
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
    found = compare(pd.concat([half, whole]), "scale", 100, "hybrid", "multi-start")
    assert found.low < found.value < found.high
    assert found.value == pytest.approx(0.5, rel=0.05)
    never = runs_of("multi-start", [10, 10], [False, False])
    assert compare(pd.concat([half, never]), "scale", 100, "hybrid", "multi-start") is None


def test_hypotheses_can_fail():
    def verdict(ours, theirs, word):
        runs = pd.concat(
            [
                runs_of("hybrid", ours, [True] * len(ours)),
                runs_of("multi-start", theirs, [True] * len(theirs)),
                runs_of("hybrid-best", theirs, [True] * len(theirs)),
            ]
        )
        tested = evaluate_hypotheses(summary_table(runs), runs)
        return next(each.holds for each in tested if word in each.statement)

    many = [100, 110, 90, 105, 95] * 4
    assert verdict(many, [300] * 20, "at most half") is True
    assert verdict(many, [150] * 20, "at most half") is False
    assert verdict(many, [150] * 20, "the best") is True
    assert verdict(many, many, "the best") is None
    assert verdict([150] * 20, many, "the best") is False


def test_the_contest_is_decided_by_intervals():
    def verdict(ours, theirs):
        runs = pd.concat(
            [
                runs_of("default", ours, [True] * len(ours), study="contest"),
                runs_of("monotonic-basin-hopping", theirs, [True] * len(theirs), study="contest"),
            ]
        )
        tested = evaluate_hypotheses(summary_table(runs), runs)
        return {each.statement: each.holds for each in tested}

    many = [100, 110, 90, 105, 95] * 4
    statement = (
        "At n = 100 the default search needs fewer evaluations than Monotonic basin hopping."
    )
    assert verdict(many, [150] * 20) == {statement: True}
    assert verdict(many, many) == {statement: None}
    assert verdict([150] * 20, many) == {statement: False}


def test_hypotheses_survive_their_json_form(tmp_path):
    runs = runs_of("hybrid", [100, 200, 300], [True, True, False], study="table")
    tested = evaluate_hypotheses(summary_table(runs), runs)
    assert tested[0].holds is False
    save(tested, tmp_path / "hypotheses.json")
    assert load(tuple[Hypothesis, ...], tmp_path / "hypotheses.json") == tuple(tested)


def test_progress_has_a_floor():
    assert progress([1e-8, 0.0, 100.0]).tolist() == pytest.approx([-8.0, -30.0, 2.0])


def test_runs_survive_their_json_form(tmp_path):
    cases = [
        Case("table", 2, "differences", 300, (1, 2)),
        Case("scale", 2, "analytic", 300, (1,)),
    ]
    made = run_cases("hybrid", "seed-1", cases, 1, print)
    assert [len(run.curve or ()) for run in made] == [len(curve_grid(300))] * 2 + [0]
    save(made, tmp_path / "runs.json")
    assert load(tuple[Run, ...], tmp_path / "runs.json") == tuple(made)
    assert list(runs_table(made)["run"]) == [1, 2, 1]


def test_a_run_does_not_depend_on_the_other_runs_of_its_job():
    whole = Case("table", 2, "differences", 300, (1, 2))
    alone = Case("table", 2, "differences", 300, (2,))
    pair, single = (run_cases("multi-start", "seed-1", [case], 1, print) for case in (whole, alone))
    assert pair[1:] == single
    assert pair[0].best != pair[1].best


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
