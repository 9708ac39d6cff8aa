"""Regularised impulse responses against dense Bayesian linear regression, and against truths."""

import numpy as np
import pytest
from scipy.linalg import block_diag, toeplitz
from scipy.optimize import approx_fprime, minimize
from scipy.signal import lfilter

from evopem import Constraints, Recording, SearchSettings, estimate
from evopem.errors import InputError
from evopem.estimation.impulse_response import KERNELS, Evidence, posterior
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.models.orders import Orders
from evopem.signals.recording import Segment

QUADRATIC = SearchSettings(objective="quadratic")
# Scale and time constant as logarithms, and of DC the Fisher transform of the correlation.
HYPER = {"TC": [5.0, 1.5], "DC": [4.0, 1.2, -0.7], "SS": [6.0, 2.5]}


def kernel_of(name, h, n):
    """The kernels as they are published, entry by entry, ``(λ, ρ)`` from the hyper-parameters."""
    c, decay = np.exp(h[0]), np.exp(-np.exp(-h[1]))
    p = np.zeros((n, n))
    for i in range(1, n + 1):
        for j in range(1, n + 1):
            last = max(i, j)
            if name == "TC":
                p[i - 1, j - 1] = c * decay**last
            elif name == "DC":
                p[i - 1, j - 1] = c * decay ** (0.5 * (i + j)) * np.tanh(h[2]) ** abs(i - j)
            else:
                p[i - 1, j - 1] = c * (decay ** (i + j + last) / 2 - decay ** (3 * last) / 6)
    return p


def dense_likelihood(x, y, p):
    """Minus twice the log-likelihood with the likeliest noise variance, but for a constant."""
    covariance = x @ p @ x.T + np.eye(len(y))
    quadratic = y @ np.linalg.solve(covariance, y)
    return len(y) * np.log(quadratic) + np.linalg.slogdet(covariance)[1]


def regression(samples=60, n=12, seed=1):
    generator = np.random.default_rng(seed)
    u = generator.standard_normal(samples + n)
    x = toeplitz(u[n - 1 :], u[n - 1 :: -1])
    b = 0.8 ** np.arange(n) * generator.standard_normal(n)
    y = x @ b + 0.5 * generator.standard_normal(len(x))
    return x / np.linalg.norm(x), y / np.linalg.norm(y)


@pytest.mark.parametrize("name", KERNELS)
def test_the_likelihood_is_that_of_the_dense_formula(name):
    x, y = regression()
    triangle = np.linalg.qr(np.column_stack([x, y]), mode="r")
    evidence = Evidence((triangle[:, :-1],), triangle[:, -1], len(y))
    h = np.array(HYPER[name])
    value, gradient = evidence.value_and_gradient(KERNELS[name], h)
    assert evidence.value(KERNELS[name], h) == value
    assert value == pytest.approx(dense_likelihood(x, y, kernel_of(name, h, 12)), rel=1e-10)
    differences = approx_fprime(h, lambda each: evidence.value(KERNELS[name], each), 1e-6)
    assert gradient == pytest.approx(differences, rel=1e-4, abs=1e-4)


def test_the_hyper_parameters_are_the_likeliest():
    """Nelder and Mead's method on the dense formula, from several points, finds nothing better."""
    for seed in range(3):
        x, y = regression(seed=seed)
        triangle = np.linalg.qr(np.column_stack([x, y]), mode="r")
        evidence = Evidence((triangle[:, :-1],), triangle[:, -1], len(y))
        reached = evidence.value(*evidence.likeliest())
        for name, start in HYPER.items():
            for scale in (0.0, 4.0, 8.0):
                found = minimize(
                    lambda h, x=x, y=y, name=name: dense_likelihood(x, y, kernel_of(name, h, 12)),
                    [scale, *start[1:]],
                    method="Nelder-Mead",
                    options={"maxfev": 150},
                )
                assert reached <= found.fun + 1e-3


