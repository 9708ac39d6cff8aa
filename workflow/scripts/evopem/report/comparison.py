"""Several models side by side, as a page and in plain text."""

from collections.abc import Callable, Mapping
from pathlib import Path

from evopem.figures.chart import Chart
from evopem.figures.comparison import (
    Comparison,
    compared_modes,
    compared_responses,
    compared_simulations,
    spread_percent,
)
from evopem.models.modes import Mode
from evopem.report.numbers import MISSING, THIN, aligned, fixed, mode_cells, percent
from evopem.report.verdict import verdict

SAME = "All models were validated on the same samples."
DIFFERENT = (
    "The models were validated on different samples: their errors are no ranking of the models."
)
# Of each figure: its name, title and caption.
FIGURES: dict[Callable[[Comparison], Chart], tuple[str, str, str]] = {
    compared_simulations: (
        *("simulations", "Measured and simulated"),
        "Validation samples; the drawing has the first of them.",
    ),
    compared_responses: ("responses", "Frequency responses", "Gain with 95 % bands, and phase."),
    compared_modes: (
        *("mode_map", "Modes"),
        "Modes with 95 % intervals; those with open marks are not to be trusted.",
    ),
}

ModeRow = tuple[tuple[Mode | None, ...], list[tuple[str, str]], str]


def _mode_rows(comparison: Comparison) -> list[ModeRow]:
    """Each matched mode, its frequency and damping in each model, and the spread.

    In brackets where a mode is not to be trusted; the spread of one model is a dash.
    """
    rows = []
    for modes in comparison.matched:
        texts = [mode_cells(mode) if mode else (MISSING, MISSING) for mode in modes]
        cells = [
            row if mode is None or mode in comparison.trusted else (f"({row[0]})", f"({row[1]})")
            for mode, row in zip(modes, texts, strict=True)
        ]
        spread = fixed(spread_percent(modes), 2)
        rows.append((modes, cells, spread if spread == MISSING else f"{spread}{THIN}%"))
    return rows


def _remark(comparison: Comparison) -> str:
    """Whether the errors of the models can be compared."""
    return SAME if comparison.has_same_validation else DIFFERENT


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
            (str(place), *(frequency for frequency, _ in cells), spread)
            for place, (_, cells, spread) in enumerate(_mode_rows(comparison), start=1)
        ]
        lines += ["", "Natural frequencies in Hz; in brackets: not to be trusted."]
        lines += aligned(modes)
    return "\n".join(lines)


def build_comparison(
    comparison: Comparison, template_directory: Path, pages: Mapping[str, str] | None = None
) -> str:
    """One HTML page that loads no other file; `pages` are addresses of reports by label."""
    from evopem.report.figures import drawn_figure
    from evopem.report.templates import environment

    outcomes = [{check.name: check.word for check in model.checks} for model in comparison.models]
    names = dict.fromkeys(name for outcome in outcomes for name in outcome)
    name, data = "-".join(comparison.labels)[:80], ("CSV of each data set",)
    table = comparison.table.assign(
        verdict=[verdict(model).sentence for model in comparison.models], label=comparison.labels
    )
    page = environment(template_directory).get_template("comparison.html.j2")
    return page.render(
        rows=table.to_dict("records"),
        remark=_remark(comparison),
        sections=[
            drawn_figure(chart_of(comparison), words, name, data)
            for chart_of, words in FIGURES.items()
            if comparison.has_same_validation or chart_of is not compared_simulations
        ],
        modes=_mode_rows(comparison),
        # The outcome of every check for each model, in words; empty where it has none.
        checks={name: [outcome.get(name, "").lower() for outcome in outcomes] for name in names},
        pages=pages or {},
    )
