"""Checks of a model: each is passed, failed or not judged, with a statement that says why.

A check passes only on numbers that show it. Where a number could not be computed (NaN) or does not
exist, ``passed`` is None and the statement says which one. A function of :data:`CHECKS` gives None
where its check does not apply to a model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from evopem.validation.checks.check import (
    SIGNIFICANCE,
    Check,
    Evidence,
    OrderRange,
    failed_checks,
    p_text,
)
from evopem.validation.checks.inputs import (
    comparable_split,
    excitation,
    independent_of_state,
    response_to_input,
    saturation,
)
from evopem.validation.checks.residuals import (
    INDEPENDENT_OF_INPUT,
    WHITE,
    better_than_mean,
    constant_in_time,
    input_independence,
    linear,
    outliers,
    spectral_peaks,
    whiteness,
    without_feedback,
)
from evopem.validation.checks.roots import (
    DISTINCT,
    cancellation,
    invertibility,
    stability,
    stability_bound,
)
from evopem.validation.checks.search import repeatability, search_ranges

CHECKS: tuple[Callable[[Evidence], Check | None], ...] = (
    stability,
    invertibility,
    whiteness,
    input_independence,
    constant_in_time,
    linear,
    without_feedback,
    spectral_peaks,
    cancellation,
    search_ranges,
    stability_bound,
    repeatability,
    excitation,
    response_to_input,
    better_than_mean,
    independent_of_state,
    comparable_split,
    outliers,
    saturation,
)
"""Every check, in the order of the report."""

# The automatic recipe has tried what the advice of these would be.
REMEDIED = (WHITE, INDEPENDENT_OF_INPUT, DISTINCT)
ELSEWHERE = "Look for nonlinearity, disturbances or feedback in the record."
LEFT_TO_DO = {
    DISTINCT: "The pair hardly affects the frequency response. Do not trust a mode of it."
}

__all__ = ["SIGNIFICANCE", "Check", "Evidence", "OrderRange", "checks", "failed_checks", "p_text"]


def checks(evidence: Evidence) -> list[Check]:
    """The checks that apply to a model, in the order of the report."""
    found = [check for judge in CHECKS if (check := judge(evidence)) is not None]
    judged = [replace(check, advice="") if check.passed else check for check in found]
    return [_after_remedies(check) for check in judged] if evidence.is_automatic else judged


def _after_remedies(check: Check) -> Check:
    """A failed check whose remedies the workflow has tried."""
    if check.passed is not False or check.name not in REMEDIED:
        return check
    return replace(
        check,
        advice="What was tried against it, and what that brought, is under “Decisions” and in"
        f" decisions.json. {LEFT_TO_DO.get(check.name, ELSEWHERE)}",
    )
