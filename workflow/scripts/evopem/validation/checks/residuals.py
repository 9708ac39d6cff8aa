"""Checks of the residuals, errors and spectral peaks of each output."""

import math

from scipy.special import ndtri

from evopem.config.structures import phases_of
from evopem.models.modes import Mode
from evopem.signals.peaks import line_spacing
from evopem.validation.checks.check import (
    Evidence,
    Found,
    check,
    largest_by_chance,
    listed,
    p_text,
    whole,
)
from evopem.validation.held_out_tests import SIGNIFICANCE
from evopem.validation.model_class import SMALL_SHARE, ResidualTest
from evopem.validation.spectra import PeakEvidence
from evopem.validation.validation import Validation

# Probability that the share of white autocorrelations inside their bounds is too small by chance:
# three standard deviations.
SHARE_LEVEL = 0.00135
# Percentage of outliers that is ignored, and up to which the absolute objective is robust.
MAX_OUTLIER_PERCENT = 0.1
MAX_OUTLIER_PERCENT_ABSOLUTE = 5.0

# A mode accounts for no peak farther away than this share of its frequency.
MAX_RELATIVE_DISTANCE = 0.1

WHITE = "White residuals"
INDEPENDENT_OF_INPUT = "Residuals independent of the input"
CONSTANT = "Constant in time"
LINEAR = "Linear"
FEEDBACK = "Free of feedback"
# What the powers that explain most point to: squares and cubes of the response, of the inputs.
AT_OUTPUT = "at the output or inside, as of a sensor, a spring, friction or backlash"
AT_INPUT = "before the dynamics, as of an actuator or amplifier"
KINDS = (
    f"Squares of the response explain most: an asymmetric nonlinearity {AT_OUTPUT}.",
    f"Cubes of the response explain most: a symmetric nonlinearity {AT_OUTPUT}.",
    f"Squares of the inputs explain most: an asymmetric nonlinearity {AT_INPUT}.",
    f"Cubes of the inputs explain most: a symmetric nonlinearity {AT_INPUT}, such as saturation.",
)
BETTER = "Every simulation error is below 100 %."
LONGER_RECORD = "Use a longer record or fewer parameters."
STATES = "“orders.nx”"  # key of the orders of a state-space model


def are_white(p_value: float, share: float, lags: int, outputs: int = 1) -> bool | None:
    """Whether residuals are as white as a test can tell; None where it was not possible.

    ``share`` of the ``lags`` autocorrelations inside their 95 % bounds.  ``outputs`` that are
    judged together, by Bonferroni's bound.
    """
    if math.isnan(share) or math.isnan(p_value) or lags < 1:
        return None
    return p_value >= SIGNIFICANCE / outputs and share >= _least_share(lags, outputs)


def are_independent(largest: float, p_value: float, lags: int, pairs: int = 1) -> bool:
    """Whether the cross-correlations of residuals and input are as small as chance makes them.

    ``largest`` in its 95 % bounds, up to ``lags`` of both signs, and ``p_value`` of all, of
    ``pairs`` of outputs and inputs, judged together by Bonferroni's bound.
    """
    return largest <= largest_by_chance((2 * lags + 1) * pairs) and p_value >= SIGNIFICANCE / pairs


def _least_share(lags: int, outputs: int) -> float:
    """Least share of autocorrelations inside their bounds: those of white noise are binomial."""
    return 0.95 + float(ndtri(SHARE_LEVEL / outputs)) * math.sqrt(0.95 * 0.05 / lags)


def white(validation: Validation) -> bool | None:
    """Whether no residuals are coloured, nor more than rounding; None where it was not tested."""
    verdicts = [] if validation.without_noise else _verdicts(validation)
    return None if None in verdicts else all(verdicts)


def _verdicts(validation: Validation) -> list[bool | None]:
    lags, outputs = validation.lags, validation.outputs
    return [
        are_white(y.ljung_box.p_value, y.autocorrelation_share_inside95, lags, len(outputs))
        for y in outputs
    ]


