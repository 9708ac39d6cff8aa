"""Checks of a state-space model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from evopem.estimation.search.certificate import POLYNOMIALS, STATE_SPACE
from evopem.validation.checks.check import SIGNIFICANCE, Check, p_text
from evopem.validation.checks.excitation import independent_of_state
from evopem.validation.checks.recording import MAX_SATURATED_PERCENT
from evopem.validation.checks.residuals import (
    INDEPENDENT_OF_INPUT,
    MAX_OUTLIER_PERCENT,
    MAX_OUTLIER_PERCENT_ABSOLUTE,
    MIN_CROSS_CORRELATION_SHARE,
    WHITE,
)
from evopem.validation.checks.search import repeatability

if TYPE_CHECKING:
    from evopem.estimation.model_record import ModelRecord
    from evopem.signals.recording_info import RecordingInfo
    from evopem.validation.multichannel import MultichannelValidation, PairCorrelation

# Names that a sentence lists at most.
LISTED = 6


def state_space_checks(
    record: ModelRecord,
    validation: MultichannelValidation,
    order: int,
    tried: Sequence[int],
    recording: RecordingInfo,
) -> list[Check]:
    """Check a state-space model against its validation, its order search and its recording.

    Parameters
    ----------
    record : ModelRecord
    validation : MultichannelValidation
    order : int
        That was chosen: of the plant that a Box-Jenkins model begins with, whose states cannot be
        told from those of the noise afterwards.
    tried : sequence of int
        Orders that were searched.
    recording : RecordingInfo
    """
    has_input = bool(record.input_names)
    return [
        _stability(record),
        _stability_bound(record),
        *([_better_than_mean(validation)] if has_input else []),
        *(
            [
                independent_of_state(
                    validation.simulation_error_percent, validation.fitted_state_error_percent
                )
            ]
            if has_input
            else []
        ),
        _whiteness(record, validation),
        *([_independence(record, validation)] if has_input else []),
        _order(record, order, tried),
        repeatability(
            record.search.diagnostics, STATE_SPACE if record.orders is None else POLYNOMIALS
        ),
        _outliers(record, validation),
        _saturation(recording),
    ]


def _named(names: Sequence[str]) -> str:
    shown = ", ".join(names[:LISTED])
    return shown if len(names) <= LISTED else f"{shown} and {len(names) - LISTED} more"


def _stability(record: ModelRecord) -> Check:
    radius = float(np.max(np.abs(record.state_space.poles())))
    passed = radius < 1.0
    return Check(
        "Stable",
        passed,
        f"The largest modulus of a pole is {radius:.6g}.",
        "" if passed else "Its simulation grows without bound; look for drift in the record.",
    )


def _stability_bound(record: ModelRecord) -> Check:
    passed = not record.search.at_stability_bound
    bound = record.search.settings.max_root_radius
    return Check(
        "Roots inside the stability bound",
        passed,
        f"{_number_of_roots(record, passed)} lies at the largest radius allowed, {bound:g}.",
        ""
        if passed
        else "Standard errors do not hold at a bound. Raise “search.max_root_radius” towards 1, or"
        " look for drift in the record.",
    )


def _better_than_mean(validation: MultichannelValidation) -> Check:
    bad = [each.name for each in validation.outputs if not each.simulation_error_percent < 100.0]
    return Check(
        "Every output simulated better than by its mean",
        not bad,
        f"Worse than the mean: {_named(bad)}." if bad else "Every simulation error is below 100 %.",
        "The inputs may not reach these outputs, or not linearly; leave them out." if bad else "",
    )


def _whiteness(record: ModelRecord, validation: MultichannelValidation) -> Check:
    """Ljung-Box tests of all outputs, with Bonferroni's bound for their number."""
    tests = [each.ljung_box_p for each in validation.outputs]
    if any(map(math.isnan, tests)):
        return Check(WHITE, None, "A test could not be computed.", "Use a longer record.")
    level = SIGNIFICANCE / len(tests)
    coloured = coloured_outputs(validation)
    lowest = min(tests)
    found = (
        f"Ljung-Box tests of the validation residuals of each output: lowest {p_text(lowest)},"
        f" {level:.2g} allowed for {len(tests)} output{'s' * (len(tests) > 1)}."
    )
    if coloured and not record.has_noise_model:
        return Check(
            WHITE,
            True,
            f"Not asked of a model that claims nothing of the noise. {found} The intervals of the"
            " plant model take the colour into account.",
        )
    return Check(
        WHITE,
        not coloured,
        f"{found} Coloured: {_named(coloured)}." if coloured else found,
        f"Raise the upper end of “{_range_key(record)}”, or look for trends, mains hum or"
        " nonlinearity in the record."
        if coloured
        else "",
    )


