"""Estimates of every structure: known truths, an independent solver, standard errors."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.stats import chi2
from simulated_records import polynomial_record

from evopem import SearchSettings, estimate
from evopem.models.polynomial import PolynomialModel

QUADRATIC = SearchSettings(objective="quadratic")
SHORT = SearchSettings(objective="quadratic", evaluations=1)
ONE = np.ones(1)
RESONANT = np.poly([0.92 * np.exp(0.6j), 0.92 * np.exp(-0.6j)]).real
DAMPED = np.poly([0.8 * np.exp(1.5j), 0.8 * np.exp(-1.5j)]).real
COLOUR = np.array([1.0, 0.5, 0.2])
B = np.array([1.0, 0.6])

TRUTHS = {
    "fir": PolynomialModel(ONE, np.array([1.0, -0.4, 0.2]), ONE, ONE, ONE, 1),
    "arx": PolynomialModel(RESONANT, B, ONE, ONE, ONE, 1),
    "arma": PolynomialModel(RESONANT, np.empty(0), COLOUR, ONE, ONE, 0),
    "armax": PolynomialModel(RESONANT, B, COLOUR, ONE, ONE, 1),
    "ararx": PolynomialModel(RESONANT, B, ONE, DAMPED, ONE, 1),
    "ararmax": PolynomialModel(RESONANT, B, COLOUR, DAMPED, ONE, 1),
    "oe": PolynomialModel(ONE, B, ONE, ONE, np.convolve(RESONANT, DAMPED), 1),
    "bj": PolynomialModel(ONE, B, COLOUR, DAMPED, RESONANT, 1),
    "general": PolynomialModel(np.array([1.0, -0.5]), B, COLOUR, ONE, RESONANT, 1),
}


def record(structure, samples, seed, noise_percent=20.0):
    generator = np.random.default_rng(seed)
    return polynomial_record(TRUTHS[structure], samples, noise_percent, generator)


def estimated(structure, samples=1500, seed=1, settings=QUADRATIC, **others):
    u, y, variance = record(structure, samples, seed)
    found = estimate(
        None if structure == "arma" else u,
        y,
        TRUTHS[structure].orders,
        structure=structure,
        settings=settings,
        **others,
    )
    return found, u, y, variance


@pytest.mark.parametrize("structure", [name for name in TRUTHS if name != "armax"])
def test_every_structure_finds_its_truth(structure):
    found, _, _, variance = estimated(structure)
    errors = found.model.parameters - TRUTHS[structure].parameters
    # Mahalanobis distance: chi-square with n degrees of freedom.
    distance = errors @ np.linalg.solve(found.model.covariance, errors)
    assert distance < chi2.ppf(0.999, len(errors))
    assert found.model.noise_variance == pytest.approx(variance, rel=0.15)
    assert found.search.diagnostics.n_confirming >= 1
    assert found.model.structure == structure


@pytest.mark.parametrize("structure", [name for name in TRUTHS if name != "armax"])
def test_no_independent_least_squares_solution_is_lower(structure):
    """Residuals by SciPy's filters, solved by SciPy from the truth: no code is shared."""
    found, u, y, _ = estimated(structure, samples=600)
    truth, o = TRUTHS[structure], TRUTHS[structure].orders
    first = found.window.residual_start
    sizes = np.cumsum([o.na, o.single.nb, o.nc, o.nd, o.single.nf, o.single.nf])
    weights = np.concatenate([np.full(o.single.nf, 1e-3), np.full(o.noise_states, 1e-1)])

    def residuals(point):
        a, b, c, d, f, plant, noise = np.split(point, sizes)
        a, c, d, f = (np.concatenate([ONE, part]) for part in (a, c, d, f))
        through_b = (
            lfilter(np.concatenate([np.zeros(o.single.nk), b]), ONE, u) if o.single.nb else 0.0 * u
        )
        x = -through_b[first:]
        x[: o.single.nf] += plant
        v = lfilter(a, ONE, y)[first:] + lfilter(ONE, f, x)
        v = lfilter(d, ONE, v)
        v[: o.noise_states] += noise
        states = np.concatenate([plant, noise])
        return np.concatenate([lfilter(ONE, c, v), weights * states])

    start = np.concatenate([truth.parameters, np.zeros(o.single.nf + o.noise_states)])
    solved = least_squares(residuals, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac")
    value = 100.0 * 2.0 * solved.cost / np.sum(y[first:] ** 2)
    assert found.search.value <= value * (1.0 + 1e-6)


@pytest.mark.parametrize("structure", ["oe", "bj"])
def test_errors_have_the_size_that_the_covariance_says(structure):
    """Squared errors of 40 records, in units of the estimated covariance."""
    records = 40
    n = len(TRUTHS[structure].parameters)
    distances, covered = [], []
    for seed in range(records):
        found, _, _, _ = estimated(structure, samples=1000, seed=100 + seed, settings=SHORT)
        errors = found.model.parameters - TRUTHS[structure].parameters
        distances.append(errors @ np.linalg.solve(found.model.covariance, errors))
        deviations = np.sqrt(np.diag(found.model.covariance))
        covered.append(np.abs(errors) <= 1.96 * deviations)
    # The sum is chi-square with 40 n degrees of freedom where the covariance is right.
    low, high = chi2.ppf([0.0005, 0.9995], records * n)
    assert low < np.sum(distances) < high
    assert 0.9 < np.mean(covered) < 0.99


def test_the_absolute_objective_resists_outliers():
    u, y, _ = record("oe", 1500, 3, noise_percent=5.0)
    generator = np.random.default_rng(7)
    y[generator.integers(0, len(y), 75)] += 10.0 * np.std(y) * generator.standard_normal(75)
    orders, truth = TRUTHS["oe"].orders, TRUTHS["oe"].parameters
    errors = [
        np.linalg.norm(
            estimate(
                u, y, orders, structure="oe", settings=SearchSettings(objective=objective)
            ).model.parameters
            - truth
        )
        for objective in ("absolute", "quadratic")
    ]
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize("structure", ["oe", "bj", "arx", "armax"])
def test_a_level_is_found_whatever_the_signals_means(structure):
    u, y, _ = record(structure, 1500, 5)
    orders = TRUTHS[structure].orders
    without = estimate(u, y, orders, structure=structure, settings=QUADRATIC, level=True)
    model = without.model
    gain = np.sum(model.B[0]) / np.sum(model.plant_denominator)
    shifted = estimate(
        u + 3.0, y - 7.0, orders, structure=structure, settings=QUADRATIC, level=True
    )
    np.testing.assert_allclose(shifted.model.parameters, model.parameters, atol=1e-3)
    assert shifted.model.output_level == pytest.approx(
        model.output_level - 7.0 - 3.0 * gain, abs=0.05
    )


def test_the_scale_of_the_signals_scales_the_model_bit_by_bit():
    u, y, _ = record("oe", 800, 2)
    orders = TRUTHS["oe"].orders
    one = estimate(u, y, orders, structure="oe", settings=QUADRATIC).model
    other = estimate(2.0**40 * u, 2.0**-30 * y, orders, structure="oe", settings=QUADRATIC).model
    np.testing.assert_array_equal(one.F[0], other.F[0])
    np.testing.assert_array_equal(one.B[0] * 2.0**-70, other.B[0])


def test_the_armax_structure_is_estimated_as_without_naming_it():
    u, y, _ = record("armax", 800, 2)
    named = estimate(u, y, {"na": 2, "nb": 2, "nc": 2, "nk": 1}, structure="armax")
    np.testing.assert_array_equal(
        named.model.parameters, estimate(u, y, (2, 2, 2, 1)).model.parameters
    )


@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
def test_a_record_without_noise_gives_its_model(objective):
    u = np.random.default_rng(1).standard_normal(60)
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.2, 0.7], u)
    found = estimate(u, y, (2, 2, 1), structure="oe", settings=SearchSettings(objective=objective))
    np.testing.assert_allclose(found.model.parameters, [1.0, 0.5, -1.2, 0.7], atol=1e-6)


