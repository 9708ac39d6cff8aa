"""The parts of the report: when each applies, what it is called, and what it shows.

The template ``section_<id>.html.j2`` of a part sets its content; parts of figures alone share one.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

from evopem.automatic.decision import Decision, OtherModel
from evopem.config.constraints import Constraints
from evopem.estimation.model_record import FitRecord
from evopem.figures.view import View
from evopem.report import chapter, equations, modes
from evopem.report.numbers import is_number, number
from evopem.report.verdict import mode_lines, verdict
from evopem.results.dataset import DatasetResults

# Alternatives that the table shows beside the choice: all structures of a choice of structures.
MOST_RIVALS = 8


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    id: str
    title: Callable[[View], str]  # its heading
    content: Callable[[View], dict[str, Any]] | None = None  # None for figures alone
    applies: Callable[[View], bool] = lambda _: True  # whether the page has it


def _summary(view: View) -> dict[str, Any]:
    return {"verdict": verdict(view), "evidence": mode_lines(view), "checks": view.checks}


def _model(view: View) -> dict[str, Any]:
    record = view.results.model
    content = {
        "equation": "",
        "polynomials": [],
        "constraints": list(constraint_rows(record.fit)),
    }
    if record.orders is None:
        return content
    model = record.polynomials
    return content | {
        "equation": equations.equation(model),
        "orders_note": equations.orders_note(model),
        "polynomials": equations.polynomials(model),
        "coefficients": equations.coefficient_table(model),
        "copies": [
            ("text", "Plain text", equations.text(model)),
            ("matlab", "MATLAB", equations.matlab(model)),
            ("python", "Python", equations.python(model)),
            ("json", "JSON", equations.as_json(model)),
        ],
    }


def constraint_rows(fit: FitRecord | None) -> Iterator[tuple[str, str, str]]:
    """Key, value and effect of each constraint that was given for a model."""
    given = None if fit is None else fit.constraints
    if fit is None or given is None:
        return
    built_in = asdict(Constraints())
    for key, value in asdict(given).items():
        if value == built_in[key]:
            continue
        parts = {key: value}
        if isinstance(value, dict):
            parts = {f"{key}.{name}": each for name, each in value.items()}
        elif key == "priors":
            parts = {f"{key}[{index}]": each for index, each in enumerate(value)}
        for name, each in parts.items():
            held = {name, key} & set(fit.active)
            effect = "weighted" if key == "priors" else "active" if held else "not active"
            unit = " Hz" if key.endswith(("_band", "_bands")) else ""
            yield name, _shown(each, unit), effect


def _shown(value: Any, unit: str = "") -> str:
    """A value of the configuration: numbers, two bounds, several of them, a pole or a prior."""
    match value:
        case {"quantity": quantity, "mean": mean, "standard_deviation": deviation}:
            unit = " Hz" if quantity == "frequency" else ""
            mode = "" if value["mode_hz"] is None else f" of the mode near {value['mode_hz']:g} Hz"
            return f"{quantity}{mode}: {number(mean)} ± {number(deviation)}{unit}"
        case {"real": None, "frequency_hz": frequency, "damping_ratio": damping_ratio}:
            return f"{number(frequency)} Hz, damping ratio {number(damping_ratio)}"
        case {"real": real}:
            return f"z = {number(real)}"
    if isinstance(value, tuple):
        if all(each is None or is_number(each) for each in value):
            return " to ".join(map(_shown, value)) + unit
        return "; ".join(_shown(each, unit) for each in value)
    return number(value) if is_number(value) else str(value or "none")


def _errors(view: View) -> dict[str, Any]:
    return {
        "recordings": recording_rows(view.results),
    }


def recording_rows(results: DatasetResults) -> list[tuple[str, int, int, int, float]]:
    """File, samples as recorded, for estimation and for validation, and error of each recording.

    The error in percent is of its validation samples, mean over the outputs: of simulations,
    without an input of predictions.  There are no rows where there is only one recording.
    """
    transforms, has_input = results.model.transforms, results.model.has_input
    used, held_out = Counter[int](), Counter[int]()
    for counted, origins in ((used, transforms.estimation), (held_out, transforms.validation)):
        for each in origins:
            counted[each.recording] += each.samples
    errors: dict[int, float] = {}
    for origin, found in zip(transforms.validation, results.validation.stretches, strict=False):
        percent = found.simulation_error_percent if has_input else found.prediction_error_percent
        share = origin.samples / held_out[origin.recording]
        errors[origin.recording] = errors.get(origin.recording, 0.0) + share * percent
    return [
        (
            *(file.path, file.samples, used[place], held_out[place]),
            errors.get(place, math.nan),
        )
        for place, file in enumerate(results.files if transforms.several_recordings else ())
    ]


def _selection(view: View) -> dict[str, Any]:
    record, validation = view.results.decisions, view.results.validation
    candidates = [] if view.candidates is None else view.candidates.to_dict("records")
    if record is None:
        return {"record": None, "candidates": candidates}
    model = OtherModel(
        *(record.purpose, view.model_text),
        *(validation.prediction_error_percent, validation.simulation_error_percent),
    )
    return {
        "record": record,
        "candidates": candidates,
        "decisions": [(each, rivals(each)) for each in record.decisions],
        "purposes": [model, record.other] if record.other else [],
    }


def rivals(decision: Decision) -> str:
    """The best alternatives with their scores, the choice among them."""
    scored = [each for each in decision.alternatives if math.isfinite(each.score)]
    best = sorted(scored, key=lambda each: each.score)[: MOST_RIVALS + 1]
    chosen = next((each for each in scored if each.name == decision.choice), None)
    if chosen is not None and chosen not in best:
        best = [*best[:MOST_RIVALS], chosen]
    return "; ".join(f"{each.name}: {number(each.score, 4)}" for each in best)


SECTIONS = (
    Section("summary", lambda _: "Verdict", _summary),
    Section("model", lambda _: "Model", _model),
    Section(
        "modes",
        lambda view: "Modes beside the truth" if view.truth and view.truth.modes else "Modes",
        modes.content,
    ),
    Section("response", lambda view: "Response to the input" if view.has_input else "Noise filter"),
    Section(
        "errors",
        lambda view: "Prediction and simulation" if view.has_input else "Prediction",
        _errors,
    ),
    Section("residual_tests", lambda _: "Residuals"),
    Section("recording", lambda _: "Recording"),
    Section(
        "selection",
        lambda view: f"Choice of {'structure and ' if view.results.decisions else 'the '}orders",
        _selection,
    ),
    Section(
        "chapter",
        lambda _: "Comparison with the chapter",
        lambda view: {"rows": chapter.compare_with_chapter(view.results)},
        lambda view: chapter.stands_in_for_the_chapter(view.results.settings),
    ),
    Section("provenance", lambda _: "Provenance", lambda _: {}),
)
"""The parts in the order of the page."""
