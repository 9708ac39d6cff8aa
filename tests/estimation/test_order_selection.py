"""The search for delay and orders, on systems that are known."""

from dataclasses import replace

import numpy as np
import pytest

from evopem.config.channels import SyntheticSource
from evopem.config.settings import PreparationSettings, ScoringWindow, SearchSettings
from evopem.errors import InputError
from evopem.estimation.criteria import Criteria
from evopem.estimation.order_candidate import (
    Candidate,
    first_pass,
    race,
    select_delay,
    select_order,
)
from evopem.estimation.order_selection import (
    OrderSearch,
    complete_estimate,
    continue_search,
    estimate_candidates,
    estimate_in_parallel,
    reoptimize_from,
    select_candidate,
    settle,
)
from evopem.estimation.search.certificate import (
    AFTER_FEW_OPTIMA,
    AFTER_FIRST_PASS,
    FEW_OPTIMA,
    Target,
)
from evopem.estimation.search.problem import SearchDiagnostics
from evopem.files.json_form import to_json
from evopem.models.orders import armax_orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.preparation import prepare
from evopem.signals.recording import Recording
from evopem.synthesis import armax, synthesize

SEARCH = SearchSettings(objective="quadratic", evaluations=8000)
WINDOW = ScoringWindow(18, 38)
LATE = ScoringWindow(90, 110)


@pytest.fixture(scope="module")
def record():
    return armax(seed=3, samples=4500)[0]


@pytest.fixture(scope="module")
def short(record):
    return Recording(record.input[:600], record.output[:600], 100.0)


def test_the_delay_is_found(record):
    orders = [armax_orders(k, k, k, nk) for k in (6, 7) for nk in range(5)]
    candidates = estimate_candidates(OrderSearch(record, SEARCH, WINDOW), orders, "delay")
    selected, reason = select_delay(candidates)
    assert selected.single.nk == 3
    assert "delay of 3 samples" in reason


def test_the_true_orders_are_found(record):
    """Phases nc and nb from the true plant order, near the truth."""
    orders = [armax_orders(7, 7, k, 3) for k in range(5, 10)]
    selected, reason = select_order(
        estimate_candidates(OrderSearch(record, SEARCH, WINDOW), orders, "nc")
    )
    assert selected == armax_orders(7, 7, 7, 3)
    assert "ARMAX(7,7,7,3) has the smallest BIC" in reason
    orders = [armax_orders(7, k, 7, 3) for k in range(4, 9)]
    found = estimate_candidates(OrderSearch(record, SEARCH, WINDOW), orders, "nb")
    assert select_order(found)[0] == armax_orders(7, 6, 7, 3)


@pytest.mark.parametrize("seed", [2, 6])
def test_the_chapters_case(seed):
    """The flexible arm, prepared as in the chapter: delay and modes near the physical truth.

    The 2 Hz mode is not found, as in the chapter: two differences leave 1.6 % of its gain.
    """
    preparation = PreparationSettings()
    source = SyntheticSource("flexible_arm", seed=seed, samples=5000)
    recording, truth = synthesize(source, preparation.transforms)
    data = prepare(recording, preparation).estimation
    search = SearchSettings(objective="absolute", evaluations=20000)
    orders = [armax_orders(k, k, k, nk) for k in (7, 8) for nk in (1, 2, 3)]
    candidates = estimate_candidates(OrderSearch(data, search, WINDOW), orders, "delay")
    selected, _ = select_delay(candidates)
    assert selected.single.nk == truth.delay_samples == 3
    chosen = next(each for each in candidates if each.orders == armax_orders(8, 8, 8, 3))
    modes = complete_estimate(chosen, data, search, WINDOW).model.modes()
    expected = ((5.36, 0.91, 0.003), (16.65, 17.5, 0.01), (37.0, 1.07, 0.001))
    for frequency, damping, tolerance in expected:
        near = min(modes, key=lambda mode: abs(mode.frequency_hz - frequency))
        assert near.frequency_hz == pytest.approx(frequency, rel=tolerance)
        assert 100 * near.damping_ratio == pytest.approx(damping, rel=0.25)


def test_jobs_and_processes_do_not_change_a_bit(short):
    orders = [armax_orders(2, 2, k, 3) for k in range(1, 5)]
    whole = estimate_candidates(OrderSearch(short, SEARCH, LATE), orders, "nc")
    parts = [
        estimate_candidates(OrderSearch(short, SEARCH, LATE), orders[i::2], "nc") for i in (1, 0)
    ]
    by_parts = [parts[1][0], parts[0][0], parts[1][1], parts[0][1]]
    by_processes = estimate_in_parallel(OrderSearch(short, SEARCH, LATE), orders, "nc", cores=2)
    assert to_json(whole) == to_json(by_parts) == to_json(by_processes)
    assert [each.orders for each in whole] == orders


