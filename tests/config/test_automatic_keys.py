"""The automatic recipe: what is written decides, what is missing is left to the recording."""

import pytest
import yaml

from evopem.config.defaults import complete, yaml_text
from evopem.config.settings import (
    AutomaticSettings,
    GivenPreparation,
    OrderRanges,
    SplitSettings,
    TransformSettings,
)
from evopem.config.structures import searched_structures
from evopem.errors import InputError

PUMP = "file: pump.csv, input: torque, output: speed, sampling_rate: 200"


def settings(keys="", defaults=""):
    text = f"defaults: {{{defaults}}}\ndatasets: {{pump: {{{PUMP}, recipe: auto{keys}}}}}"
    return complete(yaml.safe_load(text)).datasets["pump"]


def refusal(keys):
    with pytest.raises(InputError) as caught:
        settings(keys)
    return str(caught.value)


def test_a_source_alone_leaves_every_decision_to_the_recording():
    pump = settings()
    assert pump.automatic == AutomaticSettings()
    assert pump.preparation.transforms == TransformSettings("none", 0, 0)
    assert pump.preparation.split == SplitSettings(0, 0.8)
    assert pump.preparation.resample is None


@pytest.mark.parametrize(
    ("keys", "decided"),
    [
        (", structure: oe", {"structure": "oe"}),
        (", delay: {nk: 2}", {"orders": OrderRanges(nk=(2, 2))}),
        (
            ", orders: {plant: [2, 5], nb: 3}",
            {"orders": OrderRanges(plant=(2, 5), nb=(3, 3))},
        ),
        (", orders: {plant: auto}", {}),
        (", resample: none", {"preparation": GivenPreparation(factor=1)}),
        (", split: {discard: 30}", {"preparation": GivenPreparation(start=0)}),
        (
            ", search: {objective: absolute}",
            {"preparation": GivenPreparation(objective="absolute")},
        ),
        (", transforms: {difference: 0}", {"preparation": GivenPreparation(differences=0)}),
        (", transforms: {box_cox: auto}", {"preparation": GivenPreparation(box_cox=True)}),
        (", purpose: prediction", {"purpose": "prediction"}),
    ],
)
def test_a_key_decides_itself_and_nothing_else(keys, decided):
    assert settings(keys).automatic == AutomaticSettings(**decided)


def test_defaults_decide_for_every_data_set():
    pump = settings(", orders: {nb: 3}", "orders: {nb: 2, nc: 1}, split: {estimation: 0.5}")
    assert pump.automatic == AutomaticSettings(orders=OrderRanges(nb=(3, 3), nc=(1, 1)))
    assert pump.preparation.split == SplitSettings(0, 0.5)


@pytest.mark.parametrize(
    "keys",
    [
        "",
        ", validation_file: other.csv",
        ", structure: bj, orders: {nc: [1, 3]}, delay: {nk: 1}, purpose: modes",
        ", split: {discard: 0.1}, resample: 50, search: {objective: quadratic, seed: 4}",
        ", transforms: {difference: 1, difference_input: 1}",
        ", transforms: {difference: 1, difference_input: 1, difference_pole: 0.9}",
    ],
)
def test_the_complete_configuration_gives_the_same_settings(keys):
    pump = settings(keys)
    assert complete(yaml.safe_load(yaml_text(pump))).datasets == {"pump": pump}


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (", structure: arma", "structure arma has no input"),
        (", level: false", "datasets.pump.level: the automatic recipe always estimates a level"),
        (", delay: {orders: 3}", "datasets.pump.delay.orders: the automatic recipe has no such"),
        (", search: {prune: true}", "datasets.pump.search.prune: the automatic recipe has no such"),
        (", search: {mu: 5}", "datasets.pump.search.mu: the automatic recipe has no such key"),
        (", structure: oe, orders: {nc: 2}", "datasets.pump.orders.nc: structure oe has no such"),
        (", structure: impulse, recipe: chapter", "orders, and a regularised response has none"),
        (", purpose: control", "give what the model is for, auto, simulation, prediction or modes"),
        (", transforms: {difference_pole: 0.9}", "each input and output; write difference: 1"),
        (", transforms: {difference: 2, difference_pole: 0.9}", "takes the place of one"),
        (", split: {estimation: 1.0}", "takes all samples, so none are left to validate on"),
    ],
)
def test_what_the_recipe_does_not_have_is_refused_in_a_sentence(keys, words):
    sentence = refusal(keys)
    assert words in sentence
    assert sentence.endswith(".")
    assert sentence.count("\n") == 0


def test_a_purpose_without_the_automatic_recipe_is_refused():
    text = f"datasets: {{pump: {{{PUMP}, recipe: chapter, purpose: modes}}}}"
    with pytest.raises(InputError, match="the chapter's recipe knows no purpose"):
        complete(yaml.safe_load(text))


def test_a_structure_brings_those_that_its_search_starts_from():
    assert searched_structures("fir") == ("fir",)
    assert searched_structures("bj") == ("arx", "armax", "oe", "bj")
