"""Figures of the comparison on the Fletcher-Powell function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from evopem.figures.chart import FAMILY as ROLES
from evopem.figures.chart import FAMILY_MARKERS
from evopem.figures.style import (
    COLOURS,
    ERROR,
    INK,
    LABEL_BOX,
    MODEL,
    MUTED,
    PAPER,
    TRUTH,
    WIDTH,
    logarithmic,
    power_of_ten,
    say_nothing_to_draw,
    styled,
    svg_text,
)
from evopem.files.atomic import write_text
from fletcher_powell.experiments import BASIN_HOPPING, CHAPTER, DEFAULT, MULTI_START
from fletcher_powell.tables import Tables

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FAMILY = tuple(COLOURS[role] for role in ROLES)
FAMILY_LINES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), "-.", (0, (7, 2)), ":")
BASELINES = (
    MULTI_START,
    "monotonic-basin-hopping",
    "cma-es",
    "basin-hopping",
    "differential-evolution",
    "dual-annealing",
)
REFINED = {
    "hybrid": "worst",
    "hybrid-random": "random",
    "hybrid-best": "best",
    "hybrid-all": "all",
}
SCALE = ("hybrid", DEFAULT, MULTI_START, *reversed(BASIN_HOPPING))
# P at the target.
TARGET = -6.0
# A minimum with a value below this is a global one.
ZERO = 1e-9


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """Return an empty figure, sizes in inches, that pyplot does not keep."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


@dataclass(frozen=True)
class ComparisonFigure:
    """One figure.

    Attributes
    ----------
    name : str
        Stem of its file.
    title, caption : str
    draw : callable
        Draws it from the tables.
    table : callable
        The rows that it shows.
    data : str
        The file that holds these rows.
    """

    name: str
    title: str
    caption: str
    draw: Callable[[Tables], Figure]
    table: Callable[[Tables], pd.DataFrame]
    data: str


@styled
def draw_landscape(landscape: pd.DataFrame, minima: pd.DataFrame) -> Figure:
    """Draw contours of the function of two variables, and its minima (chapter figure 1)."""
    figure = new_figure(4.3, 5.4)
    axes = figure.subplots()
    grid = landscape.pivot_table(index="x2", columns="x1", values="f")
    x, y, values = grid.columns.to_numpy(), grid.index.to_numpy(), grid.to_numpy()
    levels = np.max(values) * np.linspace(0.0, 1.0, 13)[1:-1] ** 2
    for number, (low, high) in enumerate(zip([0.0, *levels], [*levels, np.inf], strict=True)):
        shade = 0.02 + 0.62 * number / len(levels)
        axes.contourf(x, y, values, [low - 1.0, high], colors=[MODEL], alpha=shade)
    axes.contour(x, y, values, levels, colors=[MODEL], linewidths=0.5)
    is_global = minima["f"] < ZERO
    others, lowest = minima[~is_global], minima[is_global]
    axes.plot(
        others["x1"],
        others["x2"],
        linestyle="none",
        marker="o",
        color=ERROR,
        markerfacecolor=PAPER,
        label="other minima",
    )
    axes.plot(
        lowest["x1"],
        lowest["x2"],
        linestyle="none",
        marker="*",
        markersize=11,
        color=TRUTH,
        label="f = 0",
    )
    ticks = np.pi * np.array([-1, -0.5, 0, 0.5, 1])
    labels = ["−π", "−π/2", "0", "π/2", "π"]
    axes.set_xticks(ticks, labels)
    axes.set_yticks(ticks, labels)
    axes.set_aspect("equal")
    axes.set_xlabel("x₁")
    axes.set_ylabel("x₂")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
    return figure


