"""Constraints of models with several inputs: they hold exactly, at the lowest optimum."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.signal import lfilter

from evopem import SearchSettings, estimate
from evopem.config.constraints import Constraints, FixedPole
from evopem.errors import InputError
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.signals.recording import Recording, Segment

RATE = 20.0
SHORT = SearchSettings(objective="quadratic", evaluations=200)
F = (np.array([1.0, -1.6, 0.8]), np.array([1.0, -1.1, 0.6]))
B = (np.array([1.0, 0.4]), np.array([-0.7, 0.3]))
ORDERS = {"oe": {"nb": 2, "nf": 2, "nk": 1}, "armax": {"na": 2, "nb": 2, "nc": 1, "nk": 1}}


def recorded(samples, seed, noise=0.2):
    generator = np.random.default_rng(seed)
    u = 3.0 * generator.standard_normal((samples, 2)) * [1.0, 10.0]
    clean = sum(lfilter([0.0, *b], f, u[:, k]) for k, (b, f) in enumerate(zip(B, F, strict=True)))
    return u, clean + noise * clean.std() * generator.standard_normal(samples) + 5.0


def gains_of(model):
    return [b.sum() / (model.A.sum() * f.sum()) for b, f in zip(model.B, model.F, strict=True)]


def found_with(structure, constraints, seed=1, objective="quadratic", samples=500):
    u, y = recorded(samples, seed)
    settings = replace(SHORT, objective=objective)
    recording = Recording(u, y, RATE, input_names=("hot", "cold"))
    return estimate(
        recording,
        orders=ORDERS[structure],
        structure=structure,
        settings=settings,
        constraints=constraints,
        level=True,
    )


def problem_of(model, samples=500, seed=1):
    u, y = recorded(samples, seed)
    return PolynomialErrors([Segment(u, y)], model.orders, "quadratic", 0.9999, 0.9999, True)


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
@pytest.mark.parametrize("structure", ORDERS)
def test_static_gains_hold_exactly(structure, objective):
    constraints = Constraints(static_gain={"hot": 6.0}, static_gain_bounds={"cold": (None, -1.0)})
    found = found_with(structure, constraints, objective=objective)
    gains = gains_of(found.model)
    assert gains[0] == pytest.approx(6.0, rel=1e-9)
    assert gains[1] <= -1.0 + 1e-9
    assert {"static_gain", "static_gain_bounds"} <= set(found.constraints.active)
    assert found.constraints.objective > found.constraints.objective_without
    spread = found.model.frequency_response([0.0])  # the covariance knows of both gains
    assert np.allclose(spread[0, 0].real, gains, rtol=1e-6)


def test_the_optimum_with_a_given_gain_is_that_of_another_method():
    found = found_with("oe", Constraints(static_gain={"hot": 6.0}))
    errors = problem_of(found.model)
    part = errors.orders.part

    def gain(point):
        return point[part("b", 0)].sum() - 6.0 * (1.0 + point[part("f", 0)].sum())

    def squares(point):
        e, J = errors.residuals(point), errors.jacobian(point)
        if not np.isfinite(J).all():  # a step of the other method out of the stable region
            return 1e12, np.zeros(len(point))
        return e @ e, 2.0 * (J.T @ e)

    start = found.search.point
    other = minimize(
        squares,
        start,
        jac=True,
        method="SLSQP",
        constraints={"type": "eq", "fun": gain},
        options={"maxiter": 500, "ftol": 1e-14},
    )
    assert abs(gain(other.x)) < 1e-8
    assert squares(start)[0] <= squares(other.x)[0] * (1.0 + 1e-7)


@pytest.mark.parametrize(
    ("poles", "name"),
    [
        (Constraints(max_pole_radius=0.7), "max_pole_radius"),
        (Constraints(min_damping_ratio=0.5), "min_damping_ratio"),
        (Constraints(frequency_band=(2.8, 8.0)), "frequency_band"),
        (Constraints(forbidden_bands=((1.4, 2.4),)), "forbidden_bands"),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)
@pytest.mark.parametrize("structure", ORDERS)
def test_poles_keep_to_their_region(structure, poles, name):
    found = found_with(structure, poles)
    plants = found.model.F if structure == "oe" else (found.model.A,)
    z = np.concatenate([np.roots(plant) for plant in plants])
    s = np.log(z[z.imag > 1e-6]) * RATE  # two equal real poles part by rounding
    hertz, damping = np.abs(s) / (2.0 * np.pi), -s.real / np.abs(s)
    assert name in found.constraints.active
    assert found.search.diagnostics.n_confirming >= 1  # descents from elsewhere end there
    if name == "max_pole_radius":
        assert np.abs(z).max() <= 0.7 + 1e-9
    elif name == "min_damping_ratio":
        assert damping.min() >= 0.5 - 1e-9
    elif name == "frequency_band":
        assert hertz.min() >= 2.8 - 1e-9
    else:
        assert not np.any((hertz > 1.4 + 1e-9) & (hertz < 2.4 - 1e-9))
    assert found.constraints.objective > found.constraints.objective_without


def test_a_fixed_pole_is_a_pole():
    poles = Constraints(fixed_poles=(FixedPole(real=0.5),))
    found = found_with("armax", poles)
    assert np.abs(np.roots(found.model.A) - 0.5).min() < 1e-9


def test_constraints_that_are_met_change_nothing():
    free = found_with("oe", None)
    met = found_with("oe", Constraints(max_pole_radius=0.99))
    assert np.allclose(met.model.parameters, free.model.parameters, rtol=1e-7)
    assert met.constraints.active == ()


def test_the_covariance_is_that_of_least_squares_under_an_equality():
    found = found_with("armax", Constraints(static_gain={"hot": 6.0}))
    errors = problem_of(found.model)
    point, o = found.search.point, found.model.orders
    columns = errors.jacobian(point)
    # One direction is held, which leaves one number less to estimate.
    degrees = len(columns) - len(point)
    variance = found.model.noise_variance * degrees / (degrees + 1)
    free = variance * np.linalg.inv(columns.T @ columns)
    normal = np.zeros(len(point))
    normal[o.part("b", 0)] = 1.0
    normal[o.part("a")] = -6.0
    held = free - np.outer(free @ normal, free @ normal) / (normal @ free @ normal)
    own = found.model.parameter_standard_errors()
    expected = np.sqrt(np.diag(held))[: o.parameters]
    assert np.allclose(own, expected, rtol=1e-4)


@pytest.mark.parametrize(
    ("constraints", "key"),
    [
        (Constraints(static_gain={"warm": 1.0}), "static_gain"),
        (Constraints(max_pole_radius=1.5), "max_pole_radius"),
        (Constraints(fixed_poles=(FixedPole(real=0.5),)), "fixed_poles"),
    ],
    ids=["input", "radius", "which"],
)
def test_contradictions_are_refused(constraints, key):
    with pytest.raises(InputError) as refused:
        found_with("oe", constraints)
    assert refused.value.place == key
