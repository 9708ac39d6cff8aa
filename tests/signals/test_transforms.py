from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import boxcox, norm

from evopem.errors import InputError
from evopem.signals.transforms import (
    box_cox,
    difference,
    invert_box_cox,
    invert_difference,
    likeliest_box_cox,
    positive_shift,
)

signals = arrays(
    np.float64,
    st.integers(8, 60),
    elements=st.floats(-1e3, 1e3, allow_subnormal=False).map(lambda v: round(v, 6)),
)


@settings(max_examples=200, deadline=None)
@given(signals, st.floats(-1.0, 3.0))
@example(np.arange(8) % 8 // 7.0, 5e-324)
def test_box_cox_round_trip(signal, parameter):
    shift = positive_shift(signal)
    if np.ptp(signal) < 1e-3:
        return
    assert (signal + shift).min() > 0.0
    back = invert_box_cox(box_cox(signal, parameter, shift), parameter, shift)
    assert np.abs(back - signal).max() <= 1e-6 * np.ptp(signal)


@settings(max_examples=200, deadline=None)
@given(signals, st.integers(0, 4))
def test_difference_round_trip(signal, times):
    both = np.column_stack([signal, signal[::-1]])
    kept = both.copy()
    differenced, initial = difference(both, times)
    np.testing.assert_array_equal(both, kept)
    assert len(initial) == times
    np.testing.assert_array_equal(differenced, np.diff(both, times, axis=0))
    back = invert_difference(differenced, initial)
    bound = 4.0 ** (times + 1) * np.finfo(float).eps * signal.size**times
    assert np.abs(back - both).max() <= bound * max(1.0, np.abs(signal).max())


@pytest.mark.parametrize("pole", [0.5, 0.9, 0.99])
def test_a_high_pass_filter_is_that_of_its_equation_and_comes_back(pole):
    """A level that is followed from the first samples on; a pure tone has the filter's gain."""
    t = np.arange(4000)
    signal = 3.0 + np.column_stack([np.cos(0.3 * t), np.random.default_rng(0).normal(size=4000)])
    passed, ((level, _),) = difference(signal, 1, pole)
    assert level == pytest.approx(signal[: round(1.0 / (1.0 - pole)), 0].mean())
    expected = []
    for value in signal[1:, 0]:
        expected.append(value - level)
        level = pole * level + (1.0 - pole) * value
    np.testing.assert_allclose(passed[:, 0], expected, atol=1e-12)
    z = np.exp(-0.3j)
    gain = abs((1.0 - z) / (1.0 - pole * z))
    assert np.std(passed[2000:, 0]) == pytest.approx(gain * np.std(signal[2000:, 0]), rel=0.01)
    back = invert_difference(*difference(signal, 1, pole), pole)
    np.testing.assert_allclose(back[1:], signal[1:], atol=1e-11)


@given(
    arrays(np.int64, st.integers(5, 50), elements=st.integers(-(10**6), 10**6)), st.integers(0, 3)
)
def test_differences_of_whole_numbers_come_back_exactly(signal, times):
    differenced, initial = difference(signal[:, None].astype(float), times)
    np.testing.assert_array_equal(invert_difference(differenced, initial)[:, 0], signal)


@pytest.mark.parametrize("parameter", [-0.5, 0.0, 0.5, 1.0, 1.1, 2.0])
def test_box_cox_agrees_with_its_formula_and_scipy(parameter):
    signal = np.random.default_rng(0).gamma(2.0, size=300) + 0.1
    shifted = signal + 2.0
    formula = np.log(shifted) if parameter == 0 else (shifted**parameter - 1.0) / parameter
    np.testing.assert_allclose(box_cox(signal, parameter, 2.0), formula, rtol=1e-12)
    np.testing.assert_allclose(box_cox(signal, parameter, 0.0), boxcox(signal, parameter))


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("parameter", [0.0, 0.5, 1.5])
def test_automatic_parameter_finds_the_truth_in_any_unit(parameter, scale):
    """Normal quantiles sent backwards through the transform: the parameter is known."""
    normal = 6.0 + norm.ppf((np.arange(100_000) + 0.5) / 100_000)
    values = np.exp(normal) if parameter == 0 else (parameter * normal + 1.0) ** (1.0 / parameter)
    assert likeliest_box_cox(scale * values, 0.0) == pytest.approx(parameter, abs=1e-3)


def test_automatic_parameter_agrees_with_scipy():
    signal = np.random.default_rng(5).gamma(3.0, size=2000)
    assert likeliest_box_cox(signal, 0.0) == pytest.approx(boxcox(signal)[1], abs=1e-4)


def test_shift_is_zero_for_positive_signals_and_follows_the_unit():
    signal = np.random.default_rng(6).standard_normal(500)
    assert positive_shift(signal + 10.0) == 0.0
    assert positive_shift(1000.0 * signal) == pytest.approx(1000.0 * positive_shift(signal))
    other = signal - 20.0
    assert (other + positive_shift(signal, other)).min() > 0.0


def test_box_cox_that_cannot_be_applied_or_undone_is_refused():
    signal = np.linspace(0.0, 10.0, 50)
    with pytest.raises(InputError, match="sample 1: the output plus its shift"):
        box_cox(signal, 1.1, 0.0, "stationarity: box_cox")
    for parameter in (-40.0, 400.0):
        with pytest.raises(InputError, match="could not be transformed back"):
            box_cox(signal, parameter, 5.0)
    with pytest.raises(InputError, match="no parameter between"):
        likeliest_box_cox(np.append(np.full(5000, 1.0), 1.0 + 1e-3), 0.0)
