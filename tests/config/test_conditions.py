"""Conditions of recordings, and their order."""

import pytest

from evopem.config.configuration import Positions, order_of
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
    assert found.order == from_json(Positions, to_json(found.order))
    assert found.order.places == {"a": 21.5, "b": -3.0}
    plain = complete({"datasets": {"a": entry(), "b": entry()}})
    assert plain.datasets == found.datasets
    assert plain.order is None


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
