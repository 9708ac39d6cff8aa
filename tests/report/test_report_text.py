"""Numbers and sentences: printed as a reader expects, computed and not canned."""

from types import SimpleNamespace

import pandas as pd
import pytest

from evopem.report import equations, numbers, report_text
from evopem.report.mode_table import CHAPTER, mode_rows

THIN = numbers.THIN


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (5.36123, 0.0042, "5.3612 ± 0.0042"),
        (17.5, 1.96, "17.5 ± 2.0"),
        (1234.5, 25.0, "1234 ± 25"),
        (-0.5, 0.031, "−0.500 ± 0.031"),
        (5.36123, None, "5.361"),
        (5.36123, float("nan"), "5.361"),
        (None, 0.1, "–"),
    ],
)
def test_values_with_errors(value, error, text):
    assert numbers.with_error(value, error) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0004, "0.0004"),
        (-1.5, "−1.5"),
        (3.2e-9, "3.2\u00a0·\u00a010⁻⁹"),
        (None, "–"),
        (float("nan"), "–"),
    ],
)
def test_numbers(value, text):
    assert numbers.number(value) == text


def test_percentages_and_counts():
    assert numbers.percent(3.5312) == f"3.53{THIN}%"
    assert numbers.percent(97.124) == f"97.1{THIN}%"
    assert numbers.percent(0.0123456) == f"0.0123{THIN}%"
    assert numbers.percent(3.54e-6) == f"3.54\u00a0·\u00a010⁻⁶{THIN}%"
    assert numbers.percent(0) == f"0{THIN}%"
    assert numbers.count(1234567) == f"1{THIN}234{THIN}567"
    assert numbers.fixed(-0.001, 2) == "0.00"
    assert numbers.root(-0.5, 0.25, 2) == "−0.50 ± 0.25i"
    assert numbers.root(-0.5, 1e-9, 2) == "−0.50"
    assert numbers.enumeration(["a", "b", "c"]) == "a, b and c"


MODEL = {
    "orders": {"na": 2, "nb": 2, "nc": 1, "nk": 3},
    "a": [1.0, -1.5, 0.7],
    "b": [0.5, -0.25],
    "c": [1.0, 0.3],
    "sampling_rate": 100.0,
    "noise_variance": 0.01,
    "parameter_standard_errors": [0.1, 0.2, 0.3, 0.4, 0.5],
}


def plain(markup):
    return " ".join(markup.striptags().split())


def test_polynomials_start_b_at_its_delay():
    shown = {letter: plain(polynomial) for letter, polynomial in equations.polynomials(MODEL)}
    assert shown == {
        "A": "1 − 1.5 q−1 + 0.7 q−2",
        "B": "0.5 q−3 − 0.25 q−4",
        "C": "1 + 0.3 q−1",
    }


def test_difference_equation_moves_a_to_the_right():
    assert plain(equations.difference_equation(MODEL)) == (
        "1.5 y(t − 1) − 0.7 y(t − 2) + 0.5 u(t − 3) − 0.25 u(t − 4) + e(t) + 0.3 e(t − 1)"
    )


def test_python_statement_makes_the_transfer_function():
    pytest.importorskip("control", reason="python-control is not installed")
    import numpy as np

    scope = {}
    exec(equations.python(MODEL), scope)
    z = np.exp(0.3j)
    expected = (0.5 * z**-3 - 0.25 * z**-4) / (1 - 1.5 * z**-1 + 0.7 * z**-2)
    assert scope["G"](z) == pytest.approx(expected)
    assert scope["G"].dt == 0.01


def test_matlab_statement_keeps_the_leading_zeros():
    text = equations.matlab(MODEL)
    assert "[0 0 0 0.5 -0.25]" in text
    assert text.endswith("1, 1, 0.01, 0.01);") or "0.01, 0.01" in text


def test_coefficients_with_their_lags_and_errors():
    assert equations.coefficient_table(MODEL) == [
        ("a", 1, -1.5, 0.1),
        ("a", 2, 0.7, 0.2),
        ("b", 3, 0.5, 0.3),
        ("b", 4, -0.25, 0.4),
        ("c", 1, 0.3, 0.5),
    ]


def mode(frequency, damping=1.0, frequency_error=0.1, damping_error=0.5):
    return {
        "frequency_hz": frequency,
        "damping_percent": damping,
        "frequency_se_hz": frequency_error,
        "damping_se_percent": damping_error,
    }


def test_modes_are_paired_and_the_missed_ones_listed():
    truth = [{"frequency_hz": f, "damping_percent": 1.0} for f in (2.0, 5.36, 37.0)]
    rows = mode_rows([mode(5.4), mode(16.0), mode(36.9), mode(45.0)], truth, CHAPTER)
    shown = [
        tuple(part and part["frequency_hz"] for part in (row.estimate, row.truth, row.chapter))
        for row in rows
    ]
    assert shown == [
        (None, 2.0, None),
        (5.4, 5.36, 5.36),
        (16.0, None, 16.65),
        (36.9, 37.0, 37.0),
        (45.0, None, None),
    ]
    assert rows[1].frequency_deviation == pytest.approx(0.4)
    assert rows[0].frequency_deviation is None


