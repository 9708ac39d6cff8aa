"""The parts of the report: when each applies, what it is called, and what it shows.

The template ``section_<id>.html.j2`` of a part sets its content; parts of figures alone share one.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from operator import attrgetter
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from evopem.automatic.decision import Alternative, Decision, OtherModel
from evopem.config.channels import SyntheticSource
from evopem.config.constraints import Constraints
from evopem.config.settings import DatasetSettings
from evopem.estimation.model_record import FitRecord
from evopem.estimation.order_candidate import PhaseSelection
from evopem.figures.draw import ShapeDrawing
from evopem.figures.moving import moving_modes, picture
from evopem.models.mode_matching import deviations, matched_modes
from evopem.models.modes import Mode
from evopem.models.orders import armax_orders
from evopem.report import equations
from evopem.report.figures import drawn_figure
from evopem.report.numbers import hertz, is_number, number
from evopem.report.results_text import error_parts, moving_sentence
from evopem.report.templates import Context
from evopem.report.verdict import mode_lines, verdict
from evopem.results.dataset import DatasetResults
from evopem.synthesis import true_mode

# The chapter on its own recording, which the simulated flexible arm stands in for.
# Table 2: natural frequency in Hz, damping ratio.
CHAPTER_MODES = tuple(
    true_mode(frequency, damping, 100.0)
    for frequency, damping in ((5.36, 0.0091), (16.65, 0.1750), (37.00, 0.0107))
)
# Sections 5.1 to 5.4.
CHAPTER_ORDERS = armax_orders(7, 6, 7, 3)
SPECTRAL_PEAKS = "near 2, 5 and 36, a broad one near 17"
# Alternatives that the table shows beside the choice: all structures of a choice of structures.
MOST_RIVALS = 8


class ModeRow(NamedTuple):
    """One row of the table of modes; None where there is no corresponding mode."""

    estimate: Mode | None
    truth: Mode | None
    chapter: Mode | None

    @property
    def deviations(self) -> tuple[float, float]:
        """Estimate minus truth of frequency and damping in standard errors; NaN where not known."""
        if self.estimate is None or self.truth is None:
            return math.nan, math.nan
        return deviations(self.estimate, self.truth)


def mode_rows(*beside: Sequence[Mode]) -> list[ModeRow]:
    """The modes of the estimate, of the truth and of the chapter, matched by frequency."""
    return [ModeRow(*row) for row in matched_modes(beside)]


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    id: str
    title: Callable[[DatasetResults], str]  # its heading
    content: Callable[[DatasetResults], Context] | None = None  # None for figures alone
    applies: Callable[[DatasetResults], bool] = lambda _: True  # whether the page has it


def _summary(results: DatasetResults) -> Context:
    moved = [moving_sentence(results.varying.moves)] if results.varying else []
    return {
        "verdict": verdict(results),
        "parts_of_error": [*filter(None, moved), *error_parts(results.validation)],
        "evidence": mode_lines(results),
        "checks": results.checks,
    }


def _moving(results: DatasetResults) -> Context:
    """What a moving model says, its modes over time, and its gain beside the spectrogram."""
    varying = results.varying
    assert varying is not None
    assert varying.model is not None
    assert results.prepared is not None
    files = ["varying_modes.csv", "varying.json"]
    chart, name = moving_modes(varying, results.truth), results.name
    schedule, beside = varying.model.schedule, ", and of the data"
    of_frozen = f"Of the model frozen at each {'moment' if schedule == 'time' else schedule}"
    modes = "moving_modes", f"Modes over {schedule}", f"{of_frozen}."
    of_gain = f"{of_frozen}{beside if schedule == 'time' else ''}."
    gain = "moving_gain", f"Gain over {schedule}", of_gain
    drawings = [drawn_figure(chart, modes, name, files)] if len(chart.table) else []
    still, image = replace(chart, panels=()), picture(results.prepared, varying.model)
    drawings.append(drawn_figure(still, gain, name, files, image))
    return {"moves": varying.moves, "drawings": drawings}


def _model(results: DatasetResults) -> Context:
    record = results.model
    return {
        "polynomials": record.polynomials if record.orders else None,
        "written": equations,
        "constraints": list(constraint_rows(record.fit)),
    }


def _continuous(results: DatasetResults) -> Context:
    """The model in s: of each path its numbers in words, and its transfer function."""
    record = results.model.continuous
    model = record.model if record else None
    if model is None:
        return {"record": record}
    paths = [
        (results.outputs[at[0]], results.inputs[at[1]], model.quantities(*at), path)
        for at in np.ndindex(*model.D.shape)
        for path in [model.transfer_function(*at)]
    ]
    return {"record": record, "paths": paths}


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
            parts = {f"{key}.{name}": item for name, item in value.items()}
        elif key == "priors":
            parts = {f"{key}[{index}]": item for index, item in enumerate(value)}
        for name, part in parts.items():
            held = {name, key} & set(fit.active)
            effect = "weighted" if key == "priors" else "active" if held else "not active"
            unit = " Hz" if key.endswith(("_band", "_bands")) else ""
            yield name, _shown(part, unit), effect


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
        if all(item is None or is_number(item) for item in value):
            return " to ".join(map(_shown, value)) + unit
        return "; ".join(_shown(item, unit) for item in value)
    return number(value) if is_number(value) else str(value or "none")


def _modes(results: DatasetResults) -> Context:
    """The table of modes, their lines of evidence, and the shapes of several outputs."""
    stand_in = stands_in_for_the_chapter(results.settings)
    true_modes = results.true_modes
    of_chapter = CHAPTER_MODES if stand_in else ()
    geometry, names = results.settings.geometry, tuple(output.name for output in results.outputs)
    drawing = ShapeDrawing(geometry, names) if geometry is not None else None
    labels = [
        f"Shape of mode {k} at {hertz(m.frequency_hz)}" for k, m in enumerate(results.modes, 1)
    ]
    return {
        "rows": mode_rows(results.modes, true_modes, of_chapter),
        "lines": {line.mode.pole: line for line in mode_lines(results)},
        "labels": labels if len(names) > 1 else [],
        "drawn": [
            (
                Markup(drawing.drawn(mode.shape, label)),
                Markup(drawing.drawn(mode.shape, f"{label}, moving", moving=True)),
            )
            for mode, label in zip(results.modes, labels, strict=True)
            if drawing and len(names) > 1
        ],
        "assurance": results.validation.modes.assurance,
        "has_truth": bool(true_modes),
        "chapter_orders": CHAPTER_ORDERS if stand_in else None,
    }


def stands_in_for_the_chapter(settings: DatasetSettings) -> bool:
    """Whether a data set is an ARMAX model of the simulated arm, as the chapter's recording."""
    source = settings.source
    of_arm = isinstance(source, SyntheticSource) and source.synthesis == "flexible_arm"
    by_chapter = settings.automatic is None and settings.order_grid.structure == "armax"
    return of_arm and by_chapter


