"""A model's tables against the model itself."""

import numpy as np

from evopem.models.polynomial import PolynomialModel
from evopem.models.response_tables import frequency_response_table
from evopem.synthesis.armax import true_model


def test_the_response_runs_from_zero_to_half_the_rate():
    model = true_model()
    table = frequency_response_table(model, ("u",), ("y",))
    assert (table["frequency_hz"][0], table["frequency_hz"][-1]) == (0.0, 50.0)
    turned = table["gain"] * np.exp(1j * np.radians(table["phase_deg"]))
    response = model.frequency_response(table["frequency_hz"])[:, 0, 0]
    np.testing.assert_allclose(turned, response, atol=1e-9)
    assert np.abs(np.diff(table["phase_deg"])).max() < 180.0


def test_a_slow_and_lightly_damped_peak_is_resolved():
    rate, frequency, damping = 100.0, 0.02, 0.01
    pole = np.exp((-damping + 1j * np.sqrt(1.0 - damping**2)) * 2.0 * np.pi * frequency / rate)
    model = PolynomialModel(
        A=np.array([1.0, -2.0 * pole.real, abs(pole) ** 2]),
        B=(np.array([1.0]),),
        nk=(1,),
        sampling_rate=rate,
    )
    table = frequency_response_table(model, ("u",), ("y",))
    fine = np.linspace(0.9 * frequency, 1.1 * frequency, 4001)
    largest = np.abs(model.frequency_response(fine)).max()
    assert table["gain"].max() > 0.99 * largest
    assert np.all(np.diff(table["frequency_hz"]) > 0.0)
