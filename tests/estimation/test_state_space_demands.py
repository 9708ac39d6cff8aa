"""State-space models for errors of several steps, and under hard constraints."""

from dataclasses import replace

import numpy as np
import pytest

import evopem
from evopem.config.constraints import Constraints, FixedPole, Prior
from evopem.config.settings import SearchSettings
from evopem.errors import InputError
from evopem.estimation.damped_descent import descend
from evopem.estimation.state_space.entry_problem import EntryProblem
from evopem.estimation.state_space.estimate import estimate_state_space
from evopem.estimation.state_space.local_estimates import StateSpaceTask
from evopem.estimation.state_space.point_model import PointModel
from evopem.estimation.state_space.starting_points import from_poles
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording

RATE = 10.0
SETTINGS = SearchSettings(objective="quadratic", evaluations=0)
A = np.zeros((4, 4))
for k, (frequency, damping) in enumerate(((0.8, 0.05), (2.5, 0.1))):
    turn = 2.0 * np.pi * frequency / RATE
    pole = np.exp(turn * complex(-damping, np.sqrt(1.0 - damping**2)))
    A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]


def recorded(inputs=1, outputs=1, samples=250, seed=0, structure="ss"):
    """A recording of two modes with process noise, or with noise of the outputs alone."""
    generator = np.random.default_rng(seed)
    B = generator.standard_normal((4, inputs))
    C = generator.standard_normal((outputs, 4))
    u = generator.standard_normal((samples, inputs))
    x, y = np.zeros(4), np.empty((samples, outputs))
    for t in range(samples):
        y[t] = 2.0 + C @ x + 0.1 * generator.standard_normal(outputs)
        x = A @ x + B @ u[t] + (0.3 * generator.standard_normal(4) if structure == "ss" else 0.0)
    names = tuple(f"u{k + 1}" for k in range(inputs))
    return Recording(u, y, RATE, input_names=names)


def estimated(recording, order=4, **options):
    return estimate_state_space(recording, order, settings=SETTINGS, **options)


def problem(recording, structure="ss", horizon=1, constraints=None, point=None):
    """The problem of all entries and a point: that of coordinates, or of the true poles."""
    errors = StateSpaceTask(structure).errors(recording, 4)
    start = errors.projection(from_poles(errors, np.linalg.eigvals(A)) if point is None else point)
    found = EntryProblem(errors, horizon, constraints)
    return found, found.begun(found.point_of(PointModel(errors, start).matrices))


@pytest.mark.parametrize(
    ("structure", "horizon", "constraints"),
    [
        ("ss", 1, None),
        ("ss", 3, None),
        ("ss_oe", 1, None),
        ("ss", 2, Constraints(min_damping_ratio=0.02)),
        ("ss_oe", 1, Constraints(fixed_poles=(FixedPole(real=0.5),))),
    ],
)
def test_derivatives_agree_with_finite_differences(structure, horizon, constraints):
    made, point = problem(recorded(2, 2, 120), structure, horizon, constraints)
    derivatives = made.derivatives(made.projection(point))
    generator = np.random.default_rng(1)
    for _ in range(3):
        step = 1e-6 * generator.standard_normal(len(point))
        step[[k for k, code in enumerate(_codes(made)) if code == 3]] = 0.0
        moved = (made.projection(made.moved(point, sign * step)).errors for sign in (1, -1))
        difference = next(moved) - next(moved)
        expected = 2.0 * derivatives @ step
        np.testing.assert_allclose(difference, expected, atol=1e-6 * np.abs(expected).max())


def _codes(made):
    return [code for block in made.blocks for code in block.codes]


def test_errors_of_a_point_are_those_of_its_model():
    made, point = problem(recorded(2, 2), horizon=4)
    found = made.projection(point)
    model = made.scaled(point).model()
    data = made.plain.data.recording
    ahead = data.outputs - model.predict(data.inputs, data.outputs, 4, found.matrices.drives[:, -1])
    np.testing.assert_allclose(ahead / made.plain.data.output_scales, found.errors, atol=1e-9)


@pytest.mark.parametrize("structure", ["ss", "ss_oe"])
def test_the_optimum_of_one_step_is_one_of_all_entries_as_well(structure):
    recording = recorded(2, 2)
    free = estimated(recording, structure=structure)
    made, point = problem(recording, structure, point=free.search.point)
    reached = descend(made, point, 100, 1e-11)
    assert made.plain.percent(reached.value) == pytest.approx(free.objective, rel=1e-8)


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
@pytest.mark.parametrize(("inputs", "outputs"), [(1, 1), (2, 2), (0, 2)])
def test_several_steps_are_predicted_better_by_a_model_for_them(inputs, outputs, objective):
    recording = recorded(inputs, outputs, 150)
    options = {"weighting": "noise", "settings": replace(SETTINGS, objective=objective)}
    # An order too small for both modes: the focus decides which of them it has.
    one, five = (estimate_state_space(recording, 2, focus=focus, **options) for focus in (1, 5))
    assert five.focus_objective < five.objective * 50.0
    assert one.objective <= five.objective * (1.0 + 1e-9)

    def ahead(found):
        model = found.model
        u, y = recording.inputs, recording.outputs
        e = y - model.predict(u, y, 5, found.initial_states[0])
        size = np.abs(e) if objective == "absolute" else e**2
        return float(np.sum(np.log(np.mean(size, axis=0))))

    assert ahead(five) < ahead(one)


