"""A model's tables against the model itself."""

import numpy as np

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
