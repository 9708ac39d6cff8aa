"""Sentences of the report: computed from the results, and changed with them."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import identified
import numpy as np
import pytest
from browsing import TEMPLATES, renamed_channels, told
from covariances import covariance_of_matrix

from evopem.estimation.model_record import Rival
from evopem.models.modes import Mode
from evopem.models.polynomial import PolynomialModel
from evopem.report.numbers import THIN, count, number, percent
from evopem.report.page_sections import (
    CHAPTER_MODES,
    compare_with_chapter,
    mode_rows,
    stands_in_for_the_chapter,
)
from evopem.report.templates import environment
from evopem.report.verdict import verdict
from evopem.signals.peaks import SpectralPeak
from evopem.signals.recording_info import FileOrigin
from evopem.signals.timestamps import Unevenness
from evopem.synthesis import true_mode


def mode(frequency, damping=0.01, frequency_error=0.1, damping_error=0.004):
    return Mode(frequency, damping, 0j, frequency_error, damping_error)


def told_of(about, results):
    return told(about, results)


def with_model(results, **changes):
    return replace(results, model=replace(results.model, **changes))


def with_transforms(results, **changes):
    neutral = {"box_cox": None, "difference": 0, "difference_input": 0}
    transforms = replace(results.model.transforms, **(neutral | changes))
    return with_model(results, transforms=transforms)


def test_modes_are_paired_and_the_missed_ones_listed():
    truth = [mode(2.0), mode(5.36), mode(37.0)]
    estimates = [mode(5.4), mode(16.0), mode(36.9), mode(45.0)]
    rows = mode_rows(estimates, truth, CHAPTER_MODES)
    shown = [
        tuple(part and part.frequency_hz for part in (row.estimate, row.truth, row.chapter))
        for row in rows
    ]
    assert shown == [
        (None, 2.0, None),
        (5.4, 5.36, 5.36),
        (16.0, None, 16.65),
        (36.9, 37.0, 37.0),
        (45.0, None, None),
    ]
    assert rows[1].deviations == pytest.approx((0.4, 0.0))
    assert all(map(math.isnan, rows[0].deviations + rows[2].deviations))


def test_missed_modes_of_truth_and_chapter_share_a_row():
    (row,) = mode_rows([], [mode(5.4)], CHAPTER_MODES[:1])
    assert (row.truth.frequency_hz, row.chapter.frequency_hz) == (5.4, 5.36)


def test_recording_and_division(results):
    (text,) = told("record", results)
    assert text.startswith(
        f"The recording has {count(1500)} samples of one input and one output at 100{THIN}Hz,"
        f" 15{THIN}s in total."
    )
    assert "The output was Box-Cox transformed with λ = 1.1 and differenced twice." in text
    assert f"The first 100 samples are discarded. The next {count(1000)} samples" in text
    assert "398 samples, those that follow without a gap, are used for validation" in text
    stretches = results.model.transforms.estimation * 2
    (text,) = told("record", with_transforms(results, estimation=stretches))
    assert f"The next {count(2000)} samples that are left are used for estimation" in text


def test_recording_with_names_units_and_a_validation_recording(results):
    whole = replace(results.model.transforms.estimation[0], first=1)
    changed = with_transforms(
        results,
        validation_source="file",
        estimation=(whole,),
        difference_input=1,
        resampled_from=200.0,
    )
    named = renamed_channels(results.recording_info, "torque", "tip")
    (text,) = told("record", replace(changed, recording_info=named))
    assert "samples of torque (input) and tip (output)" in text
    assert f"resampled from 200{THIN}Hz to 100{THIN}Hz" in text
    assert "The output was not transformed. The input was differenced once." in text
    assert f"The first {count(1000)} samples are used for estimation" in text
    assert "those of an independent recording" in text
    shifted = with_transforms(results, box_cox=0.5, shift=2.5)
    (text,) = told("record", shifted)
    assert "shifted by 2.5 to be positive and Box-Cox transformed with λ = 0.5." in text


def test_uneven_stamps_are_told(results):
    lost = Unevenness(in_gaps=5, longest_gap=4.0, largest_shift=0.2)
    (text,) = told("uneven_stamps", [lost])
    assert text.endswith("0.2 steps away. 5 samples are missing, in gaps of up to 4 steps.")
    (text,) = told("uneven_stamps", [replace(lost, tick=10.0 / 3.0)])
    assert "a tick lasts 3.33 samples" in text
    assert "interpolated" not in text
    assert told("uneven_stamps", []) == []


def test_filled_and_left_out_samples_are_told():
    origin = FileOrigin("a.csv", "ab" * 32, 1, "text", (1,), (2,), 900, filled=7)
    (text,) = told("gaps", [origin, replace(origin, filled=2)])
    assert text.startswith("9 missing values were filled by interpolation")
    (text,) = told("gaps", [replace(origin, filled=0, segments=2, left_out=3)])
    assert text.startswith("3 samples are missing")
    assert "2 stretches" in text


def effects(results, **changes):
    return told("transform_effects", with_transforms(results, **changes).model.transforms)


def test_differencing_the_output_alone_is_explained(results):
    (paragraph,) = effects(results, difference=2)
    assert (
        "differenced twice, the input not at all. B therefore contains the factor (1 − q⁻¹)²"
        in (paragraph)
    )
    # |2 sin(π · 2/100)|² = 0.0158
    assert f"0.016 at 2{THIN}Hz and 4 at 50{THIN}Hz" in paragraph
    assert "high-pass" in paragraph


def test_differencing_the_input_alone_is_explained(results):
    (paragraph,) = effects(results, difference_input=1)
    assert "The input was differenced once, the output not at all." in paragraph
    assert "it has an integrator more" in paragraph


def test_differencing_both_needs_no_explanation(results):
    assert effects(results, difference=2, difference_input=2) == []


def test_box_cox_is_explained_unless_it_is_linear(results):
    assert "not linear" in effects(results, box_cox=1.1)[0]
    assert effects(results, box_cox=1.0) == []


def with_peaks(results, *frequencies):
    peaks = tuple(SpectralPeak(frequency, 1.0, 20.0, 0.5, 2.0) for frequency in frequencies)
    return replace(
        results, spectrum_summaries=(replace(results.spectrum_summaries[0], peaks=peaks),)
    )


def test_spectrum_counts_the_peaks(results):
    *_, text = told_of("spectrum", with_peaks(results, 2.0, 5.0, 36.0))
    assert f"3 significant peaks, at 2{THIN}Hz, 5{THIN}Hz and 36{THIN}Hz, with" in text
    assert f"prominences of 20, 20 and 20{THIN}dB" in text
    assert "the order is at least 6" in text
    *_, text = told_of("spectrum", with_peaks(results, 2.0))
    assert f"1 significant peak, at 2{THIN}Hz, with a prominence of 20{THIN}dB. It requires" in text
    *_, text = told_of("spectrum", with_peaks(results))
    assert text == "It has no significant peak."
    *_, text = told_of("spectrum", with_peaks(results, *range(1, 100)))
    assert f"It has 99 significant peaks, about 1{THIN}Hz apart" in text
    assert "at least" not in text


def test_the_true_delay_is_beside_the_selected_one(results):
    assert told("delay", results) == ["The true delay is 3 samples, which was found."]
    missed = replace(results, truth=replace(results.truth, delay_samples=1))
    assert told("delay", missed) == ["The true delay is 1 sample, 2 off."]


def test_stabilization_lists_the_modes_that_persist(results):
    (text,) = told("stabilization", results)
    # 37 Hz is within 1 % and 10 % at the orders 6, 7 and 8; the broad mode at 17 Hz is not.
    assert text.startswith(f"Over the orders 6 to 8, poles at 36.99{THIN}Hz are stable")
    assert "16." not in text
    table = results.validation.modes
    two = replace(table, poles=tuple(pole for pole in table.poles if pole.order < 8))
    fewer = identified.with_outcome(results, modes=two)
    (text,) = told("stabilization", fewer)
    assert text == "Over the orders 6 to 7, no pole is stable over 3 successive orders."


def test_missed_modes_get_a_sentence(results):
    truth = [mode(2.0)]
    rows = mode_rows([mode(10.0), mode(53.0)], truth, [])
    (text,) = told("remarks_on_modes", with_transforms(results, difference=2), rows)
    assert f"The true mode at 2{THIN}Hz was not found." in text
    assert "multiplies the gain by 0.016" in text
    plain = with_transforms(results)
    (text,) = told("remarks_on_modes", plain, mode_rows([], truth, []))
    assert text == f"The true mode at 2{THIN}Hz was not found."
    assert told("remarks_on_modes", results, mode_rows([mode(10.0)], [], [])) == []


def test_a_mode_that_outlasts_the_recording_gets_a_sentence(results):
    slow, quick = mode(5.36, damping=0.0091), mode(20.0, damping=0.05)
    stretch = replace(results.model.transforms.estimation[0], samples=500)
    short = with_transforms(results, estimation=(stretch,))
    (text,) = told("remarks_on_modes", short, mode_rows([slow, quick], [], []))
    # 2π · 5.36 Hz · 0.0091 · 5 s = 1.53
    assert "last only 1.5 time constants of mode 1" in text
    unknown = mode(5.36, damping=0.0091, damping_error=0.005)
    (text,) = told("remarks_on_modes", short, mode_rows([unknown, quick], [], []))
    assert "interval of the damping of mode 1 contains 0" in text
    assert "time constants" not in text
    assert "mode 2" not in text


def with_coefficients(results, a, b, c, covariance=None):
    if covariance is not None:
        covariance = covariance_of_matrix(covariance)
    model = PolynomialModel(
        np.array(a), np.array(b), np.array(c), nk=1, sampling_rate=100.0, covariance=covariance
    )
    frequencies = np.linspace(0.0, 50.0, 8193)
    gain = np.abs(model.frequency_response(frequencies)[:, 0, 0])
    table = results.frequency_response.iloc[:0].reindex(range(len(gain)))
    pair = {"output": "output", "input": "input"}
    table = table.assign(frequency_hz=frequencies, gain=gain, **pair)
    record = identified.with_model(results.model, model)
    return replace(results, model=record, frequency_response=table)


@pytest.mark.parametrize(
    ("b", "trend"), [([1.0, -1.0], "high-pass"), ([1.0, 1.0], "low-pass"), ([1.0], "no marked")]
)
def test_trend_of_the_frequency_response(results, b, trend):
    (text,) = told("frequency_response", with_coefficients(results, [1.0], b, [1.0]))
    assert trend in text


def test_the_largest_gain_is_at_a_resonance(results):
    pole = true_mode(20.0, 0.01, 100.0).pole
    a = np.real(np.poly([pole, pole.conjugate()]))
    given = with_coefficients(results, a, [1.0], [1.0])
    (text,) = told("frequency_response", given)
    # 1 / |A| at the resonance, 1 / |(1 − r)(1 − r exp(−2iω))| to first order.
    gain = 1 / abs((1 - abs(pole)) * (1 - abs(pole) * np.exp(-2j * np.angle(pole))))
    assert text.startswith("The gain of model G is largest at 20")
    assert float(text.split("where it is ")[1].split(".  ")[0].split(". ")[0]) == pytest.approx(
        gain, rel=0.01
    )


def test_poles_and_zeros(results):
    given = with_coefficients(
        results, np.poly([0.5, 0.9j, -0.9j]), np.poly([2.0, -0.1]), np.poly([0.3]), 1e-6 * np.eye(7)
    )
    (text,) = told("poles_zeros", given)
    assert "The slowest pole has radius 0.90000" in text
    # 0.9^n = 1/e after 9.49 samples of 10 ms.
    assert f"decays to 37 % within 0.0949{THIN}s" in text
    assert "Of 3 poles, 2 form 1 oscillating mode and 1 is real." in text
    assert "1 zero of B lies outside the unit circle, so the inverse of G is unstable." in text
    assert "The largest zero of the noise filter has radius 0.3000000." in text
    assert "ellipse" not in text
    unknown = replace(given, model=identified.without_covariance(given.model))
    (text,) = told("poles_zeros", unknown)
    assert "The covariance of 6 roots is not known, so no ellipse is drawn" in text


@pytest.mark.parametrize(
    ("poles", "said"),
    [
        ([0.5], "The only pole is real."),
        ([0.5, 0.3], "All poles are real."),
        ([0.9j, -0.9j], "The 2 poles form 1 oscillating mode."),
    ],
)
def test_poles_of_one_kind_are_not_divided(results, poles, said):
    (text,) = told("poles_zeros", with_coefficients(results, np.poly(poles), [2.0], [1.0]))
    assert said in text


def test_a_model_without_roots_has_no_sentence_on_poles(results):
    assert told("poles_zeros", with_coefficients(results, [1.0], [1.0], [1.0])) == []


def test_residual_tests(results):
    validation = results.validation
    (text,) = told_of("residual_correlation", results)
    share = percent(100 * validation.outputs[0].autocorrelation_share_inside95)
    assert f"{share} of {validation.lags}" in text
    assert f"N = {validation.residual_samples} residuals" in text
    assert "is expected of white innovations after this fit: p" in text
    assert f"at lags −{validation.correlation_lags} to" in text
    (pair,) = validation.pairs
    assert f"the largest is {number(pair.max_in_bounds, 3)} times its 95 % bound" in text


def test_residual_tests_that_were_not_possible(results):
    test = replace(results.validation.outputs[0].ljung_box, p_value=math.nan)
    unknown = identified.with_outcome(
        results,
        outputs={"autocorrelation_share_inside95": math.nan, "ljung_box": test},
        pairs={"p_value": math.nan},
    )
    assert told_of("residual_correlation", unknown) == [
        "The autocorrelation of the residuals is not known. The Ljung-Box test was not possible."
        " The cross-correlation of residuals and input is not known."
    ]


def test_simulation_says_where_it_starts(results):
    validation = results.validation
    (text,) = told_of("simulation", results)
    error = percent(validation.simulation_error_percent)
    assert f"Its error is {error} of the deviation of the measured output" in text
    assert "over 398 validation samples" in text
    assert "runs on from the samples before them" in text
    fitted = percent(validation.fitted_state_error_percent)
    assert f"as in MATLAB's compare, the error is {fitted}." in text
    independent = replace(validation, unscored_samples=8)
    (text,) = told_of("simulation", replace(results, validation=independent))
    assert "The first 8 samples determine the states and are not scored" in text


def test_simulation_in_recorded_units(results):
    recorded = replace(
        results.validation.outputs[0].recorded,
        prediction_error_percent=0.5,
        simulation_error_percent=250.0,
        integrations=2,
        undefined_samples=3,
    )
    changed = identified.with_outcome(results, outputs={"recorded": recorded})
    (text,) = told_of("simulation", changed)
    assert f"one-step error is 0.500{THIN}% and the error of the simulation 250{THIN}%." in text
    assert "integrates the error of the simulation twice" in text
    assert "3 simulated samples outside the range of the Box-Cox transform" in text
    (text,) = told_of("simulation", with_transforms(changed))
    assert "In the units of the recording" not in text
    (text,) = told_of("simulation", with_transforms(changed, box_cox=0.5))
    assert "In the units of the recording" in text


def test_the_results_beside_those_of_the_chapter(results):
    orders = results.model.orders
    assert compare_with_chapter(results) == [
        ("Spectral peaks (Hz)", "5.47, 37", "near 2, 5 and 36, a broad one near 17"),
        ("Delay nk", "3", "3"),
        ("Plant order", "7", "7"),
        ("Order of C, nc", "6", "7"),
        ("Coefficients of B, nb", "6", "6"),
        ("Model", str(orders), "ARMAX(7,6,7,3)"),
    ]
    assert not stands_in_for_the_chapter(results.settings)


@pytest.mark.parametrize("factor", [30.0, math.inf])
def test_a_band_that_is_wider_than_the_gain_is_no_number(results, factor):
    response = results.frequency_response
    response = response.assign(gain_upper=factor * response["gain"])
    results = replace(results, frequency_response=response)
    [use] = [use for use in verdict(results).uses if use.name == "the frequency response"]
    assert use.answer != "good"
    assert "wider than the gain itself at half" in use.reason
    assert "±" not in use.reason


def test_a_band_that_is_wide_where_the_response_is_large_is_not_good(results):
    table = results.frequency_response.copy()
    peak = table["gain"].idxmax()
    table["gain_lower"], table["gain_upper"] = 0.99 * table["gain"], 1.01 * table["gain"]
    narrow = replace(results, frequency_response=table)
    # Beside a zero the relative error has no bound, and the gain is small.
    zero = table["gain"].iloc[1:].idxmin()
    table.loc[zero, ["gain", "gain_lower", "gain_upper"]] = [1e-4, 1e-30, 1e22]
    table = table.copy()
    table.loc[peak, "gain_upper"] = 1e3 * table.loc[peak, "gain"]
    wide = replace(results, frequency_response=table)
    # Of frequency responses there are no residuals in time.
    measured = replace(wide, validation=replace(results.validation, residual_samples=0))
    answers = [
        next(use for use in verdict(each).uses if use.name == "the frequency response")
        for each in (narrow, wide, measured)
    ]
    assert "where the response is large" not in answers[0].reason
    for use in answers[1:]:
        assert use.answer != "good"
        assert "where the response is large" in use.reason


def test_slow_frequencies_count_as_in_a_bode_diagram(results):
    """They are few of those at even steps, where a noise model may take what the input moves."""
    table = results.frequency_response.copy()
    table["gain_lower"], table["gain_upper"] = 0.99 * table["gain"], 1.01 * table["gain"]
    slow = table["frequency_hz"].between(0.2, 1.0)
    table.loc[slow, "gain"] = table["gain"].max()
    table.loc[slow, "gain_lower"], table.loc[slow, "gain_upper"] = (
        factor * table.loc[slow, "gain"] for factor in (0.5, 2.0)
    )
    found = verdict(replace(results, frequency_response=table))
    [use] = [use for use in found.uses if use.name == "the frequency response"]
    assert use.answer != "good"
    words = r"off by up to a factor of ([\d.]+) .*, most at ([\d.]+).Hz"
    ((off, place),) = re.findall(words, use.reason)
    assert 2.0 < float(off) < 2.0**1.25
    assert 0.2 <= float(place) <= 1.0
    reasons = []
    for factor in (1.2, 1.45, 49.3):
        model = replace(results.model, rival=Rival("oe nb=2 nf=2 nk=1", 0.5, factor))
        uses = verdict(replace(results, frequency_response=table, model=model)).uses
        reasons += [use.reason for use in uses if use.name == "the frequency response"]
    words = "(oe nb=2 nf=2 nk=1, which the data do not tell from it, differs in gain and phase by "
    assert [words in reason for reason in reasons] == [False, True, True]
    assert f"{words}45{THIN}%, most" in reasons[1]
    assert f"{words}a factor of 49, most" in reasons[2]


@pytest.mark.parametrize(
    ("inputs", "outputs", "words"),
    [(0, 3, "3 outputs"), (1, 2, "1 input, 2 outputs"), (2, 1, "2 inputs, 1 output")],
)
def test_channels_are_counted_where_there_are_any(inputs, outputs, words):
    results = SimpleNamespace(is_single=False, inputs=[None] * inputs, outputs=[None] * outputs)
    parts = environment(TEMPLATES).get_template("parts.html.j2").module
    assert str(parts.channels_of(results)).strip() == words
