"""Periods of signals; best linear approximations against closed forms and a public package."""

import numpy as np
import pytest

from evopem.signals.best_linear_approximation import (
    best_linear_approximation,
    excited_lines,
    interpolated_lines,
    line_weights,
    period_of,
    same_realisation,
    spectra_of_periods,
)

PERIOD, LINES = 64, np.array([3, 5, 6, 9, 14, 20])


def multisine(generator, period=PERIOD, lines=LINES):
    spectrum = np.zeros(period // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(2j * np.pi * generator.uniform(size=len(lines)))
    return np.fft.irfft(spectrum, period) * period


@pytest.mark.parametrize("noise", [0.0, 0.03])
@pytest.mark.parametrize("lines", [LINES, np.array([1, 3, 7, 11])])
def test_the_period_of_all_inputs_is_found(noise, lines):
    generator = np.random.default_rng(3)
    u = np.tile(multisine(generator, lines=lines), 4)
    u += noise * np.std(u) * generator.standard_normal(len(u))
    both = np.column_stack([u, np.roll(u, 5)])
    assert period_of(u[:, None]) == period_of(both) == PERIOD
    assert period_of(u[: 2 * PERIOD, None]) == PERIOD
    assert period_of(u[: 2 * PERIOD - 1, None]) == 0


@pytest.mark.parametrize(
    "signal",
    [
        np.zeros(300),
        np.random.default_rng(0).standard_normal(300),
        np.sin(2.0 * np.pi * np.arange(800) / 50.4),  # between two numbers of samples
        np.tile(np.random.default_rng(1).standard_normal(40), 5) * np.linspace(1.0, 2.0, 200),
    ],
)
def test_what_does_not_repeat_has_no_period(signal):
    assert period_of(signal[:, None]) == 0


def test_the_power_of_lines_is_that_of_the_signal():
    generator = np.random.default_rng(2)
    for period in (64, 63):
        x = np.tile(generator.standard_normal(period), 3)
        spectra = spectra_of_periods(np.r_[[7.0], x][:, None], period)
        power = line_weights(period) @ np.abs(spectra[:, :, 0].T) ** 2
        np.testing.assert_allclose(power, np.mean(x**2), rtol=1e-12)


def test_lines_with_power_are_told_from_those_with_little():
    generator = np.random.default_rng(4)
    u = multisine(generator) + 0.02 * generator.standard_normal(PERIOD)
    excited = excited_lines(spectra_of_periods(u[:, None], PERIOD))
    np.testing.assert_array_equal(np.flatnonzero(excited), LINES)


def test_a_shifted_or_negative_period_is_no_other_realisation():
    generator = np.random.default_rng(5)
    first, other = (spectra_of_periods(multisine(generator)[:, None], PERIOD)[0] for _ in range(2))
    u = multisine(np.random.default_rng(5))
    again = spectra_of_periods(-np.roll(u, 11)[:, None], PERIOD)[0]
    assert same_realisation(first, again, PERIOD)
    assert not same_realisation(first, other, PERIOD)


def test_interpolation_between_lines():
    known, others = np.zeros((2, 12), dtype=bool)
    known[[2, 6, 10]], others[[1, 3, 6, 9, 11]] = True, True
    values = np.zeros(12)
    values[[2, 6, 10]] = 1.0, 5.0, 3.0
    found = interpolated_lines(known, others) @ values
    np.testing.assert_allclose(found[others], [1.0, 2.0, 5.0, 3.5, 3.0])
    assert not found[~others].any()


def realisations(generator, inputs=1, count=4, periods=3):
    """Spectra (M, P, E, channels) of inputs of equal power, and of outputs with noise."""

    def normal(*shape):
        return generator.standard_normal(shape) + 1j * generator.standard_normal(shape)

    lines = len(LINES)
    phases = generator.uniform(size=(count, 1, lines, inputs))
    u = np.exp(2j * np.pi * phases) + np.zeros((1, periods, 1, 1))
    gain = normal(lines, 2, inputs)
    y = np.einsum("elm,rpem->rpel", gain, u) + 0.3 * normal(count, 1, lines, 2)
    return u, y + 0.1 * normal(count, periods, lines, 2)


def test_against_the_definitions_of_the_robust_method():
    u, y = realisations(np.random.default_rng(6))
    response, variances = best_linear_approximation(u, y)
    of_period = y / u
    of_realisation = of_period.mean(axis=1)
    total = of_realisation.var(axis=0, ddof=1)
    np.testing.assert_allclose(response[..., 0], of_realisation.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(variances, total, rtol=1e-12)


def test_one_realisation_has_no_total_variance():
    u, y = realisations(np.random.default_rng(7), count=1)
    response, variances = best_linear_approximation(u, y)
    np.testing.assert_allclose(response[..., 0], (y / u)[0].mean(axis=0), rtol=1e-12)
    assert np.isnan(variances).all()


def test_the_variance_of_two_inputs_is_the_one_that_is_found():
    generator = np.random.default_rng(8)
    found = [best_linear_approximation(*realisations(generator, inputs=2)) for _ in range(300)]
    total = np.mean([total for _, total in found])
    assert total == pytest.approx(2 * 0.3**2 + 2 * 0.1**2 / 3, rel=0.05)


def test_against_the_package_best_linear_approximation():
    package = pytest.importorskip("best_linear_approximation")
    generator = np.random.default_rng(9)
    signals = np.stack([np.tile(multisine(generator), 3) for _ in range(4)])
    u = signals.reshape(4, 3, PERIOD)
    y = np.tanh(0.3 * signals).reshape(u.shape) + 0.01 * generator.standard_normal(u.shape)
    one = np.moveaxis(u[:, :1], 2, 0)[:, None, :, 0]
    theirs = package.robust.known_input(
        one, np.moveaxis(y, 2, 0)[:, None], 1.0, LINES, show_warnings=False
    ).G
    spectra = [np.fft.rfft(each, axis=2)[:, :, LINES, None] / PERIOD for each in (u, y)]
    response, total = best_linear_approximation(*spectra)
    np.testing.assert_allclose(response, theirs.value, rtol=1e-10)
    power = np.mean(np.abs(spectra[0]) ** 2, axis=(0, 1))[:, 0]
    np.testing.assert_allclose(total[:, 0] / power / 4.0, theirs.total.var[..., 0, 0], rtol=1e-10)