@styled
def draw_final(runs: pd.DataFrame, summary: pd.DataFrame) -> Figure:
    """Draw P of every run of the chapter's four algorithms, and the chapter's tables."""
    figure = new_figure(2.7)
    axes = figure.subplots()
    table = summary[summary["study"] == "table"].set_index("algorithm")
    shown = [name for name in CHAPTER if name in table.index]
    for row, name in enumerate(shown):
        own = np.sort(runs.loc[(runs["study"] == "table") & (runs["algorithm"] == name), "P"])
        spread = 0.26 * (np.arange(len(own)) * 0.618 % 1.0 - 0.5)
        axes.plot(
            own,
            row - 0.14 + spread,
            linestyle="none",
            marker="o",
            markersize=2.6,
            color=MODEL,
            alpha=0.55,
            label="one run" if row == 0 else None,
        )
        axes.plot(
            table.loc[name, "P_mean"],
            row - 0.14,
            marker="|",
            markersize=15,
            markeredgewidth=1.8,
            linestyle="none",
            color=INK,
            label="mean of the runs" if row == 0 else None,
        )
        low, mean, high = table.loc[name, ["chapter_min", "chapter_mean", "chapter_max"]]
        axes.plot([low, high], [row + 0.24] * 2, color=ERROR, linewidth=1.4)
        axes.plot(
            mean,
            row + 0.24,
            marker="D",
            color=ERROR,
            linestyle="none",
            label="chapter: mean, least to largest" if row == 0 else None,
        )
    axes.axvline(TARGET, color=MUTED, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.set_yticks(range(len(shown)), [table.loc[name, "label"] for name in shown])
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("P = log₁₀ f at the end of the run")
    axes.legend(loc="upper center", bbox_to_anchor=(0.45, 1.17), ncols=3)
    return figure


@styled
def draw_convergence(convergence: pd.DataFrame, summary: pd.DataFrame) -> Figure:
    """Draw P against the evaluations: medians, with bands from the 10th to the 90th percentile."""
    figure = new_figure(3.6)
    left, right = figure.subplots(1, 2, sharey=True)
    labels = summary.drop_duplicates("algorithm").set_index("algorithm")["label"]
    own = convergence[convergence["study"] == "table"]
    for axes, names, title, bands in (
        (left, CHAPTER, "The chapter's algorithms", True),
        (right, ("hybrid", *BASELINES), "The hybrid and the baselines", False),
    ):
        colours = iter(zip(FAMILY, FAMILY_LINES, strict=True))
        for name in names:
            curve = own[own["algorithm"] == name]
            if curve.empty:
                continue
            colour, line = (INK, "-") if name == "hybrid" else next(colours)
            if bands:
                axes.fill_between(
                    curve["evaluations"],
                    curve["P_10"],
                    curve["P_90"],
                    color=colour,
                    alpha=0.14,
                    linewidth=0,
                )
            axes.plot(
                curve["evaluations"],
                curve["P_50"],
                color=colour,
                linestyle=line,
                linewidth=1.8 if name == "hybrid" else 1.2,
                label=labels.get(name, name),
            )
        axes.axhline(TARGET, color=MUTED, linewidth=0.8, linestyle=(0, (4, 3)))
        _logarithmic_evaluations(axes)
        axes.set_title(title)
        axes.legend(loc="lower left", fontsize=7.0, labelspacing=0.25)
    left.set_ylabel("P = log₁₀ f, best so far")
    low = min(own["P_50"].min(), TARGET) if not own.empty else TARGET
    left.set_ylim(max(low, -20.0) - 7.5, None)
    return figure


@styled
def draw_refinement(summary: pd.DataFrame) -> Figure:
    """Draw expected evaluations to success for the four choices of offspring to refine."""
    hybrids = summary[summary["algorithm"].isin(REFINED)]
    cases = [
        (study, dimension)
        for (study, dimension), group in hybrids.groupby(["study", "dimension"], sort=False)
        if group["algorithm"].nunique() == len(REFINED)
    ]
    figure = new_figure(2.6)
    if not cases:
        say_nothing_to_draw(figure.subplots(), "Not all four choices were run.")
        return figure
    titles = {"table": "finite differences", "precise": "analytic", "scale": "analytic"}
    panels = figure.subplots(1, len(cases), sharey=True, squeeze=False)[0]
    for axes, (study, dimension) in zip(panels, cases, strict=True):
        rows = hybrids[(hybrids["study"] == study) & (hybrids["dimension"] == dimension)]
        rows = rows.set_index("algorithm")
        for place, name in enumerate(REFINED):
            row = rows.loc[name]
            _with_interval(axes, row, place, MODEL if name == "hybrid" else MUTED)
            axes.annotate(
                f"{row['successes']} of {row['runs']}",
                (row["expected_evaluations"], place),
                xytext=(0, 6),
                textcoords="offset points",
                ha="center",
                fontsize=7.0,
            )
        axes.set_title(f"n = {dimension}, {titles[study]}")
        axes.set_yticks(range(len(REFINED)), REFINED.values())
        axes.set_ylim(len(REFINED) - 0.5, -0.7)
        _logarithmic_evaluations(axes, "Expected evaluations to success")
    panels[0].set_ylabel("BFGS refines")
    return figure


def _with_interval(axes: Axes, row: pd.Series, place: float, colour: str) -> None:
    ends = [row["expected_evaluations_low"], row["expected_evaluations_high"]]
    axes.plot(ends, [place, place], color=colour, linewidth=1.4)
    axes.plot(row["expected_evaluations"], place, marker="o", color=colour, linestyle="none")


@styled
def draw_scale(summary: pd.DataFrame) -> Figure:
    """Draw expected evaluations to success against the dimension, with 95 % intervals."""
    figure = new_figure(3.4, 5.6)
    axes = figure.subplots()
    scale = summary[summary["study"] == "scale"]
    if scale["expected_evaluations"].isna().all():
        say_nothing_to_draw(axes, "No run reached the target.")
        return figure
    for number, name in enumerate(SCALE):
        rows = scale[(scale["algorithm"] == name) & scale["expected_evaluations"].notna()]
        if rows.empty:
            continue
        colour = INK if name == "hybrid" else FAMILY[number - 1]
        # Shifted, so that the intervals do not overlap.
        place = rows["dimension"] * 1.02 ** (number - 1.5)
        for where, (_, row) in zip(place, rows.iterrows(), strict=True):
            axes.plot(
                [where, where],
                [row["expected_evaluations_low"], row["expected_evaluations_high"]],
                color=colour,
                linewidth=1.0,
            )
        axes.plot(
            place,
            rows["expected_evaluations"],
            color=colour,
            marker=FAMILY_MARKERS[number],
            linestyle="-" if name == "hybrid" else FAMILY_LINES[number - 1],
            label=rows["label"].iloc[0],
        )
        solved = rows[rows["successes"] < rows["runs"]]
        for where, (_, row) in zip(place[solved.index], solved.iterrows(), strict=True):
            axes.annotate(
                f"{row['successes']}/{row['runs']}",
                (where, row["expected_evaluations"]),
                xytext=(5, -2),
                textcoords="offset points",
                fontsize=7.0,
                color=colour,
                bbox=LABEL_BOX,
            )
    axes.set_xscale("log")
    logarithmic(axes)
    dimensions = sorted(scale["dimension"].unique())
    axes.set_xticks(dimensions, [str(dimension) for dimension in dimensions])
    axes.minorticks_off()
    axes.set_xlabel("Dimension n")
    axes.set_ylabel("Expected evaluations to success")
    axes.legend(loc="upper left")
    return figure


def _logarithmic_evaluations(axes: Axes, label: str = "Evaluations of the objective") -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    axes.set_xscale("log")
    low, high = axes.get_xlim()
    subs = (1.0, 2.0, 5.0) if high / low < 200 else (1.0,)
    wide = high / low > 10
    locator = LogLocator(base=10, subs=subs, numticks=9) if wide else MaxNLocator(3)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(FuncFormatter(power_of_ten))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel(label)


COMPARISON_FIGURES = (
    ComparisonFigure(
        "final",
        "Where each run ended",
        "P of each run of the chapter's four algorithms (gradients by finite differences, each"
        " counted n), and the mean, least and largest P of the chapter's table 1. Dashed: the"
        " target, f = 10⁻⁶.",
        lambda tables: draw_final(tables.runs, tables.summary),
        lambda tables: tables.runs[
            (tables.runs["study"] == "table") & tables.runs["algorithm"].isin(CHAPTER)
        ],
        "runs.csv",
    ),
    ComparisonFigure(
        "convergence",
        "Convergence",
        "Best value so far against the evaluations: median over the runs; bands from the 10th to"
        " the 90th percentile. Gradients by finite differences. Dashed: the target.",
        lambda tables: draw_convergence(tables.convergence, tables.summary),
        lambda tables: tables.convergence,
        "convergence.csv",
    ),
    ComparisonFigure(
        "refinement",
        "Which offspring BFGS refines",
        "Expected evaluations to success for the chapter's choice, the worst offspring, and for the"
        " three that it rejected, with 95 % bootstrap intervals and the number of successful runs.",
        lambda tables: draw_refinement(tables.summary),
        lambda tables: tables.summary[tables.summary["algorithm"].isin(REFINED)],
        "table.csv",
    ),
    ComparisonFigure(
        "scale",
        "Growth with the dimension",
        "Expected evaluations to success against the dimension, with 95 % bootstrap intervals;"
        " analytic gradients, each counted one. A fraction is the share of successful runs, where"
        " some failed.",
        lambda tables: draw_scale(tables.summary),
        lambda tables: tables.summary[tables.summary["study"] == "scale"],
        "table.csv",
    ),
    ComparisonFigure(
        "landscape",
        "The function",
        "The first instance for n = 2 (compare chapter figure 1); darker is higher. Two equations"
        " in two unknowns can have several solutions, so f can be 0 at points other than α. f is"
        " 2π-periodic, so opposite sides of the box coincide.",
        lambda tables: draw_landscape(tables.landscape, tables.minima),
        lambda tables: tables.landscape,
        "landscape.csv",
    ),
)


def draw_figures(tables: Tables, directory: Path) -> None:
    """Draw every figure of the comparison as an SVG file."""
    for entry in COMPARISON_FIGURES:
        write_text(directory / f"{entry.name}.svg", svg_text(entry.draw(tables)))