def test_a_completed_candidate_is_the_estimate(short):
    (candidate,) = estimate_candidates(
        OrderSearch(short, SEARCH, LATE), [armax_orders(2, 2, 2, 3)], "nb"
    )
    complete = complete_estimate(candidate, short, SEARCH, LATE)
    assert complete.criteria == candidate.criteria
    np.testing.assert_array_equal(complete.model.parameters, candidate.model.parameters)
    np.testing.assert_array_equal(complete.noise_state, candidate.noise_state)
    assert complete.search.value == candidate.minimum
    assert complete.at_stability_bound == candidate.at_stability_bound
    assert candidate.model.covariance is None
    assert np.isfinite(complete.model.covariance.matrix).all()


def test_radii_of_a_candidate_are_those_of_its_model(short):
    (candidate,) = estimate_candidates(
        OrderSearch(short, SEARCH, LATE), [armax_orders(2, 2, 2, 3)], "nb"
    )
    assert candidate.max_pole_radius == np.abs(np.roots(candidate.model.A)).max()
    assert candidate.max_noise_zero_radius == np.abs(np.roots(candidate.model.C)).max()


def test_a_record_too_short_for_an_order_is_refused_in_a_sentence(record):
    too_short = Recording(record.input[:120], record.output[:120], 100.0)
    with pytest.raises(InputError, match=r"ARMAX\(7,7,7,3\) has 21 parameters"):
        estimate_candidates(OrderSearch(too_short, SEARCH, LATE), [armax_orders(7, 7, 7, 3)], "nb")


def candidate(orders, bic, minimum=1.0, n_confirming=1):
    """A candidate of no particular model, for what depends on criteria and diagnostics alone."""
    orders = armax_orders(*orders)
    return Candidate(
        phase="plant",
        orders=orders,
        model=PolynomialModel(
            np.r_[1.0, np.zeros(orders.na)],
            np.ones(orders.single.nb),
            np.r_[1.0, np.zeros(orders.nc)],
            orders.single.nk,
        ),
        criteria=Criteria(objective=minimum, fit_percent=100 - minimum, rss=1.0, bic=bic),
        levels=(),
        plant_state=np.zeros(0),
        noise_state=np.zeros(orders.nc),
        minimum=minimum,
        at_stability_bound=False,
        diagnostics=SearchDiagnostics(
            evaluations=10,
            generations=1,
            restart_minima=(minimum,) * (n_confirming + 1),
            n_confirming=n_confirming,
            n_local_optima=1,
            n_multistart=0,
            undiscovered_probability=1.0,
            convergence=((10, minimum),),
        ),
    )


def plant(k, minimum, n_confirming=1, nk=0):
    """ARMAX(k,k,k,nk) whose BIC follows its minimum."""
    return candidate((k, k, k, nk), minimum + 0.1 * k, minimum, n_confirming)


def confirmed(each, n_confirming):
    return replace(each, diagnostics=replace(each.diagnostics, n_confirming=n_confirming))


def test_the_delay_has_the_smallest_mean_bic_over_the_orders():
    candidates = [
        candidate((k, k, k, nk), bic)
        for nk, values in ((0, (1.0, -2.0)), (1, (-1.0, -1.5)), (2, (-0.9, -1.4)))
        for k, bic in zip((6, 7), values, strict=True)
    ]
    selected, reason = select_delay(candidates)
    assert selected == armax_orders(7, 7, 7, 1)
    assert "(-1.2500, 0.1000 below the next)" in reason
    assert "varies by 0.5000" in reason


def test_the_smaller_of_models_with_equal_bic_is_selected():
    candidates = [candidate((2, k, 2, 0), 1.0) for k in (5, 3, 4)]
    assert select_order(candidates)[0] == armax_orders(2, 3, 2, 0)


def no_reoptimization(nested, larger):
    raise AssertionError("no candidate has a higher minimum than a nested one here")


def test_a_selected_candidate_without_confirmation_is_searched_once_more():
    repeated = []

    def repeat(each):
        repeated.append(each.orders.na)
        return confirmed(each, 0)

    candidates = [plant(2, 3.0), plant(3, 1.0, n_confirming=0), plant(4, 0.95)]
    selection = settle(candidates, "plant", repeat, no_reoptimization)
    # Once, although the repeated search is not confirmed either.
    assert (repeated, selection.orders.na) == ([3], 3)
    assert selection.candidates[0] is candidates[0]
    assert selection.selected is selection.candidates[1]
    assert selection.phase == "plant"


