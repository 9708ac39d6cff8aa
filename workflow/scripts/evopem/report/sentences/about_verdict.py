"""The verdict: what a model is good for, what it is not good for, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from evopem.figures.frequency_domain import model_source
from evopem.figures.view import PolynomialView, Results, View, view_of
from evopem.report.numbers import THIN, count, enumeration, is_number, number, percent, plural
from evopem.results.dataset import DatasetResults
from evopem.validation.checks import Check
from evopem.validation.checks.excitation import RESTING, input_rests
from evopem.validation.checks.residuals import WITHOUT_NOISE_MODEL, white

Answer = Literal["good", "care", "no"]

# Simulation errors, in percent of the output's standard deviation, up to which a simulation is good
# and up to which it is of use at all. The error has no natural limit, so the report shows it beside
# the word.
GOOD_SIMULATION, USABLE_SIMULATION = 30.0, 60.0

# The checks that a use rests on: without the first it is not given, without the second with care.
ESSENTIAL: dict[str, tuple[str, ...]] = {
    "simulation": ("Stable", "Response to the input significant"),
    "prediction": ("Invertible",),
    "response": ("Stable", "Response to the input significant", "Excitation adequate"),
    "intervals": ("Roots inside the stability bound",),
    "spectrum": ("Stable",),
}
DESIRABLE: dict[str, tuple[str, ...]] = {
    "simulation": (
        "Validation input comparable",
        "Simulation independent of its initial state",
        "Search repeatable",
    ),
    "prediction": ("White residuals", "Search repeatable"),
    "response": ("Residuals independent of the input", "Search repeatable"),
    "spectrum": ("White residuals", "Every spectral peak modelled", "Search repeatable"),
    "intervals": (
        "White residuals",
        "Residuals independent of the input",
        "Poles and zeros distinct",
        "Search repeatable",
        "Few residual outliers",
    ),
}


@dataclass(frozen=True)
class Use:
    """One thing that a model may be used for."""

    name: str
    answer: Answer
    reason: str  # A clause with the number that decides


@dataclass(frozen=True)
class Verdict:
    """What a model is good for."""

    sentence: str  # the whole in a sentence
    uses: list[Use]  # the good ones first

    def of(self, answer: Answer) -> list[Use]:
        """The uses with an answer."""
        return [use for use in self.uses if use.answer == answer]


def verdict(results: Results | View) -> Verdict:
    """Judge every use of a model by its errors on validation samples and by its checks.

    A model without input cannot be simulated; it is judged by its prediction and its spectrum."""
    from evopem.report.sentences.about_state_space import state_space_uses

    view = view_of(results)
    uses = _uses(view) if isinstance(view, PolynomialView) else state_space_uses(view.results)
    return Verdict(sentence_of(uses), sorted(uses, key=lambda use: ANSWERS.index(use.answer)))


def _uses(view: PolynomialView) -> list[Use]:
    results = view.results
    outcome = {check.name: check for check in results.checks}
    of_input = []
    if results.model.has_input:
        of_input = [_simulation(results, outcome), *_simulation_as_recorded(results, outcome)]
    return [
        *of_input,
        _prediction(results, outcome),
        _frequency_response(view, outcome),
        _modes(results),
        _intervals(results, outcome),
    ]


_WORDS: dict[Answer, str] = {"good": "good for", "care": "with care for", "no": "not for"}
ANSWERS: tuple[Answer, ...] = ("good", "care", "no")


def sentence_of(uses: Sequence[Use]) -> str:
    """All uses in a sentence, those of one answer together."""
    named: dict[Answer, str] = {
        answer: enumeration([use.name for use in uses if use.answer == answer])
        for answer in ANSWERS
    }
    if not named["good"] and not named["care"]:
        return "This model is good for nothing that was tested."
    parts = [f"{_WORDS[answer]} {named[answer]}" for answer in ANSWERS if named[answer]]
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}."


def _by_checks(use: str, outcome: Mapping[str, Check]) -> tuple[Answer, str]:
    """What the checks say of a use, and which of them speak against it."""
    for names, failed in ((ESSENTIAL, "no"), (DESIRABLE, "care")):
        against = [outcome[name] for name in names.get(use, ()) if name in outcome]
        wrong = [check.name for check in against if check.passed is False]
        if wrong:
            return ("no" if failed == "no" else "care"), _against("failed", wrong)
    unknown = [
        name
        for name in (*ESSENTIAL.get(use, ()), *DESIRABLE.get(use, ()))
        if name in outcome and outcome[name].passed is None
    ]
    return ("care", _against("not judged", unknown)) if unknown else ("good", "")


def _against(what: str, names: Sequence[str]) -> str:
    return f"{what}: {enumeration([f'“{name}”' for name in names])}"


def worse(first: Answer, second: Answer) -> Answer:
    """The less favourable one of two answers."""
    return max(first, second, key=ANSWERS.index)


def answer_by_error(error: float) -> Answer:
    """What a simulation error in percent says of a simulation."""
    if not is_number(error) or error > USABLE_SIMULATION:
        return "no"
    return "good" if error <= GOOD_SIMULATION else "care"


def _simulation(results: DatasetResults, outcome: Mapping[str, Check]) -> Use:
    validation, transforms = results.validation, results.model.transforms
    name = "simulation from the input"
    if transforms.changes_output:
        name = "simulation of the transformed output"
    if input_rests(validation):
        return Use(name, "no", f"not tested: {RESTING}")
    answer, against = _by_checks("simulation", outcome)
    error = validation.simulation_error_percent
    reason = (
        f"off by {percent(error)} of the output’s deviation on"
        f" {count(validation.samples)} validation samples"
        if is_number(error)
        else "the error is not known"
    )
    return Use(name, worse(answer, answer_by_error(error)), joined(reason, against))


def _simulation_as_recorded(results: DatasetResults, outcome: Mapping[str, Check]) -> list[Use]:
    """The simulation in the units of the recording, where transforms make it another quantity."""
    if not results.model.transforms.changes_output:
        return []
    recorded = results.validation.recorded
    name = "simulation of the output as recorded"
    if input_rests(results.validation):
        return [Use(name, "no", f"not tested: {RESTING}")]
    answer, against = _by_checks("simulation", outcome)
    error = recorded.simulation_error_percent
    reason = f"off by {percent(error)}" if is_number(error) else "the error is not known"
    if recorded.integrations and answer_by_error(error) != "good":
        reason += ", because undoing the differences sums up the error"
    return [Use(name, worse(answer, answer_by_error(error)), joined(reason, against))]


def _prediction(results: DatasetResults, outcome: Mapping[str, Check]) -> Use:
    answer, against = _by_checks("prediction", outcome)
    error = results.validation.prediction_error_percent
    if not is_number(error):
        return Use("one-step prediction", "no", "the error is not known")
    reason = f"off by {percent(error)} on validation samples"
    if _without_noise_model(results):
        # It is a simulation, and is as good as one.
        answer = worse(answer, answer_by_error(error))
        if white(results.validation) is not True:
            answer = worse(answer, "care")
            against = joined(against, "the residuals are coloured, which no noise model uses")
    return Use("one-step prediction", answer, joined(reason, against))


def _without_noise_model(results: DatasetResults) -> bool:
    return results.model.structure in WITHOUT_NOISE_MODEL


def _frequency_response(view: PolynomialView, outcome: Mapping[str, Check]) -> Use:
    """The response of the plant; of a model without input, the spectrum that its noise has."""
    table = view.frequency_response
    table = table[table["source"] == model_source(view)[0]]
    name, rests_on = "the frequency response", "response"
    if not view.has_input:
        name, rests_on = "the spectrum of the output", "spectrum"
    answer, against = _by_checks(rests_on, outcome)
    inside = table[(table["gain"] > 0) & table["gain_lower"].notna()]
    reason = "its 95 % band is not known"
    if len(inside):
        width = (inside["gain_upper"] - inside["gain_lower"]) / (2 * inside["gain"])
        half = 100 * float(np.median(width))
        reason = f"95 % band of ±{number(half, 2)}{THIN}% of the gain (median over frequency)"
        if not np.isfinite(half):
            reason = "its 95 % band has no upper limit at half of the frequencies or more"
            answer = worse(answer, "care")
    else:
        answer = worse(answer, "care")
    return Use(name, answer, joined(reason, against))


def _modes(results: DatasetResults) -> Use:
    trusted = results.trusted_modes
    if not trusted:
        reason = (
            "none passes every test" if results.model.modes else "the model has no oscillating mode"
        )
        return Use("modes", "no", reason)
    places = enumeration([number(each.mode.frequency_hz, 3) for each in trusted]) + f"{THIN}Hz"
    others = len(results.model.modes) - len(trusted)
    reason = "seen in validation samples"
    if all(each.stable for each in trusted):
        reason += " and at most other orders"
    if others:
        reason += f"; {plural(others, 'further mode')} not to be trusted"
    name = "the mode at" if len(trusted) == 1 else "the modes at"
    return Use(f"{name} {places}", "good", reason)


def _intervals(results: DatasetResults, outcome: Mapping[str, Check]) -> Use:
    answer, against = _by_checks("intervals", outcome)
    residuals = "white residuals"
    if _without_noise_model(results) and white(results.validation) is not True:
        residuals = "the colour of the residuals is taken into account"
    reason = f"{residuals}, repeatable optimum" if answer == "good" else ""
    errors = results.model.parameter_standard_errors
    known = 0 if errors is None else int(np.isfinite(errors).sum())
    total = len(results.model.polynomials.parameters)
    if known == 0:
        return Use("standard errors", "no", joined("no coefficient has one", against))
    if known < total:
        answer = worse(answer, "care")
        reason = f"not known of {total - known} of {plural(total, 'coefficient')}"
    return Use("standard errors", answer, joined(reason, against))


def joined(*reasons: str) -> str:
    """Reasons that are not empty, one after the other."""
    return "; ".join(reason for reason in reasons if reason)
