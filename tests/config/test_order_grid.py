"""The order grid: its candidates, their jobs, and the samples on which they are compared."""

from dataclasses import replace

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from evopem.config.defaults import complete
from evopem.config.order_grid import (
    candidate_orders,
    check_samples,
    grid_of_phase,
    max_candidate_count,
    max_candidates_per_part,
    needs_resonances,
    part_count,
    previous_phase,
    sample_requirements,
    scoring_window,
)
from evopem.config.settings import (
    CHAPTER_RANGES,
    OrderGrid,
    SampleRequirements,
    ScoringWindow,
    SearchSettings,
)
from evopem.config.structures import phases_of
from evopem.errors import InputError

PHASES = phases_of("armax")

SELECTED = {"na": 7, "nb": 7, "nc": 7, "nk": 3}


def tuples(candidates):
    return [tuple(each[name] for name in ("na", "nb", "nc", "nk")) for each in candidates]


def dataset(text=""):
    config = yaml.safe_load(f"datasets: {{arm: {{recipe: chapter, synthesis: armax, {text}}}}}")
    return complete(config).datasets["arm"]


def grid(text=""):
    return dataset(text).order_grid


def settings_with(order_grid, n_initial_discard=0):
    search = SearchSettings(n_initial_discard=n_initial_discard)
    return replace(dataset(), order_grid=order_grid, search=search)


def test_the_built_in_grid_is_the_chapters():
    arm = grid()
    assert tuples(candidate_orders("delay", arm)) == [
        (k, k, k, nk) for k in (6, 7, 8, 9) for nk in (0, 1, 2, 3)
    ]
    assert tuples(candidate_orders("plant", arm, SELECTED)) == [(k, k, k, 3) for k in range(6, 15)]
    assert tuples(candidate_orders("nc", arm, SELECTED)) == [(7, 7, k, 3) for k in range(2, 17)]
    assert tuples(candidate_orders("nb", arm, SELECTED)) == [(7, k, 7, 3) for k in range(2, 17)]


def test_each_phase_starts_from_the_selection_of_the_one_before():
    assert [previous_phase(phase, "armax") for phase in PHASES] == [None, "delay", "plant", "nc"]
    with pytest.raises(ValueError, match="selection of phase delay"):
        candidate_orders("plant", grid())


@pytest.mark.parametrize(("peaks", "lowest"), [(0, 2), (1, 2), (3, 6), (7, 14), (20, 14)])
def test_auto_takes_two_orders_for_each_peak(peaks, lowest):
    arm = grid("orders: {plant: auto}")
    orders = [candidate["na"] for candidate in candidate_orders("plant", arm, SELECTED, peaks)]
    assert orders == list(range(lowest, 15))
    assert len(orders) <= max_candidate_count("plant", arm) == 13


def test_only_the_joint_phase_with_auto_needs_the_spectrum():
    assert [needs_resonances(phase, grid("orders: {plant: auto}")) for phase in PHASES] == [
        False,
        True,
        False,
        False,
    ]
    assert not any(needs_resonances(phase, grid()) for phase in PHASES)


def test_the_loss_starts_behind_the_longest_memory_of_all_candidates():
    assert scoring_window(dataset()) == ScoringWindow(16 + 3 - 1, 16 + 3 - 1 + 20)
    longer = dataset("search: {n_initial_discard: 0}, orders: {nc: [2, 40]}")
    assert scoring_window(longer) == ScoringWindow(40, 40)
    later = dataset("search: {n_initial_discard: 0}, delay: {nk: [0, 50]}")
    assert scoring_window(later) == ScoringWindow(65, 65)


def test_the_requirements_are_those_of_the_largest_candidate():
    # Joint 14 with nb 16 and nc 16: 46 parameters; the memory is 18, the noise has 16 states.
    assert sample_requirements(dataset()) == SampleRequirements(38, 14 + 16 + 16, 18 + 16)
    # The delay's ARMAX(30,30,30) is the largest.
    large = dataset("delay: {orders: [6, 30]}, search: {n_initial_discard: 5}")
    assert sample_requirements(large) == SampleRequirements(32 + 5, 90, 32 + 16)