@pytest.mark.parametrize(("orders", "expected"), [({"nc": 1}, 0.5), ({"na": 1}, -0.5)])
def test_a_noise_model_may_have_one_polynomial(orders, expected):
    e = np.random.default_rng(1).standard_normal(2000)
    y = lfilter([1.0, 0.5], [1.0], e) if "nc" in orders else lfilter([1.0], [1.0, -0.5], e)
    found = estimate(None, y, orders, structure="arma", settings=QUADRATIC)
    assert found.model.parameters == pytest.approx([expected], abs=0.07)


def test_an_input_of_zeros_has_no_effect():
    y = np.random.default_rng(1).standard_normal(300)
    found = estimate(np.zeros(300), y, (2, 1, 1), structure="oe", settings=QUADRATIC)
    np.testing.assert_array_equal(found.model.B[0], 0.0)


def test_the_record_is_not_modified():
    u, y, _ = record("bj", 400, 2)
    before = u.copy(), y.copy()
    estimate(u, y, TRUTHS["bj"].orders, structure="bj", level=True)
    np.testing.assert_array_equal((u, y), before)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"input": None}, "needs an input"),
        ({"orders": {"nb": 40, "nf": 40}}, "needs more than 120 residuals"),
        ({"output": np.zeros(100)}, "zero throughout"),
        ({"output": np.ones(90)}, "one length"),
        ({"output": np.full(100, np.nan)}, "must be finite"),
        ({"settings": SearchSettings(max_root_radius=1.0)}, "between 0 and 1"),
        ({"structure": "state space"}, "structure must be one of"),
        ({"structure": ["oe"]}, "structure must be a name"),
        ({"settings": {"seed": 1}}, "settings must be SearchSettings"),
        ({"settings": SearchSettings(refine="oldest")}, "refine must be one of"),
    ],
)
def test_bad_arguments_are_named(changes, message):
    u, y = np.random.default_rng(1).standard_normal((2, 100))
    arguments = {"input": u, "output": y, "orders": {"nb": 1, "nf": 1}, "structure": "oe"}
    with pytest.raises(ValueError, match=message):
        estimate(**(arguments | changes))
