"""A focus and constraints that contradict the orders or the rate are refused in one sentence."""

import re

import pytest

from evopem.config.defaults import complete
from evopem.errors import InputError
from evopem.pipeline.planning.constraint_plan import check_fit, check_planned_fits, known_rate

EMPTY = {"frequency_band": [5, 6], "forbidden_bands": [[4, 7]]}


def planned(keys, rate=50):
    written = (
        {"file": "x.csv", "recipe": "chapter"}
        | ({"sampling_rate": rate} if rate else {"time": "t"})
        | keys
    )
    config = complete({"datasets": {"a": written}})
    check_planned_fits(config.datasets, "config.yaml")
    return config.datasets["a"]


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"structure": "arma", "focus": "simulation", "output": 1}, "focus: a model without"),
        ({"focus": 0}, "focus: 0 is below 1"),
        ({"focus": "simulate"}, "did you mean simulation?"),
        ({"constraints": {"stabilty": "free"}}, "did you mean stability?"),
        ({"constraints": {"max_pole_radius": 1.2}}, "constraints.max_pole_radius: 1.2 allows"),
        ({"constraints": {"frequency_band": [30, 40]}}, "constraints.frequency_band: 30"),
        ({"constraints": {"frequency_band": [3, 2]}}, "constraints.frequency_band: 3"),
        ({"constraints": EMPTY}, "no mode has a natural frequency"),
        ({"constraints": {"fixed_coefficients": {"a9": 1}}}, "fixed_coefficients.a9: a model of"),
        ({"constraints": {"fixed_coefficients": {"a1": "x"}}}, "fixed_coefficients.a1: x cannot"),
        ({"constraints": {"real_poles": "none"}}, "for ARMAX(7,"),
        ({"constraints": {"static_gain": 1, "static_gain_bounds": [0, None]}}, "given already"),
        ({"constraints": {"priors": [{"quantity": "b0", "mean": 1}]}}, "priors[0]: the key"),
        ({"constraints": {"fixed_poles": [{"real": 1, "damping_ratio": 0}]}}, "fixed_poles[0]"),
        ({"focus": "simulation", "constraints": {"stability": "free"}}, "need a stable plant"),
        ({"structure": "oe", "constraints": {"stability": "free"}}, "constraints.stability"),
    ],
)
def test_a_contradiction_names_its_key(keys, said):
    with pytest.raises(InputError) as refused:
        planned(keys)
    assert said in str(refused.value)
    assert re.fullmatch(r"config\.yaml, datasets\.a\..+: .+; .+\.", str(refused.value))


def test_constraints_of_the_defaults_are_kept_one_by_one():
    config = {
        "defaults": {
            "recipe": "chapter",
            "focus": 5,
            "constraints": {"static_gain": 2, "max_pole_radius": 0.9},
        },
        "datasets": {"a": {"file": "x.csv", "constraints": {"static_gain": 3}}, "b": {"file": "y"}},
    }
    datasets = complete(config).datasets
    assert datasets["a"].fit.constraints.static_gain == 3
    assert datasets["a"].fit.constraints.max_pole_radius == 0.9
    assert datasets["b"].fit.constraints.static_gain == 2
    assert {each.fit.focus for each in datasets.values()} == {5}


def test_a_rate_that_only_the_recording_states_is_waited_for():
    settings = planned({"constraints": {"frequency_band": [30, 40]}}, rate=None)
    assert known_rate(settings) is None
    check_fit(settings.fit, settings.order_grid, 100.0, "datasets.a", "")
    with pytest.raises(InputError, match="half the sampling rate, 25"):
        check_fit(settings.fit, settings.order_grid, 50.0, "datasets.a", "")
