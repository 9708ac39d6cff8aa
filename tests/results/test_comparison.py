"""Models side by side: modes matched across all of them, and labels that tell them apart."""

import re
from dataclasses import replace

import numpy as np
import pytest
from identified import with_judged_modes, with_output_name

from evopem.config.channels import ChannelPlace, Geometry
from evopem.errors import InputError
from evopem.models.modes import Mode
from evopem.report.comparison import build_comparison, dependence_sentences, merged_sentences
from evopem.results.comparison import Comparison, spread_percent


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


def driven_by(results, amplitudes, frequencies):
    """Models of recordings whose inputs have other amplitudes, each with one mode."""
    recording, models = results.recording, []
    for number, (amplitude, frequency) in enumerate(zip(amplitudes, frequencies, strict=True)):
        other = with_frequencies(results, frequency, name=f"r{number}")
        driven = replace(recording, inputs=amplitude * (recording.inputs - recording.inputs.mean()))
        models.append(replace(other, recording=driven))
    return Comparison.of(models)


def test_a_mode_that_goes_with_the_amplitude_is_said(results):
    amplitudes, errors = np.arange(1.0, 7.0), 0.01 * np.random.default_rng(3).standard_normal(6)
    compared = driven_by(results, amplitudes, 5.0 - 0.05 * amplitudes + errors)
    (sentence,) = dependence_sentences(compared.dependences)
    assert sentence.startswith("Dependence on the standard deviation of input: from ")
    slope = np.polyfit(amplitudes, 5.0 - 0.05 * amplitudes + errors, 1)[0]
    told = float(re.search("changes by −([0-9.]+) ± ", sentence)[1])
    assert told == pytest.approx(-5.0 * slope, abs=0.001)
    # Of one recording, or three, nothing is said; of constant modes that nothing was found.
    assert not driven_by(results, np.ones(6), 5.0 + errors).dependences
    assert not driven_by(results, amplitudes[:3], 5.0 + errors[:3]).dependences
    (none,) = dependence_sentences(driven_by(results, amplitudes, 5.0 + errors).dependences)
    assert none.startswith("No dependence of a mode on amplitude")


def test_a_constant_mode_is_seldom_said_to_depend(results):
    draws = np.random.default_rng(8).standard_normal((60, 6))
    amplitudes = np.arange(1.0, 7.0)
    found = [driven_by(results, amplitudes, 5.0 + 0.01 * draw).dependences for draw in draws]
    assert sum(tests[0].p_value < 0.01 for tests in found) <= 3


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
        (1, (), "compare: the number of models is 1; give 2 to 6 of them."),
        (7, (), "compare: the number of models is 7; give 2 to 6 of them."),
        (2, ("a", "a"), "labels: they are not one for each model, all different"),
    ],
)
def test_what_cannot_be_compared_is_refused(results, number, labels, sentence):
    with pytest.raises(InputError) as refused:
        Comparison.of([results] * number, labels)
    assert str(refused.value).startswith(sentence)


def test_models_of_set_ups_are_merged(results):
    """Two records that say the same halve the variance of all that is common."""
    compared = Comparison.of([results] * 7, list("abcdefg"), setups=True)
    assert compared.merged.contradictions == ()
    for mode, alone in zip(compared.merged.modes, results.model.plant.modes(), strict=True):
        assert mode.frequency_hz == pytest.approx(alone.frequency_hz)
        assert mode.frequency_se_hz == pytest.approx(alone.frequency_se_hz / 7**0.5, rel=1e-6)
    assert Comparison.of([results, results], setups=True).matched == [
        (mode, mode) for mode in results.model.plant.modes()
    ]


def test_set_ups_of_different_sensors_are_scaled_by_a_common_input(results):
    other = with_output_name(results, "tip")
    compared = Comparison.of([results, other], ["root", "tip"], setups=True)
    assert compared.merged.outputs == ("output", "tip")
    assert compared.modes["trusted"].all()
    for mode in compared.merged.modes:
        np.testing.assert_allclose(mode.shape, [1.0, 1.0], rtol=1e-6)
        assert np.isfinite(mode.shape_se_real).all()
    away = replace(other, recording=replace(other.recording, input_names=("shaker",)))
    with pytest.raises(InputError, match="tip: it has no channel in common"):
        Comparison.of([results, away], ["root", "tip"], setups=True)


def test_a_set_up_that_contradicts_the_others_is_named_in_a_sentence(results):
    record = results.model
    warm = replace(record.model, sampling_rate=1.02 * record.sampling_rate)
    other = replace(results, model=replace(record, model=warm))
    other = with_judged_modes(other, warm.modes())
    other = replace(other, model=replace(record, model=warm))
    merged = Comparison.of([results, results, other], ["a", "b", "c"], setups=True).merged
    counted, contradiction = merged_sentences(merged)
    assert counted == "3 set-ups and 1 output; input and output in all set-ups."
    assert contradiction.startswith(
        "c contradicts the others, most in the frequency of mode 3: 37.72 beside 36.99, "
    )
    merged = Comparison.of([results, other], ["a", "c"], setups=True).merged
    assert all(" contradicts the other, " in each for each in merged_sentences(merged)[1:])
    assert len(merged.contradictions) == 2


def test_merged_shapes_are_drawn_over_the_geometries_of_all_set_ups(results):
    def at(point, output):
        place = ChannelPlace(point, (0.0, 0.0, 1.0))
        points = {"root": (0.0, 0.0, 0.0), point: (1.0, 0.0, 0.0)}
        geometry = Geometry(points, {output: place}, (("root", point),))
        named = with_output_name(results, output)
        return replace(named, settings=replace(results.settings, geometry=geometry))

    compared = Comparison.of([at("mid", "a"), at("tip", "b")], ["one", "other"], setups=True)
    page = build_comparison(compared)
    assert page.count('<svg class="shape"') == 3
    assert "<title>mid</title>" in page
    assert "<title>tip</title>" in page
    alone = Comparison.of([at("mid", "a"), results], ["one", "other"], setups=True)
    assert build_comparison(alone).count('<svg class="shape"') == 3
