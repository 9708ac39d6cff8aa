"""The grids: which candidates there are, how they are shared out, where scoring starts."""

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from evopem.config.defaults import complete
from evopem.config.order_grid import (
    PHASES,
    candidate_orders,
    part_count,
    previous_phase,
    scoring_start,
    widest_candidate_count,
)

SCHEMA = Path(__file__).parents[2] / "workflow" / "schemas" / "config.schema.yaml"
CHOSEN = {"na": 7, "nb": 7, "nc": 7, "nk": 3}


def dataset(text=""):
    config = yaml.safe_load(f"datasets: {{arm: {{synthesis: armax, {text}}}}}")
    return complete(config, SCHEMA)["datasets"]["arm"]


def test_the_chapters_sweeps():
    arm = dataset()
    assert candidate_orders("delay", arm) == [
        (k, k, k, nk) for k in (6, 7, 8, 9) for nk in (0, 1, 2, 3)
    ]
    assert candidate_orders("common", arm, CHOSEN) == [(k, k, k, 3) for k in range(6, 15)]
    assert candidate_orders("c", arm, CHOSEN) == [(7, 7, k, 3) for k in range(2, 17)]
    assert candidate_orders("b", arm, CHOSEN) == [(7, k, 7, 3) for k in range(2, 17)]


def test_each_phase_needs_its_predecessors_choice():
    assert [previous_phase(phase) for phase in PHASES[1:]] == ["delay", "common", "c"]
    with pytest.raises(ValueError, match="no predecessor"):
        previous_phase("delay")
    with pytest.raises(ValueError, match="choice of phase delay"):
        candidate_orders("common", dataset())


@pytest.mark.parametrize(("peaks", "lowest"), [(0, 2), (1, 2), (3, 6), (7, 14), (20, 14)])
def test_auto_takes_two_orders_for_each_peak(peaks, lowest):
    arm = dataset("orders: {common: auto}")
    orders = [candidate[0] for candidate in candidate_orders("common", arm, CHOSEN, peaks)]
    assert orders == list(range(lowest, 15))
    assert len(orders) <= widest_candidate_count("common", arm)


def test_scoring_starts_behind_the_longest_memory_of_all_candidates():
    assert scoring_start(dataset()) == 16 + 3 - 1 + 20
    assert scoring_start(dataset("search: {burn_in: 0}, orders: {c: [2, 40]}")) == 40
    assert scoring_start(dataset("search: {burn_in: 0}, delay: {delays: [0, 50]}")) == 65


@given(
    lower=st.integers(1, 20),
    count=st.integers(1, 20),
    per_job=st.integers(1, 30),
    phase=st.sampled_from(PHASES),
)
def test_every_candidate_is_in_exactly_one_part(lower, count, per_job, phase):
    limits = [lower, lower + count - 1]
    grid = {"delay": {"orders": limits, "delays": [0, 2]}, "orders": {"common": limits}}
    grid["orders"] |= {"c": limits, "b": limits}
    candidates = candidate_orders(phase, grid, CHOSEN)
    parts = part_count(phase, grid, per_job)
    shares = [candidates[part::parts] for part in range(parts)]
    assert sorted(candidate for share in shares for candidate in share) == candidates
    assert all(1 <= len(share) <= per_job for share in shares)


@given(
    delays=st.tuples(st.integers(0, 5), st.integers(0, 5)).map(sorted),
    ranges=st.lists(
        st.tuples(st.integers(1, 20), st.integers(1, 20)).map(sorted), min_size=4, max_size=4
    ),
    data=st.data(),
)
def test_no_candidate_remembers_more_than_scoring_leaves_out(delays, ranges, data):
    grid = {
        "delay": {"orders": ranges[0], "delays": delays},
        "orders": dict(zip(("common", "c", "b"), ranges[1:], strict=True)),
        "search": {"burn_in": 0},
    }
    selected = None
    for phase in PHASES:
        candidates = candidate_orders(phase, grid, selected)
        for na, nb, nc, nk in candidates:
            assert max(na, nb + nk - 1, nc) <= scoring_start(grid)
        chosen = data.draw(st.sampled_from(candidates))
        selected = dict(zip(("na", "nb", "nc", "nk"), chosen, strict=True))
