"""Checks of the channels: saturation, excitation, and whether the outputs respond to the inputs."""

import math

import numpy as np

from evopem.validation.checks.check import LISTED, Evidence, Found, check, listed, p_text, whole
from evopem.validation.held_out_tests import SIGNIFICANCE, HeldOutTest
from evopem.validation.spectra import FEWEST_SAMPLES
from evopem.validation.validation import Validation

EXCITATION_ADEQUATE = "Excitation adequate"
RESPONSE_SIGNIFICANT = "Response to the input significant"
OTHER_SAMPLES = "Validated on other samples"
INPUT_COMPARABLE = "Validation input comparable"
INDEPENDENT_OF_STATE = "Simulation independent of its initial state"
# A fitted state may lower the simulation error to this part, beside a margin in percent.
STATE_FACTOR, STATE_MARGIN = 1.5, 2.0
# Percentage of the samples at a channel's limits above which the channel counts as saturated.
MAX_SATURATED_PERCENT = 0.1
# Two slow signals that are not related have some course alike, but of a size that no model gives.
LARGEST_COEFFICIENT = 2.0
EXCITE_AGAIN = (
    "Record a second step or blow, in the same file or as a “validation_file”: one event cannot be"
    " fitted and tested as well."
)


@check(
    EXCITATION_ADEQUATE,
    "Trust the model only at frequencies where the input has power. Record with a broader input, or"
    " resample to a lower rate.",
    # A quarter of the records of linear systems fail it, half as many have a poor response.
    "caution",
)
def excitation(evidence: Evidence) -> Found | None:
    """The order of excitation of each input at least the number of coefficients of its plant.

    Of polynomials: the states of a state-space model are shared by inputs and outputs.
    """
    inputs = [channel for channel in evidence.validation.inputs if channel.excitation_needed]
    if not inputs:
        return None
    worst = min(inputs, key=lambda channel: channel.excitation_order - channel.excitation_needed)
    orders = evidence.model.polynomials.orders
    terms = [name for name in ("na", "nf", "nb") if np.any(getattr(orders, name))]
    called = "The input" if len(inputs) == 1 else f"The input {worst.name}"
    return (
        worst.excitation_order >= worst.excitation_needed,
        f"{called} is persistently exciting of order {worst.excitation_order}, and the model needs"
        f" {worst.excitation_needed} ({' + '.join(terms)}). Directions more than 40 dB below the"
        " strongest are not counted.",
    )


@check(
    OTHER_SAMPLES,
    "Take evopem.identify, which holds samples out, or compare the model with another recording.",
    "caution",
)
def other_samples(evidence: Evidence) -> Found | None:
    """Samples to judge a model by that it has not seen, as identifications have."""
    if evidence.model.transforms.holds_out:
        return None
    return False, "The samples that judge the model are those that it was estimated from."


@check(
    RESPONSE_SIGNIFICANT,
    "The model does not describe a response to this input. Check that the channels belong to the"
    " same system and have the same time axis, and search longer delays (“delay.nk”).",
)
def response_to_input(evidence: Evidence) -> Found | None:
    """The response to the inputs significant on samples that were not used for estimation."""
    validation, test = evidence.validation, evidence.validation.input_test
    if not validation.inputs or not evidence.model.transforms.holds_out:
        return None
    passed = responds(test)
    if passed is None and input_rests(validation):
        return None, f"Not tested: {resting()}.", EXCITE_AGAIN
    if passed is None:
        statement = "The response to the input could not be tested"
        statement += f" on {test.samples} validation samples."
        return None, statement, "Leave at least 40 samples to validation."
    too_large = " A coefficient above 2 is not that of the model's response."
    return (
        passed,
        f"Regression of the measured on the simulated output over {whole(test.samples)} validation"
        f" samples: coefficient {test.coefficient:.3g}, {p_text(test.p_value)}."
        + (too_large if test.coefficient > LARGEST_COEFFICIENT else ""),
    )


@check(
    "Every input significant",
    "Leave it out, or move it more in the record: its response is as uncertain as its band.",
    "caution",
)
def each_response(evidence: Evidence) -> Found | None:
    """The response to each of several inputs significant beside those to the others."""
    inputs = [c for c in evidence.validation.inputs if responds(c.test) is not None]
    if len(inputs) < 2 or not responds(evidence.validation.input_test):
        return None
    nothing = [f"{c.name} ({p_text(c.test.p_value)})" for c in inputs if not responds(c.test)]
    zero = f"the response to {listed(nothing)} does not differ from zero"
    return not nothing, f"Beside the others {zero if nothing else 'each explains a part'}."


