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

# A response that is not that of the record makes these fail, whatever the system.
BY_RESPONSE = (LINEAR, CONSTANT, INDEPENDENT_OF_INPUT)
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

# What explains less beside what: the checks that follow, their cause, and what was shown.
FOLLOWS = {
    "constant": ((CONSTANT,), LINEAR, "beside nonlinear terms a change explains less than they do"),
    "linear": ((LINEAR,), CONSTANT, "beside the change nonlinear terms explain less than it does"),
    "feedback": ((CONSTANT, LINEAR), residuals.FEEDBACK, "not found beside later inputs"),
}

__all__ = ["Check", "Evidence", "OrderRange", "checks", "failed_checks"]


def checks(evidence: Evidence) -> list[Check]:
    """The checks that apply to a model, in the order of the report."""
    if evidence.validation.checks:
        return list(evidence.validation.checks)
    judged = [check for judge in CHECKS if (check := judge(evidence)) is not None]
    judged = [_with_reason(check, evidence) for check in judged]
    failed = [check.name for check in failed_checks(judged)]
    causes = [c for c in (inputs.RESPONSE_SIGNIFICANT, LINEAR, CONSTANT) if c in failed]
    coloured = any(check.name == WHITE and check.passed is False for check in judged)
    judged = [_following(check, causes, coloured, evidence) for check in judged]
    places = {check.name: place for place, check in enumerate(judged)}
    return sorted(judged, key=lambda c: (places[c.follows_from or c.name], bool(c.follows_from)))


def _following(check: Check, causes: Sequence[str], coloured: bool, evidence: Evidence) -> Check:
    """A failed test of residuals as what a wrong response or class leaves, if none was of use."""
    of_peaks = coloured and check.name == residuals.spectral_peaks.name
    tested = WHITE if of_peaks else check.name  # white residuals leave no peak
    revisions = sum(tested in of_revision for of_revision in evidence.revised or ())
    if not (causes and failed_checks([check])):
        return check
    if causes[0] == inputs.RESPONSE_SIGNIFICANT and check.name in BY_RESPONSE:
        return _from(check, causes[0], ": residuals hold all that the model's response lacks")
    if not (revisions and tested in (WHITE, INDEPENDENT_OF_INPUT)):
        return check
    too = ", as the coloured residuals do" * of_peaks
    return _from(check, causes[0], f"{too}: no model tried against it ({revisions}) did as well")


def _from(check: Check, cause: str, shown: str) -> Check:
    """A check that a failed one explains, with what was shown of both."""
    statement = f"Follows from “{cause}”{shown}. {check.statement}"
    return replace(check, statement=statement, grade="caution", follows_from=cause)


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
        return _from(check, cause, f": {shown}")
    unclaimed = check.name == residuals.spectral_peaks.name and not evidence.model.has_noise_model
    if unclaimed or (check.name == roots.INSIDE_BOUND and roots.is_of_noise(evidence.model)):
        return replace(check, grade="caution")
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
