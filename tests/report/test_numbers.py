"""Numbers as a reader expects them."""

import math

import pytest

from evopem.models.modes import Mode
from evopem.report import numbers
from evopem.validation.checks.check import root_text

THIN = numbers.THIN


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (5.36123, 0.0042, "5.3612 ± 0.0042"),
        (17.5, 1.96, "17.5 ± 2.0"),
        (1234.5, 25.0, "1234 ± 25"),
        (-0.5, 0.031, "−0.500 ± 0.031"),
        (5.36123, 0.0, "5.361 ± 0"),
        (747.0, 247581777.0, "747 ± not known"),
        (7.275, 3200826.0, "7.28 ± not known"),
        (5.36123, None, "5.361 ± not known"),
        (5.36123, math.nan, "5.361 ± not known"),
        (5.36123, math.inf, "5.361 ± not known"),
        (None, 0.1, "–"),
        (math.nan, 0.1, "–"),
    ],
)
def test_values_with_errors(value, error, text):
    assert numbers.with_error(value, error) == text


@pytest.mark.parametrize(
    ("damping", "error", "cell", "place"),
    [
        (9e-7, 0.041, f"<{numbers.FIRM}8", f"2.26 (damping below 8.0{THIN}%)"),
        (0.004, 0.0021, f"<{numbers.FIRM}0.81", f"2.26 (damping below 0.81{THIN}%)"),
        (-0.01, 0.01, f"<{numbers.FIRM}0.96", f"2.26 (damping below 0.96{THIN}%)"),
        (0.004, 0.002, "0.40 ± 0.20", "2.26"),
        (-0.03, 0.01, "−3.0 ± 1.0", "2.26"),
        (0.02, math.inf, "2 ± not known", "2.26"),
        (0.2, 0.5, "20 ± 50", "2.26"),
        (0.0, math.nan, "0 ± not known", "2.26"),
    ],
)
def test_a_damping_whose_interval_contains_0_has_an_upper_limit_alone(damping, error, cell, place):
    mode = Mode(2.2584, damping, 0.9 + 0.1j, 0.05, error)
    assert numbers.mode_cells(mode) == ("2.258 ± 0.050", cell)
    assert numbers.mode_place(mode) == place


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (36.98741, 0.0002, "36.9874"),
        (154.23, 0.3, "154.2"),
        (154.23, 40.0, "154"),
        (0.0123456, 1e-9, "0.0123456"),
        (5.36123, math.nan, "5.36"),
        (-0.5, 0.031, "−0.50"),
        (None, 0.1, "–"),
    ],
)
def test_values_to_the_first_digit_of_their_errors(value, error, text):
    assert numbers.to_its_error(value, error) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0004, "0.0004"),
        (-1.5, "−1.5"),
        (3.2e-9, "3.2\u00a0·\u00a010⁻⁹"),
        (None, "–"),
        (math.nan, "–"),
        (-math.inf, "–"),
        (True, "–"),
    ],
)
def test_numbers(value, text):
    assert numbers.number(value) == text


@pytest.mark.parametrize("missing", [None, math.nan, math.inf])
def test_what_is_missing_is_no_number(missing):
    for shown in (numbers.fixed, numbers.percent, numbers.count):
        assert shown(missing) == "–"
    assert numbers.raw(missing) == ""
    assert numbers.standard_error(missing) == "not known"


def test_percentages_and_counts():
    assert numbers.percent(3.5312) == f"3.53{THIN}%"
    assert numbers.percent(97.124) == f"97.1{THIN}%"
    assert numbers.percent(0.0123456) == f"0.0123{THIN}%"
    assert numbers.percent(3.54e-6) == f"3.54\u00a0·\u00a010⁻⁶{THIN}%"
    assert numbers.percent(0) == f"0{THIN}%"
    assert numbers.count(1234567) == f"1{THIN}234{THIN}567"
    assert numbers.fixed(-0.001, 2) == "0.00"
    assert numbers.standard_error(0.01234) == "0.012"
    assert root_text(-0.5 + 0.25j) == "−0.5000 ± 0.2500i"
    assert root_text(-0.5 + 1e-9j) == "−0.5000"
    assert root_text(-1e-9 - 1e-9j) == "0.0000"


def test_amounts_in_words():
    assert numbers.enumeration([]) == ""
    assert numbers.enumeration(["a", "b"]) == "a and b"
    assert numbers.enumeration(["a", "b", "c"]) == "a, b and c"
    assert numbers.plural(1, "optimum", "optima") == "1 optimum"
    assert numbers.plural(2, "optimum", "optima") == "2 optima"
    assert numbers.plural(0, "zero") == "0 zeros"
    assert [numbers.times(count) for count in range(4)] == [
        "not at all",
        "once",
        "twice",
        "3 times",
    ]
