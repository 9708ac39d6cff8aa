"""Checks of the input: whether it excites the system, and whether the output responds to it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc

from evopem.models.root_covariance import parameter_covariance
from evopem.validation.checks.check import SIGNIFICANCE, Check, p_text

if TYPE_CHECKING:
    from evopem.estimation.model_record import ModelRecord
    from evopem.validation.validation import Validation


def excitation(validation: Validation) -> Check:
    """The order of excitation of the input at least na + nb."""
    order, needed = validation.excitation.order, validation.excitation.needed
    passed = order >= needed
    return Check(
        "Excitation adequate",
        passed,
        f"The input is persistently exciting of order {order}; the model needs {needed}"
        " (na + nb). Directions more than 40 dB below the strongest are not counted.",
        ""
        if passed
        else "Trust the model only at frequencies where the input has power. Record with a broader"
        " input, or resample to a lower rate.",
    )


def response_to_input(model: ModelRecord) -> Check:
    """Wald test of the hypothesis B = 0."""
    name = "Response to the input significant"
    poles, b = model.orders.na, model.b
    covariance = parameter_covariance(model.covariance, poles + b.size)
    if covariance is None:
        return Check(
            name,
            None,
            "There is no Wald test of B = 0: the covariance of the parameters is not known.",
            "Lower the orders, or use a longer record.",
        )
    of_b = covariance[poles:, poles:]
    p_value = float(chdtrc(b.size, b @ np.linalg.pinv(of_b, hermitian=True) @ b))
    passed = p_value < SIGNIFICANCE
    return Check(
        name,
        passed,
        f"Wald test of B = 0: {p_text(p_value)}.",
        ""
        if passed
        else "The model does not describe a response to this input. Check that the channels belong"
        " to the same system and have the same time axis, and search longer delays (“delay.nk”).",
    )
