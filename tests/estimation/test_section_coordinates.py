"""Descents in the sections' own coordinates, along the edge of the stability region."""

import numpy as np
import pytest

from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.pem.kernels.polynomials import products_of_sections
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.prediction_errors import prediction_errors, scaled_errors
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.root_sections import in_sections
from evopem.models.orders import armax_orders, orders_of
from evopem.signals.recording import Segment
from evopem.synthesis import armax

RADIUS = 0.9999


def armax_problem(objective="quadratic", orders=(5, 5, 5, 3)):
    record = armax(seed=2, samples=400)[0]
    given = (record.segments, armax_orders(*orders), objective, RADIUS, RADIUS, False)
    return PolynomialProblem(PolynomialErrors(*given, ScoringWindow(20, 40)))


def box_jenkins(objective="quadratic"):
    record = armax(seed=2, samples=400)[0]
    settings = SearchSettings(objective=objective)
    orders = orders_of("bj", (4, 3, 2, 5, 3))
    window = ScoringWindow(20, 40)
    return PolynomialProblem(
        scaled_errors(prediction_errors(record, orders, settings, window, False))[0]
    )


def joined(objective="quadratic"):
    record = armax(seed=2, samples=400)[0]
    parts = [slice(0, 150), slice(150, None)]
    stretches = [Segment(record.input[part], record.output[part], 0) for part in parts]
    orders = orders_of("oe", (4, 4, 3))
    window = ScoringWindow(10, 20)
    return PolynomialProblem(
        PolynomialErrors(stretches, orders, objective, RADIUS, RADIUS, True, window)
    )


@pytest.mark.parametrize("order", [1, 2, 5, 6])
def test_products_of_sections_are_those_of_numpy(order):
    generator = np.random.default_rng(order)
    reflections = generator.uniform(-1.0, 1.0, (3, order))
    coefficients, derivatives = products_of_sections(reflections, 0.9)
    for row, own in zip(coefficients, reflections, strict=True):
        product = np.ones(1)
        for one, two in own[: order - order % 2].reshape(-1, 2):
            product = np.convolve(product, [1.0, 0.9 * one * (1.0 + two), 0.81 * two])
        if order % 2:
            product = np.convolve(product, [1.0, 0.9 * own[-1]])
        np.testing.assert_allclose(row, product[1:], atol=1e-14)
        assert np.max(np.abs(np.roots(product))) <= 0.9 * (1.0 + 1e-9)
    for j in range(order):
        moved = reflections.copy()
        moved[:, j] += 1e-6
        change = (products_of_sections(moved, 0.9)[0] - coefficients) / 1e-6
        np.testing.assert_allclose(derivatives[:, :, j], change, atol=1e-8)


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
@pytest.mark.parametrize("made", [armax_problem, box_jenkins, joined])
def test_values_and_slopes_are_those_of_the_coefficients(made, objective):
    searched = made(objective)
    points = searched.descend(searched.random(3, np.random.default_rng(4))).points
    sections = in_sections(searched.errors)
    at = sections.coordinates.of_points(points)
    np.testing.assert_allclose(sections.values(at), searched.values(points), rtol=1e-3)
    smoothing = searched.errors.mean_absolute_residuals(searched.values(points))
    values, gradients = sections.values_and_gradients(at, smoothing, smoothing)
    for j in range(at.shape[1]):
        step = np.zeros_like(at)
        step[:, j] = 2e-7
        above = sections.values_and_gradients(at + step, smoothing, smoothing)[0]
        below = sections.values_and_gradients(at - step, smoothing, smoothing)[0]
        scale = np.maximum(np.abs(gradients[:, j]), values)
        np.testing.assert_allclose(
            (above - below) / 4e-7 / scale, gradients[:, j] / scale, atol=2e-4
        )
    matrices = sections.curvatures(at, smoothing, smoothing)
    rounding = 1e-9 * np.max(np.abs(matrices))
    np.testing.assert_allclose(matrices, np.swapaxes(matrices, 1, 2), atol=rounding)


@pytest.mark.parametrize("made", [armax_problem, box_jenkins, joined])
def test_a_descent_in_sections_never_leads_up_nor_out(made):
    searched = made()
    begun = searched.descend(searched.random(4, np.random.default_rng(7)))
    ended = searched.descend_in_sections(begun.points)
    assert np.all(ended.values <= begun.values)
    np.testing.assert_array_equal(searched.values(ended.points), ended.values)
    assert np.all(searched.errors.feasible(ended.points))


def test_a_descent_goes_on_where_two_roots_lie_on_the_edge_at_one_place():
    """Each of two equal pairs of zeros of C has to go its own way along the edge."""
    searched = armax_problem(orders=(6, 6, 6, 3))
    c = searched.errors.parts["c"]
    points = searched.descend(searched.random(4, np.random.default_rng(7))).points
    pair = np.array([1.0, -2.0 * 0.99989 * np.cos(1.5), 0.99989**2])
    points[:, c] = np.convolve(np.convolve(pair, pair), [1.0, 0.0, 0.0])[1:]
    in_coefficients = searched.polish(points)
    in_sections = searched.descend_in_sections(points)
    assert np.median(in_sections.values / in_coefficients.values) < 1.0