@check(WHITE, of_noise=True)
def whiteness(evidence: Evidence) -> Found:
    """Residual autocorrelations as small as those of white noise, jointly and one by one."""
    model, validation = evidence.model, evidence.validation
    outputs, lags = validation.outputs, validation.lags
    verdicts = _verdicts(validation)
    if None in verdicts:
        test = outputs[verdicts.index(None)].ljung_box
        return (
            None,
            "The residual autocorrelation or its Ljung-Box test could not be computed: there are"
            f" {validation.residual_samples} residuals, and their fit leaves an expected statistic"
            f" of {test.expected:.3g}.",
            LONGER_RECORD,
        )
    coloured = [output.name for output, white in zip(outputs, verdicts, strict=True) if not white]
    worst = min(outputs, key=lambda output: output.ljung_box.p_value)
    share = min(output.autocorrelation_share_inside95 for output in outputs)
    tested = f"over {worst.ljung_box.lags} lags: {p_text(worst.ljung_box.p_value)}"
    if not model.has_noise_model:
        claimless = "output-error" if model.orders is None else model.structure.upper()
        return (
            True,
            f"Not asked of {claimless} models, which claim nothing of the noise. The residuals are"
            f" {'coloured' if coloured else 'white'} (Ljung-Box test {tested}); the intervals of"
            " the plant model take the colour into account. The cross-correlation with the input is"
            " the test that counts.",
        )
    of_all = f", {SIGNIFICANCE / len(outputs):.2g} allowed for {len(outputs)} outputs"
    phases = phases_of(model.structure) if model.orders else ()
    keys = [f"“orders.{phase}”" for phase in ("nc", "nd", "plant") if phase in phases]
    return (
        not coloured,
        f"Ljung-Box test of whiteness {tested}{of_all if outputs[1:] else ''}."
        f" {100 * share:.1f} % of {whole(lags)} autocorrelations lie inside their 95 % bounds (at"
        f" least {100 * _least_share(lags, len(outputs)):.1f} % required)."
        + (f" Coloured: {listed(coloured)}." if coloured and outputs[1:] else ""),
        f"The noise model is incomplete: raise the upper end of {' or '.join(keys) or STATES}, or"
        " look for trends, mains hum or nonlinearity in the record.",
    )


@check(INDEPENDENT_OF_INPUT, of_noise=True)
def input_independence(evidence: Evidence) -> Found | None:
    """No significant cross-correlation of residuals and inputs."""
    pairs, lags = evidence.validation.pairs, evidence.validation.correlation_lags
    if not pairs:
        return None
    if any(math.isnan(pair.p_value) or math.isnan(pair.max_in_bounds) for pair in pairs):
        unknown = "The cross-correlation of residuals and input could not be computed:"
        remedy = "Use a record whose input varies, or fewer parameters."
        return None, f"{unknown} one of them is constant.", remedy
    dependent = [
        f"{pair.output} with {pair.input}"
        for pair in pairs
        if not are_independent(pair.max_in_bounds, pair.p_value, lags, len(pairs))
    ]
    worst = max(pairs, key=lambda pair: pair.max_in_bounds)
    p_value = min(pair.p_value for pair in pairs)
    count = (2 * lags + 1) * len(pairs)
    of_pair = f", of {worst.output} and {worst.input}," if pairs[1:] else ""
    keys = "“orders.nb” or “orders.plant”" if evidence.model.orders else STATES
    return (
        not dependent,
        f"All {whole(2 * lags + 1)} cross-correlations (lags −{whole(lags)} to {lags}) together:"
        f" {p_text(p_value)}{' of the lowest pair' if pairs[1:] else ''}. The largest{of_pair} is"
        f" {worst.max_in_bounds:.2f} times its 95 % bound; up to {largest_by_chance(count):.2f}"
        f" times is not significant (Bonferroni, {100 * SIGNIFICANCE:g} %)."
        + (f" Dependent: {listed(dependent)}." if dependent and pairs[1:] else ""),
        f"If positive lags are significant, raise the upper end of {keys}, or search further delays"
        " (“delay.nk”). Significant negative lags indicate feedback from output to input.",
    )


