"""What follows a search keeps its optimum: states, units, the shortest B, errors at the bound."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem import SearchSettings, estimate
from evopem.automatic.chosen_model import described_by_search
from evopem.automatic.fit import SWEEP_STAGES
from evopem.errors import InputError
from evopem.estimation import polynomial_estimate
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import describe, searched_objective
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.staged_descent import staged_descent
from evopem.estimation.state_space.point_model import ScaledModel
from evopem.models.orders import Orders, orders_of
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording, Segment

QUICK = SearchSettings(objective="quadratic", evaluations=2000)
ONE = np.ones(1)
OF_STRUCTURE = {"oe": {"nb": 1, "nf": 2}, "bj": {"nb": 1, "nc": 1, "nd": 1, "nf": 2}}
RETURNED = {
    "fir": {"nb": 40, "nk": 1},
    "arx": (2, 2, 1),
    "armax": (2, 2, 2, 1),
    "ararx": {"na": 2, "nb": 2, "nd": 1, "nk": 1},
    "ararmax": {"na": 2, "nb": 2, "nc": 1, "nd": 1, "nk": 1},
    "oe": (2, 2, 1),
    "bj": (2, 1, 1, 2, 1),
    "general": {"na": 1, "nb": 2, "nc": 1, "nd": 1, "nf": 2, "nk": 1},
    "ss": 3,
    "ss_oe": 2,
    "ss_oe_drift": 2,
    "ss_bj": 2,
}


def test_descents_to_larger_orders_begin_at_the_known_model():
    """Least squares do not give the B of slow modes again, whose columns hardly differ."""
    frequencies, damping = np.array([0.02, 0.05, 0.12, 0.3]), np.array([0.05, 0.03, 0.02, 0.01])
    poles = np.exp(frequencies * (1j * np.sqrt(1.0 - damping**2) - damping))
    paths = [np.delete(poles, k) for k in range(4)]
    b = sum(
        sign * frequency * np.append(np.real(np.poly([*path, *path.conj()])), 0.0)
        for sign, frequency, path in zip((1, -1, 1, -1), frequencies, paths, strict=True)
    )
    f, d = np.real(np.poly([*poles, *poles.conj()])), np.array([1.0, -0.7])
    u, e = np.random.default_rng(0).standard_normal((2, 3000))
    response = lfilter(np.append(0.0, b), f, u)
    y = response + 0.1 * response.std() * lfilter([1.0], d, e)
    known = PolynomialModel(ONE, b, ONE, d, f, 1)
    larger = Orders(nb=9, nd=2, nf=8, nk=0)
    errors = PolynomialErrors((Segment(u, y),), larger, "quadratic", 1.0 - 1e-7, 0.9999, True)
    problem = PolynomialProblem(errors, [known], own_starts=False)
    grown = np.concatenate([[0.0], b, d[1:], [0.0], f[1:]])
    np.testing.assert_array_equal(problem.adapted(known)[0, : len(grown)], grown)
    (of_known,) = problem.values(errors.completed_by_states(grown)[None])
    assert problem.values(problem.starts()[:1])[0] <= of_known
    assert problem.values(problem.completed(problem.adapted(known))[0]).min() > 2.0 * of_known


@pytest.mark.parametrize("mean", [0.0, 3e3, 1e5])
@pytest.mark.parametrize(("structure", "orders"), [("oe", (2, 2, 1)), ("bj", (2, 1, 1, 2, 1))])
def test_a_level_is_found_beside_an_input_of_any_mean(structure, orders, mean):
    generator = np.random.default_rng(1)
    u, e = generator.standard_normal(600) + mean, 0.1 * generator.standard_normal(600)
    noise = lfilter([1.0, 0.5], [1.0, -0.3], e) if structure == "bj" else e
    # The plant has been at rest under the mean for ever.
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u - mean) + 7.5 * mean + 2.0 + noise
    found = estimate(u, y, orders, structure=structure, settings=QUICK, level=True)
    assert found.model.noise_variance == pytest.approx(np.var(e), rel=0.05)
    assert found.model.F[0] == pytest.approx([1.0, -1.5, 0.7], abs=0.02)
    constant = found.model.B[0].sum() / found.model.F[0].sum() * mean + found.model.level
    assert constant == pytest.approx(7.5 * mean + 2.0, abs=0.1)


def test_states_that_hardly_decay_are_fitted_without_harm():
    """Their columns are as good as dependent: least squares alone would lose all digits."""
    generator = np.random.default_rng(2)
    slow = np.real(np.poly(0.9998 * np.exp(1j * np.array([0.01, -0.01, 0.012, -0.012, 0.0, 0.0]))))
    model = PolynomialModel(ONE, np.array([1.0]), slow, slow, slow, 1)
    u, y = generator.standard_normal((2, 3000))
    errors = PolynomialErrors([Segment(u, y)], model.orders, "quadratic", 1.0, 1.0)
    at_rest = np.zeros(errors.dimension)
    at_rest[: model.orders.parameters] = model.parameters
    point = errors.completed_by_states(model.parameters)
    fitted, rest = errors.values(np.array([point, at_rest]))
    assert fitted <= rest


def test_states_of_finely_sampled_poles_leave_the_noise_alone():
    """Their response from rest is larger than the noise by eight digits, and rounding with it."""
    generator = np.random.default_rng(4)
    poles = np.array([0.979, 0.992, 0.995]) * np.exp(1j * np.array([0.06, 0.04, 0.02]))
    f = np.real(np.poly([*poles, *poles.conj()]))
    model = PolynomialModel(ONE, (f[::-1],), ONE, ONE, (f,), (1,))  # of gain 1 at all frequencies
    u = generator.standard_normal(2400)
    y = lfilter([0.0, *f[::-1]], f, u) + 0.01 * generator.standard_normal(2400)
    stretch = [Segment(u[1400:, None], y[1400:, None])]
    errors = PolynomialErrors(stretch, model.orders, "quadratic", 1.0, 1.0, level=True)
    residuals = errors.residuals(errors.completed_by_states(model.parameters))
    assert np.std(residuals) == pytest.approx(0.01, rel=0.05)
    # A descent begins there as well: products of columns do not tell B.
    start = PolynomialProblem(errors, [model], own_starts=False).starts()[0]
    assert np.std(errors.residuals(start)) == pytest.approx(0.01, rel=0.05)


def test_least_squares_are_the_only_start_of_an_arx_model_with_poles_inside():
    u, e = np.random.default_rng(5).standard_normal((2, 400))
    orders = orders_of("arx", (2, 1, 1))
    for a in ([1.0, -1.5, 0.7], [1.0, -1.5, 1.02]):
        y = 3.0 + lfilter([0.0, 1.0], a, u) + lfilter([1.0], a, 0.1 * e)
        errors = PolynomialErrors([Segment(u, y)], orders, "quadratic", 1.0, 1.0, level=True)
        starts = PolynomialProblem(errors, []).starts()
        assert (len(starts) == 1) == (a[-1] < 1.0)
        columns = np.column_stack([-y[1:-1], -y[:-2], u[1:-1], np.ones(398)])
        least = np.linalg.lstsq(columns, y[2:])[1][0]
        if a[-1] < 1.0:
            ended = staged_descent(errors, starts, SWEEP_STAGES).points[0]
            reached = np.sum(errors.residuals(ended) ** 2)
            assert reached == pytest.approx(least, rel=1e-7)
            # Descents on absolute errors end at corners that are not the lowest one.
            absolute = PolynomialErrors([Segment(u, y)], orders, "absolute", 1.0, 1.0, level=True)
            assert len(PolynomialProblem(absolute, []).starts()) > 1


@pytest.mark.parametrize("structure", OF_STRUCTURE)
def test_an_estimate_has_the_objective_of_its_search_or_is_refused(structure):
    """Whatever the mean of the input: it moves constants between the level and the states."""
    generator = np.random.default_rng(3)
    u = 20.0 + generator.standard_normal(300)
    y = lfilter([0.0, 1.0], np.poly([0.99, 0.5]), u) + 20.0 * generator.standard_normal(300)
    orders = orders_of(structure, OF_STRUCTURE[structure])
    found = estimate(u, y, orders, structure=structure, level=True, settings=QUICK)
    errors = PolynomialErrors(
        [Segment(u, y)], orders, "quadratic", 0.9999, 0.9999, True, found.window
    )
    value = found.search.value
    assert searched_objective(errors, found.search.point) == pytest.approx(value, rel=1e-7)
    assert describe(errors, found.search, 1.0, shortest=True).objective == found.objective
    for excess in (1e-4, 0.5):
        lower = replace(found.search, value=value / (1.0 + excess))
        with pytest.raises(InputError, match="objective"):
            describe(errors, lower, 1.0, shortest=True)


def test_a_model_with_states_of_least_squares_has_their_objective():
    """Its search, of absolute errors beside outliers, ended at a lower one."""
    generator = np.random.default_rng(6)
    u = generator.standard_normal((400, 1))
    y = lfilter([0.0, 1.0], [1.0, -0.5], u, axis=0) + 0.1 * generator.standard_normal((400, 1))
    y[::20] += 10.0
    data, search = Recording(u, y, 1.0), replace(QUICK, objective="absolute")
    found = estimate(data, orders=(1, 1, 1), structure="arx", level=True, settings=search)
    described = described_by_search(found.model, found.search, search, data)
    assert described.search.value > 1.001 * found.search.value
    assert described.objective == pytest.approx(described.search.value, rel=1e-9)


@pytest.mark.parametrize("structure", RETURNED)
def test_a_model_that_predicts_worse_than_its_search_is_refused(structure, monkeypatch):
    """As rounding in a change of coordinates makes it: here all numbers move by a hundredth."""
    generator = np.random.default_rng(5)
    u, e = generator.standard_normal((2, 300))
    y = lfilter([0.0, 1.0, 0.4], [1.0, -1.6, 0.8], u) + 0.05 * lfilter([1.0, 0.3], [1.0, -0.7], e)
    given = {"orders": RETURNED[structure], "structure": structure, "level": True}
    estimate(u, y, **given, settings=replace(QUICK, evaluations=0))

    def moved(self_or_orders, *arguments, **attributes):
        model = made(self_or_orders, *arguments, **attributes)
        return model.with_parameters(model.parameters * 1.01)

    owner, name = polynomial_estimate, "model_of"
    if structure.startswith("ss"):
        owner, name = ScaledModel, "model"
    made = getattr(owner, name)
    monkeypatch.setattr(owner, name, moved)
    with pytest.raises(InputError, match="lost in rounding: their squares are"):
        estimate(u, y, **given, settings=replace(QUICK, evaluations=0))


def test_a_model_of_slow_poles_is_returned_as_it_was_found():
    """Its powers of a companion matrix rise to 1e8: they are not taken."""
    angles, radii = np.array([0.0822, 0.0486, 0.0221]), np.array([0.9932, 0.9997, 0.9999])
    poles, y = radii * np.exp(1j * angles), np.zeros(1800)
    u, e = np.random.default_rng(3).standard_normal((2, 1800))
    for pole, gain in zip(poles, (1.0, 0.3, 0.2), strict=True):
        y += gain * lfilter([0.0, 0.1], np.real(np.poly([pole, pole.conjugate()])), u)
    y += lfilter([0.0, 0.1], [1.0, -0.9825], u)
    y += 0.01 * np.std(y) * e
    found = estimate(u, y, (7, 7, 1), structure="oe", level=True, settings=QUICK)
    form, signals = found.model.state_space(), (u[:, None], y[:, None])
    errors = form.residuals(*signals, form.prediction_state(*signals))[100:, 0]
    assert np.std(errors) < 1.05 * np.std(found.residuals[100:])


@pytest.mark.parametrize(("structure", "orders"), [("oe", (1, 2, 1)), ("ss_oe", 2), ("ss", 2)])
def test_a_standard_error_at_the_bound_covers_what_the_bound_takes_away(structure, orders):
    damping, turn = 3e-5, 0.8
    pole = np.exp(turn * (-damping + 1j * np.sqrt(1.0 - damping**2)))
    generator = np.random.default_rng(4)
    u = generator.standard_normal(2000)
    clean = lfilter([0.0, 1.0], np.real(np.poly([pole, pole.conjugate()])), u)
    y = clean + 0.01 * np.std(clean) * generator.standard_normal(2000)
    found = estimate(u, y, orders, structure=structure, settings=QUICK)
    assert found.at_stability_bound
    (mode,) = found.model.modes()
    assert mode.damping_ratio > 1.2e-4
    assert abs(mode.damping_ratio - damping) < 2.0 * mode.damping_se
    assert mode.damping_se < 1e-3
