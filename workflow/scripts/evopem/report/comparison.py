"""Several models side by side, as a page and in plain text."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
from evopem.report.numbers import MISSING, THIN, aligned, fixed, mode_cells, percent
from evopem.report.verdict import verdict

SAME = "All models were validated on the same samples."
DIFFERENT = (
    "The models were validated on different samples: their errors are no ranking of the models."
)
FIGURES: tuple[tuple[str, str, str, Callable[[Comparison], Chart]], ...] = (
    (
        *("simulations", "Measured and simulated"),
        *("Validation samples; the drawing has the first of them.", compared_simulations),
    ),
    (
        *("responses", "Frequency responses", "Gain with 95 % bands, and phase."),
        compared_responses,
    ),
    (
        *("mode_map", "Modes"),
        "Modes with 95 % intervals; those with open marks are not to be trusted.",
        compared_modes,
    ),
)


def _remark(comparison: Comparison) -> str:
    """Whether the errors of the models can be compared."""
    return SAME if comparison.has_same_validation else DIFFERENT


def _cells(matched: MatchedMode) -> list[tuple[str, str]]:
    """Frequency and damping of a mode in each model, in brackets where not to be trusted."""
    shown = []
    for mode, trusted in zip(matched.modes, matched.trusted, strict=True):
        cells = mode_cells(mode) if mode else (MISSING, MISSING)
        shown.append(cells if trusted or not mode else (f"({cells[0]})", f"({cells[1]})"))
    return shown


def _spread(matched: MatchedMode) -> str:
    """Largest less smallest frequency in percent, a dash for one model."""
    value = matched.spread_percent
    return MISSING if value != value else f"{fixed(value, 2)}{THIN}%"


def comparison_text(comparison: Comparison) -> str:
    """Errors of the models, and their modes, one line for each."""
    errors = [("", "model", "simulation", "one step", "failed checks")]
    errors += [
        (
            *(str(label), row["model"], percent(row["simulation_error_percent"])),
            *(percent(row["prediction_error_percent"]), str(row["failed_checks"])),
        )
        for label, row in comparison.table.iterrows()
    ]
    lines = [*aligned(errors), "", _remark(comparison)]
    if comparison.matched:
        modes = [("mode", *comparison.labels, "spread")]
        modes += [
            (str(place), *(frequency for frequency, _ in _cells(each)), _spread(each))
            for place, each in enumerate(comparison.matched, start=1)
        ]
        lines += ["", "Natural frequencies in Hz; in brackets: not to be trusted."]
        lines += aligned(modes)
    return "\n".join(lines)


def build_comparison(
    comparison: Comparison, template_directory: Path, pages: Mapping[str, str] | None = None
) -> str:
    """One HTML page that loads no other file; `pages` are addresses of reports by label."""
    from evopem.report.figures import DrawnFigure
    from evopem.report.templates import environment

    sentences = [verdict(each).sentence for each in comparison.models]
    outcomes = [{check.name: check.word for check in each.checks} for each in comparison.models]
    names = dict.fromkeys(name for outcome in outcomes for name in outcome)
    name, sections = "-".join(comparison.labels)[:80], []
    for figure, title, caption, chart_of in FIGURES[0 if comparison.has_same_validation else 1 :]:
        chart = chart_of(comparison)
        data = ("CSV of each data set",)
        sections.append(
            DrawnFigure.of(chart, svg_text(draw(chart)), (figure, title, caption), name, data)
        )
    table = comparison.table.assign(verdict=sentences, label=comparison.labels)
    page = environment(template_directory).get_template("comparison.html.j2")
    return page.render(
        rows=table.to_dict("records"),
        remark=_remark(comparison),
        sections=sections,
        modes=[(each.modes, _cells(each), _spread(each)) for each in comparison.matched],
        # The outcome of every check for each model, in words; empty where it has none.
        checks={name: [each.get(name, "").lower() for each in outcomes] for name in names},
        pages=pages or {},
    )