def _of_class(test: ResidualTest, what: str, reason: str = "") -> Found:
    """A test of what every model assumes, with what else is said where it fails."""
    if math.isnan(test.p_value):
        return None, "There are too few samples to test it.", "Use a longer record."
    return (
        test.passed,
        f"Regression of the whitened residuals on {what}: {p_text(test.p_value)}, explains"
        f" {100 * test.share:.2g} % of their variance (fails where p is below"
        f" {100 * SIGNIFICANCE:g} % and more than {100 * SMALL_SHARE:g} % is explained)."
        f"{'' if test.passed else reason}",
    )


@check(
    CONSTANT,
    "The system changed during the record: a gain, frequency or damping of the model is a mean."
    " Identify parts of the record one by one, and compare them.",
    of_noise=True,
)
def constant_in_time(evidence: Evidence) -> Found:
    """The response of the system as it is at the beginning until the end."""
    tests = evidence.validation.model_class
    moment = tests.changed_at / evidence.model.sampling_rate
    reason = f" One sudden change explains it, about {moment:.3g} s after the beginning."
    if not moment > 0.0:
        gradual = " No single moment explains it as well: a gradual change, or several."
        reason = gradual if moment == 0.0 else ""
    if (period := tests.period / evidence.model.sampling_rate) > 0.0:
        reason = f" The change comes back about every {period:.3g} s."
    forms = "polynomials" if period == 0.0 else "polynomials or waves"
    known = "response" if evidence.validation.inputs else "output before"
    return _of_class(tests.constant, f"{forms} in time multiplied by the {known}", reason)


@check(
    LINEAR,
    "The model describes one amplitude, and its intervals are too narrow. Record with a smaller"
    " input, or take the root or logarithm of a channel that is no linear measure.",
    of_noise=True,
)
def linear(evidence: Evidence) -> Found:
    """No squares and cubes of the response and of the inputs in the residuals."""
    tests = evidence.validation.model_class
    reason = f" {KINDS[tests.powers.index(max(tests.powers))]}" if tests.powers else ""
    known = "response and of the inputs" if evidence.validation.inputs else "output before"
    return _of_class(tests.linear, f"squares and cubes of the {known}", reason)


@check(
    FEEDBACK,
    "The input depends on the output, as of a controller: the model may be that of the controller,"
    " or carry its bias. Use a structure with a noise model and a delay of one sample at least, or"
    " record without the controller. Exchange input and output if the input is the response.",
    of_noise=True,
)
def without_feedback(evidence: Evidence) -> Found | None:
    """No dependence of later inputs on the residuals."""
    test = evidence.validation.model_class.without_feedback
    if math.isnan(test.p_value) and test.share == 0.0:
        return True, "The input is periodic, so that little of it can follow the noise."
    if not evidence.validation.inputs:
        return None
    judged = _of_class(test, "later samples of an input")
    inputs = zip(evidence.model.delays, evidence.validation.inputs, strict=True)
    if judged[0] and any(delay == 0 and known.may_follow for delay, known in inputs):
        same = "What acts on the same sample is not told from a response without delay."
        return None, f"{judged[1]} {same}", "Set a delay of one sample at least for a controller."
    return judged