def coloured_outputs(validation: MultichannelValidation) -> list[str]:
    """Names of the outputs whose residuals are not white, with Bonferroni's bound."""
    level = SIGNIFICANCE / len(validation.outputs)
    return [each.name for each in validation.outputs if each.ljung_box_p < level]


def dependent_pairs(validation: MultichannelValidation) -> list[PairCorrelation]:
    """The pairs whose residuals depend on the input, with Bonferroni's bound."""
    allowed = _allowed(validation)
    return [
        each
        for each in validation.pairs
        if each.max_in_bounds > allowed or each.share_inside95 < MIN_CROSS_CORRELATION_SHARE
    ]


def _tested(validation: MultichannelValidation) -> int:
    """Number of cross-correlations of all pairs."""
    return (2 * validation.correlation_lags + 1) * len(validation.pairs)


def _allowed(validation: MultichannelValidation) -> float:
    """The largest cross-correlation that is not significant, in its 95 % bound."""
    if not validation.pairs:
        return math.inf
    return float(ndtri(1 - SIGNIFICANCE / (2 * _tested(validation))) / ndtri(0.975))


def _independence(record: ModelRecord, validation: MultichannelValidation) -> Check:
    pairs = validation.pairs
    if any(math.isnan(each.max_in_bounds) for each in pairs):
        return Check(
            INDEPENDENT_OF_INPUT, None, "A test could not be computed.", "Use a longer record."
        )
    count, allowed = _tested(validation), _allowed(validation)
    bad = dependent_pairs(validation)
    worst = max(pairs, key=lambda each: each.max_in_bounds)
    found = (
        f"The largest of {count} cross-correlations, of {worst.output} and"
        f" {worst.input}, is {worst.max_in_bounds:.2f} times its 95 % bound; up to {allowed:.2f}"
        f" times is not significant (Bonferroni, {100 * SIGNIFICANCE:g} %)."
    )
    names = _named([f"{each.output} with {each.input}" for each in bad])
    return Check(
        INDEPENDENT_OF_INPUT,
        not bad,
        f"{found} Dependent: {names}." if bad else found,
        f"Raise the upper end of “{_range_key(record)}”. Significant negative lags indicate"
        " feedback from output to input."
        if bad
        else "",
    )


def _order(record: ModelRecord, order: int, tried: Sequence[int]) -> Check:
    name, key = "Order inside its range", _range_key(record)
    text = f"{order} states{' of the plant' if record.structure == 'ss_bj' else ''};"
    if record.orders is not None:
        order, text = record.orders.plant, f"{record.text}; joint orders"
    text += f" {min(tried)} to {max(tried)} were tried"
    if record.at_upper_ends:
        return Check(
            name,
            False,
            f"At the upper end of its range: {_named(record.at_upper_ends)}, in {record.text}.",
            "Give the range a higher upper end, or one number if it is known.",
            "note",
        )
    if len(tried) == 1:
        return Check(
            name,
            None,
            f"The configuration fixes the order: {text}.",
            f"Give “{key}” a range, if the order is not known.",
        )
    if order >= max(tried):
        return Check(
            name,
            False,
            f"At the upper end: {text}.",
            f"Give “{key}” a higher upper end; a larger model may be better.",
            "note",
        )
    return Check(name, True, f"Inside: {text}.")


def _range_key(record: ModelRecord) -> str:
    """Key of the range of orders."""
    return "orders.nx" if record.orders is None else "orders.joint"


def _number_of_roots(record: ModelRecord, none: bool) -> str:
    """Such as "No root of A, C, D or F", or that there is one."""
    if record.orders is None:
        return f"{'No' if none else 'An'} eigenvalue of A or of A − K C"
    return f"{'No' if none else 'A'} root of A, C, D or F"


def _outliers(record: ModelRecord, validation: MultichannelValidation) -> Check:
    worst = max(validation.outputs, key=lambda each: each.outlier_percent)
    absolute = record.search.settings.objective == "absolute"
    bearable = MAX_OUTLIER_PERCENT_ABSOLUTE if absolute else MAX_OUTLIER_PERCENT
    passed = worst.outlier_percent <= bearable
    return Check(
        "Few residual outliers",
        passed,
        f"At most {worst.outlier_percent:.2g} % of the residuals of an output ({worst.name}) lie"
        " beyond five robust standard deviations.",
        ""
        if passed
        else "Inspect them in the record, and repair spikes and drop-outs."
        + ("" if absolute else " The objective “absolute” gives outliers less weight."),
    )


def _saturation(recording: RecordingInfo) -> Check:
    channels = (*recording.inputs, *recording.outputs)
    saturated = [each.name for each in channels if each.saturated_percent > MAX_SATURATED_PERCENT]
    return Check(
        "Record not saturated",
        not saturated,
        f"Saturated: {_named(saturated)}."
        if saturated
        else "No channel stays at its smallest or largest value.",
        "A linear model does not describe saturation. Record again within the range of the"
        " instrument."
        if saturated
        else "",
    )