@check(
    "Inputs told apart",
    "Use no response or delay of one of them. Record again with inputs that move independently.",
)
def told_apart(evidence: Evidence) -> Found | None:
    """No input that follows from the others, and hides its response behind theirs."""
    inputs = evidence.validation.inputs
    if len(inputs) < 2:
        return None
    hidden = [channel for channel in inputs if channel.hidden_hz]
    if not hidden:
        return True, "No input follows from the others at any frequency."
    where = ", ".join(f"{low:.3g} to {high:.3g} Hz" for low, high in hidden[0].hidden_hz[:4])
    names = f"{listed([channel.name for channel in hidden])} cannot be distinguished at {where}:"
    return False, f"{names} the others make each one's standard error more than ten times as large."


def responds(test: HeldOutTest) -> bool | None:
    """Whether a response is significant and no larger than can be the model's."""
    significant = test.significant(SIGNIFICANCE)
    return significant and test.coefficient <= LARGEST_COEFFICIENT


def resting(judging: str = "validation") -> str:
    """What is said where :func:`input_rests`, of samples that are for this."""
    return f"the input does not change in the {judging} samples"


def input_rests(validation: Validation) -> bool:
    """Whether no input changes in validation samples that are enough to tell."""
    enough = validation.samples >= FEWEST_SAMPLES
    return enough and all(channel.split.comparable is None for channel in validation.inputs)


@check(
    INDEPENDENT_OF_STATE,
    "Slow poles, or poles near the unit circle that zeros nearly cancel, let a fitted state imitate"
    " a drift. Try lower orders, or look for a trend in the record.",
    "caution",
)
def independent_of_state(evidence: Evidence) -> Found | None:
    """Simulations do as well without a state that is fitted to the validation samples.

    Or that state does no better than at records of the model's own noise.
    """
    validation = evidence.validation
    if not validation.inputs:
        return None
    simulated, share = validation.simulation_error_percent, validation.share_of_noise
    fitted = validation.fitted_state_error_percent
    if not (math.isfinite(simulated) and math.isfinite(fitted)):
        return None, "One of the simulation errors is not known."
    alike, by_noise = simulated <= STATE_FACTOR * fitted + STATE_MARGIN, fitted >= share * simulated
    return (
        alike or by_noise,
        f"The simulation error is {simulated:.3g} % with the state that earlier samples give, and"
        f" {fitted:.3g} % with the initial state that fits best."
        + (" The noise of the model explains as much." if by_noise and not alike else ""),
    )


@check(
    INPUT_COMPARABLE,
    "The validation errors measure extrapolation. Divide the recording differently (“split”), or"
    " give an independent recording with the same kind of input (“validation_file”).",
    "caution",
)
def comparable_split(evidence: Evidence) -> Found | None:
    """The validation inputs have power only where the estimation inputs have power as well."""
    inputs = evidence.validation.inputs
    if not inputs or not evidence.model.transforms.holds_out:
        return None
    if input_rests(evidence.validation):
        error = "The simulation error there is that of the free response."
        return None, f"T{resting()[1:]}. {error}", EXCITE_AGAIN
    known = [channel for channel in inputs if channel.split.comparable is not None]
    if not known:
        unknown = "The spectra of the input in the two parts could not be compared:"
        return None, f"{unknown} a part is too short.", "Leave more samples to validation."
    worst = max(known, key=lambda channel: channel.split.share_outside)
    failed = [channel.name for channel in known if not channel.split.comparable]
    bands = ", ".join(f"{low:.3g} to {high:.3g} Hz" for low, high in worst.split.bands_hz[:4])
    return (
        not failed,
        f"{100 * worst.split.share_outside:.2g} % of the power of the validation input"
        f"{f' {worst.name}' if inputs[1:] else ''} lies where the estimation input has none"
        f"{f' ({bands})' if bands else ''}."
        + (f" Also of {listed(failed)}." if failed[1:] else ""),
    )


@check(
    "Record not saturated",
    "A linear model does not describe saturation. Record again within the range of the instrument.",
)
def saturation(evidence: Evidence) -> Found:
    """No channel saturated: at its smallest or largest value for several samples."""
    recording, percent = evidence.recording, {}
    for role, channels in (("input", recording.inputs), ("output", recording.outputs)):
        for channel in channels:
            called = role if len(channels) == 1 else f"{role} {channel.name}"
            percent[called] = channel.saturated_percent
    if any(math.isnan(share) for share in percent.values()):
        unknown = "The share of saturated samples could not be computed."
        return None, unknown, "Inspect the record."
    saturated = {channel: s for channel, s in percent.items() if s > MAX_SATURATED_PERCENT}
    if not saturated:
        return True, "No channel stays at its smallest or largest value."
    shares = [f"{share:.2g} % of the {channel}" for channel, share in saturated.items()]
    more = f" and {len(shares) - LISTED} more channels" if len(shares) > LISTED else ""
    stays = "is saturated: it stays at its smallest or largest value."
    return False, f"{' and '.join(shares[:LISTED])}{more} {stays}"
