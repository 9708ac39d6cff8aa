"""The function: its values, gradients and minima."""

import numpy as np
import pytest

from fletcher_powell.function import instance, wrap

NAMES = ["seed-1", "seed-2", "cec2005-f12"]


@pytest.fixture(params=NAMES)
def problem(request):
    if request.param.startswith("cec"):
        pytest.importorskip("optproblems")
    return instance(request.param, 7)


def points(problem, count=5, seed=0):
    return np.random.default_rng(seed).uniform(-4.0, 4.0, (count, problem.dimension))


def test_values_are_the_double_sum(problem):
    for x, value in zip(points(problem), problem.values(points(problem)), strict=True):
        total = 0.0
        for a, b in zip(problem.a, problem.b, strict=True):
            wanted = sum(a * np.sin(problem.alpha) + b * np.cos(problem.alpha))
            total += (wanted - sum(a * np.sin(x) + b * np.cos(x))) ** 2
        assert value == pytest.approx(total, rel=1e-12)


def test_the_published_instance_has_the_values_of_its_package():
    cec2005 = pytest.importorskip("optproblems.cec2005")
    ours = instance("cec2005-f12", 20)
    theirs = cec2005.F12(20)
    for x in points(ours):
        assert ours.values(x[None])[0] == pytest.approx(
            theirs.objective_function(list(x)) - theirs.bias, rel=1e-10
        )


def test_the_analytic_gradient_is_that_of_the_values(problem):
    x = points(problem)
    values, gradients = problem.values_and_gradients(x)
    assert values == pytest.approx(problem.values(x), rel=1e-13)
    step = 1e-5
    for j in range(problem.dimension):
        move = step * np.eye(problem.dimension)[j]
        central = (problem.values(x + move) - problem.values(x - move)) / (2 * step)
        assert gradients[:, j] == pytest.approx(central, rel=1e-5, abs=1e-3)


def test_the_residuals_and_their_derivatives_give_values_and_gradients(problem):
    x = points(problem)
    values, gradients = problem.values_and_gradients(x)
    for point, value, gradient in zip(x, values, gradients, strict=True):
        residuals = problem.residuals(point)
        assert residuals @ residuals == pytest.approx(value, rel=1e-12)
        exact = problem.jacobian(point)
        assert 2.0 * exact.T @ residuals == pytest.approx(gradient, rel=1e-10)
        assert problem.jacobian_by_differences(point) == pytest.approx(exact, abs=1e-4)


def test_differences_are_those_of_n_whole_evaluations(problem):
    x = points(problem)
    values, differences = problem.values_and_differences(x)
    step = np.sqrt(np.finfo(float).eps) * np.maximum(1.0, np.abs(x))
    for j in range(problem.dimension):
        moved = x.copy()
        moved[:, j] += step[:, j]
        plain = (problem.values(moved) - problem.values(x)) / (moved[:, j] - x[:, j])
        # Another order of summation moves a difference by some eps f / step.
        noise = 100 * np.finfo(float).eps * values / step[:, j]
        assert np.all(np.abs(differences[:, j] - plain) <= noise)


def test_the_minimum_is_zero_at_alpha_and_at_its_images(problem):
    image = problem.alpha + 2 * np.pi * np.array([1, -2, 0, 3, 0, 1, 0])
    assert problem.values(problem.alpha[None])[0] <= problem.precision
    assert problem.values(image[None])[0] < 1e-20
    assert wrap(image) == pytest.approx(problem.alpha, abs=1e-12)
    assert np.all(problem.values(points(problem, 100)) > 1.0)


def test_instances_differ_and_are_reproducible():
    first, again, other = instance("seed-1", 5), instance("seed-1", 5), instance("seed-2", 5)
    assert np.array_equal(first.a, again.a)
    assert np.array_equal(first.alpha, again.alpha)
    assert not np.array_equal(first.a, other.a)
    entries = np.concatenate([instance("seed-3", 100).a, instance("seed-3", 100).b])
    assert entries.min() == -100
    assert entries.max() == 100
    assert np.array_equal(entries, entries.round())


def test_an_unknown_instance_is_refused():
    with pytest.raises(ValueError, match="unknown instance"):
        instance("cec", 5)
