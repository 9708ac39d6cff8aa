"""The verdict: what a model is good for, what it is not good for, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from evopem.figures.frequency_domain import model_source
from evopem.figures.view import Results, View, view_of
from evopem.report.numbers import THIN, count, enumeration, is_number, number, percent, plural
from evopem.report.sentences.about_modes import mode_lines
from evopem.validation.checks import Check
from evopem.validation.checks.inputs import RESTING

Answer = Literal["good", "care", "no"]

# Simulation errors, in percent of the output's standard deviation, up to which a simulation is good
# and up to which it is of use at all. The error has no natural limit, so the report shows it beside
# the word.
GOOD_SIMULATION, USABLE_SIMULATION = 30.0, 60.0

# Modes that a sentence names at most.
MOST_NAMED = 8

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

    A model without input cannot be simulated; it is judged by its prediction and its spectrum.
    """
    view = view_of(results)
    outcome = {check.name: check for check in view.checks}
    uses = [_prediction(view, outcome), _frequency_response(view, outcome)]
    if view.has_input:
        uses = [_simulation(view, outcome), *_simulation_as_recorded(view, outcome), *uses]
    uses += [_modes(view), _intervals(view, outcome)]
    return Verdict(sentence_of(uses), sorted(uses, key=lambda use: ANSWERS.index(use.answer)))


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


def _simulation(view: View, outcome: Mapping[str, Check]) -> Use:
    several = len(view.outputs) > 1
    name = f"simulation from the {plural_of('input', view.inputs)}"
    if view.recorded is not None:
        name = f"simulation of the transformed {plural_of('output', view.outputs)}"
    if view.input_rests:
        return Use(name, "no", f"not tested: {RESTING}")
    answer, against = _by_checks("simulation", outcome)
    validation = view.results.validation
    error = validation.simulation_error_percent
    if not is_number(error):
        return Use(name, "no", joined("the error is not known", against))
    reason = (
        f"off by {percent(error)} of the {'outputs’' if several else 'output’s'} deviation on"
        f" {count(validation.samples)} validation samples"
    )
    answer = worse(answer, answer_by_error(error))
    if several:
        worst = max(view.errors, key=lambda each: each.simulation)
        reason += f", by {percent(worst.simulation)} at {worst.name}"
        if answer_by_error(worst.simulation) != "good":
            answer = worse(answer, "care")
    return Use(name, answer, joined(reason, against))


def plural_of(noun: str, things: Sequence[object]) -> str:
    """A noun in the number of the things."""
    return noun if len(things) == 1 else f"{noun}s"


def _simulation_as_recorded(view: View, outcome: Mapping[str, Check]) -> list[Use]:
    """The simulation in the units of the recording, where transforms make it another quantity."""
    recorded = view.recorded
    if recorded is None:
        return []
    name = f"simulation of the {plural_of('output', view.outputs)} as recorded"
    if view.input_rests:
        return [Use(name, "no", f"not tested: {RESTING}")]
    answer, against = _by_checks("simulation", outcome)
    error = recorded.simulation_error_percent
    reason = f"off by {percent(error)}" if is_number(error) else "the error is not known"
    if recorded.integrations and answer_by_error(error) != "good":
        reason += ", because undoing the differences sums up the error"
    return [Use(name, worse(answer, answer_by_error(error)), joined(reason, against))]


def _prediction(view: View, outcome: Mapping[str, Check]) -> Use:
    answer, against = _by_checks("prediction", outcome)
    error = view.results.validation.prediction_error_percent
    if not is_number(error):
        return Use("one-step prediction", "no", "the error is not known")
    where = "on average over the outputs" if len(view.outputs) > 1 else "on validation samples"
    if not view.has_noise_model:
        # It is a simulation, and is as good as one.
        answer = worse(answer, answer_by_error(error))
        if view.white is not True:
            answer = worse(answer, "care")
            against = joined(against, "the residuals are coloured, which no noise model uses")
    return Use("one-step prediction", answer, joined(f"off by {percent(error)} {where}", against))


def _frequency_response(view: View, outcome: Mapping[str, Check]) -> Use:
    """The response of the plant; of a model without input, the spectrum that its noise has."""
    table = view.frequency_response
    table = table[table["source"] == model_source(view)[0]]
    several = len(view.pairs) > 1
    name, rests_on = f"the {plural_of('frequency response', view.pairs)}", "response"
    if not view.has_input:
        name, rests_on = f"the spectrum of the {plural_of('output', view.outputs)}", "spectrum"
    answer, against = _by_checks(rests_on, outcome)
    inside = table[(table["gain"] > 0) & table["gain_lower"].notna()]
    if not len(inside):
        return Use(name, worse(answer, "care"), joined("its 95 % band is not known", against))
    width = (inside["gain_upper"] - inside["gain_lower"]) / (2 * inside["gain"])
    half = 100 * float(np.median(width))
    over = "all pairs and frequencies" if several else "frequency"
    reason = f"95 % band of ±{number(half, 2)}{THIN}% of the gain (median over {over})"
    if not np.isfinite(half):
        reason = "its 95 % band has no upper limit at half of the frequencies or more"
        answer = worse(answer, "care")
    return Use(name, answer, joined(reason, against))


def _modes(view: View) -> Use:
    lines = mode_lines(view)
    trusted = [line for line in lines if line.trusted]
    others = len(view.modes) - len(trusted)
    if not trusted:
        reason = "none passes every test" if others else "the model has no oscillating mode"
        return Use("modes", "no", reason)
    shown = [number(each.mode.frequency_hz, 3) for each in trusted[:MOST_NAMED]]
    places = f"{enumeration(shown)}{THIN}Hz"
    if len(trusted) > MOST_NAMED:
        places = enumeration([*shown, f"{len(trusted) - MOST_NAMED} more"])
    reason = "seen in validation samples"
    if all(each.stable for each in trusted):
        reason += " and at most other orders"
    against = f"{plural(others, 'further mode')} not to be trusted" if others else ""
    name = f"the {plural_of('mode', trusted)} at {places}"
    if len(view.outputs) == 1:
        return Use(name, "good", joined(reason, against))
    mixed = sum(bool(each.shape_doubt) for each in trusted)
    shapes = f"{plural(mixed, 'shape')} not to be trusted" if mixed else ""
    answer: Answer = "care" if mixed else "good"
    return Use(f"{name}, with shapes", answer, joined(reason, against, shapes))


def _intervals(view: View, outcome: Mapping[str, Check]) -> Use:
    answer, against = _by_checks("intervals", outcome)
    residuals = "white residuals"
    if not view.has_noise_model and view.white is not True:
        residuals = "the colour of the residuals is taken into account"
    reason = f"{residuals}, repeatable optimum" if answer == "good" else ""
    errors = view.standard_errors
    known, total = int(np.isfinite(errors).sum()), len(errors)
    if known == 0:
        return Use("standard errors", "no", joined("no coefficient has one", against))
    if known < total:
        answer = worse(answer, "care")
        reason = f"not known of {total - known} of {plural(total, 'coefficient')}"
    return Use("standard errors", answer, joined(reason, against))


def joined(*reasons: str) -> str:
    """Reasons that are not empty, one after the other."""
    return "; ".join(reason for reason in reasons if reason)
