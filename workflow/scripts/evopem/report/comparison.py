"""Several models side by side, as a page and in plain text."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from markupsafe import Markup

from evopem.config.channels import joined_geometry
from evopem.figures.chart import Chart
from evopem.figures.comparison import compared_modes, compared_responses, compared_simulations
from evopem.figures.draw import ShapeDrawing
from evopem.models.merged_modes import MergedModes
from evopem.models.modes import Mode
from evopem.models.setups import INPUT
from evopem.report.figures import drawn_figure
from evopem.report.numbers import (
    MISSING,
    THIN,
    aligned,
    enumeration,
    fixed,
    mode_cells,
    number,
    percent,
    plural,
    with_error,
)
from evopem.report.templates import environment, template_folder
from evopem.report.verdict import verdict
from evopem.results.comparison import MOST, Comparison, Dependence, spread_percent

# Probability of any dependence that is said where there is none.
FALSE_ALARMS = 0.01
SAME = "All models were validated on the same samples."
DIFFERENT = (
    "The models were validated on different samples: their errors are no ranking of the models."
)
# Of each figure: its name, title and caption.
FIGURES: dict[Callable[[Comparison], Chart], tuple[str, str, str]] = {
    compared_simulations: (
        *("simulations", "Measured and simulated"),
        "The samples that judge the models; the drawing has the first of them.",
    ),
    compared_responses: ("responses", "Frequency responses", "Gain with 95 % bands, and phase."),
    compared_modes: (
        *("mode_map", "Modes"),
        "Modes with 95 % intervals; those with open marks are not to be trusted.",
    ),
}

ModeRow = tuple[tuple[Mode | None, ...], list[tuple[str, str]], str]


def _mode_rows(comparison: Comparison) -> list[ModeRow]:
    """Each matched mode, its frequency and damping in each model, and the spread. In brackets where
    a mode is not to be trusted; the spread of one model is a dash."""
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
    """Whether the errors of the models can be compared; of set-ups, whether they fit each other."""
    if comparison.merged:
        return " ".join(merged_sentences(comparison.merged))
    remark = SAME if comparison.has_same_validation else DIFFERENT
    return " ".join([remark, *dependence_sentences(comparison.dependences)])


def dependence_sentences(tests: Sequence[Dependence]) -> list[str]:
    """How modes go with amplitude and mean of an input, tested together (Bonferroni)."""
    limit = f"{percent(100.0 * FALSE_ALARMS, 1)} ({len(tests)} tests together)."
    none = f"No dependence of a mode on amplitude or mean of an input is significant at {limit}"
    sentences = [
        f"Dependence on the {tested.of} of {tested.input_name}: from {number(tested.lowest, 3)} to"
        f" {number(tested.highest, 3)} the mode at {number(tested.frequency_hz)} Hz changes by"
        f" {with_error(tested.change_hz, tested.standard_error_hz)} Hz, significant at {limit}"
        for tested in tests
        if tested.p_value < FALSE_ALARMS / len(tests)
    ]
    return sentences or [none] * bool(tests)


def merged_sentences(merged: MergedModes) -> list[str]:
    """How set-ups were merged, and which of them contradict the others."""
    of_all = set.intersection(*(set(setup.channels) for setup in merged.setups))
    common = enumeration([name.removeprefix(INPUT) for name in sorted(of_all)])
    counted = plural(len(merged.setups), "set-up"), plural(len(merged.outputs), "output")
    sentences = [f"{' and '.join(counted)}; {common or 'no channel'} in all set-ups."]
    others = "the other" if len(merged.setups) == 2 else "the others"
    for c in merged.contradictions:
        values = f"{number(c.value)} beside {number(c.joint)}"
        sentences.append(
            f"{c.setup} contradicts {others}, most in the {c.quantity} of mode"
            f" {c.mode + 1}: {values}, {number(abs(c.standard_errors), 2)} standard errors"
            " apart; it counts with errors enlarged until it agrees."
        )
    return sentences + [f"No set-up contradicts {others}."] * (not merged.contradictions)


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
        merged = comparison.merged.modes if comparison.merged else ()
        modes = [("mode", *(["merged"] if merged else []), *comparison.labels, "spread")]
        modes += [
            (
                *(str(place), *(mode_cells(mode)[0] for mode in merged[place - 1 : place])),
                *(*(frequency for frequency, _ in cells), spread),
            )
            for place, (_, cells, spread) in enumerate(_mode_rows(comparison), start=1)
        ]
        lines += ["", "Natural frequencies in Hz; in brackets: not to be trusted."]
        lines += aligned(modes)
    return "\n".join(lines)


def _drawn(comparison: Comparison) -> list[Markup]:
    """The merged shapes over the geometries of all set-ups."""
    geometry = joined_geometry([model.settings.geometry for model in comparison.models])
    if comparison.merged is None or geometry is None:
        return []
    drawing = ShapeDrawing(geometry, comparison.merged.outputs)
    shapes = [np.nan_to_num(mode.shape) for mode in comparison.merged.modes]
    return [Markup(drawing.drawn(shape, f"Mode {k}")) for k, shape in enumerate(shapes, 1)]


def build_comparison(comparison: Comparison, pages: Mapping[str, str] | None = None) -> str:
    """One HTML page that loads no other file; `pages` are addresses of reports by label."""
    outcomes = [{check.name: check.word for check in model.checks} for model in comparison.models]
    names = dict.fromkeys(name for outcome in outcomes for name in outcome)
    name, data = "-".join(comparison.labels)[:80], ("CSV of each data set",)
    table = comparison.table.assign(
        verdict=[verdict(model).sentence for model in comparison.models],
        label=comparison.labels,
        of_responses=[model.of_responses for model in comparison.models],
    )
    page = environment(template_folder()).get_template("comparison.html.j2")
    return page.render(
        rows=table.to_dict("records"),
        remark=_remark(comparison),
        merged=comparison.merged,
        drawn=_drawn(comparison),
        sections=[
            drawn_figure(chart_of(comparison), words, name, data)
            for chart_of, words in FIGURES.items()
            if comparison.has_same_validation or chart_of is not compared_simulations
            if len(comparison.models) <= MOST
        ],
        modes=_mode_rows(comparison),
        # The outcome of every check for each model, in words; empty where it has none.
        checks={name: [outcome.get(name, "").lower() for outcome in outcomes] for name in names},
        pages=pages or {},
    )