@pytest.mark.parametrize(
    ("structure", "objective", "inputs", "outputs"),
    [
        ("ss", "quadratic", 1, 1),
        ("ss", "absolute", 1, 2),
        ("ss_oe", "quadratic", 2, 2),
        ("ss_oe_drift", "absolute", 1, 1),
    ],
)
def test_modes_keep_their_least_damping(structure, objective, inputs, outputs, monkeypatch):
    monkeypatch.setattr("evopem.estimation.state_space.estimate.RANDOM_STARTS", 2)
    found = estimate_state_space(
        recorded(inputs, outputs, 150, structure=structure),
        4,
        structure=structure,
        constraints=Constraints(min_damping_ratio=0.09),
        weighting="noise",
        settings=replace(SETTINGS, objective=objective),
    )
    assert min(mode.damping_ratio for mode in found.model.modes()) >= 0.09 - 1e-6
    assert found.constraints.active == ("min_damping_ratio",)
    assert found.constraints.objective > found.constraints.objective_without
    # The mode that is damped enough stays where it is.
    assert max(mode.frequency_hz for mode in found.model.modes()) == pytest.approx(2.5, abs=0.1)


def test_constraints_that_an_optimum_meets_change_nothing():
    recording = recorded()
    free = estimated(recording)
    found = estimated(recording, constraints=Constraints(max_pole_radius=0.999))
    np.testing.assert_array_equal(found.model.A, free.model.A)
    assert found.constraints.active == ()


def test_known_poles_and_gains_are_those_of_the_model():
    recording = recorded(2, 1)
    constraints = Constraints(
        fixed_poles=(FixedPole(frequency_hz=0.8, damping_ratio=0.05),),
        static_gain={"u1": 1.5},
        static_gain_bounds={"u2": (None, -3.0)},
    )
    found = estimated(recording, constraints=constraints)
    assert np.abs(found.model.poles() - A[0, 0] - 1j * A[0, 1]).min() < 1e-12
    gains = found.model.frequency_response(0.0)[0].real
    assert gains[0] == pytest.approx(1.5, rel=1e-9)
    assert gains[1] <= -3.0 + 1e-9
    assert {"fixed_poles", "static_gain"} <= set(found.constraints.active)
    modes = sorted(found.model.modes(), key=lambda mode: mode.frequency_hz)
    assert modes[0].frequency_se_hz == pytest.approx(0.0, abs=1e-9)
    assert modes[1].frequency_se_hz > 0.0


def test_a_static_gain_of_zero_is_a_constraint_too():
    found = estimated(recorded(1, 1), constraints=Constraints(static_gain=0.0))
    assert found.model.frequency_response(0.0)[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert found.constraints.active == ("static_gain",)


def test_standard_errors_of_one_step_are_those_without_constraints():
    """Where a bound is not active, the directions of a point are those of the free problem."""
    recording = recorded(1, 2)
    free = estimated(recording)
    constraints = Constraints(fixed_poles=(FixedPole(frequency_hz=0.8, damping_ratio=0.05),))
    found = estimated(recording, constraints=constraints)
    ses = [max(each.model.modes(), key=lambda m: m.frequency_hz) for each in (free, found)]
    assert ses[1].frequency_se_hz == pytest.approx(ses[0].frequency_se_hz, rel=0.1)


def test_a_plant_beside_its_noise_model_serves_every_focus():
    recording = recorded(1, 1, 80, structure="ss_oe")
    simulated = estimated(recording, structure="ss_bj", focus="simulation")
    plant = estimated(recording, structure="ss_oe")
    assert simulated.focus_objective == pytest.approx(plant.objective)
    assert simulated.order == 4
    assert estimated(recording, structure="ss_bj", focus=3).focus == 3
    assert estimated(recording, structure="ss_oe", focus=3).objective == plant.objective


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"focus": "simulation"}, "do not depend on the gain K"),
        ({"structure": "ss_bj", "constraints": Constraints(max_pole_radius=0.9)}, "one matrix"),
        (
            {"constraints": Constraints(fixed_coefficients={"a1": 1.0})},
            "none of its coefficients",
        ),
        (
            {"constraints": Constraints(priors=(Prior("a1", 0.0, 1.0),))},
            "none of its coefficients",
        ),
        ({"constraints": Constraints(static_gain=1.0)}, "for each input and output"),
        ({"constraints": Constraints(static_gain={"force": 1.0})}, "no input force"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(options, says):
    with pytest.raises(InputError, match=says):
        estimated(recorded(2, 2, 100), **options)


def test_a_model_has_its_structure_for_one_channel_as_well():
    found = estimated(recorded(1, 1, structure="ss_oe"), structure="ss_oe")
    assert isinstance(found.model, StateSpaceModel)
    assert np.sort(found.model.poles().real) == pytest.approx(
        np.sort(np.linalg.eigvals(A).real), abs=0.02
    )


@pytest.mark.parametrize(
    ("structure", "order"),
    [("ss", 2), ("ss_oe", {"n": 2, "nk": [1]}), ("ss_oe_drift", (2, [1])), ("ss_bj", (2,))],
)
def test_one_function_estimates_every_structure(structure, order):
    """From arrays, the order as a number, by its name or with delays."""
    recording = recorded(1, 1, 80, structure="ss_oe")
    found = evopem.estimate(
        *(recording.input, recording.output, order, RATE),
        structure=structure,
        level=True,
        settings=SETTINGS,
    )
    assert found.objective == estimated(recording, 2, structure=structure).objective
    assert found.order == 2


@pytest.mark.parametrize("orders", [{"nf": 2}, {"n": 2, "nb": 1}, (2, 1, 1), "4", None, 2.0])
def test_orders_that_a_state_space_model_does_not_have_are_told(orders):
    recording = recorded(1, 1, structure="ss_oe")
    with pytest.raises(ValueError, match=r"takes the number of states|orders are missing"):
        evopem.estimate(recording, orders=orders, structure="ss_oe")
