"""Fits against the horizon: theory for a known noise model, and recorded signals."""

from pathlib import Path

import numpy as np
import pytest
from simulated_records import polynomial_record

from evopem import PolynomialModel, SearchSettings, estimate
from evopem.signals.recording import Recording
from evopem.validation.responses import stretches_of
from evopem.validation.tables import error_percent

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "daisy"
QUADRATIC = SearchSettings(objective="quadratic")
ONE = np.ones(1)


def simulation_error(model, u, y):
    """In percent, from the initial state that fits the record."""
    form = model.plant().state_space()
    simulated = form.simulate_from_fitted_state(u[:, None], y[:, None])[:, 0]
    return 100.0 * np.linalg.norm(y - simulated) / np.linalg.norm(y - y.mean())


def test_the_error_grows_with_the_variance_of_the_noise_not_yet_seen():
    """Var(y - predicted) = variance times the sum of the first k squares of H's response."""
    model = PolynomialModel(ONE, np.array([1.0]), ONE, np.array([1.0, -0.8]), ONE, 1)
    u, y, variance = polynomial_record(model, 40000, 60.0, np.random.default_rng(1))
    horizons = (1, 2, 5, 20)
    expected = [variance * np.sum(0.64 ** np.arange(k)) for k in horizons]
    (stretch,) = stretches_of(model, Recording(u, y, 1.0))
    first = model.orders.first_residual
    errors = [error_percent(y[first:], stretch.predicted(k)[first:, 0]) for k in horizons]
    found = (np.array(errors) / 100.0) ** 2 * np.var(y)
    np.testing.assert_allclose(found, expected, rtol=0.05)
    in_simulation = (simulation_error(model, u, y) / 100.0) ** 2 * np.var(y)
    assert in_simulation == pytest.approx(variance / 0.36, rel=0.05)


@pytest.mark.parametrize(
    ("file", "split", "structure", "orders", "level", "error"),
    [
        ("robot_arm.dat", 800, "oe", {"nb": 10, "nf": 10}, False, 2.8),
        ("dryer.dat", 750, "bj", {"nb": 2, "nc": 2, "nd": 2, "nf": 2, "nk": 3}, True, 8.0),
    ],
)
def test_output_error_and_box_jenkins_models_simulate_recordings(
    file, split, structure, orders, level, error
):
    if not (DATA / file).is_file():
        pytest.skip(f"{file} is not at hand")
    u, y = np.loadtxt(DATA / file).T
    found = estimate(
        u[:split], y[:split], orders, structure=structure, level=level, settings=QUADRATIC
    )
    assert simulation_error(found.model, u[split:], y[split:]) <= error
