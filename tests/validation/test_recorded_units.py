"""Predictions and simulations taken back to the units of the recording."""

import numpy as np
import pytest

from evopem.config.settings import PreparationSettings, SplitSettings, TransformSettings
from evopem.models.polynomial import PolynomialModel
from evopem.signals.preparation import prepare
from evopem.signals.recording import Recording
from evopem.validation.responses import Responses
from evopem.validation.tables import recorded_errors, recorded_series
from evopem.validation.validate import validate


def recording(samples=1200, offset=50.0):
    generator = np.random.default_rng(5)
    model = PolynomialModel(
        np.array([1.0, -1.5, 0.8]), np.array([1.0, 0.5]), np.array([1.0, 0.2]), nk=1
    )
    u = generator.standard_normal(samples)
    noise = 0.05 * generator.standard_normal(samples)
    return Recording(u, model.simulate(u) + noise + offset, 100.0), model


def prepared(transforms, offset=50.0):
    record, model = recording(offset=offset)
    settings = PreparationSettings(transforms, SplitSettings(discard=10, estimation=800))
    return record, prepare(record, settings), model


def as_recorded(data, predicted, simulated):
    output = data.validation.outputs
    scored = np.ones(len(output), dtype=bool)
    responses = Responses(output, predicted, simulated, simulated, scored)
    return recorded_series(data.transforms, responses)


@pytest.mark.parametrize(
    "transforms",
    [
        TransformSettings("none", 0, 0),
        TransformSettings("none", 2, 2),
        TransformSettings(1.1, 1, 0),
        TransformSettings(0.5, 0, 0),
    ],
)
def test_the_measured_output_comes_back_as_recorded(transforms):
    record, data, _ = prepared(transforms)
    output = data.validation.outputs
    series = as_recorded(data, output, output)
    expected = record.outputs[-len(output) :]
    for values in (series.outputs, series.predicted, series.simulated):
        np.testing.assert_allclose(values, expected, rtol=1e-8)


def test_without_nonlinear_transforms_the_prediction_errors_are_those_of_the_prepared_output():
    _, data, _ = prepared(TransformSettings("none", 2, 2))
    output = data.validation.outputs
    errors = 0.1 * np.random.default_rng(1).standard_normal(output.shape)
    series = as_recorded(data, output - errors, output)
    np.testing.assert_allclose(series.outputs - series.predicted, errors, atol=1e-9)


def test_a_simulation_error_is_summed_up_once_for_each_difference():
    _, data, _ = prepared(TransformSettings("none", 1, 1))
    output = data.validation.outputs
    series = as_recorded(data, output, output - 1e-3)
    drift = 1e-3 * np.arange(1, len(output) + 1)[:, None]
    np.testing.assert_allclose(series.outputs - series.simulated, drift, rtol=1e-6)
    errors = recorded_errors(data.transforms, series, 0)
    assert errors.integrations == 1
    assert errors.simulation_error_percent > 100 * 1e-3
    assert errors.prediction_error_percent == pytest.approx(0.0, abs=1e-9)


def test_values_outside_the_range_of_the_transform_are_counted_and_not_scored():
    _, data, _ = prepared(TransformSettings(0.5, 0, 0), offset=6.0)
    output = data.validation.outputs
    low = output.copy()
    low[7] = -1e3
    series = as_recorded(data, output, low)
    errors = recorded_errors(data.transforms, series, 0)
    assert errors.undefined_samples == 1
    assert errors.simulation_error_percent == pytest.approx(0.0, abs=1e-6)


def test_validation_states_recorded_errors_beside_prepared_ones():
    _, data, model = prepared(TransformSettings("none", 0, 0))
    validation, tables = validate(model, data)
    assert validation.outputs[0].recorded.simulation_error_percent == pytest.approx(
        validation.simulation_error_percent
    )
    assert tables.simulation["recorded_output_output"].mean() == pytest.approx(50.0, abs=1.0)