def test_a_far_mode_never_takes_a_near_ones_partner():
    truth = [{"frequency_hz": 10.0, "damping_percent": 1.0}]
    rows = mode_rows([mode(8.8), mode(10.1)], truth, [])
    assert [row.truth is not None for row in rows] == [False, True]


def transforms(**changes):
    return {
        "sampling_rate": 100.0,
        "resampled_from": None,
        "box_cox": None,
        "shift": 0.0,
        "difference": 0,
        "difference_input": 0,
        "discard": 0,
    } | changes


def test_differencing_the_output_alone_is_explained():
    (paragraph,) = report_text.transform_effects(transforms(difference=2))
    assert "(1 − q⁻¹)² into B" in paragraph
    # |2 sin(π · 2/100)|² = 0.0158
    assert f"0.016 at 2{THIN}Hz and 4 at 50{THIN}Hz" in paragraph
    assert "high-pass" in paragraph


def test_differencing_both_needs_no_explanation():
    assert report_text.transform_effects(transforms(difference=2, difference_input=2)) == []


def test_box_cox_is_explained_unless_it_is_linear():
    assert "not linear" in report_text.transform_effects(transforms(box_cox=1.1))[0]
    assert report_text.transform_effects(transforms(box_cox=1.0)) == []


def contents(**parts):
    return SimpleNamespace(**parts)


def test_spectrum_reading_counts_the_peaks():
    summary = {"time_halfbandwidth": 4, "tapers": 7, "nfft": 8192, "resolution_hz": 0.22}
    peaks = [{"frequency_hz": f, "prominence_db": 20.0} for f in (2.0, 5.0, 36.0)]
    (text,) = report_text.spectrum(contents(spectrum=summary | {"peaks": peaks}))
    assert f"3 peaks stand out, at 2{THIN}Hz, 5{THIN}Hz and 36{THIN}Hz, 20{THIN}dB" in text
    assert "na is at least 6" in text
    (text,) = report_text.spectrum(contents(spectrum=summary | {"peaks": []}))
    assert "No peak stands out" in text
    lines = [{"frequency_hz": float(k), "prominence_db": 20.0} for k in range(1, 100)]
    (text,) = report_text.spectrum(contents(spectrum=summary | {"peaks": lines}))
    assert f"Its 99 peaks stand about 1{THIN}Hz apart" in text
    assert "at least" not in text


def test_delay_reading_compares_the_deviations_between_orders():
    rows = [
        ("delay", k, nk, bic * k) for k in (6, 7) for nk, bic in ((0, -1.0), (1, -0.25), (2, -2.5))
    ]
    table = pd.DataFrame(rows, columns=["phase", "na", "nk", "bic"])
    (text,) = report_text.delay(
        contents(
            candidates=table,
            phases={"delay": {"reason": "It is best (-3.1)", "selected": {"nk": 1}}},
            truth={"delay_samples": 2},
            model={"orders": {"nk": 1}},
        )
    )
    assert text.startswith("It is best (−3.1).")
    assert "Over the orders 6 to 7 the BIC of nk = 1 varies by 0.25" in text
    assert "that of the other delays by 1 to 2.5" in text
    assert text.endswith("The true delay is 2 samples: missed by 1.")


def test_phase_readings_set_rss_beside_the_choice():
    table = pd.DataFrame({"phase": "c", "nc": [2, 3, 4], "rss": [2.0, 1.5, 1.25]})
    paragraphs = report_text.phases(
        contents(
            is_stand_in=False,
            candidates=table,
            phases={"c": {"selected": {"nc": 3}, "reason": "Least BIC."}},
        )
    )
    assert paragraphs[0] == (
        f"The order of C, nc, from 2 to 4: 3, with an RSS of 1.500{THIN}% where the smallest, at 4,"
        f" is 1.250{THIN}%. Least BIC."
    )


def test_missed_and_spurious_modes_get_a_word():
    truth = [{"frequency_hz": 2.0, "damping_percent": 1.0}]
    rows = mode_rows([mode(10.0), mode(30.0, damping=84.0), mode(53.0)], truth, [])
    given = contents(model={"sampling_rate": 100.0}, transforms=transforms(difference=2))
    (text,) = report_text.modes(given, rows)
    assert "Mode 3 is damped by more than half" in text
    assert "Mode 4 lies above half the sampling rate" in text
    assert f"The true mode at 2{THIN}Hz was not found." in text
    assert "a factor 0.016 of the gain" in text
    assert report_text.modes(given, mode_rows([mode(10.0)], [], [])) == []


