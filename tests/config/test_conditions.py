"""Conditions of recordings, and their order."""

import pytest

from evopem.config.conditions import Following, order_of
from evopem.config.defaults import complete
from evopem.errors import InputError
from evopem.files.json_form import from_json, to_json


def entry(**conditions):
    return {"synthesis": "armax"} | ({"conditions": conditions} if conditions else {})


def test_a_condition_orders_the_recordings_and_stays_out_of_their_settings():
    config = {
        "follow": "temperature",
        "datasets": {"a": entry(temperature=21.5), "b": entry(temperature=-3)},
    }
    found = complete(config)
    assert found.following == from_json(Following, to_json(found.following))
    assert found.following.order.places == {"a": 21.5, "b": -3.0}
    plain = complete({"datasets": {"a": entry(), "b": entry()}})
    assert plain.datasets == found.datasets
    assert plain.following.order is None


def test_dates_become_days():
    order = order_of({"a": {"on": "2026-03-02T12:00"}, "b": {"on": "2026-03-01"}}, "on", "x.yaml")
    assert order.places == {"a": 1.5, "b": 0.0}
    assert "2026-03-01" in order.name


@pytest.mark.parametrize(
    ("entries", "follow", "expected"),
    [
        ({"a": entry(load=1), "b": entry()}, "load", "b has no condition load"),
        ({"a": entry(load=1), "b": entry(load="heavy")}, "load", "heavy is no date|1 is no date"),
        ({"a": entry(load=[1])}, "load", "conditions.load"),
    ],
)
def test_a_condition_that_cannot_order_is_refused(entries, follow, expected):
    with pytest.raises(InputError, match=expected):
        complete({"follow": follow, "datasets": entries})


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (
            {"setups": {"beam": ["a", "c"]}},
            "there is no data set c; name each of its data sets once.",
        ),
        ({"setups": {"beam": ["a"]}}, "[a] holds 1 value; give structures, each with a list"),
        ({"setups": {"beam": ["a", "b", "a"]}}, "a data set comes twice; name each"),
        ({"setups": {"a/b": ["a", "b"]}}, "a/b is not known; give structures, each"),
        ({"setups": {"beam": ["a", "b"]}, "shard": "1/2"}, "it cannot stand beside shard or"),
    ],
)
def test_set_ups_that_cannot_be_merged_are_refused(given, sentence):
    with pytest.raises(InputError) as raised:
        complete({"datasets": {"a": entry(), "b": entry()}} | given)
    assert sentence in str(raised.value)
    assert "setups." in str(raised.value)


def test_set_ups_are_data_sets():
    config = complete({"datasets": {"a": entry(), "b": entry()}, "setups": {"beam": ["a", "b"]}})
    assert config.run.setups == {"beam": ("a", "b")}


def test_conditions_are_regressed_out_and_a_reference_is_named():
    entries = {"day1": entry(load=2, on="2026-03-01"), "day2": entry(load=3, on="2026-03-02")}
    given = {"follow": "on", "correct_for": "load", "reference": "day*", "false_alarms": 0.05}
    following = complete(given | {"datasets": entries}).following
    assert following.corrected == {"load": {"day1": 2.0, "day2": 3.0}}
    assert following.reference == ("day1", "day2")
    assert following.false_alarms == 0.05
    assert following == from_json(Following, to_json(following))
    assert complete({"datasets": entries, "reference": 1}).following.reference == 1


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"correct_for": ["load", "wind"]}, "a has no number for wind, whose effect is to be"),
        ({"correct_for": "on"}, "a has no number for on"),
        ({"correct_for": "load", "follow": "load"}, "load is regressed out, so that nothing"),
        ({"reference": "c*"}, "no data set is named c*; correct the name or pattern."),
        ({"reference": 0}, "0 is below 1"),
        ({"reference": 1, "false_alarms": 0}, "0 is not above 0"),
    ],
)
def test_comparisons_that_cannot_be_made_are_refused(given, sentence):
    with pytest.raises(InputError) as raised:
        complete({"datasets": {"a": entry(load=1, on="2026-03-01"), "b": entry(load=2)}} | given)
    assert sentence in str(raised.value)
