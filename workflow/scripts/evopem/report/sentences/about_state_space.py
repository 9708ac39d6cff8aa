"""The verdict on a state-space model: what it is good for, and why."""

from __future__ import annotations

import numpy as np

from evopem.report.numbers import THIN, count, enumeration, is_number, number, percent, plural
from evopem.report.sentences.about_verdict import (
    Answer,
    Use,
    answer_by_error,
    joined,
    worse,
)
from evopem.results.multichannel import MultichannelResults

# Modes that a sentence names at most.
MOST_NAMED = 8
# The checks that standard errors rest on; without the first there are none.
_OF_INTERVALS = (
    "Roots inside the stability bound",
    "White residuals",
    "Residuals independent of the input",
    "Search repeatable",
)


def state_space_uses(results: MultichannelResults) -> list[Use]:
    """Judge every use of a model of several channels by its errors and its checks."""
    failed = {check.name for check in results.checks if check.passed is False}
    of_inputs = (
        [_simulation(results, failed), _responses(results, failed)]
        if results.model.input_names
        else []
    )
    unknown = {check.name for check in results.checks if check.passed is None}
    return [
        *of_inputs,
        _prediction(results, failed),
        _modes(results),
        _intervals(failed, unknown),
    ]


def _simulation(results: MultichannelResults, failed: set[str]) -> Use:
    validation = results.validation
    error = validation.simulation_error_percent
    if not is_number(error) or "Stable" in failed:
        return Use("simulation from the inputs", "no", "it grows without bound")
    worst = max(validation.outputs, key=lambda each: each.simulation_error_percent)
    reason = f"off by {percent(error)} of the outputs’ deviation on {count(validation.samples)}"
    reason += " validation samples"
    if len(validation.outputs) > 1:
        reason += f", by {percent(worst.simulation_error_percent)} at {worst.name}"
    answer = answer_by_error(error)
    if answer_by_error(worst.simulation_error_percent) != "good":
        answer = worse(answer, "care")
    return Use("simulation from the inputs", answer, reason)


def _prediction(results: MultichannelResults, failed: set[str]) -> Use:
    error = results.validation.prediction_error_percent
    if not is_number(error):
        return Use("one-step prediction", "no", "the error is not known")
    against = "failed: “White residuals”" if "White residuals" in failed else ""
    answer: Answer = "care" if against else "good"
    if not results.model.has_noise_model:
        answer = worse(answer, answer_by_error(error))
    return Use(
        "one-step prediction", answer, joined(f"off by {percent(error)} on average", against)
    )


def _responses(results: MultichannelResults, failed: set[str]) -> Use:
    table = results.frequency_response
    known = table[(table["gain"] > 0) & np.isfinite(table["gain_upper"])]
    answer: Answer = "care" if "Residuals independent of the input" in failed else "good"
    against = "failed: “Residuals independent of the input”" if answer == "care" else ""
    if not len(known) or "Stable" in failed:
        return Use("the frequency responses", worse(answer, "care"), "their bands are not known")
    width = (known["gain_upper"] - known["gain_lower"]) / (2 * known["gain"])
    half = number(100 * float(np.median(width)), 2)
    reason = f"95 % bands of ±{half}{THIN}% of the gain (median over all pairs and frequencies)"
    return Use("the frequency responses", answer, joined(reason, against))


def _modes(results: MultichannelResults) -> Use:
    trusted, others = results.trusted_modes, len(results.modes.modes)
    others -= len(trusted)
    if not trusted:
        reason = "none passes every test" if others else "the model has no oscillating mode"
        return Use("modes", "no", reason)
    shown = [number(mode.frequency_hz, 3) for mode in trusted[:MOST_NAMED]]
    if len(trusted) > MOST_NAMED:
        shown.append(f"{len(trusted) - MOST_NAMED} more")
    places = enumeration(shown) + ("" if len(trusted) > MOST_NAMED else f"{THIN}Hz")
    name = "the mode at" if len(trusted) == 1 else "the modes at"
    reason = f"{plural(others, 'further mode')} not to be trusted" if others else ""
    mixed = sum(each.trusted and not each.shape_trusted for each in results.modes.table.modes)
    against = f"{plural(mixed, 'shape')} not to be trusted" if mixed else ""
    return Use(
        f"{name} {places}, with shapes", "care" if mixed else "good", joined(reason, against)
    )


def _intervals(failed: set[str], unknown: set[str]) -> Use:
    against = [
        f"{word}: {enumeration([f'“{name}”' for name in _OF_INTERVALS if name in names])}"
        for word, names in (("failed", failed), ("not judged", unknown))
        if names.intersection(_OF_INTERVALS)
    ]
    if not against:
        return Use("standard errors", "good", "white residuals, repeatable optimum")
    answer: Answer = "no" if _OF_INTERVALS[0] in failed else "care"
    return Use("standard errors", answer, joined(*against))
