"""The search of a long record on blocks of it, with descents on the whole at its end."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation import prediction_estimate
from evopem.estimation.estimate import estimate_polynomial
from evopem.estimation.prediction_errors import prediction_errors
from evopem.estimation.search import blocks
from evopem.estimation.search.global_search import global_search
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.models.orders import orders_of
from evopem.signals.recording import Recording, Segment, concatenated

SAMPLES, SEARCHED = 8000, 1800


@pytest.fixture(autouse=True)
def short_blocks(monkeypatch):
    monkeypatch.setattr(blocks, "SEARCHED", SEARCHED)
    monkeypatch.setattr(blocks, "BLOCKS", 3)


@pytest.fixture
def searched(monkeypatch):
    """Samples of each problem that is searched."""
    samples, search = [], prediction_estimate.global_search

    def recorded(problem, *given):
        samples.append(sum(stretch.samples for stretch in problem.errors.stretches))
        return search(problem, *given)

    monkeypatch.setattr(prediction_estimate, "global_search", recorded)
    return samples


def record(seed=1, samples=SAMPLES, inputs=1):
    generator = np.random.default_rng(seed)
    u, e = generator.standard_normal((samples, inputs)), generator.standard_normal(samples)
    y = sum(lfilter([0, 1, 0.5], [1, -1.5 + 0.2 * i, 0.9], each) for i, each in enumerate(u.T))
    return Recording(u, y + lfilter([1, 0.7], [1, -0.8], e), 1.0)


ORDERS = {
    "armax": orders_of("armax", (2, 2, 2, 1)),
    "oe": orders_of("oe", (2, 2, 1)),
    "bj": orders_of("bj", (2, 1, 1, 2, 1)),
}


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
@pytest.mark.parametrize("structure", list(ORDERS))
def test_the_optimum_is_that_of_the_search_on_the_whole(
    monkeypatch, searched, structure, objective
):
    settings = SearchSettings(objective=objective, evaluations=4000)
    given = record(), ORDERS[structure]
    quick = estimate_polynomial(*given, settings=settings, level=True)
    monkeypatch.setattr(blocks, "LONG", 5)
    whole = estimate_polynomial(*given, settings=settings, level=True)
    assert searched == [SEARCHED, SAMPLES]
    assert quick.search.value == pytest.approx(whole.search.value, rel=1e-6)
    assert quick.model.parameters == pytest.approx(whole.model.parameters, abs=2e-3)
    assert len(quick.residuals) == SAMPLES
    assert quick.search.diagnostics.n_confirming >= 1
    lowest = min(quick.search.diagnostics.restart_minima)
    assert lowest == pytest.approx(quick.search.value, rel=1e-6)


def test_a_search_goes_on_where_an_earlier_one_ended(searched):
    first = estimate_polynomial(
        record(), ORDERS["bj"], settings=SearchSettings(objective="quadratic", evaluations=0)
    )
    settings = SearchSettings(objective="quadratic", evaluations=2000)
    second = estimate_polynomial(record(), ORDERS["bj"], settings=settings, earlier=first.search)
    assert searched == [SEARCHED, SEARCHED]
    assert second.search.value <= first.search.value
    more = second.search.diagnostics.n_restarts - first.search.diagnostics.n_restarts
    assert more >= 2
    assert second.search.diagnostics.n_confirming >= 1


def test_an_earlier_search_has_no_focus():
    given, settings = (record(), ORDERS["bj"]), SearchSettings(evaluations=0)
    first = estimate_polynomial(*given, settings=settings)
    with pytest.raises(ValueError, match="neither focus nor constraints"):
        estimate_polynomial(*given, settings=settings, focus="simulation", earlier=first.search)


@pytest.mark.parametrize("structure", ["oe", "fir"])
def test_a_record_that_a_model_explains_without_error_is_searched(structure):
    u = np.sign(np.random.default_rng(1).standard_normal(SAMPLES))
    orders = orders_of(structure, (1, 1, 1) if structure == "oe" else (1, 1))
    given = Recording(u, np.append(0.0, u[:-1]), 1.0), orders
    settings = SearchSettings(objective="quadratic", evaluations=0)
    first = estimate_polynomial(*given, settings=settings).search
    for evaluations in (0, 500):
        settings = replace(settings, evaluations=evaluations)
        assert estimate_polynomial(*given, settings=settings, earlier=first).search.value < 1e-20


def test_several_recordings_and_inputs_are_searched_on_blocks_of_them(searched, monkeypatch):
    several = concatenated([record(1, 5000, 2), record(2, 3000, 2)])
    orders = ORDERS["bj"]
    orders = replace(orders, nb=(2, 2), nf=(2, 2), nk=(1, 1))
    settings = SearchSettings(objective="quadratic", evaluations=300)
    quick = estimate_polynomial(several, orders, settings=settings, level=True)
    monkeypatch.setattr(blocks, "LONG", 5)
    whole = estimate_polynomial(several, orders, settings=settings, level=True)
    assert searched == [SEARCHED, SAMPLES]
    assert len(quick.levels) == 2
    assert quick.search.value == pytest.approx(whole.search.value, rel=1e-6)


def test_all_optima_that_the_blocks_do_not_tell_from_the_lowest_are_descended_from(monkeypatch):
    descended, polish = [], blocks.polish

    def recorded(errors, points, *given, **more):
        descended.append(len(points))
        return polish(errors, points, *given, **more)

    monkeypatch.setattr(blocks, "polish", recorded)
    settings = SearchSettings(objective="quadratic")
    errors = prediction_errors(record(), ORDERS["bj"], settings, ScoringWindow(3, 3), False)

    def search(problem, _):
        lowest = global_search(problem, settings, np.random.default_rng(1))
        assert len(lowest.ends) > lowest.diagnostics.n_multistart
        near, far = lowest.point * (1.0 + 1e-4), lowest.point.copy()
        far[0] *= 0.8
        ends = [(float(problem.values(point[None, :])[0]), point) for point in (near, far)]
        same = lowest.value * (1.0 + 1e-8), lowest.point
        between = 0.5 * (lowest.value + ends[0][0])
        assert lowest.value * (1.0 + 2e-6) < between
        diagnostics = replace(
            lowest.diagnostics,
            restart_minima=(lowest.value, between),
            convergence=((1, between), (2, lowest.value), (3, between)),
        )
        return replace(lowest, ends=(same, *ends), diagnostics=diagnostics)

    outcome = blocks.searched_in_blocks(PolynomialProblem(errors), search)
    assert descended == [2]
    # A restart that ended elsewhere does not confirm what others reached.
    assert outcome.diagnostics.n_confirming == 0
    lowest = min(outcome.diagnostics.restart_minima)
    assert outcome.value == pytest.approx(lowest, rel=1e-9)
    reached = [value for _, value in outcome.diagnostics.convergence]
    assert reached == sorted(reached, reverse=True)
    assert errors.values(outcome.point[None, :])[0] == pytest.approx(outcome.value)


def test_blocks_lie_all_over_the_record_and_where_most_happens():
    even = blocks.searched_blocks(record().segments)
    assert [block.first for block in even] == pytest.approx([1033, 3700, 6367], abs=300)
    assert {block.samples for block in even} == {SEARCHED // 3}
    u = np.zeros(SAMPLES)
    u[7000:7100] = 1.0
    late = blocks.searched_blocks([Segment(u, np.roll(u, 5))])
    assert any(block.first <= 7000 and block.first + block.samples >= 7100 for block in late)
    ends = [block.first + block.samples for block in late]
    assert all(end <= block.first for end, block in zip(ends, late[1:], strict=False))
    assert late[0].first < 4000
    assert ends[-1] <= SAMPLES
    assert blocks.searched_blocks([Segment(u[:7199], u[:7199])]) == ()
    assert blocks.searched_blocks([Segment(u[:100], u[:100])] * 80) == ()


@pytest.mark.parametrize("kind", ["noise", "plant"])
def test_a_record_unlike_its_blocks_is_searched_as_a_whole(searched, kind):
    usual = record()
    y = usual.output.copy()
    first, last = 5000, 5600
    assert all(
        block.first >= last or block.first + block.samples <= first
        for block in blocks.searched_blocks(usual.segments)
    )
    if kind == "noise":
        y[first:last] = np.std(y) * np.random.default_rng(3).standard_normal(last - first)
    else:
        y[first:last] *= -1.0
    changed = Recording(usual.inputs, y, 1.0)
    settings = SearchSettings(objective="quadratic", evaluations=1000)
    estimate_polynomial(changed, ORDERS["oe"], settings=settings)
    assert searched == [SEARCHED, SAMPLES]


def test_a_shorter_record_is_searched_as_before(searched):
    shorter = record(samples=4 * SEARCHED - 1)
    estimate_polynomial(shorter, ORDERS["oe"], settings=SearchSettings(objective="quadratic"))
    assert searched == [4 * SEARCHED - 1]