@pytest.mark.parametrize(
    ("estimation", "validation", "key"),
    [(110, 100, "orders"), (111, 50, "split"), (30, 100, "orders")],
)
def test_a_record_that_is_too_short_for_the_largest_candidate_is_refused(
    estimation, validation, key
):
    requirements = SampleRequirements(loss_start=100, parameters=10, settling=25)
    with pytest.raises(InputError, match=r"10 parameters|more than 50 are needed") as caught:
        check_samples(requirements, estimation, validation, "datasets.arm")
    assert caught.value.source == f"datasets.arm.{key}"
    check_samples(requirements, 111, 51, "datasets.arm")


@pytest.mark.parametrize("phase", PHASES)
def test_a_phase_is_given_its_own_range_alone(phase):
    changed = OrderGrid(
        replace(
            CHAPTER_RANGES,
            delay=(2, 3),
            nk=(4, 5),
            plant=(2, 3),
            nc=(4, 5),
            nb=(6, 7),
            nd=(0, 4),
            na=(0, 2),
        )
    )
    own = grid_of_phase(phase, changed)
    assert candidate_orders(phase, own, SELECTED) == candidate_orders(phase, changed, SELECTED)
    for other in set(PHASES) - {phase}:
        assert candidate_orders(other, own, SELECTED) == candidate_orders(
            other, OrderGrid(), SELECTED
        )


@given(
    lower=st.integers(1, 20),
    count=st.integers(1, 20),
    per_job=st.integers(1, 30),
    phase=st.sampled_from(PHASES),
)
def test_every_candidate_is_in_exactly_one_part(lower, count, per_job, phase):
    limits = (lower, lower + count - 1)
    order_grid = OrderGrid(
        replace(CHAPTER_RANGES, delay=limits, nk=(0, 2), plant=limits, nc=limits, nb=limits)
    )
    candidates = tuples(candidate_orders(phase, order_grid, SELECTED))
    parts = part_count(phase, order_grid, per_job)
    jobs = [candidates[part::parts] for part in range(parts)]
    assert sorted(candidate for job in jobs for candidate in job) == candidates
    assert all(1 <= len(job) <= per_job for job in jobs)
    assert max(map(len, jobs)) == max_candidates_per_part(phase, order_grid, per_job)
    assert part_count(phase, order_grid, "auto") == 1


ranges = st.tuples(st.integers(1, 20), st.integers(1, 20)).map(sorted).map(tuple)


@given(
    nk=st.tuples(st.integers(0, 5), st.integers(0, 5)).map(sorted).map(tuple),
    orders=ranges,
    plant=ranges | st.none(),
    nc=ranges,
    nb=ranges,
    data=st.data(),
)
def test_no_candidate_exceeds_what_the_window_and_the_requirements_allow_for(
    nk, orders, plant, nc, nb, data
):
    order_grid = OrderGrid(replace(CHAPTER_RANGES, delay=orders, nk=nk, plant=plant, nc=nc, nb=nb))
    window = scoring_window(settings_with(order_grid))
    requirements = sample_requirements(settings_with(order_grid))
    assert window.loss_start == window.residual_start == requirements.loss_start
    selected = None
    for phase in PHASES:
        candidates = candidate_orders(phase, order_grid, selected)
        for na, nb_, nc_, nk_ in tuples(candidates):
            assert max(na, nb_ + nk_ - 1, nc_) <= window.residual_start
            assert na + nb_ + nc_ <= requirements.parameters
        selected = data.draw(st.sampled_from(candidates))
    ((na, nb_, nc_, nk_),) = tuples([selected])
    assert max(na, nb_ + nk_ - 1, nc_) + nc_ <= requirements.settling