@check("Every spectral peak modelled")
def spectral_peaks(evidence: Evidence) -> Found:
    """A mode near every peak of the outputs' spectra, or a density there that the model gives."""
    outputs = evidence.validation.outputs
    count = sum(len(output.peaks) for output in outputs)
    if not count:
        return True, "The output's spectrum has no distinct peaks."
    spacings = [line_spacing([peak.frequency_hz for peak in output.peaks]) for output in outputs]
    resolution = evidence.validation.resolution_hz
    modes = (*evidence.model.modes, *evidence.model.noise_modes)
    if None not in spacings:
        return (
            None,
            f"The spectrum has {len(outputs[0].peaks)} peaks about {spacings[0]:.3g} Hz apart."
            " These are the lines of a periodic input, among which resonances do not show as"
            " peaks.",
            "Compare the gain of the model with the multitaper estimate at the lines.",
        )
    # A NaN is no density that the model gives.
    missed = [
        _stated(peak) + (f" of {output.name}" if outputs[1:] else "")
        for output, spacing in zip(outputs, spacings, strict=True)
        for peak in (output.peaks if spacing is None else ())
        if not peak.excess <= peak.chance
        and not any(_accounts_for(mode, peak.frequency_hz, resolution) for mode in modes)
    ]
    if not missed:
        return (
            True,
            f"Each of the {count} spectral peaks has a mode within the resolution of the"
            f" spectrum ({resolution:.2g} Hz) or within the mode's own bandwidth and uncertainty,"
            " or is no higher than the model and chance make it.",
        )
    return (
        False,
        f"{len(missed)} of {count} spectral peaks have no mode near them, and the output has more"
        f" power there than the model gives it: {listed(missed)}.",
        f"Raise the upper end of {'“orders.plant”' if evidence.model.orders else STATES}, or check"
        " whether the peak is in the input already or caused by a transform.",
    )


def _stated(peak: PeakEvidence) -> str:
    """A missed peak, and how much of its density is missing in the model."""
    if not math.isfinite(peak.excess):
        return f"{peak.frequency_hz:.4g} Hz"
    return f"{peak.frequency_hz:.4g} Hz ({peak.excess:.2g} times)"


def _accounts_for(mode: Mode, frequency: float, resolution: float) -> bool:
    """Whether a peak lies within the resolution, or the mode's half-power width or uncertainty. A
    mode with a damping ratio above 1/√2 has no resonance peak. A tenth of the mode's frequency is
    the limit, so that a broad or uncertain mode does not account for every peak."""
    centre, damping = mode.frequency_hz, abs(mode.damping_ratio)
    if damping > math.sqrt(0.5):
        return False
    error = mode.frequency_se_hz if math.isfinite(mode.frequency_se_hz) else 0.0
    width = min(max(damping * centre, 2.0 * error), MAX_RELATIVE_DISTANCE * centre)
    return abs(centre - frequency) <= max(resolution, width)


@check(
    "Every output simulated better than by its mean",
    "The inputs may not reach these outputs, or not linearly; leave them out.",
)
def better_than_mean(evidence: Evidence) -> Found | None:
    """Each of several outputs simulated better than by its mean.

    Of one output :func:`.inputs.response_to_input` is the sharper statement.
    """
    outputs = evidence.validation.outputs
    if not evidence.validation.inputs or len(outputs) == 1:
        return None
    bad = [output.name for output in outputs if not output.simulation_error_percent < 100.0]
    return not bad, f"Worse than the mean: {listed(bad)}." if bad else BETTER


@check(
    "Few residual outliers",
    "Inspect them in the record, and repair spikes and drop-outs.",
    "caution",
    of_noise=True,
)
def outliers(evidence: Evidence) -> Found:
    """Few residual outliers, or an objective that is robust against them."""
    outputs = evidence.validation.outputs
    if any(math.isnan(output.outlier_percent) for output in outputs):
        return None, "The share of residual outliers could not be computed.", LONGER_RECORD
    worst = max(outputs, key=lambda output: output.outlier_percent)
    percent = worst.outlier_percent
    of_output = f" of {worst.name}" if outputs[1:] else ""
    problem = f"{percent:.2g} % of the residuals{of_output} lie beyond five robust standard"
    if percent <= MAX_OUTLIER_PERCENT:
        return True, f"{problem} deviations."
    biased = f"{problem} deviations, so they may bias the estimate."
    if evidence.model.search.settings.objective != "absolute":
        repair = "Inspect them in the record, and repair spikes and drop-outs."
        return False, biased, f"{repair} The objective “absolute” gives outliers less weight."
    if percent <= MAX_OUTLIER_PERCENT_ABSOLUTE:
        robust = "The absolute objective is robust against so few outliers."
        return True, f"{problem} deviations. {robust}"
    return False, biased
