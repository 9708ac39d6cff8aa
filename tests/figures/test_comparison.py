"""Models side by side: modes matched across all of them, and labels that tell them apart."""

from dataclasses import replace

import numpy as np
import pytest
from identified import with_judged_modes

from evopem.errors import InputError
from evopem.figures.comparison import Comparison, spread_percent
from evopem.models.modes import Mode


@pytest.fixture(scope="module")
def results(identified):
    return identified.results


def with_frequencies(results, *frequencies, name="other"):
    """The same results with other modes and another name."""
    modes = [Mode(hertz, 0.01, np.exp(0.1j * hertz), 0.01, 0.001) for hertz in frequencies]
    changed = with_judged_modes(results, modes)
    return replace(changed, settings=replace(results.settings, name=name))


def test_modes_are_matched_across_all_models(results):
    compared = Comparison.of(
        [
            with_frequencies(results, 5.0, 20.0, name="a"),
            with_frequencies(results, 20.4, 37.0, name="b"),
            with_frequencies(results, 5.1, 36.5, 45.0, name="c"),
        ]
    )
    found = [[mode and mode.frequency_hz for mode in each] for each in compared.matched]
    assert found == [
        [5.0, None, 5.1],
        [20.0, 20.4, None],
        [None, 37.0, 36.5],
        [None, None, 45.0],
    ]
    assert spread_percent(compared.matched[0]) == pytest.approx(100 * 0.1 / 5.05)
    assert np.isnan(spread_percent(compared.matched[3]))
    assert compared.modes["mode"].tolist() == [1, 1, 2, 2, 3, 3, 4]


def test_models_of_one_name_are_told_apart(results):
    compared = Comparison.of([results, results])
    orders = str(results.model.orders)
    assert compared.labels == (f"bench, {orders} (1)", f"bench, {orders} (2)")
    assert compared.has_same_validation
    assert Comparison.of([results, with_frequencies(results, 5.0)]).labels == ("bench", "other")


def test_other_validation_samples_are_noticed(results):
    tables = results.validation_tables
    shifted = tables.simulation.assign(output_output=tables.simulation["output_output"] + 1.0)
    other = replace(results, validation_tables=replace(tables, simulation=shifted))
    assert not Comparison.of([results, other]).has_same_validation


@pytest.mark.parametrize(
    ("number", "labels", "sentence"),
    [
        (1, (), "compare: there are 1 models; give 2 to 6 of them."),
        (7, (), "compare: there are 7 models; give 2 to 6 of them."),
        (2, ("a", "a"), "labels: they are not one for each model, all different"),
    ],
)
def test_what_cannot_be_compared_is_refused(results, number, labels, sentence):
    with pytest.raises(InputError) as refused:
        Comparison.of([results] * number, labels)
    assert str(refused.value).startswith(sentence)
