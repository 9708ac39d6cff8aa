"""Checks of the residuals and errors of each output."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from scipy.special import ndtri

from evopem.config.structures import phases_of
from evopem.estimation.model_record import ModelRecord
from evopem.validation.checks.check import (
    SIGNIFICANCE,
    Check,
    Evidence,
    largest_by_chance,
    listed,
    p_text,
)

if TYPE_CHECKING:
    from evopem.validation.validation import Validation

# With a coloured input, cross-correlations at neighbouring lags are dependent, so the share inside
# the bounds varies more than a binomial one.
MIN_CROSS_CORRELATION_SHARE = 0.90
# Probability that the share of white autocorrelations inside their bounds is too small by chance:
# three standard deviations.
SHARE_LEVEL = 0.00135
# Percentage of outliers below which they are ignored, and up to which the absolute objective is
# robust against them.
MAX_OUTLIER_PERCENT = 0.1
MAX_OUTLIER_PERCENT_ABSOLUTE = 5.0

WHITE = "White residuals"
INDEPENDENT_OF_INPUT = "Residuals independent of the input"
# Structures that claim nothing of the noise.
WITHOUT_NOISE_MODEL = ("fir", "oe")


def are_white(p_value: float, share: float, lags: int, outputs: int = 1) -> bool | None:
    """Whether residuals are as white as a test can tell; None where it was not possible.

    ``p_value``: of the joint test.  ``share``: share of the autocorrelations inside their 95 %
    bounds, 0 to 1.  ``lags``: number of these.  ``outputs``: that are judged together, by
    Bonferroni's bound.
    """
    if math.isnan(share) or math.isnan(p_value) or lags < 1:
        return None
    return p_value >= SIGNIFICANCE / outputs and share >= _least_share(lags, outputs)


def are_independent(largest: float, share: float, lags: int, pairs: int = 1) -> bool:
    """Whether the cross-correlations of residuals and input are as small as chance makes them.

    ``largest``: the largest one, in its 95 % bounds.  ``share``: share of them inside these bounds,
    0 to 1.  ``lags``: largest lag, of both signs.  ``pairs``: of outputs and inputs, judged
    together by Bonferroni's bound.
    """
    allowed = largest_by_chance((2 * lags + 1) * pairs)
    return largest <= allowed and share >= MIN_CROSS_CORRELATION_SHARE


def _least_share(lags: int, outputs: int) -> float:
    """Least share of autocorrelations inside their bounds: those of white noise are binomial."""
    return 0.95 + float(ndtri(SHARE_LEVEL / outputs)) * math.sqrt(0.95 * 0.05 / lags)


def white(validation: Validation) -> bool | None:
    """Whether the residuals of all outputs are; None where a test was not possible."""
    verdicts = _verdicts(validation)
    return None if None in verdicts else all(verdicts)


def _verdicts(validation: Validation) -> list[bool | None]:
    outputs = validation.outputs
    return [
        are_white(
            each.ljung_box.p_value,
            each.autocorrelation_share_inside95,
            validation.lags,
            len(outputs),
        )
        for each in outputs
    ]


def whiteness(evidence: Evidence) -> Check:
    """Residual autocorrelations as small as those of white noise, jointly and one by one."""
    model, validation = evidence.model, evidence.validation
    outputs, lags = validation.outputs, validation.lags
    verdicts = _verdicts(validation)
    if None in verdicts:
        test = outputs[verdicts.index(None)].ljung_box
        return Check(
            WHITE,
            None,
            "The residual autocorrelation or its Ljung-Box test could not be computed: there are"
            f" {validation.residual_samples} residuals, and their fit leaves an expected statistic"
            f" of {test.expected:.3g}.",
            "Use a longer record or fewer parameters.",
        )
    coloured = [each.name for each, white in zip(outputs, verdicts, strict=True) if not white]
    worst = min(outputs, key=lambda each: each.ljung_box.p_value)
    share = min(each.autocorrelation_share_inside95 for each in outputs)
    tested = f"over {worst.ljung_box.lags} lags: {p_text(worst.ljung_box.p_value)}"
    if not model.has_noise_model:
        return Check(
            WHITE,
            True,
            f"Not asked of {_claimless(model)} models, which claim nothing of the noise. The"
            f" residuals are {'coloured' if coloured else 'white'} (Ljung-Box test {tested}); the"
            " intervals of the plant model take the colour into account."
            " The cross-correlation with the input is the test that counts.",
        )
    of_all = f", {SIGNIFICANCE / len(outputs):.2g} allowed for {len(outputs)} outputs"
    return Check(
        WHITE,
        not coloured,
        f"Ljung-Box test of whiteness {tested}{of_all if outputs[1:] else ''}."
        f" {100 * share:.1f} % of {lags} autocorrelations lie inside their 95 % bounds (at least"
        f" {100 * _least_share(lags, len(outputs)):.1f} % required)."
        + (f" Coloured: {listed(coloured)}." if coloured and outputs[1:] else ""),
        ""
        if not coloured
        else f"The noise model is incomplete: raise the upper end of {_noise_keys(model)}, or"
        " look for trends, mains hum or nonlinearity in the record.",
    )


def _claimless(model: ModelRecord) -> str:
    return "output-error" if model.orders is None else model.structure.upper()


def _noise_keys(model: ModelRecord) -> str:
    """The keys of the ranges of orders that the noise model has."""
    if model.orders is None:
        return "“orders.nx”"
    phases = phases_of(model.structure)
    return " or ".join(f"“orders.{phase}”" for phase in ("nc", "nd", "joint") if phase in phases)


def input_independence(evidence: Evidence) -> Check | None:
    """No significant cross-correlation of residuals and inputs."""
    name, validation = INDEPENDENT_OF_INPUT, evidence.validation
    pairs, lags = validation.pairs, validation.correlation_lags
    if not pairs:
        return None
    if any(math.isnan(each.share_inside95) or math.isnan(each.max_in_bounds) for each in pairs):
        return Check(
            name,
            None,
            "The cross-correlation of residuals and input could not be computed: one of them is"
            " constant.",
            "Use a record whose input varies, or fewer parameters.",
        )
    dependent = [
        f"{each.output} with {each.input}"
        for each in pairs
        if not are_independent(each.max_in_bounds, each.share_inside95, lags, len(pairs))
    ]
    worst = max(pairs, key=lambda each: each.max_in_bounds)
    share = min(each.share_inside95 for each in pairs)
    count = (2 * lags + 1) * len(pairs)
    of_pair = f", of {worst.output} and {worst.input}," if pairs[1:] else ""
    states = evidence.model.orders is None
    return Check(
        name,
        not dependent,
        f"{100 * share:.1f} % of {count} cross-correlations (lags −{lags} to"
        f" {lags}) lie inside their 95 % bounds. The largest{of_pair} is"
        f" {worst.max_in_bounds:.2f} times its bound; up to {largest_by_chance(count):.2f} times is"
        f" not significant (Bonferroni, {100 * SIGNIFICANCE:g} %)."
        + (f" Dependent: {listed(dependent)}." if dependent and pairs[1:] else ""),
        ""
        if not dependent
        else "If positive lags are significant, raise the upper end of "
        + ("“orders.nx”" if states else "“orders.nb” or “orders.joint”")
        + ", or search further delays (“delay.nk”). Significant negative lags indicate"
        " feedback from output to input.",
    )


def better_than_mean(evidence: Evidence) -> Check | None:
    """Each of several outputs simulated better than by its mean.

    Of one output :func:`.inputs.response_to_input` is the sharper statement.
    """
    outputs = evidence.validation.outputs
    if not evidence.validation.inputs or len(outputs) == 1:
        return None
    bad = [each.name for each in outputs if not each.simulation_error_percent < 100.0]
    return Check(
        "Every output simulated better than by its mean",
        not bad,
        f"Worse than the mean: {listed(bad)}." if bad else "Every simulation error is below 100 %.",
        "The inputs may not reach these outputs, or not linearly; leave them out." if bad else "",
    )


def outliers(evidence: Evidence) -> Check:
    """Few residual outliers, or an objective that is robust against them."""
    name, outputs = "Few residual outliers", evidence.validation.outputs
    if any(math.isnan(each.outlier_percent) for each in outputs):
        return Check(
            name,
            None,
            "The share of residual outliers could not be computed.",
            "Use a longer record or fewer parameters.",
        )
    worst = max(outputs, key=lambda each: each.outlier_percent)
    percent = worst.outlier_percent
    of_output = f" of {worst.name}" if outputs[1:] else ""
    statement = (
        f"{percent:.2g} % of the residuals{of_output} lie beyond five robust standard deviations"
    )
    if percent <= MAX_OUTLIER_PERCENT:
        return Check(name, True, f"{statement}.")
    absolute = evidence.model.search.settings.objective == "absolute"
    if absolute and percent <= MAX_OUTLIER_PERCENT_ABSOLUTE:
        return Check(
            name, True, f"{statement}. The absolute objective is robust against so few outliers."
        )
    return Check(
        name,
        False,
        f"{statement}, so they may bias the estimate.",
        "Inspect them in the record, and repair spikes and drop-outs."
        + ("" if absolute else " The objective “absolute” gives outliers less weight."),
    )
