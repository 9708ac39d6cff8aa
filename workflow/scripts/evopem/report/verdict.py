"""The verdict: what a model is good for and what not, and which of its modes can be trusted."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from evopem.models.modes import Mode
from evopem.report.numbers import (
    THIN,
    count,
    enumeration,
    fixed,
    is_number,
    mode_place,
    number,
    percent,
    plural,
    ratio,
)
from evopem.results.channel_labels import Channel
from evopem.results.dataset import DatasetResults, response_errors
from evopem.validation.checks.inputs import input_rests, resting
from evopem.validation.checks.residuals import LINEAR, white
from evopem.validation.frequency_responses import SPEAK_AGAINST
from evopem.validation.mode_evidence import ModeEvidence

UseKey = Literal[
    "simulation",
    "simulation_as_recorded",
    "prediction",
    "frequency_response",
    "spectrum",
    "modes",
    "standard_errors",
]
Answer = Literal["good", "care", "no"]
Finding = tuple[Answer, str]  # with a clause that says why
ANSWERS: tuple[Answer, ...] = ("good", "care", "no")
_WORDS: dict[Answer, str] = {"good": "good for", "care": "with care for", "no": "not for"}

# Simulation errors, percent of the output's standard deviation, up to which a simulation is good
# and of use at all: the report shows them beside the word.
GOOD_SIMULATION = 30.0
USABLE_SIMULATION = 60.0
WORSE = 1.1  # one-step errors to those of a simulation, which a true noise model does not exceed
# The error of the mean of the output: a model that is no better is of no use.
ERROR_OF_MEAN = 100.0
WIDE_BAND = 25.0  # half width of a 95 % band of the gain, %, from which on it is a rough one
# Error of a good response, %, which 95 % of responses like it stay below.
GOOD_RESPONSE = 30.0
BELOW_MEAN = math.nextafter(ERROR_OF_MEAN, 0.0)

OF_NOISE = "of the noise filter alone, and not tested"
MOST_NAMED = 8  # modes that a sentence names
# Share of an output's energy below which a mode is not seen there.
NEGLIGIBLE = 1e-3
NAMED = 3  # outputs that a mode is seen at and inputs that it is driven by, at most

# The uses that rest on a check: without an essential one they are not given, without a desirable
# one with care. Notes are about the settings or the search, not the model: no use rests on them.
ESSENTIAL: dict[str, tuple[str, ...]] = {
    "Stable": ("simulation", "response", "spectrum"),
    "Response to the input significant": ("simulation", "response", "intervals"),
    "Inputs told apart": ("response",),
    "Free of feedback": ("simulation", "response", "intervals"),
    "Invertible": ("prediction",),
    "Roots inside the stability bound": ("intervals",),
    "Constant in time": ("intervals",),
    "Linear": ("intervals",),
    "Record not saturated": ("intervals",),
}
DESIRABLE: dict[str, tuple[str, ...]] = {
    "Excitation adequate": ("response",),
    "Every input significant": ("response",),
    "Validated on other samples": ("simulation", "prediction"),
    "Validation input comparable": ("simulation",),
    "Simulation independent of its initial state": ("simulation",),
    "White residuals": ("prediction", "response", "spectrum", "intervals"),
    "Residuals independent of the input": ("response", "intervals"),
    "Roots inside the stability bound": ("response",),
    "Constant in time": ("simulation", "response", "modes"),
    "Linear": ("simulation", "response"),
    "Every spectral peak modelled": ("spectrum",),
    "Poles and zeros distinct": ("intervals",),
    "Few residual outliers": ("intervals",),
    "Record not saturated": ("simulation", "response", "modes"),
} | SPEAK_AGAINST


@dataclass(frozen=True)
class Use:
    """One thing that a model may be used for."""

    key: UseKey
    """what it is, a name that stays the same"""
    name: str
    """what it is of this model, in words"""
    answer: Answer
    """whether the model is good for it, to be used with care, or not to be used"""
    reason: str
    """the number or the check that decides"""


@dataclass(frozen=True)
class Verdict:
    """What a model is good for."""

    sentence: str  # the whole in a sentence
    uses: list[Use]  # the good ones first

    def of(self, answer: Answer) -> list[Use]:
        """The uses with an answer."""
        return [use for use in self.uses if use.answer == answer]


def verdict(results: DatasetResults) -> Verdict:
    """Judge every use of a model by its errors on validation samples and by its checks.

    A model without input cannot be simulated; it is judged by its prediction and its spectrum.
    """
    uses = [_frequency_response(results)]
    if not results.of_responses:
        simulations = _simulations(results) if results.model.has_input else []
        uses = [*simulations, _prediction(results), *uses]
    uses += [_modes(results), _intervals(results)]
    return Verdict(sentence_of(uses), sorted(uses, key=lambda use: ANSWERS.index(use.answer)))


def sentence_of(uses: Sequence[Use]) -> str:
    """All uses in a sentence, those of one answer together."""
    if all(use.answer == "no" for use in uses):
        return "This model is good for nothing that was tested."
    named = {answer: [use.name for use in uses if use.answer == answer] for answer in ANSWERS}
    text = "; ".join(f"{_WORDS[word]} {enumeration(n)}" for word, n in named.items() if n)
    return f"{text[0].upper()}{text[1:]}."


def _use(key: UseKey, name: str, *findings: Finding) -> Use:
    """A use by the least favourable of its findings, with what each of them says."""
    answer = max((answer for answer, _ in findings), key=ANSWERS.index)
    return Use(key, name, answer, "; ".join(reason for _, reason in findings if reason))


def _by_checks(use: str, results: DatasetResults) -> Finding:
    """What the checks say of a use, and which of them speak against it."""
    words = {check.name: check.word for check in results.checks}
    words |= {c.name: words[c.follows_from] for c in results.checks if c.follows_from}
    essential, desirable = (
        [check for check, uses in table.items() if use in uses and check in words]
        for table in (ESSENTIAL, DESIRABLE)
    )
    both = essential + desirable
    answers: tuple[tuple[list[str], str, Answer], ...] = (
        (essential, "Failed", "no"),
        (desirable, "Failed", "care"),
        (both, "Caution", "care"),
        (both, "Not judged", "care"),
    )
    for names, word, answer in answers:
        if names_of_word := [f"“{name}”" for name in names if words[name] == word]:
            return answer, f"{word.lower()}: {enumeration(names_of_word)}"
    return "good", ""


def _by_error(
    error: float, text: str = "", limits: tuple[float, float] = (GOOD_SIMULATION, USABLE_SIMULATION)
) -> Finding:
    """What an error in percent says, that is good and of use up to some limits."""
    if not is_number(error):
        return "no", "the error is not known"
    good, usable = limits
    answer: Answer = "good" if error <= good else "care" if error <= usable else "no"
    return answer, f"off by {percent(error)}{text}"


def plural_of(noun: str, things: Sequence[object]) -> str:
    """A noun in the number of the things."""
    return noun if len(things) == 1 else f"{noun}s"


def _simulations(results: DatasetResults) -> list[Use]:
    """The simulation; where transforms make it another quantity, also in recorded units."""
    validation, recorded = results.validation, results.recorded
    outputs, several = plural_of("output", results.outputs), len(results.outputs) > 1
    owner, samples = "outputs’" if several else "output’s", count(validation.samples)
    text = f" of the {owner} deviation on {samples} {results.model.transforms.judging} samples"
    checked = _by_checks("simulation", results)
    if validation.at_floor:
        text += ", as good as a linear model can be"
    worst_of: Finding = "good", ""
    if several:
        worst, errors = results.worst_first[0]
        largest = errors.simulation_error_percent
        text += f", by {percent(largest)} at {worst.prepared}"
        worst_of = ("care" if _by_error(largest)[0] != "good" else "good", "")
    of_error = _by_error(validation.simulation_error_percent, text)
    name = f"simulation from the {plural_of('input', results.inputs)}"
    said: list[tuple[UseKey, str, list[Finding]]] = [("simulation", name, [of_error, worst_of])]
    if recorded is not None:
        error = recorded.simulation_error_percent
        summed = recorded.integrations and _by_error(error)[0] != "good"
        filtered = "filter" if results.model.transforms.difference_pole else "differences"
        undone = f", because undoing the {filtered} sums up the error" if summed else ""
        name, of_recorded = f"simulation of the {outputs} as recorded", [_by_error(error, undone)]
        said = [
            ("simulation", f"simulation of the transformed {outputs}", [of_error, worst_of]),
            ("simulation_as_recorded", name, of_recorded),
        ]
    if input_rests(validation):
        why = resting(results.model.transforms.judging)
        return [Use(key, name, "no", f"not tested: {why}") for key, name, *_ in said]
    return [_use(key, name, *findings, checked) for key, name, findings in said]


def _prediction(results: DatasetResults) -> Use:
    validation, several = results.validation, len(results.outputs) > 1
    error, simulated = validation.prediction_error_percent, validation.simulation_error_percent
    where = f" on {results.model.transforms.judging} samples"
    modelled = results.model.has_noise_model  # else it is a simulation, and is as good as one
    limits = (USABLE_SIMULATION, BELOW_MEAN) if modelled else (GOOD_SIMULATION, USABLE_SIMULATION)
    findings = [_by_error(error, " on average over the outputs" if several else where, limits)]
    if error > WORSE * simulated and modelled:
        findings.append(("care", f"a simulation, without past outputs, by {percent(simulated)}"))
    if several:
        errors = [output.prediction_error_percent for output in validation.outputs]
        largest = float(np.nanmax([*errors, -math.inf]))
        findings.append(("good", f"by up to {percent(largest)}"))
        if largest >= ERROR_OF_MEAN:
            worst = results.outputs[errors.index(largest)].prepared
            findings[-1] = "care", f"by {percent(largest)} at {worst}, no better than its mean"
    if not modelled and white(results.validation) is not True:
        findings.append(("care", "the residuals are coloured, which no noise model uses"))
    return _use("prediction", "one-step prediction", *findings, _by_checks("prediction", results))


def _frequency_response(results: DatasetResults) -> Use:
    """The response of the plant; of a model without input, the spectrum that its noise has."""
    validation = results.validation
    key: UseKey = "frequency_response"
    name, rests_on = f"the {plural_of('frequency response', results.pairs)}", "response"
    error, computed = validation.simulation_error_percent, "simulates"
    if not results.model.has_input:
        key, rests_on = "spectrum", "spectrum"
        name = f"the spectrum of the {plural_of('output', results.outputs)}"
        error, computed = validation.prediction_error_percent, "predicts"
    checked = _by_checks(rests_on, results)
    if is_number(error) and error >= ERROR_OF_MEAN:
        text = f"it {computed} no better than the mean, off by {percent(error)}"
        return _use(key, name, ("no", text), checked)
    table = results.responses[results.responses["source"] == results.model_source[0]]
    errors = response_errors(table, results.lowest_hz if results.model.has_input else 0.0)
    half, off, place = float(np.max([e.half_band for e in errors])), *max(e[1:] for e in errors)
    least = f", of the least known {'pair' if results.model.has_input else 'output'}"
    least = least if len(results.pairs) > 1 else ""
    text = f"gain ±{percent(half, 2)} (95 % band, median over frequency{least})"
    if not half <= 100.0:
        wide = f"is wider than the gain itself at half of the frequencies or more{least}"
        text = f"its 95 % band {'is not known' if math.isnan(half) else wide}"
    findings: list[Finding] = [("good" if half <= WIDE_BAND else "care", text)]
    if off > GOOD_RESPONSE:
        known = off < 100.0 * GOOD_RESPONSE  # else a factor of 10¹³ and more
        text = f"off by up to {ratio(np.exp(off / 100.0))}" if known else "its error is not known"
        text += f" where the response is large{' (95 %), most' if known else ', as'}"
        text = f"{text} at {number(place, 3)}{THIN}Hz"
        rival = results.model.rival
        if rival and rival.factor > math.exp(GOOD_RESPONSE / 100.0):
            where = f"most at {number(rival.frequency_hz, 3)}{THIN}Hz"
            differs = f"differs in gain and phase by {ratio(rival.factor)}, {where}"
            text += f" ({rival.name}, which the data do not tell from it, {differs})"
        findings.append(("care", text))
    if results.model.has_input and is_number(error) and error >= USABLE_SIMULATION:
        # What the model leaves out of the response is not in the band.
        words = "it leaves" if results.of_responses else "simulations are off by"
        findings.append(("care", f"{words} {percent(error)}, which hides errors of the gain"))
    return _use(key, name, *findings, checked)


def _modes(results: DatasetResults) -> Use:
    trusted = [line for line in mode_lines(results) if line.trusted]
    others = len(results.modes) - len(trusted)
    if not trusted:
        reason = "none passes every test" if others else "the model has no oscillating mode"
        return Use("modes", "modes", "no", reason)
    shown = [mode_place(judged.mode) for judged in trusted[:MOST_NAMED]]
    places = f"{enumeration(shown)}{THIN}Hz"
    if len(trusted) > MOST_NAMED:
        places = enumeration([*shown, f"{len(trusted) - MOST_NAMED} more"])
    name = f"the {plural_of('mode', trusted)} at {places}"
    seen = f"seen in {results.model.transforms.judging} samples"
    reason = "determined by the responses" if results.of_responses else seen
    if all(mode.stable for mode in results.validation.modes.modes if mode.trusted):
        reason += " and at most other orders"
    against = f"{plural(others, 'further mode')} not to be trusted" if others else ""
    findings: list[Finding] = [("good", reason), ("good", against), _by_checks("modes", results)]
    error = results.validation.simulation_error_percent
    tested = not (results.of_responses or input_rests(results.validation))
    if results.model.has_input and tested and is_number(error) and error >= USABLE_SIMULATION:
        # More of the modes trusted there are none (docs/evidence/calibration.md).
        findings.append(("care", f"simulations are off by {percent(error)}"))
    if len(results.outputs) > 1:
        name += " (with shapes)"
        mixed = sum(bool(judged.shape_doubt) for judged in trusted)
        if mixed:
            findings.append(("care", f"{plural(mixed, 'shape')} not to be trusted"))
    return _use("modes", name, *findings)


def _intervals(results: DatasetResults) -> Use:
    checked, record = _by_checks("intervals", results), results.model
    known = record.orders is None and record.model.covariance is not None
    of_entries = np.full(record.model.parameters.size, 0.0 if known else np.nan)
    given = record.parameter_standard_errors
    errors = of_entries if given is None else np.asarray(given)
    findings: list[Finding] = []
    nonlinear = any(check.name == LINEAR and check.passed is False for check in results.checks)
    if results.validation.distortion.prevails or (nonlinear and results.validation.at_floor):
        findings.append(("no", "they leave out the nonlinear part that the residuals hold"))
    unknown = int((~np.isfinite(errors)).sum())
    if unknown == len(errors):
        findings.append(("no", "no coefficient has one"))
    elif unknown:
        findings.append(("care", f"not known of {unknown} of {plural(len(errors), 'coefficient')}"))
    if results.validation.without_noise:
        findings.append(("care", "there is no noise that they would come from"))
    if len(results.scores) > 1:
        # Intervals of models that the automatic recipe chose cover less (docs/report.md).
        findings.append(("care", "those of coefficients take the chosen orders for the true ones"))
    if not findings and checked[0] == "good":
        coloured = not results.model.has_noise_model and white(results.validation) is not True
        text = "corrected for coloured residuals" if coloured else "white residuals"
        text = "from the errors at the frequencies" if results.of_responses else text
        findings.append(("good", text))
    return _use("standard_errors", "standard errors", *findings, checked)


@dataclass(frozen=True)
class ModeLine:
    """A mode on the first screen: whether it can be trusted, and why."""

    mode: Mode
    trusted: bool
    why: str
    shape_doubt: str = ""  # reason not to trust its shape; empty where there is none


def mode_lines(results: DatasetResults) -> list[ModeLine]:
    """Every mode of the plant with what the data say about it, then the noise filter's own.

    A pole of D is no part of the response to the inputs, and only modes of the plant are tested.
    """
    shared = {mode.pole for mode in results.model.modes}
    return [
        *(_line(results, evidence) for evidence in results.validation.modes.modes),
        *(ModeLine(m, False, OF_NOISE) for m in results.model.noise_modes if m.pole not in shared),
    ]


def _line(results: DatasetResults, evidence: ModeEvidence) -> ModeLine:
    mode = evidence.mode
    reasons = list(evidence.doubts)
    words = reasons or [_origin(results, evidence)]
    if reasons and len(results.inputs) > 1 and evidence.origin == "input":
        words.append(_origin(results, evidence))
    if len(results.outputs) > 1:
        shares, least = mode.output_shares, percent(100.0 * NEGLIGIBLE, 1)
        seen = f"seen at {_strongest(results.outputs, shares)}"
        is_seen = shares.max() >= NEGLIGIBLE
        words.append(seen if is_seen else f"below {least} of the energy of every output")
    if evidence.model or evidence.order != results.validation.modes.order:
        words.append(f"of {evidence.model or f'the model of order {evidence.order}'}")
    if not reasons and is_number(evidence.recurrence):
        share = fixed(100 * evidence.recurrence, 0)
        words.append(f"{share}{THIN}% of the other orders with enough poles have it")
    shape = evidence.shape_doubt
    if evidence.pair is not None:
        shape += f"; the plane of its shape and that of mode {evidence.pair + 1} is known"
    return ModeLine(mode, not reasons, "; ".join(words), shape)


def _origin(results: DatasetResults, evidence: ModeEvidence) -> str:
    """What drives a mode, and where there are several inputs, which of them."""
    if not results.model.has_input:
        return f"it improves the prediction of {results.model.transforms.judging} samples"
    if evidence.origin != "input":
        return f"disturbances drive it, not the {'input' if len(results.inputs) == 1 else 'inputs'}"
    if len(results.inputs) == 1:
        return "the input drives it"
    driven = np.abs(evidence.mode.input_participation)
    if results.prepared is not None:
        driven = driven * results.prepared.estimation.inputs.std(axis=0)
    return f"driven by {_strongest(results.inputs, driven / max(float(driven.sum()), 1e-300))}"


def _strongest(channels: Sequence[Channel], shares: np.ndarray) -> str:
    """The channels with the largest shares, in percent."""
    best = [k for k in np.argsort(-shares, kind="stable")[:NAMED] if shares[k] >= NEGLIGIBLE]
    return ", ".join(f"{channels[k].name} {percent(100.0 * float(shares[k]), 2)}" for k in best)
