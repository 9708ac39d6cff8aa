"""Periods of signals; best linear approximations against closed forms and a public package."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.models.polynomial import PolynomialModel
from evopem.signals.best_linear_approximation import (
    best_linear_approximation,
    excited_lines,
    interpolated_lines,
    period_of,
    realisations_of,
    same_realisation,
    spectra_of_periods,
)
from evopem.signals.recording import Recording, concatenated
from evopem.signals.spectra import line_weights
from evopem.validation.distortion import distortion_of
from evopem.validation.responses import stretches_of

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
    assert realisations_of(signal[:, None]) == (0, [])


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("periods", [2, 3, 5])
def test_realisations_that_follow_each_other_are_found(noise, periods):
    generator = np.random.default_rng(11)
    length = periods * PERIOD
    made = [np.tile(multisine(generator), periods) for _ in range(3)]
    u = np.concatenate([*made, made[0][: PERIOD + 5]])
    u += noise * np.std(u) * generator.standard_normal(len(u))
    period, found = realisations_of(np.column_stack([u, -u])[5:])
    assert (period, len(found)) == (PERIOD, 3 if periods > 2 else 2)
    for k, part in enumerate(found[-2:], start=1):
        assert abs(part.start + 5 - k * length) <= 1
        assert abs(part.stop + 5 - (k + 1) * length) <= 1


@pytest.mark.parametrize("pole", [0.998 * np.exp(0.3j), 0.999, 0.9])
def test_noise_is_no_sequence_of_realisations(pole):
    for seed in range(20):
        white = np.random.default_rng(seed).standard_normal(3000)
        noise = lfilter([1.0], np.real(np.poly([pole, np.conj(pole)])), white)
        assert realisations_of(noise[:, None]) == (0, [])


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


def periods_of_a_limiter():
    """Input and output (4, 3, T): realisations, periods, samples; noise without mean."""
    generator = np.random.default_rng(9)
    signals = np.stack([np.tile(multisine(generator), 3) for _ in range(4)])
    u = signals.reshape(4, 3, PERIOD)
    noise = 0.01 * generator.standard_normal(u.shape)
    return u, np.tanh(0.3 * u) + noise - noise.mean(axis=2, keepdims=True)


# Of these periods by the package best-linear-approximation 0.1.1, which Python 3.11 does not have,
# at each line: the gain and variances of it by noise and distortion, and by noise.
BY_THE_PACKAGE = np.array(
    [
        [
            (0.1917604443313403 + 0.01206557706056458j),
            0.0002535765808865551,
            1.9184992725831084e-07,
        ],
        [
            (0.17455791874719417 + 0.00222700339261518j),
            0.00010186109720842883,
            1.4039764598197424e-07,
        ],
        [
            (0.18288962138694118 + 0.0009672279979254764j),
            6.830124941917636e-05,
            9.07939633833133e-08,
        ],
        [
            (0.17710687106862794 - 0.006930648304526542j),
            0.00011556110645653255,
            6.250319442375912e-08,
        ],
        [
            (0.18710045350941742 - 0.006727908896322641j),
            0.0001320927091045467,
            1.1967019322676766e-07,
        ],
        [
            (0.18330099354671148 + 0.00936372778691465j),
            0.0001529427414486296,
            1.5146795422125502e-07,
        ],
    ]
)


def test_the_numbers_of_the_package_best_linear_approximation():
    """Also with distortion separated from noise by all steps from recordings on."""
    u, y = periods_of_a_limiter()
    spectra = [np.fft.rfft(each, axis=2)[:, :, LINES, None] / PERIOD for each in (u, y)]
    response, total = best_linear_approximation(*spectra)
    power = np.mean(np.abs(spectra[0]) ** 2, axis=(0, 1))[:, 0]
    gain, both, noise = BY_THE_PACKAGE.T
    np.testing.assert_allclose(response[:, 0, 0], gain, rtol=1e-10)
    np.testing.assert_allclose(total[:, 0] / power / 4.0, both.real, rtol=1e-10)
    # With a period before, of which the first samples are not scored.
    whole = (np.concatenate([x[:, :1], x], axis=1).reshape(4, -1) for x in (u, y))
    recordings = [Recording(*pair, 1.0) for pair in zip(*whole, strict=True)]
    model = PolynomialModel(A=[1.0], B=[0.2])
    found = distortion_of(stretches_of(model, concatenated(recordings)), (), False)
    assert (found.period, found.periods, found.realisations) == (PERIOD, 3, 4)
    (levels,) = found.levels
    np.testing.assert_allclose(np.square(levels.noise), noise.real, rtol=1e-10)
    np.testing.assert_allclose(np.square(levels.distortion), (both - noise).real, rtol=1e-10)


def test_they_are_its_numbers():
    package = pytest.importorskip("best_linear_approximation")
    u, y = periods_of_a_limiter()
    one = np.moveaxis(u[:, :1], 2, 0)[:, None, :, 0]
    theirs = package.robust.known_input(
        one, np.moveaxis(y, 2, 0)[:, None], 1.0, LINES, show_warnings=False
    ).G
    found = [theirs.value, theirs.total.var, theirs.noise.var]
    np.testing.assert_allclose(np.ravel(found).reshape(3, -1).T, BY_THE_PACKAGE, rtol=1e-10)
