"""Damage indices of a fleet: table, sentences, page, and the function of Python."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from evopem import InputError, damage_index
from evopem.config.conditions import Following
from evopem.models.modes import Mode
from evopem.report.index_page import build_index, damage_charts, damage_sentences, movements
from evopem.results.damage_index import Compared
from evopem.results.fleet import DatasetSummary
from evopem.results.followed_modes import follow_modes
from evopem.signals.recording_info import ChannelInfo

COUNT, DAMAGED = 60, 50


def fleet(loss=0.02, seed=3):
    """Two modes that fall with the temperature; from one recording on the stiffness is less."""
    generator = np.random.default_rng(seed)
    recordings, conditions = {}, {}
    for number in range(COUNT):
        temperature = 15.0 + 10.0 * np.sin(2.0 * np.pi * number / 25.0)
        factor = 1.0 - 2e-3 * (temperature - 15.0) - 0.5 * loss * (number >= DAMAGED)
        name = f"bridge-{number + 1:02d}"
        recordings[name] = [
            Mode(f * factor + e * generator.standard_normal(), 0.02, 0.9 + 0.1j, e, 0.002)
            for f, e in ((4.0, 0.008), (9.0, 0.02))
        ]
        conditions[name] = {"temperature": temperature}
    return recordings, conditions


def results(recordings):
    """What holds the summaries that modes are taken from, and nothing else."""
    blank = dict.fromkeys(DatasetSummary.__dataclass_fields__)
    return {
        name: SimpleNamespace(
            summary=DatasetSummary(
                **blank | {"modes": tuple(modes), "trusted": (True,) * len(modes)}
            )
        )
        for name, modes in recordings.items()
    }


def test_damage_is_told_from_the_temperature_and_named():
    recordings, conditions = fleet()
    table = damage_index(results(recordings), 30, conditions)
    assert list(table["dataset"]) == list(recordings)
    assert list(table["reference"]) == [True] * 30 + [False] * 30
    judged = table[table["damage_index"].notna() & ~table["reference"]]
    above = judged[judged["above"]]
    assert set(judged["dataset"][-8:]) <= set(above["dataset"])
    assert (above["place"] > DAMAGED).mean() > 0.8
    np.testing.assert_allclose(above["change_percent"][-8:], -1.0, atol=0.6)
    sentence = damage_sentences(table, 0.01)[0]
    assert sentence.startswith(f"{len(above)} of {len(judged)} recordings lie above the limit")
    assert "bridge-60 (mode " in sentence
    (chart,) = damage_charts(table)
    assert chart["marks"].count("M") == (table["damage_index"] > 1.0).sum()
    assert chart["reference"].count("M") == 30
    page = build_index({}, damage=table)
    assert 'id="damage-index"' in page
    assert 'href="damage_index.csv"' in page
    # The link counts the recordings of all structures, of which each has a sentence of its own.
    two = pd.concat([table, table.assign(group="mast")])
    headline = f"{2 * len(above)} of {2 * len(judged)} recordings lie above the limit"
    page = build_index({}, damage=two)
    assert f'<a href="#damage-index">{headline} of the damage index</a>' in page


def driven(amplitudes, stiffening, seed):
    """Recordings under forces of other sizes, in the rain: the first mode goes with both."""
    generator, entries, rain = np.random.default_rng(seed), {}, {}
    for number, amplitude in enumerate(amplitudes):
        name = f"beam-{number}"
        rain[name] = float(generator.uniform(0.0, 5.0))
        first = 4.0 + stiffening * amplitude - 0.02 * rain[name] + 0.01 * generator.normal()
        modes = [Mode(f, 0.02, 0.9 + 0.1j, 0.01, 0.002) for f in (first, 9.0 + 0.01 * (number % 2))]
        force = ChannelInfo("force", "N", 0.0, 3.0, float(amplitude))
        (entry,) = results({name: modes}).values()
        entries[name] = replace(entry.summary, inputs=(force,))
    return Compared(entries, Following(corrected={"rain": rain}))


def test_the_page_says_that_a_mode_goes_with_the_amplitude_of_an_input():
    compared = driven(np.arange(1.0, 9.0), 0.05, 1)
    (first, other) = compared.dependences  # the mean is the same everywhere
    assert first.p_value < 1e-4 < 0.01 < other.p_value
    assert first.change_hz == pytest.approx(0.35, abs=3.0 * first.standard_error_hz)
    page = build_index({}, followed=compared.followed, dependences=compared.dependences)
    assert "Dependence on the standard deviation of force: from 1 to 8 the mode at 4" in page
    assert page.count("significant at") == 1
    # Too few recordings beside a condition; and what goes with the condition is told by it.
    assert driven(np.arange(1.0, 5.0), 0.05, 1).dependences == []
    rain = compared.following.corrected["rain"]
    assert driven([*rain.values()], 0.05, 1).dependences == []


def test_it_seldom_says_so_of_a_mode_that_does_not():
    found = [driven(np.arange(1.0, 9.0), 0.0, seed).dependences[0] for seed in range(100)]
    # Of 100 at 1 % five or more in 0.3 % of all cases.
    assert sum(each.p_value < 0.01 for each in found) < 5


def test_a_table_of_conditions_gives_the_same_and_their_absence_hides_the_damage():
    recordings, conditions = fleet()
    given = results(recordings)
    of_table = damage_index(given, 30, pd.DataFrame.from_dict(conditions, orient="index"))
    pd.testing.assert_frame_equal(of_table, damage_index(given, 30, conditions))
    hidden = damage_index(given, 30)
    assert hidden["above"][~hidden["reference"]].mean() < 0.2
    assert damage_sentences(hidden, 0.01)[0].startswith(("None of 30 recordings lies", "1 of 30"))


def test_what_is_not_judged_says_why(tmp_path):
    recordings, conditions = fleet()
    conditions["bridge-40"]["temperature"] = 40.0
    recordings["bridge-41"] = []
    table = damage_index(results(recordings), "bridge-[012]*", conditions).set_index("dataset")
    assert table["not_judged"]["bridge-40"].startswith("its conditions lie outside")
    assert table["not_judged"]["bridge-41"].startswith("it has no mode")
    told = " ".join(damage_sentences(table.reset_index(), 0.01))
    assert "Not judged, because it has no mode of the others: bridge-41." in told
    # The same from the file, in which a column with gaps is one of floats.
    table.to_csv(tmp_path / "damage_index.csv")
    of_file = damage_sentences(pd.read_csv(tmp_path / "damage_index.csv"), 0.01)
    assert " ".join(of_file) == told


def test_a_vanished_mode_is_an_event_and_one_that_others_lack_is_none(tmp_path):
    recordings, conditions = fleet()
    for name in ("bridge-04", "bridge-09", "bridge-45"):  # two of 30 lack the first mode
        recordings[name] = recordings[name][1:]
    for name in ("bridge-41", "bridge-58"):
        recordings[name] = recordings[name][:1]
    table = damage_index(results(recordings), 30, conditions)
    missing = table.set_index("dataset")["missing_modes"].dropna()
    assert missing.to_dict() == {"bridge-41": "2", "bridge-58": "2"}
    table.to_csv(tmp_path / "damage_index.csv")
    for known in (table, pd.read_csv(tmp_path / "damage_index.csv")):
        told = " ".join(damage_sentences(known, 0.01))
        assert "Modes not found: mode 2 in bridge-41 and mode 2 in bridge-58; fewer than" in told


@pytest.mark.parametrize(
    ("reference", "conditions", "false_alarms", "sentence"),
    [
        ("tower*", {}, 0.01, "no data set is named tower*"),
        (0, {}, 0.01, "0 cannot be; give 1 or more"),
        (30, {}, 0.7, "0.7 cannot be; give a probability below 0.5"),
        (30, {"bridge-01": {"wind": 3.0}}, 0.01, "bridge-02 has no number for wind"),
    ],
)
def test_what_cannot_be_compared_is_refused(reference, conditions, false_alarms, sentence):
    with pytest.raises(InputError) as raised:
        damage_index(results(fleet()[0]), reference, conditions, false_alarms)
    assert sentence in str(raised.value)


def test_steps_are_told_beside_a_condition_and_the_condition_alone_is_no_movement():
    recordings, conditions = fleet()
    temperatures = {name: each["temperature"] for name, each in conditions.items()}
    for followed in follow_modes(recordings, None, [temperatures]):
        (change,) = followed.levels.changes
        assert followed.recordings[change.index] == f"bridge-{DAMAGED + 1}"
        assert change.after / change.before == pytest.approx(0.99, abs=0.002)
        spread = np.std(followed.corrected_hz[:DAMAGED])
        assert spread < 0.2 * np.std([mode.frequency_hz for mode in followed.modes[:DAMAGED]])
    unchanged, _ = fleet(loss=0.0)
    corrected = follow_modes(unchanged, None, [temperatures])
    assert [sentence for each in corrected for sentence in movements(each)] == []
    assert all(each.constant for each in corrected)
    assert all(movements(each) for each in follow_modes(unchanged))
