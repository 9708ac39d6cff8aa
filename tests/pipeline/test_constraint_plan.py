"""A focus and constraints that contradict the orders or the rate are refused in one sentence."""

import re

import pytest

from evopem.config.defaults import complete
from evopem.errors import InputError
from evopem.pipeline.planning.constraint_plan import (
    check_fit,
    check_planned_fits,
    known_rate,
    selectable_orders,
)


def priors(*given):
    kinds = [
        {"quantity": quantity, "mean": mean, "standard_deviation": 0.01, "mode_hz": 5}
        for quantity, mean in given
    ]
    return {"constraints": {"priors": kinds}}


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
        (
            {"recipe": "auto", "constraints": {"max_pole_radius": 1.2}},
            "max_pole_radius: 1.2 allows",
        ),
        (
            {"recipe": "auto", "structure": "oe", "constraints": {"fixed_coefficients": {"a1": 1}}},
            "fixed_coefficients.a1: a model of",
        ),
        (priors(("damping", 0.02), ("damping", 0.9)), "two priors of its damping"),
        (priors(("damping", -5)), "-5.0 is no damping ratio"),
        (
            {"constraints": priors(("damping", 0.02))["constraints"] | {"min_damping_ratio": 0.5}},
            "0.02 is below min_damping_ratio",
        ),
        (priors(("frequency", -3)), "-3.0 Hz does not lie between"),
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
    check_fit(settings.fit, selectable_orders(settings.order_grid), 100.0, "datasets.a", "")
    with pytest.raises(InputError, match="half the sampling rate, 25"):
        check_fit(settings.fit, selectable_orders(settings.order_grid), 50.0, "datasets.a", "")


def test_constraints_of_the_automatic_recipe_are_those_of_its_structure():
    """Not of the grid of the other recipe, which it does not search."""
    fixed = {"structure": "oe", "constraints": {"fixed_coefficients": {"f1": -0.5}}}
    assert planned({"recipe": "auto"} | fixed).fit.constraints.fixed_coefficients == {"f1": -0.5}
    real = {"structure": "bj", "constraints": {"real_poles": "none"}}
    assert planned({"recipe": "auto"} | real).fit.constraints.real_poles == "none"