def test_a_candidate_beaten_by_a_nested_one_is_reoptimized_from_it():
    """From the smallest up: each is compared with the improved smaller ones."""
    reoptimized = []

    def reoptimize(nested, larger):
        reoptimized.append((nested.orders.na, nested.minimum, larger.orders.na))
        minimum = nested.minimum - 0.2
        bic = minimum + 0.1 * larger.orders.na
        return replace(larger, minimum=minimum, criteria=replace(larger.criteria, bic=bic))

    def no_repetition(each):
        raise AssertionError("every search is confirmed here")

    candidates = [plant(4, 0.9), plant(3, 1.2), plant(2, 1.0), plant(2, 0.7, nk=1)]
    selection = settle(candidates, "plant", no_repetition, reoptimize)
    # At nk = 0 ARMAX(3,3,3) and (4,4,4) contain ARMAX(2,2,2) of either delay; (2,2,2,0) does not.
    assert reoptimized == [(2, 0.7, 3), (3, pytest.approx(0.5), 4)]
    assert [each.minimum for each in selection.candidates] == pytest.approx([0.3, 0.5, 1.0, 0.7])
    assert selection.orders.na == 4
    assert "ARMAX(4,4,4,0)" in selection.reason


def test_all_orders_of_the_selected_delay_are_confirmed():
    repeated = []

    def repeat(each):
        repeated.append((each.orders.na, each.orders.single.nk))
        return confirmed(each, 1)

    candidates = [plant(k, 1.0 + nk - 0.1 * k, 0, nk) for k in (2, 3) for nk in (0, 1)]
    assert settle(candidates, "delay", repeat, no_reoptimization).orders.single.nk == 0
    assert repeated == [(2, 0), (3, 0)]


def test_a_selection_does_not_depend_on_the_order_of_the_candidates(short):
    search = replace(SEARCH, evaluations=500)
    orders = [armax_orders(2, 2, k, 3) for k in (1, 2, 3)]
    candidates = estimate_candidates(OrderSearch(short, search, LATE), orders, "nc")
    one, other = (
        select_candidate(OrderSearch(short, search, LATE), each, "nc")
        for each in (candidates, candidates[::-1])
    )
    assert to_json(one) == to_json(other)


def test_a_repeated_search_is_independent_and_pooled_with_the_first(short):
    search = replace(SEARCH, evaluations=1000)
    (first,) = estimate_candidates(
        OrderSearch(short, search, LATE), [armax_orders(7, 6, 7, 3)], "nb"
    )
    more = continue_search(OrderSearch(short, search, LATE).repeated(), first)
    before, after = first.diagnostics, more.diagnostics
    assert more.minimum <= first.minimum
    assert after.evaluations > before.evaluations
    assert after.restart_minima[: before.n_restarts] == before.restart_minima
    assert after.n_restarts > before.n_restarts
    # Other draws, so other minima to the last bit, and not the first search over again.
    assert set(after.restart_minima[before.n_restarts :]).isdisjoint(before.restart_minima)
    assert after.convergence[: len(before.convergence)] == before.convergence
    values = [value for _, value in after.convergence]
    assert values == sorted(values, reverse=True)
    assert values[-1] == more.minimum == min(after.restart_minima)


def test_a_reoptimized_candidate_is_no_worse_than_the_nested_one(short):
    orders = [armax_orders(4, 3, 4, 3), armax_orders(7, 6, 6, 2)]
    nested, larger = estimate_candidates(OrderSearch(short, SEARCH, LATE), orders, "nb")
    failed = replace(
        larger,
        minimum=99.0,
        diagnostics=replace(
            larger.diagnostics,
            evaluations=10,
            generations=1,
            restart_minima=(99.0,),
            n_confirming=0,
            n_local_optima=1,
            convergence=((10, 99.0),),
        ),
    )
    found = reoptimize_from(OrderSearch(short, SEARCH, LATE), nested, failed)
    objective = found.criteria.objective
    assert larger.criteria.objective * (1 - 1e-4) <= objective < nested.criteria.objective
    assert (found.diagnostics.restart_minima, found.diagnostics.descents) == ((99.0,), 1)
    # The search's value has the noise state's square added.
    assert 0.0 <= found.minimum / objective - 1.0 < 1e-3
    assert found.diagnostics.n_confirming == 0
    assert found.diagnostics.evaluations > 10


RACE_SAMPLES = 1000
SETTINGS = SearchSettings()


def open_search(orders, bic):
    """A candidate after a first pass that settled nothing."""
    found = candidate(orders, bic, n_confirming=0)
    return replace(found, diagnostics=replace(found.diagnostics, restart_minima=(1.0, 2.0)))


