"""Checks of the residuals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from scipy.special import ndtri

from evopem.config.structures import phases_of
from evopem.validation.checks.check import SIGNIFICANCE, Check, p_text

if TYPE_CHECKING:
    from evopem.estimation.model_record import ModelRecord
    from evopem.validation.validation import Validation

# With a coloured input, cross-correlations at neighbouring lags are dependent, so the share inside
# the bounds varies more than a binomial one.
MIN_CROSS_CORRELATION_SHARE = 0.90
# Percentage of outliers below which they are ignored, and up to which the absolute objective is
# robust against them.
MAX_OUTLIER_PERCENT = 0.1
MAX_OUTLIER_PERCENT_ABSOLUTE = 5.0


WHITE = "White residuals"
INDEPENDENT_OF_INPUT = "Residuals independent of the input"
# Structures that claim nothing of the noise.
WITHOUT_NOISE_MODEL = ("fir", "oe")


def white(validation: Validation) -> bool | None:
    """Whether the residuals are as white as a test can tell; None where it was not possible."""
    return are_white(
        validation.ljung_box.p_value, validation.autocorrelation_share_inside95, validation.lags
    )


def are_white(p_value: float, share: float, lags: int) -> bool | None:
    """Whether residuals are as white as a test can tell; None where it was not possible.

    Parameters
    ----------
    p_value : float
        Of the joint test.
    share : float
        Share of the autocorrelations inside their 95 % bounds, 0 to 1.
    lags : int
        Number of these.
    """
    if math.isnan(share) or math.isnan(p_value) or lags < 1:
        return None
    return p_value >= SIGNIFICANCE and share >= _least_share(lags)


def are_independent(largest: float, share: float, lags: int) -> bool:
    """Whether the cross-correlations of residuals and input are as small as chance makes them.

    Parameters
    ----------
    largest : float
        The largest one, in its 95 % bounds.
    share : float
        Share of them inside these bounds, 0 to 1.
    lags : int
        Largest lag, of both signs.
    """
    return largest <= _largest_by_chance(lags) and share >= MIN_CROSS_CORRELATION_SHARE


def _largest_by_chance(lags: int) -> float:
    """Of 2 lags + 1 correlations in 95 % bounds; Bonferroni's inequality needs no independence."""
    return float(ndtri(1 - SIGNIFICANCE / (2 * (2 * lags + 1))) / ndtri(0.975))


def _least_share(lags: int) -> float:
    """Least share of autocorrelations inside their 95 % bounds.

    Those of white noise are nearly independent, so the share is binomial; three standard deviations
    are allowed.
    """
    return 0.95 - 3.0 * math.sqrt(0.95 * 0.05 / lags)


def whiteness(model: ModelRecord, validation: Validation) -> Check:
    """Residual autocorrelations as small as those of white noise, jointly and one by one."""
    name = WHITE
    share, lags = validation.autocorrelation_share_inside95, validation.lags
    test = validation.ljung_box
    passed = white(validation)
    if passed is None:
        return Check(
            name,
            None,
            "The residual autocorrelation or its Ljung-Box test could not be computed: there are"
            f" {validation.residual_samples} residuals, and their fit leaves an expected statistic"
            f" of {test.expected:.3g}.",
            "Use a longer record or fewer parameters.",
        )
    structure = model.structure
    if structure in WITHOUT_NOISE_MODEL:
        return Check(
            name,
            True,
            f"Not asked of {structure.upper()} models, which claim nothing of the noise. The"
            f" residuals are {'white' if passed else 'coloured'} (Ljung-Box test over {test.lags}"
            f" lags: {p_text(test.p_value)}); the intervals of the plant model take the colour into"
            " account."
            " The cross-correlation with the input is the test that counts.",
        )
    return Check(
        name,
        passed,
        f"Ljung-Box test of whiteness over {test.lags} lags: {p_text(test.p_value)}."
        f" {100 * share:.1f} % of {lags} autocorrelations lie inside their 95 % bounds"
        f" (at least {100 * _least_share(lags):.1f} % required).",
        ""
        if passed
        else f"The noise model is incomplete: raise the upper end of {_noise_keys(structure)}, or"
        " look for trends, mains hum or nonlinearity in the record.",
    )


def _noise_keys(structure: str) -> str:
    """The keys of the ranges of orders that the noise model has."""
    keys = [f"“orders.{phase}”" for phase in ("nc", "nd", "joint") if phase in phases_of(structure)]
    return " or ".join(keys)


def input_independence(validation: Validation) -> Check:
    """No significant cross-correlation of residuals and input."""
    name = INDEPENDENT_OF_INPUT
    test = validation.cross_correlation
    if math.isnan(test.share_inside95) or math.isnan(test.max_in_bounds):
        return Check(
            name,
            None,
            "The cross-correlation of residuals and input could not be computed: one of them is"
            " constant.",
            "Use a record whose input varies, or fewer parameters.",
        )
    count = 2 * test.lags + 1
    allowed = _largest_by_chance(test.lags)
    passed = are_independent(test.max_in_bounds, test.share_inside95, test.lags)
    return Check(
        name,
        passed,
        f"{100 * test.share_inside95:.1f} % of {count} cross-correlations (lags −{test.lags} to"
        f" {test.lags}) lie inside their 95 % bounds. The largest is {test.max_in_bounds:.2f} times"
        f" its bound; up to {allowed:.2f} times is not significant (Bonferroni,"
        f" {100 * SIGNIFICANCE:g} %).",
        ""
        if passed
        else "If positive lags are significant, raise the upper end of “.orders.nb” or"
        " “orders.joint”, or search further delays (“delay.nk”). Significant negative lags indicate"
        " feedback from output to input.",
    )


def outliers(model: ModelRecord, validation: Validation) -> Check:
    """Few residual outliers, or an objective that is robust against them."""
    name = "Few residual outliers"
    percent = validation.residual_outlier_percent
    if math.isnan(percent):
        return Check(
            name,
            None,
            "The share of residual outliers could not be computed.",
            "Use a longer record or fewer parameters.",
        )
    statement = f"{percent:.2g} % of the residuals lie beyond five robust standard deviations"
    if percent <= MAX_OUTLIER_PERCENT:
        return Check(name, True, f"{statement}.")
    absolute = model.search.settings.objective == "absolute"
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