def test_a_mode_that_outlasts_the_record_gets_a_word():
    slow, quick = mode(5.36, damping=0.91), mode(20.0, damping=5.0)
    given = contents(model={"sampling_rate": 100.0}, transforms=transforms(estimation_samples=500))
    (text,) = report_text.modes(given, mode_rows([slow, quick], [], []))
    assert "last only 1.5 time constants of mode 1" in text
    assert "mode 2" not in text


@pytest.mark.parametrize(
    ("b", "trend"), [([1.0, -1.0], "high-pass"), ([1.0, 1.0], "low-pass"), ([1.0], "no marked")]
)
def test_trend_of_the_response(b, trend):
    model = {"a": [1.0], "b": b, "sampling_rate": 100.0}
    assert trend in report_text.frequency_response(contents(model=model))[0]


def test_simulation_reading_says_where_it_starts():
    validation = {
        "simulation_error_percent": 21.0,
        "simulation_fit_percent": 79.0,
        "samples": 900,
        "unscored_samples": 0,
        "continued_simulation_error_percent": 24.0,
    }
    (text,) = report_text.simulation(contents(validation=validation))
    assert "the state that fits these samples best" in text
    assert "without seeing one validation output, the same model misses by 24" in text
    validation |= {"continued_simulation_error_percent": None, "unscored_samples": 8}
    (text,) = report_text.simulation(contents(validation=validation))
    assert "without seeing" not in text
    assert "The first 8 samples" in text


def chosen(**evidence):
    found = {"generations": 9, "populations": 4, "agreement": 2 / 3, "basins": 5}
    found |= {"checked": 64, "unseen": 0.0015}
    return found | {"at_margin": False, "noise_state": [0.1, 0.2]} | evidence


@pytest.mark.parametrize(
    ("evidence", "sentence"),
    [
        ({}, "9 generations of 4 independent populations; 2 of the 3 beside the one"),
        ({"populations": 1, "agreement": 0.0}, "no independent one confirms the optimum"),
        ({}, "ended at 5 distinct values"),
        ({}, "descents from 64 random points, which leave an estimated 0.15 % of all"),
        ({"checked": 0, "unseen": 1.0}, "No check from random points was made"),
        ({}, "The 2 noise samples before the first residual"),
        ({"at_margin": True}, "the limit and not the data holds it"),
    ],
)
def test_evidence_of_the_search_in_words(evidence, sentence):
    candidates = pd.DataFrame(
        {
            "evaluations": [100, 200],
            "agreement": [0.0, 2 / 3],
            "at_margin": [True, False],
        }
    )
    (text,) = report_text.search(
        contents(candidates=candidates, chosen=chosen(**evidence), model={})
    )
    assert sentence in text
    assert "Of all 2 candidates 1 was confirmed by another population and 1 has a root" in text
    assert ("the limit and not" in text) == (evidence.get("at_margin") is True)


def test_the_search_without_evidence_says_so():
    candidates = pd.DataFrame({"evaluations": [100]})
    (text,) = report_text.search(contents(candidates=candidates, chosen={}, model={}))
    assert "is not on record" in text


def test_the_chapters_choices_stand_beside_ours():
    phases = {
        "delay": {"selected": {"nk": 3}},
        "common": {"selected": {"na": 8}},
        "c": {"selected": {"nc": 7}},
    }
    rows = report_text.beside_chapter(
        contents(
            phases=phases,
            spectrum={"peaks": [{"frequency_hz": 5.41}, {"frequency_hz": 37.0}]},
            model={"orders": {"na": 8, "nb": 8, "nc": 7, "nk": 3}},
        )
    )
    assert ("Delay nk", "3", "3") in rows
    assert ("Phase one, common order", "8", "7") in rows
    assert ("Phase three, nb", "–", "6") in rows
    assert ("Model", "ARMAX(8, 8, 7, 3)", "ARMAX(7, 6, 7, 3)") in rows
    assert rows[0][1] == "5.41, 37"


def test_the_equation_in_plain_text_and_json_gives_the_model_back():
    import json

    model = {
        "orders": {"na": 1, "nb": 2, "nc": 1, "nk": 3},
        "a": [1.0, -0.123456789012],
        "b": [0.5, -2e-7],
        "c": [1.0, 0.25],
        "noise_variance": 0.01,
        "sampling_rate": 100.0,
    }
    assert equations.text(model).splitlines() == [
        "A(q) y(t) = B(q) u(t) + C(q) e(t)",
        "A(q) = 1 - 0.123456789 q^-1",
        "B(q) = 0.5 q^-3 - 2e-07 q^-4",
        "C(q) = 1 + 0.25 q^-1",
        "variance of e = 0.01",
        "sampling rate = 100 Hz",
    ]
    assert json.loads(equations.as_json(model)) == model
