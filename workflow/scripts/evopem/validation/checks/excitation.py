"""Checks of the input: whether it excites the system, and whether the output responds to it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from evopem.validation.checks.check import SIGNIFICANCE, Check, p_text
from evopem.validation.split_spectra import FEWEST_SAMPLES

if TYPE_CHECKING:
    from evopem.estimation.model_record import ModelRecord
    from evopem.validation.validation import Validation


EXCITATION_ADEQUATE = "Excitation adequate"
RESPONSE_SIGNIFICANT = "Response to the input significant"
INPUT_COMPARABLE = "Validation input comparable"
INDEPENDENT_OF_STATE = "Simulation independent of its initial state"
# A fitted state may lower the simulation error to this part, beside a margin in percent.
STATE_FACTOR, STATE_MARGIN = 1.5, 2.0
CHECK_THE_MODEL = (
    "Slow poles, or poles near the unit circle that zeros nearly cancel, let a fitted state imitate"
    " a drift. Try lower orders, or look for a trend in the record."
)
RESTING = "the input does not change in the validation samples"
EXCITE_AGAIN = (
    "Record a second step or blow, in the same file or as a “validation_file”: one event cannot be"
    " fitted and tested as well."
)


def excitation(model: ModelRecord, validation: Validation) -> Check:
    """The order of excitation of the input at least the number of coefficients of the plant."""
    order, needed = validation.excitation.order, validation.excitation.needed
    orders = model.polynomials.orders
    terms = [name for name in ("na", "nf", "nb") if getattr(orders.single, name) or name == "nb"]
    passed = order >= needed
    return Check(
        EXCITATION_ADEQUATE,
        passed,
        f"The input is persistently exciting of order {order}, and the model needs {needed}"
        f" ({' + '.join(terms)}). Directions more than 40 dB below the strongest are not counted.",
        ""
        if passed
        else "Trust the model only at frequencies where the input has power. Record with a broader"
        " input, or resample to a lower rate.",
    )


def response_to_input(validation: Validation) -> Check:
    """The response to the input significant on samples that were not used for estimation."""
    name = RESPONSE_SIGNIFICANT
    test = validation.input_test
    passed = test.significant(SIGNIFICANCE)
    if passed is None and input_rests(validation):
        return Check(name, None, f"Not tested: {RESTING}.", EXCITE_AGAIN)
    if passed is None:
        return Check(
            name,
            None,
            f"The response to the input could not be tested on {test.samples} validation samples.",
            "Leave at least 50 samples to validation.",
        )
    return Check(
        name,
        passed,
        "Regression of the measured on the simulated output over"
        f" {test.samples} validation samples: coefficient {test.coefficient:.3g},"
        f" {p_text(test.p_value)}.",
        ""
        if passed
        else "The model does not describe a response to this input. Check that the channels belong"
        " to the same system and have the same time axis, and search longer delays (“delay.nk”).",
    )


def input_rests(validation: Validation) -> bool:
    """Whether the input does not change in validation samples that are enough to tell."""
    return validation.samples >= FEWEST_SAMPLES and validation.split.comparable is None


def independent_of_state(simulated: float, fitted: float) -> Check:
    """Simulations do as well without a state that is fitted to the validation samples.

    Parameters
    ----------
    simulated, fitted : float
        Errors in percent: with the state that earlier samples give, and with the one that fits.
    """
    name = INDEPENDENT_OF_STATE
    if not (math.isfinite(simulated) and math.isfinite(fitted)):
        return Check(name, None, "One of the simulation errors is not known.", CHECK_THE_MODEL)
    passed = simulated <= STATE_FACTOR * fitted + STATE_MARGIN
    return Check(
        name,
        passed,
        f"The simulation error is {simulated:.3g} % with the state that earlier samples give, and"
        f" {fitted:.3g} % with the initial state that fits the validation samples best.",
        "" if passed else CHECK_THE_MODEL,
        "caution",
    )


def comparable_split(validation: Validation) -> Check:
    """The validation input has power only where the estimation input has power as well."""
    name = INPUT_COMPARABLE
    split = validation.split
    if input_rests(validation):
        return Check(
            name,
            None,
            f"{RESTING[0].upper()}{RESTING[1:]}. The simulation error there is that of the free"
            " response.",
            EXCITE_AGAIN,
        )
    if split.comparable is None:
        return Check(
            name,
            None,
            "The spectra of the input in the two parts could not be compared: a part is too short.",
            "Leave more samples to validation.",
        )
    bands = ", ".join(f"{low:.3g} to {high:.3g} Hz" for low, high in split.bands_hz[:4])
    statement = (
        f"{100 * split.share_outside:.2g} % of the power of the validation input lies where the"
        " estimation input has none"
    )
    return Check(
        name,
        split.comparable,
        f"{statement}{f' ({bands})' if bands else ''}.",
        ""
        if split.comparable
        else "The validation errors measure extrapolation. Divide the recording differently"
        " (“split”), or give an independent recording with the same kind of input"
        " (“validation_file”).",
    )
