"""Modes recognised over recordings, and warnings where they moved."""

import numpy as np
import pytest
from scipy.special import ndtri

from evopem.models.modes import Mode
from evopem.report.index_page import build_index, followed_charts, movements
from evopem.results.followed_modes import follow_modes, followed_table, group_of


def mode(frequency, error=0.01, shape=(1.0,)):
    return Mode(frequency, 0.02, 0.9 + 0.1j, error, 0.002, np.array(shape, dtype=complex))


def fleet(count, drop_from, seed=1):
    """Three modes with errors of 0.1 %, whose frequencies drop by 1 % from a recording on."""
    generator = np.random.default_rng(seed)
    recordings = {}
    for number in range(1, count + 1):
        factor = 0.99 if number >= drop_from else 1.0
        recordings[f"day{number:02d}"] = [
            mode(f * (factor + 0.001 * generator.standard_normal()), 0.001 * f)
            for f in (3.0, 8.0, 8.7)
        ]
    return recordings


def test_a_drop_is_found_in_every_mode_at_its_recording():
    followed = follow_modes(fleet(20, 11))
    assert [each.number for each in followed] == [1, 2, 3]
    for each in followed:
        (change,) = each.levels.changes
        assert each.recordings[change.index] == "day11"
        assert change.after / change.before == pytest.approx(0.99, abs=0.001)
        (sentence,) = movements(each)
        assert "moved by −" in sentence
        assert sentence.endswith("from day11 on.")


def test_a_single_recording_away_from_the_others_is_named_and_drawn():
    recordings = fleet(20, 99)
    recordings["day07"][0] = mode(3.1, 0.003)
    first, *others = follow_modes(recordings)
    (sentence,) = movements(first)
    assert sentence.endswith("in day07 alone.")
    assert not any(map(movements, others))
    charts = followed_charts([first, *others])
    assert [chart["marks"].count("M") for chart in charts] == [1, 0, 0]
    assert all(chart["points"].count("M") == 20 for chart in charts)
    assert charts[0]["first"] == "day01 (1)"


def test_the_order_is_that_of_a_condition_where_one_is_given():
    recordings = fleet(20, 11)
    names = list(recordings)
    shuffled = {name: recordings[name] for name in np.random.default_rng(2).permutation(names)}
    places = {name: 100.0 + 3.0 * names.index(name) for name in names}
    assert all(each.levels.changes for each in follow_modes(shuffled, places))
    by_place = follow_modes(shuffled, places)[0]
    assert by_place.recordings == tuple(names)
    assert by_place.places[:2] == (100.0, 103.0)


def test_doubted_and_missing_modes_leave_gaps_and_pair_nothing_wrongly():
    recordings = fleet(12, 99)
    recordings["day05"] = [mode(8.71, 0.009), mode(20.0)]  # the mode at 8.7 Hz, not that at 8
    recordings["day06"][0] = mode(3.1, error=np.inf)
    first, second, third = follow_modes(recordings)
    assert "day05" not in first.recordings + second.recordings
    assert "day06" not in first.recordings
    assert third.recordings == tuple(recordings)
    assert third.modes[4].frequency_hz == 8.71
    assert not any(movements(each) for each in (first, second, third))


def test_shapes_keep_modes_apart_whose_frequencies_cross():
    one, other = (1.0 + 0j, 0.2 + 0j), (-0.2 + 0j, 1.0 + 0j)
    recordings = {
        f"r{number}": [mode(10.0 + 0.05 * number, shape=one), mode(10.2, shape=other)]
        for number in range(10)
    }
    followed = follow_modes(recordings)
    assert [len({tuple(m.shape) for m in each.modes}) for each in followed] == [1, 1]


def test_different_structures_are_followed_apart_and_single_recordings_not_at_all():
    recordings = {"wing-1": [mode(5.0)], "wing-2": [mode(5.01)], "tail": [mode(5.0)]}
    (only,) = follow_modes(recordings)
    assert only.group == group_of("wing-1") == "wing"
    assert only.levels is None
    assert follow_modes({}) == []


def test_the_table_has_a_row_for_each_mode_and_recording():
    table = followed_table(follow_modes(fleet(16, 9)))
    assert len(table) == 48
    row = table.iloc[0]
    assert row["dataset"] == "day01"
    assert row["frequency_low_hz"] < row["frequency_hz"] < row["frequency_high_hz"]
    assert list(table["warning"].dropna()) == ["moved from here on"] * 3
    assert list(table["dataset"][table["warning"].notna()]) == ["day09"] * 3
    assert len(followed_table([])) == 0


def sequence(values, error):
    return {f"day{k:02d}": [mode(value, error)] for k, value in enumerate(values, start=1)}


def test_a_slow_trend_is_told_and_not_taken_for_scatter():
    """Equal steps make equal differences, which are no scatter; each is far above the error."""
    (followed,) = follow_modes(sequence(np.linspace(12.0, 11.496, 13), 0.0002))
    assert followed.drift.kind == "trend"
    np.testing.assert_allclose(followed.levels.values, np.linspace(12.0, 11.496, 13), atol=1e-6)
    (sentence,) = movements(followed)
    assert sentence.startswith("The mode at 11.75 Hz follows a trend: −4.29")
    assert not followed.constant
    html = build_index({}, followed=[followed])
    assert "follows a trend" in html
    assert "No mode moved" not in html


def test_an_oscillation_is_told_with_its_period():
    values = 12.0 + 0.05 * np.sin(2 * np.pi * np.arange(24) / 6.0)
    (followed,) = follow_modes(sequence(values, 0.005))
    assert followed.drift.kind == "oscillation"
    assert followed.drift.period == pytest.approx(6.0)
    (sentence,) = movements(followed)
    assert "oscillates by ±0.4" in sentence
    assert sentence.endswith("with a period of 6.")


def test_no_mode_moved_is_said_where_a_constant_holds_alone():
    # Quantiles of a normal distribution in no order.
    noise = ndtri((np.random.default_rng(3).permutation(20) + 0.5) / 20)
    (steady,) = follow_modes(sequence(12.0 + 0.01 * noise, 0.01))
    assert steady.constant
    assert "No mode moved by more than its error" in build_index({}, followed=[steady])
    (restless,) = follow_modes(sequence(12.0 + 0.05 * noise, 0.01))
    assert not restless.constant
    assert movements(restless) == []
    html = build_index({}, followed=[restless])
    assert "No mode moved" not in html
    assert "more than its standard error of 0.083" in html


def test_a_step_is_told_as_a_step_and_not_as_a_trend():
    generator = np.random.default_rng(4)
    values = 12.0 - 0.06 * (np.arange(16) > 7) + 0.01 * generator.standard_normal(16)
    (followed,) = follow_modes(sequence(values, 0.01))
    assert followed.drift is None
    assert [change.index for change in followed.levels.changes] == [8]
