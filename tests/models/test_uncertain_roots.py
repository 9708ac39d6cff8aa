"""95 % ellipses of roots against random draws of the coefficients."""

import numpy as np
import pytest
from covariances import covariance_of_matrix

from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_roots import ellipse_outline

# Poles 0.95 exp(±0.6i) and 0.3, zeros 0.5 ± 0.5i, root of C 0.2.
A = np.real(np.poly([0.95 * np.exp(0.6j), 0.95 * np.exp(-0.6j), 0.3]))
B = np.array([1.0, -1.0, 0.5])
C = np.array([1.0, -0.2])
DEVIATION = 1e-4


def model(covariance):
    known = None if covariance is None else covariance_of_matrix(covariance)
    return PolynomialModel(A, B, C, nk=1, sampling_rate=50.0, noise_variance=1.0, covariance=known)


@pytest.mark.parametrize(("letter", "coefficients", "free"), [("a", A, 1), ("b", B, 0)])
def test_an_ellipse_covers_95_percent_of_the_estimates(letter, coefficients, free):
    generator = np.random.default_rng(3)
    draws, size = 4000, coefficients.size - free
    half = DEVIATION * np.tril(generator.normal(size=(size, size))) + DEVIATION * np.eye(size)
    covariance = np.eye(7) * 1e-8
    rows = slice(0, 3) if letter == "a" else slice(3, 6)
    covariance[rows, rows] = half @ half.T
    roots = model(covariance).uncertain_roots(letter)
    root, spread = max(roots, key=lambda each: each[0].imag)
    offsets = np.zeros(draws, dtype=complex)
    for draw in range(draws):
        changed = coefficients.copy()
        changed[free:] += half @ generator.normal(size=size)
        offsets[draw] = max(np.roots(changed), key=lambda value: value.imag) - root
    points = np.vstack([offsets.real, offsets.imag])
    distance = np.sum(points * np.linalg.solve(spread, points), axis=0)
    # Up to three standard errors of the share of 4000 draws.
    assert np.mean(distance < 5.9915) == pytest.approx(0.95, abs=0.0104)


def test_the_outline_is_that_of_the_covariance():
    covariance = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]) * 1e-8
    for root, spread in model(covariance).uncertain_roots("b"):
        offsets = ellipse_outline(root, spread) - np.array([[root.real], [root.imag]])
        form = np.sum(offsets * np.linalg.solve(spread, offsets), axis=0)
        np.testing.assert_allclose(form, 5.9915, rtol=1e-4)


def test_a_real_root_varies_on_the_real_axis():
    covariance = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 4.0]) * 1e-8
    ((root, spread),) = model(covariance).uncertain_roots("c")
    assert root == pytest.approx(0.2)
    # The root is -c, so its standard error is that of c, and 1.96 of them hold 95 %.
    reach = np.ptp(ellipse_outline(root, spread, 3601), axis=1)
    np.testing.assert_allclose(reach, [2 * 1.96 * 2e-4, 0.0], rtol=1e-4)
    np.testing.assert_allclose(spread, [[4e-8, 0.0], [0.0, 0.0]], atol=1e-20)


def test_without_a_covariance_nothing_is_known():
    for letter, count in (("a", 3), ("b", 2), ("c", 1)):
        roots = model(None).uncertain_roots(letter)
        assert len(roots) == count
        assert all(np.isnan(spread).all() for _, spread in roots)


def test_an_infinite_variance_is_not_known():
    covariance = np.diag([np.inf, 1e-8, 1e-8, 1e-8, 1e-8, 1e-8, 1e-8])
    assert all(np.isnan(spread).all() for _, spread in model(covariance).uncertain_roots("a"))
    assert all(np.isfinite(spread).all() for _, spread in model(covariance).uncertain_roots("b"))