@pytest.mark.parametrize("name", KERNELS)
def test_taps_are_those_of_bayesian_linear_regression(name, monkeypatch):
    """Two inputs, three segments of two recordings, each with a level, by N x N matrices."""
    generator = np.random.default_rng(4)
    orders = Orders("impulse", nb=(7, 5), nk=(1, 0))
    hyper = np.array([HYPER[name], [h + 0.3 for h in HYPER[name]]])
    monkeypatch.setattr(Evidence, "likeliest", lambda *_: (KERNELS[name], hyper.ravel()))
    segments = []
    for recording, samples in ((0, 40), (0, 25), (1, 30)):
        u = generator.standard_normal((samples, 2)) + 3.0
        y = lfilter([0.0, 2.0], [1.0, -0.7], u[:, 0]) + u[:, 1] + generator.standard_normal(samples)
        segments.append(Segment(u, y + 10.0 * recording, recording))
    found = posterior(PolynomialErrors(segments, orders, "quadratic", 0.99, 0.99, level=True))
    first = orders.first_residual
    rows, levels = [], []
    for each in segments:
        u1, u2 = each.inputs.T
        for t in range(first, each.samples):
            rows.append([*(u1[t - 1 - k] for k in range(7)), *(u2[t - k] for k in range(5))])
            levels.append([each.recording == 0, each.recording == 1])
    x, ones = np.array(rows), np.array(levels, float)
    y = np.concatenate([each.output[first:] for each in segments])
    rest = np.eye(len(y)) - ones @ np.linalg.pinv(ones)
    xc, yc = rest @ x, rest @ y
    units = [np.linalg.norm(part) / np.sqrt(part.shape[1]) for part in (xc[:, :7], xc[:, 7:])]
    p = block_diag(
        kernel_of(name, hyper[0], 7) / units[0] ** 2, kernel_of(name, hyper[1], 5) / units[1] ** 2
    )
    z = xc @ p @ xc.T + np.eye(len(y))
    b = p @ xc.T @ np.linalg.solve(z, yc)
    variance = yc @ np.linalg.solve(z, yc) / (len(y) - 2)
    covariance = variance * (p - p @ xc.T @ np.linalg.solve(z, xc @ p))
    hat = np.trace(np.linalg.solve(z, xc @ p @ xc.T))
    assert found.point[:12] == pytest.approx(b, rel=1e-8, abs=1e-10)
    assert found.point[12:] == pytest.approx(np.linalg.lstsq(ones, y - x @ b, rcond=None)[0])
    assert found.noise_variance == pytest.approx(variance)
    assert found.factor @ found.factor.T == pytest.approx(covariance, rel=1e-6, abs=1e-12)
    assert found.effective == pytest.approx(hat)


def response(n=60):
    return lfilter([1.0, 0.5], [1.0, -1.5, 0.75], np.eye(1, n)[0])


def record(seed, samples=200, colour=(1.0,), size=1.0):
    generator = np.random.default_rng(seed)
    u, e = generator.standard_normal((2, samples))
    y = lfilter(np.r_[0.0, response()], [1.0], u)
    v = lfilter([1.0], colour, e)
    return u, y + size * y.std() / v.std() * v


def test_a_decaying_truth_is_nearer_than_to_least_squares():
    truth, errors = response(), []
    for seed in range(12):
        u, y = record(seed, size=0.5)
        found = estimate(u, y, (60, 1), structure="impulse", settings=QUADRATIC, level=True)
        x = toeplitz(u[59:-1], u[59::-1])
        columns = np.column_stack([x, np.ones(len(x))])
        plain = np.linalg.lstsq(columns, y[60:], rcond=None)[0][:60]
        errors.append([np.sum((each - truth) ** 2) for each in (found.model.B[0], plain)])
    regularised, plain = np.mean(errors, axis=0)
    assert regularised < 0.35 * plain


@pytest.mark.parametrize("colour", [(1.0,), (1.0, -0.9)])
def test_standard_errors_are_those_of_repeated_records(colour):
    """Of the gain at a frequency, whose error is that of the noise at it: of any colour."""
    frequencies, deviations, errors = [0.02, 0.09], [], []
    truth = np.array([response() @ np.exp(-2j * np.pi * f * np.arange(60)) for f in frequencies])
    gradients = np.array([np.cos(2.0 * np.pi * f * np.arange(60)) for f in frequencies])
    for seed in range(40):
        u, y = record(seed, 600, colour)
        found = estimate(u, y, (60, 1), structure="impulse", settings=QUADRATIC, level=True).model
        errors.append(gradients @ found.B[0] - truth.real)
        deviations.append(found.covariance.standard_errors(gradients))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square(deviations), axis=0))
    assert np.all((ratio > 0.7) & (ratio < 1.35)), ratio


def test_a_noise_free_record_is_fitted_to_rounding():
    u, y = record(1, size=0.0)
    found = estimate(u, y, (60, 1), structure="impulse", settings=QUADRATIC).model
    assert found.B[0] == pytest.approx(response(), abs=1e-3)


def test_a_short_record_has_more_taps_than_residuals():
    u, y = record(3, 100, size=0.3)
    found = estimate(u, y, (60, 1), structure="impulse", settings=QUADRATIC).model
    assert np.linalg.norm(found.B[0] - response()) < 0.5 * np.linalg.norm(response())
    with pytest.raises(ValueError, match="needs more"):
        estimate(u[:60], y[:60], (60, 1), structure="impulse", settings=QUADRATIC)


def test_what_a_prior_cannot_hold_is_refused():
    u, y = record(1)
    with pytest.raises(InputError, match="a prior of its own"):
        estimate(u, y, (20, 1), structure="impulse", constraints=Constraints(static_gain=1.0))


def test_segments_and_recordings_are_taken_together():
    u, y = record(2, 400, size=0.2)
    both = Recording(
        u, np.r_[y[:150], y[150:] + 20.0], 1.0, segment_starts=(0, 150), segment_recordings=(0, 1)
    )
    found = estimate(both, orders=(40, 1), structure="impulse", settings=QUADRATIC, level=True)
    assert np.diff(found.levels)[0] == pytest.approx(20.0, abs=0.5)
    assert np.linalg.norm(found.model.B[0] - response(40)) < 0.3 * np.linalg.norm(response(40))
