"""Several models side by side, as a page and in plain text."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from evopem.figures.chart import Chart
from evopem.figures.comparison import (
    Comparison,
    MatchedMode,
    compared_modes,
    compared_responses,
    compared_simulations,
)
from evopem.figures.draw import draw
from evopem.figures.style import svg_text
from evopem.report.figures import DrawnFigure
from evopem.report.numbers import MISSING, THIN, fixed, percent, with_error
from evopem.report.templates import environment
from evopem.report.verdict import verdict
from evopem.validation.checks import failed_checks

SAME = "All models were validated on the same samples."
DIFFERENT = (
    "The models were validated on different samples: their errors are no ranking of the models."
)


@dataclass(frozen=True)
class ModelRow:
    """A model of a comparison."""

    label: str
    model: str
    samples: int  # for estimation
    sampling_rate: float  # Hz
    simulation_error_percent: float
    prediction_error_percent: float
    failed: int  # checks
    verdict: str


def _rows(comparison: Comparison) -> list[ModelRow]:
    rows = []
    for label, view in zip(comparison.labels, comparison.views, strict=True):
        validation = view.results.validation
        rows.append(
            ModelRow(
                *(label, view.model_text, view.results.model.transforms.estimation_samples),
                *(view.sampling_rate, validation.simulation_error_percent),
                *(validation.prediction_error_percent, len(failed_checks(view.checks))),
                verdict(view).sentence,
            )
        )
    return rows


def _validated_on(comparison: Comparison) -> str:
    """Whether the errors of the models can be compared."""
    return SAME if comparison.has_same_validation else DIFFERENT


def _cells(matched: MatchedMode) -> list[tuple[str, str]]:
    """Frequency and damping of a mode in each model, in brackets where not to be trusted."""
    shown = []
    for mode, trusted in zip(matched.modes, matched.trusted, strict=True):
        texts = (MISSING, MISSING)
        if mode is not None:
            texts = (
                with_error(mode.frequency_hz, mode.frequency_se_hz),
                with_error(100 * mode.damping_ratio, 100 * mode.damping_se),
            )
            texts = texts if trusted else (f"({texts[0]})", f"({texts[1]})")
        shown.append(texts)
    return shown


def _spread(matched: MatchedMode) -> str:
    """Largest less smallest frequency in percent, a dash for one model."""
    value = matched.spread_percent
    return MISSING if value != value else f"{fixed(value, 2)}{THIN}%"


def comparison_text(comparison: Comparison) -> str:
    """Errors of the models, and their modes, one line for each."""
    errors = [
        ("", "model", "simulation", "one step", "failed checks"),
        *(
            (
                *(row.label, row.model, percent(row.simulation_error_percent)),
                *(percent(row.prediction_error_percent), str(row.failed)),
            )
            for row in _rows(comparison)
        ),
    ]
    modes = [
        ("mode", *comparison.labels, "spread"),
        *(
            (str(place), *(frequency for frequency, _ in _cells(each)), _spread(each))
            for place, each in enumerate(comparison.modes, start=1)
        ),
    ]
    lines = [*_aligned(errors), "", _validated_on(comparison)]
    if comparison.modes:
        lines += ["", "Natural frequencies in Hz; in brackets: not to be trusted."]
        lines += _aligned(modes)
    return "\n".join(lines)


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def build_comparison(
    comparison: Comparison, template_directory: Path, pages: Mapping[str, str] | None = None
) -> str:
    """One HTML page that loads no other file; `pages` are addresses of reports by label."""
    page = environment(template_directory).get_template("comparison.html.j2")
    return page.render(
        rows=_rows(comparison),
        remark=_validated_on(comparison),
        sections=_sections(comparison),
        modes=[(each.modes, _cells(each), _spread(each)) for each in comparison.modes],
        checks=_checks(comparison),
        pages=pages or {},
    )


def _checks(comparison: Comparison) -> dict[str, list[str]]:
    """The outcome of every check for each model, in words; empty where it has none."""
    outcomes = [{check.name: check.word for check in each.checks} for each in comparison.views]
    names = dict.fromkeys(name for outcome in outcomes for name in outcome)
    return {name: [outcome.get(name, "").lower() for outcome in outcomes] for name in names}


def _sections(comparison: Comparison) -> list[DrawnFigure]:
    figures: list[tuple[str, str, str, Callable[[Comparison], Chart]]] = [
        (
            *("responses", "Frequency responses", "Gain with 95 % bands, and phase."),
            compared_responses,
        ),
        (
            *("mode_map", "Modes"),
            "Modes with 95 % intervals; those with open marks are not to be trusted.",
            compared_modes,
        ),
    ]
    if comparison.has_same_validation:
        caption = "Validation samples; the drawing has the first of them."
        figures.insert(0, ("simulations", "Measured and simulated", caption, compared_simulations))
    drawn = []
    for name, title, caption, chart_of in figures:
        chart = chart_of(comparison)
        drawn.append(
            DrawnFigure.of(
                *(chart, svg_text(draw(chart)), (name, title, caption)),
                *("-".join(comparison.labels)[:80], ("CSV of each data set",)),
            )
        )
    return drawn
