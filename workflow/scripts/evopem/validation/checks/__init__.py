"""Checks of a model: each is passed, failed or not judged, with a statement that says why.

A check passes only on numbers that show it. Where a number could not be computed (NaN) or does not
exist, ``passed`` is None and the statement says which one.
"""

from collections.abc import Sequence
from dataclasses import replace

from evopem.validation.checks import inputs, residuals, roots, search
from evopem.validation.checks.check import Check, Evidence, Judge, OrderRange, failed_checks, p_text
from evopem.validation.checks.residuals import CONSTANT, INDEPENDENT_OF_INPUT, LINEAR, WHITE
from evopem.validation.checks.roots import DISTINCT

CHECKS = tuple(
    value
    for module in (roots, residuals, search, inputs)
    for value in vars(module).values()
    if isinstance(value, Judge)
)
"""Every check, in the order of the report: that of these modules."""

# The automatic recipe has tried what the advice of these would be.
REVISED = (WHITE, INDEPENDENT_OF_INPUT, DISTINCT)
ELSEWHERE = "Look for nonlinearity, disturbances or feedback in the record."
OF_PAIR = "The pair hardly affects the frequency response. Do not trust a mode of it."

# Distortion makes these fail, whatever the linear model.
BY_DISTORTION = (WHITE, INDEPENDENT_OF_INPUT, LINEAR)
AT_FLOOR = (
    "No linear model does much better: nine tenths of the simulation error or more are what none of"
    " these inputs removes, such as noise, nonlinearity and change."
)
NOT_THE_MODEL = (
    "This model is not to blame: no other order or structure removes the distortion. Record with a"
    " smaller input, and trust no standard error."
)

# What is not found beside what: the checks that follow, their cause, and what was shown.
FOLLOWS = {
    "constant": ((CONSTANT,), LINEAR, "beside nonlinear terms the data show no change"),
    "linear": ((LINEAR,), CONSTANT, "beside the change the data show no nonlinearity"),
    "feedback": ((CONSTANT, LINEAR), residuals.FEEDBACK, "not found beside later inputs"),
}

__all__ = ["Check", "Evidence", "OrderRange", "checks", "failed_checks", "p_text"]


def checks(evidence: Evidence) -> list[Check]:
    """The checks that apply to a model, in the order of the report."""
    if evidence.validation.checks:
        return list(evidence.validation.checks)
    judged = [check for judge in CHECKS if (check := judge(evidence)) is not None]
    judged = [_with_reason(check, evidence) for check in judged]
    causes = [check.name for check in failed_checks(judged) if check.name in (LINEAR, CONSTANT)]
    coloured = any(check.name == WHITE and check.passed is False for check in judged)
    judged = [_following(check, causes, coloured, evidence) for check in judged]
    places = {check.name: place for place, check in enumerate(judged)}
    return sorted(judged, key=lambda c: (places[c.follows_from or c.name], bool(c.follows_from)))


def _following(check: Check, causes: Sequence[str], coloured: bool, evidence: Evidence) -> Check:
    """A failed test of residuals as what a wrong class leaves, where no revision was of use."""
    of_peaks = coloured and check.name == residuals.spectral_peaks.name
    tested = WHITE if of_peaks else check.name  # white residuals leave no peak
    revisions = sum(tested in of_revision for of_revision in evidence.revised or ())
    of_residuals = tested in (WHITE, INDEPENDENT_OF_INPUT) and failed_checks([check])
    if not (causes and revisions and of_residuals):
        return check
    too = ", as the coloured residuals do" * of_peaks
    shown = f"no model tried against it ({revisions}) did as well"
    statement = f"Follows from “{causes[0]}”{too}: {shown}. {check.statement}"
    return replace(check, statement=statement, grade="caution", follows_from=causes[0])


def _with_reason(check: Check, evidence: Evidence) -> Check:
    """A failed check with what was tried, and what is shown to be its cause."""
    validation, distortion = evidence.validation, evidence.validation.distortion
    if check.passed is not False:
        return check
    if evidence.revised is not None and check.name in REVISED:
        tried = "What was tried against it, and what that brought, is under “Decisions” and in"
        advice = f"{tried} decisions.json. {OF_PAIR if check.name == DISTINCT else ELSEWHERE}"
        check = replace(check, advice=advice)
    followers, cause, shown = FOLLOWS.get(validation.model_class.follows, ((), "", ""))
    if check.name in followers:
        statement = f"Follows from “{cause}”: {shown}. {check.statement}"
        return replace(check, statement=statement, grade="caution", follows_from=cause)
    of_floor = validation.at_floor and check.name != WHITE
    if check.name not in BY_DISTORTION or not (distortion.shown or of_floor):
        return check
    if not distortion.shown:
        return replace(check, statement=f"{check.statement} {AT_FLOOR}", grade="caution")
    worst = max(output.distortion.percent for output in distortion.outputs)
    least = "" if distortion.separated else "at least "
    statement = (
        f"{check.statement} Nonlinear distortion, {least}{worst:.2g} % of the output's deviation"
        f" ({p_text(distortion.p_value)}), repeats with the input and is in the residuals of every"
        " linear model."
    )
    check = replace(check, statement=statement)
    return replace(check, advice=NOT_THE_MODEL, grade="caution") if distortion.prevails else check
