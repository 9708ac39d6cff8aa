"""Validation on several recordings of several channels: nothing reaches from one to the next."""

from itertools import pairwise

import numpy as np
import pytest

from evopem.models.state_space import StateSpaceModel
from evopem.signals.prepared_data import PreparedData, StretchOrigin, Transforms
from evopem.signals.recording import Recording, concatenated
from evopem.validation.residual_tests import autocorrelation_of, correlation_with_input
from evopem.validation.validate import validate

LENGTHS = (150, 90, 120)
MODEL = StateSpaceModel(
    A=np.array([[0.9, 0.3], [-0.3, 0.9]]),
    B=np.array([[1.0], [0.5]]),
    C=np.eye(2),
    D=np.zeros((2, 1)),
    K=0.3 * np.eye(2),
    sampling_rate=10.0,
    level=np.zeros(2),
    noise_covariance=np.eye(2),
)


def records():
    generator = np.random.default_rng(3)
    found = []
    for number, samples in enumerate(LENGTHS):
        u, e = generator.standard_normal((samples, 1)), generator.standard_normal((samples, 2))
        y = MODEL.simulate(u, generator.standard_normal(2)) + 0.3 * e + 0.5 * number
        found.append(Recording(u, y, 10.0, ("u",), ("a", "b"), ("",), ("", "")))
    return found


def prepared(validation):
    """A recording that validates a model of others."""
    origins = tuple(
        StretchOrigin(number, 0, 0.0, each.samples, (0.0,), (0.0, 0.0))
        for number, each in enumerate(validation.separated)
    )
    return PreparedData(
        validation, validation, Transforms(10.0, None, origins, origins, validation_source="file")
    )


@pytest.mark.parametrize("fit_level", [False, True])
def test_each_recording_is_simulated_and_predicted_as_if_it_were_alone(fit_level):
    parts = records()
    joined, tables = validate(MODEL, prepared(concatenated(parts)), fit_level=fit_level)
    assert tables.simulation["recording"].tolist() == np.repeat([1, 2, 3], LENGTHS).tolist()
    assert tables.simulation.groupby("recording")["time_s"].max().tolist() == [14.9, 8.9, 11.9]
    for number, each in enumerate(parts):
        alone, own = validate(MODEL, prepared(each), fit_level=fit_level)
        rows = tables.simulation[tables.simulation["recording"] == number + 1]
        for name in ("predicted_a", "simulated_b"):
            np.testing.assert_array_equal(rows[name], own.simulation[name])
        assert joined.stretches[number] == alone.stretches[0]
        assert "recording" not in own.simulation


def test_correlations_have_no_product_of_samples_of_two_recordings():
    generator = np.random.default_rng(1)
    e, u = generator.standard_normal((2, sum(LENGTHS)))
    e[:150] += 4.0  # a level that steps at the joint
    bounds = np.cumsum([0, *LENGTHS]).tolist()
    parts = [slice(*edge) for edge in pairwise(bounds)]
    centred, driven = e - e.mean(), u - u.mean()
    lags = 100  # more than the shortest recording has samples
    found = autocorrelation_of(e, lags, bounds).table("autocorrelation")
    for lag in (1, 7, 100):
        products = sum(centred[p][lag:] @ centred[p][: max(len(e[p]) - lag, 0)] for p in parts)
        value = found["autocorrelation"][lag]
        assert value == pytest.approx(products / (centred @ centred), abs=1e-12)
    assert found["bound95"][1] == pytest.approx(1.96 / np.sqrt(sum(LENGTHS)), rel=1e-3)
    crossed = (
        correlation_with_input(e, u, lags, bounds)
        .table("cross_correlation")
        .set_index("lag")["cross_correlation"]
    )
    size = np.sqrt((centred @ centred) * (driven @ driven))
    for lag in (3, 60):
        products = sum(centred[p][lag:] @ driven[p][: max(len(e[p]) - lag, 0)] for p in parts)
        assert crossed[lag] == pytest.approx(products / size, abs=1e-12)
