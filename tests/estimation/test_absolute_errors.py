"""The absolute objective of several channels: optima, intervals, and what outliers do."""

import numpy as np
import pytest
from least_absolute import descended, loss

from evopem import SearchSettings, estimate
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.estimate import estimate_state_space
from evopem.estimation.state_space.problem import AbsoluteStateSpaceProblem
from evopem.estimation.state_space.scaled_recording import scaled_recording
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording, Segment, concatenated

RATE = 10.0
ABSOLUTE = {
    "weighting": "noise",
    "settings": SearchSettings(objective="absolute", evaluations=0),
}
TRUTH = StateSpaceModel(
    A=np.array([[0.9, 0.3], [-0.3, 0.9]]),
    B=np.array([[1.0, 0.3], [0.5, -0.8]]),
    C=np.array([[1.0, 0.2], [-0.4, 1.5]]),
    D=np.zeros((2, 2)),
    K=np.array([[0.4, 0.1], [-0.2, 0.3]]),
    sampling_rate=RATE,
    level=np.array([2.0, -1.0]),
    noise_covariance=np.eye(2),
    structure="ss",
)


def recorded(samples, seed, share=0.03, structure="ss_oe"):
    """A record with Laplace errors of 10 and 20 %, and a share of outliers."""
    generator = np.random.default_rng(seed)
    u = generator.standard_normal((samples, 2))
    e = generator.laplace(size=(samples, 2)) * [0.2, 0.5]
    if structure == "ss":
        x, y = np.zeros(2), np.empty((samples, 2))
        for t in range(samples):
            y[t] = TRUTH.level + TRUTH.C @ x + e[t]
            x = TRUTH.A @ x + TRUTH.B @ u[t] + TRUTH.K @ e[t]
    else:
        y = TRUTH.simulate(u) + e
    outliers = generator.random((samples, 2)) < share
    return u, y + outliers * 20.0 * generator.standard_normal((samples, 2))


def matrices_of(parameters, structure):
    """A, B, C, K, level and initial state of the parameters of the other method."""
    sizes = (4, 4, 4, 4 if structure == "ss" else 0, 2, 2)
    parts = np.split(parameters, np.cumsum(sizes)[:-1])
    gain = parts[3].reshape(2, 2) if structure == "ss" else np.zeros((2, 2))
    return *(part.reshape(2, 2) for part in parts[:3]), gain, parts[4], parts[5]


def errors_by_recursion(parameters, u, y, structure):
    A, B, C, K, level, x = matrices_of(parameters, structure)
    errors = np.empty_like(y)
    with np.errstate(all="ignore"):
        for t in range(len(y)):
            errors[t] = y[t] - level - C @ x
            x = A @ x + B @ u[t] + K @ errors[t]
    return errors


@pytest.mark.parametrize("structure", ["ss_oe", "ss"])
def test_the_jacobian_is_the_derivative_of_the_errors(structure):
    u, y = recorded(150, 1, structure=structure)
    record = scaled_recording(
        concatenated([Recording(u[:90], y[:90], RATE), Recording(u[90:], y[90:], RATE)]), [0, 1]
    )
    errors = AbsoluteStateSpaceProblem(StateSpaceErrors(record, 3, structure, "noise"))
    generator = np.random.default_rng(2)
    coordinates = 0.3 * generator.standard_normal(errors.plain.layout.dimension)
    point = errors.completed(coordinates)
    for k, (columns, places) in enumerate(errors.jacobians(point)):
        expected = np.zeros((150, errors.dimension))
        for j in range(errors.dimension):
            step = 1e-6 * np.eye(errors.dimension)[j]
            moved = (errors.moved(point, each) for each in (step, -step))
            above, below = (errors.projection(each).errors[:, k] for each in moved)
            expected[:, j] = (above - below) / 2e-6
        found = np.zeros_like(expected)
        found[:, places] = columns
        assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("structure", ["ss_oe", "ss"])
def test_the_optimum_is_that_of_linear_programmes(structure):
    u, y = recorded(100, 3, structure=structure)
    found = estimate_state_space(Recording(u, y, RATE), 2, structure=structure, **ABSOLUTE)
    model = found.model
    gain = model.K.ravel() if structure == "ss" else []
    parts = (model.A.ravel(), model.B.ravel(), model.C.ravel(), gain)
    levels, states = found.segment_levels[0], found.initial_states[0]
    own = np.concatenate([*parts, levels, states])
    value = loss(errors_by_recursion(own, u, y, structure))
    assert value == pytest.approx(loss(found.residuals[0]), abs=1e-8)

    def errors_of(parameters):
        return errors_by_recursion(parameters, u, y, structure)

    truth = [TRUTH.A.ravel(), TRUTH.B.ravel(), TRUTH.C.ravel()]
    truth += [TRUTH.K.ravel()] if structure == "ss" else []
    for start in (own, np.concatenate([*truth, TRUTH.level, np.zeros(2)])):
        assert value - descended(errors_of, start)[1] < 2e-6


def test_several_inputs_have_the_optimum_of_linear_programmes():
    u, y = recorded(200, 5)
    orders = {"nb": 2, "nf": [2, 2], "nk": 1}
    settings = SearchSettings(evaluations=200)
    found = estimate(u, y[:, 0], orders, RATE, structure="oe", settings=settings, level=True)
    errors = PolynomialErrors(
        [Segment(u, y[:, 0])], found.model.orders, "absolute", 0.9999, 0.9999, True
    )

    def errors_of(point):
        return errors.residuals(point)[:, None]

    value = loss(errors_of(found.search.point))
    assert value - descended(errors_of, found.search.point)[1] < 2e-6


@pytest.mark.parametrize("structure", ["oe", "armax"])
def test_several_inputs_are_hardly_moved_by_outliers(structure):
    u, y = recorded(800, 6, share=0.0)
    spiked = y[:, 0].copy()
    spiked[np.random.default_rng(1).random(800) < 0.02] += 40.0
    orders = {"nb": 2, "nf": 2} if structure == "oe" else {"na": 2, "nb": 2, "nc": 2}
    orders["nk"] = 1
    moves = {}
    for objective in ("quadratic", "absolute"):
        settings = SearchSettings(objective=objective, evaluations=200)
        clean, moved = (
            estimate(
                *(u, each, orders, RATE), structure=structure, settings=settings, level=True
            ).model
            for each in (y[:, 0], spiked)
        )
        moves[objective] = np.abs(
            clean.frequency_response([0.2, 0.5, 1.0]) - moved.frequency_response([0.2, 0.5, 1.0])
        ).max()
    assert moves["absolute"] < 0.1 * moves["quadratic"]