def certified(orders, bic):
    found = candidate(orders, bic, n_confirming=2)
    return replace(found, diagnostics=replace(found.diagnostics, undiscovered_probability=0.001))


def searched_on(searched, gain=0.0):
    def search(each, target):
        searched.append(each.orders)
        spent = replace(each.diagnostics, evaluations=SETTINGS.evaluations)
        bic = each.criteria.bic - gain
        return replace(each, diagnostics=spent, criteria=replace(each.criteria, bic=bic))

    return search


def test_the_first_pass_differs_in_its_evaluations_alone():
    assert replace(first_pass(SETTINGS), evaluations=SETTINGS.evaluations) == SETTINGS


def test_a_candidate_too_far_from_the_lowest_is_pruned_with_the_reason():
    gain = AFTER_FIRST_PASS * 9 / RACE_SAMPLES
    best = certified((2, 2, 2, 0), 1.0)
    near = open_search((3, 3, 3, 0), 1.0 + 0.9 * gain)
    far = open_search((3, 3, 3, 1), 1.0 + 1.1 * gain)
    searched = []
    found = race([best, near, far], "plant", RACE_SAMPLES, SETTINGS, searched_on(searched), list)
    assert searched == [near.orders]
    assert [bool(each.pruned) for each in found] == [False, False, True]
    assert f"{1.1 * gain:.4f} above the lowest" in found[2].pruned
    assert found[2].criteria == far.criteria


def test_the_lowest_is_searched_first_and_may_prune_the_others():
    gain = AFTER_FIRST_PASS * 6 / RACE_SAMPLES
    candidates = [open_search((2, 2, 2, nk), 1.0 + 0.8 * gain * nk) for nk in range(3)]
    searched = []
    race(candidates, "plant", RACE_SAMPLES, SETTINGS, searched_on(searched, gain), list)
    assert searched == [candidates[0].orders]


def test_few_optima_of_a_first_pass_leave_less_to_gain():
    best = certified((2, 2, 2, 0), 1.0)
    near = open_search((3, 3, 3, 0), 1.0 + 1.1 * AFTER_FEW_OPTIMA * 9 / RACE_SAMPLES)
    few = replace(near, diagnostics=replace(near.diagnostics, undiscovered_probability=FEW_OPTIMA))
    for each, count in ((near, 1), (few, 0)):
        searched = []
        race([best, each], "plant", RACE_SAMPLES, SETTINGS, searched_on(searched), list)
        assert len(searched) == count


def test_a_search_is_told_where_the_lowest_bic_lies_and_may_end_before():
    best = certified((2, 2, 2, 0), 1.0)
    lack = 0.5 * AFTER_FIRST_PASS * 9 / RACE_SAMPLES
    near = open_search((3, 3, 3, 0), 1.0 + lack)
    told = []

    def ends_early(each, target):
        told.append(target)
        return each

    found = race([best, near], "plant", RACE_SAMPLES, SETTINGS, ends_early, list)
    assert [bool(each.pruned) for each in found] == [False, True]
    assert "more than the rest of its search" in found[1].pruned
    (target,) = told
    power = 1 if SETTINGS.objective == "absolute" else 2
    assert power * np.log(near.minimum / target.value) == pytest.approx(lack)
    assert not target.is_unlikely(near.minimum, 1.01 * lack * RACE_SAMPLES / 9)
    assert target.is_unlikely(near.minimum, 0.99 * lack * RACE_SAMPLES / 9)


def test_a_search_that_is_unlikely_to_reach_its_aim_ends(short):
    search = replace(SEARCH, evaluations=20000)
    orders = armax_orders(9, 9, 9, 3)
    (first,) = estimate_candidates(OrderSearch(short, first_pass(search), LATE), [orders], "plant")
    whole = continue_search(OrderSearch(short, search, LATE), first)
    out_of_reach = Target(0.5 * whole.minimum, orders.parameters / len(short.output))
    ended = continue_search(OrderSearch(short, search, LATE), first, out_of_reach)
    assert ended.diagnostics.evaluations < whole.diagnostics.evaluations
    assert ended.minimum <= first.minimum


@pytest.mark.parametrize(("lead", "count"), [(2.0, 0), (0.4, 4)])
def test_delays_are_searched_only_where_another_may_overtake(lead, count):
    gain = AFTER_FIRST_PASS * 6 / RACE_SAMPLES
    candidates = [
        open_search((2, k, 4 - k, nk), 1.0 + lead * gain * nk) for nk in (0, 1) for k in (1, 3)
    ]
    searched = []
    found = race(candidates, "delay", RACE_SAMPLES, SETTINGS, searched_on(searched), list)
    assert len(searched) == count
    assert sum(bool(each.pruned) for each in found) == 4 - count