def compare_with_chapter(results: DatasetResults) -> list[tuple[str, str, str]]:
    """Quantity, value of these results, value of the chapter."""
    selected = {phase: selection.orders for phase, selection in results.phases.items()}
    peaks = [number(peak.frequency_hz, 3) for peak in results.spectrum_summaries[0].peaks]
    return [
        ("Spectral peaks (Hz)", ", ".join(peaks) or "none", SPECTRAL_PEAKS),
        ("Delay nk", str(selected["delay"].single.nk), str(CHAPTER_ORDERS.single.nk)),
        ("Plant order", str(selected["plant"].na), str(CHAPTER_ORDERS.na)),
        ("Order of C, nc", str(selected["nc"].nc), str(CHAPTER_ORDERS.nc)),
        ("Coefficients of B, nb", str(selected["nb"].single.nb), str(CHAPTER_ORDERS.single.nb)),
        ("Model", str(results.model.orders), str(CHAPTER_ORDERS)),
    ]


def recording_rows(results: DatasetResults) -> list[tuple[str, int, int, int, float]]:
    """File, samples as recorded, for estimation and for validation, and error of each recording.

    The error in percent is of its validation samples, mean over the outputs: of simulations,
    without an input of predictions.  There are no rows where there is only one recording.
    """
    transforms, has_input = results.model.transforms, results.model.has_input
    used, held_out = Counter[int](), Counter[int]()
    for counted, origins in ((used, transforms.estimation), (held_out, transforms.validation)):
        for stretch in origins:
            counted[stretch.recording] += stretch.samples
    kind = "simulation_error_percent" if has_input else "prediction_error_percent"
    errors: dict[int, float] = {}
    for origin, scores in zip(transforms.validation, results.validation.stretches, strict=False):
        share = origin.samples / held_out[origin.recording]
        known = errors.get(origin.recording, 0.0)
        errors[origin.recording] = known + share * getattr(scores, kind)
    return [
        (file.path, file.samples, used[place], held_out[place], errors.get(place, math.nan))
        for place, file in enumerate(results.files if transforms.several_recordings else ())
    ]


