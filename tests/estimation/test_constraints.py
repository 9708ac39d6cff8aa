"""Constraints: they hold exactly, cost nothing where they are met, and leave honest intervals."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter
from simulated_records import polynomial_record

from evopem import Constraints, FixedPole, Prior, SearchSettings, estimate
from evopem.errors import InputError
from evopem.files.json_form import from_json, to_json
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_roots import max_root_radius

QUADRATIC = SearchSettings(objective="quadratic")
SHORT = SearchSettings(objective="quadratic", evaluations=0)
FS = 50.0
ONE = np.ones(1)
RESONANT = np.poly([0.92 * np.exp(0.6j), 0.92 * np.exp(-0.6j)]).real
COLOUR = np.array([1.0, 0.5, 0.2])
B = np.array([1.0, 0.6])
# One mode of 4.82 Hz and damping 0.138, pole radius 0.92, static gain 4.88.
TRUTH = PolynomialModel(ONE, B, COLOUR, ONE, RESONANT, 1, FS)
GAIN = float(B.sum() / RESONANT.sum())
MODE = TRUTH.modes()[0]
ORDERS = (2, 2, 0, 2, 1)


def record(seed=1, samples=600, truth=TRUTH):
    u, y, _ = polynomial_record(truth, samples, 20.0, np.random.default_rng(seed))
    return u, y


def constrained(constraints, u=None, y=None, **others):
    if y is None:
        u, y = record()
    options = {"structure": "bj", "settings": QUADRATIC} | others
    orders = options.pop("orders", ORDERS)
    return estimate(u, y, orders, sampling_rate=FS, constraints=constraints, **options)


@pytest.fixture(scope="module")
def free():
    return constrained(Constraints())


def static_gain(model):
    return float(model.B[0].sum() / model.plant_denominator.sum())


def damping(model):
    return min((mode.damping_ratio for mode in model.modes()), default=1.0)


HARD = {
    "max_pole_radius": (
        Constraints(max_pole_radius=0.85),
        Constraints(max_pole_radius=0.99),
        lambda model: np.max(np.abs(model.poles())) <= 0.85 + 1e-9,
    ),
    "min_damping_ratio": (
        Constraints(min_damping_ratio=0.25),
        Constraints(min_damping_ratio=0.02),
        lambda model: damping(model) >= 0.25 - 1e-9,
    ),
    "frequency_band": (
        Constraints(frequency_band=(6.0, 12.0)),
        Constraints(frequency_band=(3.0, 6.0)),
        lambda model: all(6.0 - 1e-6 <= m.frequency_hz <= 12.0 + 1e-6 for m in model.modes()),
    ),
    "forbidden_bands": (
        Constraints(forbidden_bands=((4.0, 5.5),)),
        Constraints(forbidden_bands=((8.0, 9.0), (1.0, 2.0))),
        lambda model: not any(4.0 + 1e-6 < m.frequency_hz < 5.5 - 1e-6 for m in model.modes()),
    ),
    "static_gain": (
        Constraints(static_gain=4.0),
        None,
        lambda model: math.isclose(static_gain(model), 4.0, rel_tol=1e-12),
    ),
    "static_gain_bounds": (
        Constraints(static_gain_bounds=(None, 4.0)),
        Constraints(static_gain_bounds=(1.0, 9.0)),
        lambda model: static_gain(model) <= 4.0 * (1.0 + 1e-12),
    ),
    "static_gain_bounds, both": (
        Constraints(static_gain_bounds=(5.5, 6.0)),
        Constraints(static_gain_bounds=(1.0, None)),
        lambda model: 5.5 * (1.0 - 1e-12) <= static_gain(model) <= 6.0 * (1.0 + 1e-12),
    ),
    "fixed_coefficients": (
        Constraints(fixed_coefficients={"f1": -1.4, "b0": 0.8, "c2": 0.0}),
        None,
        lambda model: (model.F[0][1], model.B[0][0], model.C[2]) == (-1.4, 0.8, 0.0),
    ),
    "fixed_poles": (
        Constraints(fixed_poles=(FixedPole(frequency_hz=5.0, damping_ratio=0.1),)),
        None,
        lambda model: np.allclose(
            [model.modes()[0].frequency_hz, model.modes()[0].damping_ratio], [5.0, 0.1], rtol=1e-9
        ),
    ),
}


@pytest.mark.parametrize("key", HARD)
def test_a_truth_that_violates_a_constraint_yields_a_model_that_meets_it(key):
    violated, _, met_by = HARD[key]
    found = constrained(violated)
    assert met_by(found.model)
    effect = found.constraints
    assert effect.objective > effect.objective_without * 1.01
    assert any(name.startswith(key.split(",")[0]) for name in effect.active)
    assert found.search.diagnostics.n_confirming >= 1
    assert np.all(np.isfinite(found.model.covariance.matrix))


@pytest.mark.parametrize("key", [key for key, (_, met, _) in HARD.items() if met is not None])
def test_a_constraint_that_the_truth_meets_changes_nothing(key):
    met = HARD[key][1]
    u, y = record()
    free = estimate(u, y, ORDERS, sampling_rate=FS, structure="bj", settings=QUADRATIC)
    found = constrained(met, u, y)
    np.testing.assert_array_equal(found.model.parameters, free.model.parameters)
    assert found.constraints.objective == found.constraints.objective_without
    assert found.constraints.active == ()
    np.testing.assert_allclose(found.model.covariance, free.model.covariance, rtol=1e-6)


def test_a_pole_at_a_bound_is_where_an_independent_minimiser_puts_it():
    """SciPy's SLSQP on simulation errors by SciPy's filters: no code is shared."""
    from scipy.optimize import minimize

    u, y = record(truth=PolynomialModel(ONE, B, ONE, ONE, RESONANT, 1, FS))
    found = constrained(
        Constraints(max_pole_radius=0.88, static_gain_bounds=(None, 5.0)),
        u,
        y,
        structure="oe",
        orders=(2, 2, 1),
    )

    def cost(x):
        if max_root_radius(x[2:4]) > 0.99:
            return 1e3
        simulated = lfilter(np.r_[0.0, x[:2]], np.r_[1.0, x[2:4]], u)[2:]
        # The state before the first residual, by its own least squares.
        impulse = np.zeros(len(u) - 2)
        impulse[0] = 1.0
        column = lfilter([1.0], np.r_[1.0, x[2:4]], impulse)
        columns = np.column_stack([column, np.r_[0.0, column[:-1]]])
        remainder = y[2:] - simulated
        state = np.linalg.lstsq(columns, remainder, rcond=None)[0]
        return 100.0 * np.sum((remainder - columns @ state) ** 2) / np.sum(y[2:] ** 2)

    bounds = [
        {"type": "ineq", "fun": lambda x: 0.88 - max_root_radius(x[2:4])},
        {"type": "ineq", "fun": lambda x: 5.0 - (x[0] + x[1]) / (1.0 + x[2] + x[3])},
    ]
    start = np.array([1.0, 0.5, -1.3, 0.7])
    solved = minimize(
        cost, start, method="SLSQP", constraints=bounds, options={"ftol": 1e-13, "maxiter": 500}
    )
    assert found.constraints.objective <= solved.fun * (1.0 + 1e-6)


def test_real_poles_may_be_forbidden_where_they_are_negative():
    truth = PolynomialModel(ONE, B, ONE, ONE, np.array([1.0, 0.7]), 1, FS)
    u, y = record(truth=truth)
    found = constrained(Constraints(real_poles="positive"), u, y, structure="oe", orders=(2, 1, 1))
    assert found.model.poles().real.min() >= 0.0
    assert found.constraints.active == ("real_poles",)
    truth = PolynomialModel(ONE, B, ONE, ONE, np.array([1.0, -0.7]), 1, FS)
    u, y = record(truth=truth)
    found = constrained(Constraints(real_poles="positive"), u, y, structure="oe", orders=(2, 1, 1))
    assert found.constraints.active == ()


def test_a_fixed_integrator_is_a_pole_at_one_and_the_rest_is_estimated():
    a = np.convolve([1.0, -0.8], [1.0, -1.0])
    generator = np.random.default_rng(5)
    u, e = generator.standard_normal((2, 1000))
    y = lfilter([0.0, 0.5, 0.3], a, u) + lfilter(COLOUR, a, 0.3 * e)
    integrator = Constraints(fixed_poles=(FixedPole(real=1.0),))
    model = constrained(integrator, u, y, structure="armax", orders=(2, 2, 2, 1)).model
    assert model.A.sum() == pytest.approx(0.0, abs=1e-14)
    errors = model.parameters - np.concatenate([a[1:], [0.5, 0.3], COLOUR[1:]])
    deviations = np.sqrt(np.diag(model.covariance.matrix))
    np.testing.assert_array_less(np.abs(errors), 4.0 * deviations)


def test_an_unstable_plant_under_feedback_is_found_where_stability_is_free():
    a = np.convolve([1.0, -1.05], [1.0, -0.6])
    generator = np.random.default_rng(5)
    e, r = 0.2 * generator.standard_normal(1000), generator.standard_normal(1000)
    u, y = np.zeros(1000), np.zeros(1000)
    for t in range(2, 1000):
        y[t] = -a[1:] @ y[t - 2 : t][::-1] + 0.5 * u[t - 1] + 0.3 * u[t - 2] + e[t] + 0.4 * e[t - 1]
        u[t] = r[t] - 0.5 * y[t]
    options = {"structure": "armax", "orders": (2, 2, 1, 1)}
    free = constrained(Constraints(stability="free"), u, y, **options)
    stable = constrained(Constraints(), u, y, **options)
    assert max_root_radius(stable.model.A[1:]) <= QUADRATIC.max_root_radius
    assert "stability" in stable.constraints.active
    assert free.constraints.objective < stable.constraints.objective
    errors = free.model.parameters - np.array([*a[1:], 0.5, 0.3, 0.4])
    deviations = np.sqrt(np.diag(free.model.covariance.matrix))
    np.testing.assert_array_less(np.abs(errors), 4.0 * deviations)


@pytest.mark.parametrize(
    ("prior", "quantity"),
    [
        (Prior("f1", -1.45, 1e-5), lambda model: model.F[0][1]),
        (Prior("b0", 0.9, 1e-5), lambda model: model.B[0][0]),
        (Prior("static_gain", 4.0, 1e-5), static_gain),
        (Prior("frequency", 5.0, 1e-5), lambda model: model.modes()[0].frequency_hz),
        (Prior("damping", 0.2, 1e-5, mode_hz=5.0), lambda model: model.modes()[0].damping_ratio),
    ],
)
def test_a_prior_draws_as_far_as_its_weight_says(prior, quantity, free):
    u, y = record()
    firm = constrained(Constraints(priors=(prior,)), u, y, settings=SHORT)
    assert quantity(firm.model) == pytest.approx(prior.mean, abs=1e-3)
    vague = Prior(prior.quantity, prior.mean, 1e6, prior.mode_hz)
    loose = constrained(Constraints(priors=(vague,)), u, y, settings=SHORT)
    np.testing.assert_allclose(loose.model.parameters, free.model.parameters, atol=1e-5)


def test_a_prior_counts_as_an_observation():
    """Mean and standard error of b0 are those of two independent measurements."""
    u, y = record(truth=PolynomialModel(ONE, B, ONE, ONE, ONE, 1, FS))
    options = {"structure": "fir", "orders": (2, 1)}
    free = constrained(Constraints(), u, y, **options).model
    deviation = float(np.sqrt(np.diag(free.covariance.matrix))[0])
    prior = Prior("b0", free.B[0][0] + deviation, deviation)
    found = constrained(Constraints(priors=(prior,)), u, y, **options).model
    assert found.B[0][0] == pytest.approx(free.B[0][0] + 0.5 * deviation, rel=1e-4)
    after = float(np.sqrt(np.diag(found.covariance.matrix))[0])
    assert after == pytest.approx(deviation / math.sqrt(2.0), rel=1e-2)


def test_an_active_constraint_leaves_no_variance_across_it():
    found = constrained(Constraints(static_gain_bounds=(None, 4.0), min_damping_ratio=0.2))
    model = found.model
    assert found.constraints.active == ("min_damping_ratio", "static_gain_bounds")
    assert model.modes()[0].damping_se < 1e-9
    assert model.modes()[0].frequency_se_hz > 1e-4
    of_gain = np.zeros(len(model.parameters))
    of_gain[:2] = 1.0 / model.F[0].sum()
    of_gain[4:] = -model.B[0].sum() / model.F[0].sum() ** 2
    assert model.covariance.standard_errors(of_gain[None, :])[0] < 1e-9


@pytest.mark.parametrize(
    "constraints",
    [
        Constraints(static_gain=GAIN),
        Constraints(static_gain_bounds=(None, GAIN)),
        Constraints(min_damping_ratio=MODE.damping_ratio),
    ],
)
def test_intervals_under_active_constraints_are_honest(constraints):
    """Bounds at the truth: half of the records are at an inequality, all at an equality."""
    inside = []
    for seed in range(16):
        u, y = record(seed=100 + seed, samples=400)
        found = constrained(constraints, u, y, settings=SHORT)
        if not found.constraints.active:
            continue
        deviations = np.sqrt(np.diag(found.model.covariance.matrix))
        inside += list(np.abs(found.model.parameters - TRUTH.parameters) <= 1.96 * deviations)
    # About 50 correlated intervals; the larger experiment is benchmarks/constraint_coverage.py.
    assert len(inside) >= 30
    assert np.mean(inside) > 0.85


def test_constraints_hold_for_every_focus():
    u, y = record()
    for focus in (3, "simulation"):
        found = constrained(Constraints(min_damping_ratio=0.25, static_gain=4.0), u, y, focus=focus)
        assert damping(found.model) >= 0.25 - 1e-9
        assert static_gain(found.model) == pytest.approx(4.0, rel=1e-10)
        assert found.constraints.objective > found.constraints.objective_without


def test_constraints_may_be_numbers_of_numpy():
    band = (np.int64(1), np.float32(20.0))
    found = constrained(Constraints(static_gain=np.float32(4.0), frequency_band=band))
    assert static_gain(found.model) == pytest.approx(4.0, rel=1e-12)


def test_the_absolute_objective_takes_constraints():
    found = constrained(Constraints(static_gain=4.0), settings=SearchSettings())
    assert static_gain(found.model) == pytest.approx(4.0, rel=1e-12)


def test_constraints_have_one_json_form():
    constraints = Constraints(
        stability="free",
        frequency_band=(1.0, 2.0),
        static_gain_bounds=(None, 2.0),
        fixed_coefficients={"a1": -1.5},
        fixed_poles=(FixedPole(real=1.0),),
        priors=(Prior("damping", 0.02, 0.01, 5.0),),
    )
    assert from_json(Constraints, to_json(constraints)) == constraints


@pytest.mark.parametrize(
    ("constraints", "structure", "orders", "message"),
    [
        (
            Constraints(
                min_damping_ratio=0.1,
                fixed_poles=(FixedPole(frequency_hz=5.0, damping_ratio=0.01),),
            ),
            "oe",
            (2, 2, 1),
            "its damping ratio 0.01 is below min_damping_ratio 0.1",
        ),
        (Constraints(static_gain_bounds=(2.0, 1.0)), "oe", (2, 2, 1), "exceeds the upper one"),
        (Constraints(fixed_coefficients={"f1": 1.0}), "armax", (2, 2, 2, 1), "no such coefficient"),
        (Constraints(fixed_coefficients={"f1": -3.0}), "oe", (2, 2, 1), "inside the unit circle"),
        (Constraints(stability="free"), "oe", (2, 2, 1), "poles of F must be stable"),
        (Constraints(max_pole_radius=0.9), "fir", (2, 1), "no plant with poles"),
        (Constraints(max_pole_radius=1.1), "armax", (2, 2, 2, 1), "stability is required"),
        (Constraints(min_damping_ratio=5.0), "oe", (2, 2, 1), "5 is not below 1; give the least"),
        (Constraints(max_pole_radius=0.0), "oe", (2, 2, 1), "0 is not above 0; give the largest"),
        (Constraints(real_poles="some"), "oe", (2, 2, 1), "may have, any, positive or none"),
        (Constraints(static_gain=np.nan), "oe", (2, 2, 1), "static_gain: nan is not a finite"),
        (Constraints(priors=(Prior("f1", np.inf, 1.0),)), "oe", (2, 2, 1), "mean: inf is not a"),
        (Constraints(frequency_band=(9.0, 3.0)), "oe", (2, 2, 1), "is no band"),
        (Constraints(frequency_band=(30.0, 40.0)), "oe", (2, 2, 1), "above half the sampling rate"),
        (
            Constraints(frequency_band=(0.0, 0.01), max_pole_radius=0.5),
            "oe",
            (2, 2, 1),
            "no mode has a natural frequency",
        ),
        (Constraints(static_gain=1.0), "arma", (2, 2), "no static gain"),
        (
            Constraints(static_gain=1.0, fixed_poles=(FixedPole(real=1.0),)),
            "oe",
            (2, 2, 1),
            "no static gain",
        ),
        (Constraints(fixed_poles=(FixedPole(real=1.1),)), "oe", (2, 2, 1), "predictor unstable"),
        (
            Constraints(fixed_poles=(FixedPole(),)),
            "oe",
            (2, 2, 1),
            "neither a real pole nor a pair",
        ),
        (Constraints(fixed_poles=(FixedPole(real=0.5),) * 3), "oe", (2, 2, 1), "more of them"),
        (Constraints(priors=(Prior("f9", 1.0, 1.0),)), "oe", (2, 2, 1), "has no 'f9'"),
        (Constraints(priors=(Prior("f1", 1.0, 0.0),)), "oe", (2, 2, 1), "not positive"),
        (Constraints(priors=(Prior("damping", 0.1, 0.1),)), "oe", (2, 2, 1), "which mode"),
        (
            Constraints(priors=(Prior("frequency", 5.0, 0.1), Prior("frequency", 9.0, 0.1, 5.0))),
            "oe",
            (2, 2, 1),
            "two priors of its frequency",
        ),
        (
            Constraints(priors=(Prior("damping", 0.02, 0.01, 5.0),), min_damping_ratio=0.5),
            "oe",
            (2, 2, 1),
            "below min_damping_ratio",
        ),
        (
            Constraints(priors=(Prior("static_gain", 5.0, 0.1),), static_gain_bounds=(None, 1.0)),
            "oe",
            (2, 2, 1),
            "outside static_gain_bounds",
        ),
        (
            Constraints(max_pole_radius=0.9, fixed_coefficients={"f1": -1.0}),
            "oe",
            (2, 2, 1),
            "cannot be fixed while",
        ),
    ],
)
def test_contradictions_are_refused_in_one_sentence(constraints, structure, orders, message):
    u, y = record(samples=100)
    with pytest.raises(InputError, match=message) as refusal:
        constrained(
            constraints,
            None if structure == "arma" else u,
            y,
            structure=structure,
            orders=orders,
        )
    assert str(refusal.value).startswith(("constraints, ", "constraints: "))