# What the phases of an order search decide, where their names do not say it.
PHASE_NAMES = {"plant": "plant order"}


def _selection(results: DatasetResults) -> Context:
    record, validation = results.decisions, results.validation
    decisions = record.decisions if record else map(phase_decision, results.phases.values())
    other_model = record.other_model if record else None
    model = OtherModel(
        purpose=record.purpose if record else "",
        model=results.model.text,
        prediction_error_percent=validation.prediction_error_percent,
        simulation_error_percent=validation.simulation_error_percent,
    )
    return {
        "record": record,
        "candidates": results.candidates.to_dict("records") if results.phases else [],
        "decisions": [(decision, rivals(decision)) for decision in decisions],
        "purposes": [model, other_model] if other_model else [],
    }


def phase_decision(phase: PhaseSelection) -> Decision:
    """A phase of an order search as a decision among its candidates or, the first one, delays."""
    subject, criterion, choice = PHASE_NAMES.get(phase.phase, phase.phase), "BIC", str(phase.orders)
    scores = {str(tried.orders): tried.criteria.bic for tried in phase.candidates}
    if phase.phase == "delay":
        criterion, choice = "mean BIC over the orders", f"nk = {phase.orders.single.nk}"
        by_delay: dict[str, list[float]] = {}
        for tried in phase.candidates:
            by_delay.setdefault(f"nk = {tried.orders.single.nk}", []).append(tried.criteria.bic)
        scores = {name: fmean(values) for name, values in by_delay.items()}
    alternatives = tuple(Alternative(*item) for item in scores.items())
    reason = re.sub(r"(?<![\w-])-(?=\d)", "−", phase.reason)
    return Decision(subject, choice, alternatives, criterion, reason)


def rivals(decision: Decision) -> str:
    """The best alternatives with their scores, the choice among them."""
    scored = [a for a in decision.alternatives if math.isfinite(a.score)]
    best = sorted(scored, key=lambda alternative: alternative.score)[: MOST_RIVALS + 1]
    chosen = next((a for a in scored if a.name == decision.choice), None)
    if chosen is not None and chosen not in best:
        best = [*best[:MOST_RIVALS], chosen]
    return "; ".join(f"{alternative.name}: {number(alternative.score, 4)}" for alternative in best)


_IN_TIME = attrgetter("recording")  # which frequency responses are none
SECTIONS = (
    Section("summary", lambda _: "Verdict", _summary),
    Section("model", lambda _: "Model", _model),
    Section(
        "continuous",
        lambda _: "In continuous time",
        _continuous,
        lambda results: results.model.continuous is not None,
    ),
    Section(
        "modes", lambda results: "Modes beside the truth" if results.true_modes else "Modes", _modes
    ),
    Section(
        "moving",
        lambda _: "What moves",
        _moving,
        lambda results: results.varying is not None and results.varying.model is not None,
    ),
    Section(
        "response",
        lambda results: "Response to the input" if results.model.has_input else "Noise filter",
    ),
    Section(
        "errors",
        lambda results: "Prediction and simulation" if results.model.has_input else "Prediction",
        lambda results: {"recordings": recording_rows(results)},
        _IN_TIME,
    ),
    Section("residual_tests", lambda _: "Residuals", applies=_IN_TIME),
    Section("recording", lambda _: "Recording", applies=_IN_TIME),
    Section(
        "selection",
        lambda results: f"Choice of {'structure and ' if results.decisions else 'the '}orders",
        _selection,
        _IN_TIME,
    ),
    Section(
        "chapter",
        lambda _: "Comparison with the chapter",
        lambda results: {"rows": compare_with_chapter(results)},
        lambda results: stands_in_for_the_chapter(results.settings),
    ),
    Section("provenance", lambda _: "Provenance", lambda _: {}),
)
"""The parts in the order of the page."""
