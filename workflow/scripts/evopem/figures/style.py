"""Style of all figures: colours, lines, labels, and reproducible SVG text.

Each role has one colour, which differs from the others in lightness or line style as well, so that
figures are readable without colour. No colour has two roles, so a page may replace the colours.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from functools import wraps
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from evopem.arrays import Array, Indices
from evopem.validation.checks.check import superscript

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

INK = "#1f2328"  # text, axes and what was measured
MUTED = "#6b7480"  # what was computed without a model
GRID = "#dfe3e8"
PAPER = "#fefefe"  # behind labels and inside open markers
MODEL = "#0a5fa8"  # the parametric model and its band
ERROR = "#c64b05"  # errors, bounds exceeded, selections
TRUTH = "#0b8f6a"  # the known truth of a synthetic recording
COLOURS = {
    "ink": INK,
    "muted": MUTED,
    "model": MODEL,
    "error": ERROR,
    "truth": TRUTH,
    "fourth": "#8b5aa8",  # further curves of a family
    "fifth": "#9a7b00",
}

# Background of a label that lies on lines.
LABEL_BOX = {"facecolor": PAPER, "edgecolor": "none", "pad": 0.8}

WIDTH = 7.2  # inches; 518 pt, the text width of the report
PIXELS = 72.0  # of a page, on an inch of paper
# Points: around a panel; a tick and the space to its label; the label of an axis; a further line of
# one; a letter of a tick's label.
EDGE, TICK, LABEL, LINE, LETTER = 3.0, 8.0, 15.0, 10.5, 5.1

PARAMETERS: Any = {  # matplotlib types its keys as one long Literal
    "svg.fonttype": "none",
    "svg.hashsalt": "evopem",
    # Names, units and values are shown as they are, dollar signs included.
    **dict.fromkeys(("text.parse_math", "axes.formatter.useoffset"), False),
    **dict.fromkeys(("axes.spines.top", "axes.spines.right", "legend.frameon"), False),
    **dict.fromkeys(("axes.grid", "axes.axisbelow", "axes.unicode_minus", "path.simplify"), True),
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "Helvetica"],
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 8.5),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize", "legend.fontsize"), 8.0),
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 5.0,
    "legend.handlelength": 2.2,
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor"), INK),
    **dict.fromkeys(("xtick.color", "ytick.color"), INK),
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width"), 0.7),
    **dict.fromkeys(("xtick.minor.width", "ytick.minor.width"), 0.5),
    "lines.linewidth": 1.2,
    "lines.markersize": 4.5,
    "lines.solid_capstyle": "round",
    "lines.solid_joinstyle": "round",
    **dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor"), "none"),
}

P = ParamSpec("P")
T = TypeVar("T")


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Run a drawing function with the project's settings of matplotlib, and restore them after."""

    @wraps(draw)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> T:
        from matplotlib import rc_context

        with rc_context(PARAMETERS):
            return draw(*args, **kwargs)

    return wrapper


@styled
def svg_text(figure: Figure) -> str:
    """Render a figure as SVG text; equal data give equal bytes.

    Coordinates are cut to two decimals of a point: the file is small, and does not depend on the
    last bits of the arithmetic. The layout is computed once and its places are rounded: matplotlib
    names clipping paths after all their digits, the last of which differ from run to run.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
    figure.set_layout_engine("none")
    for axes in figure.axes:
        left, bottom, width, height = (round(float(x), 5) for x in axes.get_position().bounds)
        axes.set_position((left, bottom, width, height))
    stream = io.StringIO()
    # `savefig` would draw all of it once more, for a layout that stands.
    FigureCanvasSVG(figure).print_svg(
        stream, metadata={"Date": None, "Creator": None, "Format": None, "Type": None}
    )
    text = re.sub(r' transform="rotate\(-0 [^"]*"', "", stream.getvalue())
    return re.sub(r' [dxy]="[^"]*"', lambda at: re.sub(r"(\.\d\d)\d+", r"\1", at[0]), text)


def arrange(places: Sequence[Axes], columns: int) -> None:
    """Place the panels of a figure, row by row, with margins by the lengths of their labels.

    matplotlib's own layouts measure every text, some of them four times: as long as all drawing.
    """
    figure, grid = places[0].get_figure(root=True), places[0].get_gridspec()
    assert figure is not None
    assert grid is not None
    across, up = (float(length) for length in PIXELS * figure.get_size_inches())
    margins = np.array([_margins(axes) for axes in places]).reshape(-1, columns, 5)
    left, right, legend = margins[:, :, [0, 1, 4]].max(axis=0).T
    below, above = margins[:, :, 2:4].max(axis=1).T
    for _ in range(2):  # what a legend is wider than its panel lies to the left of it
        width = (across - np.sum(left + right)) / columns
        left = np.maximum(left, legend - width)
    ratios = np.array(grid.get_height_ratios())
    heights = (up - np.sum(below + above)) * ratios / np.sum(ratios)
    x = np.cumsum(left + width + right) - width - right
    y = up - np.cumsum(above + heights + below) + below
    for number, axes in enumerate(places):
        row, column = divmod(number, columns)
        axes.set_position((x[column] / across, y[row] / up, width / across, heights[row] / up))


def _margins(axes: Axes) -> tuple[float, float, float, float, float]:
    """Left of a panel, right, below and above, and the width of a legend above it, in points."""
    if not axes.axison:
        return (EDGE, EDGE, EDGE, EDGE, 0.0)
    widest_label = _longest_label(axes.yaxis)
    beside, below = (
        EDGE + TICK + (LABEL + label.count("\n") * LINE if label else 0.0)
        for label in (axes.get_ylabel(), axes.get_xlabel())
    )
    below += LINE if axes.xaxis.get_tick_params()["labelbottom"] else -TICK / 2
    title = LINE + 5.0 if axes.get_title(loc="left") else EDGE
    title += LINE if axes.yaxis.get_major_formatter().get_offset() else 0.0
    legend = axes.get_legend()
    if legend and legend.get_bbox_to_anchor().y0 == axes.bbox.y0:
        legend = None  # within the panel
    over = [artist.get_window_extent() for artist in (*axes.texts, *filter(None, [legend]))]
    points = PIXELS / axes.figure.dpi
    right = [_longest_label(axes.xaxis) / 2, *(points * (box.x1 - axes.bbox.x1) for box in over)]
    above = [title, *(points * (box.y1 - axes.bbox.y1) + 1.0 for box in over)]
    wide = points * over[-1].width if legend else 0.0
    return beside + widest_label, EDGE + max(right), below, max(above), wide


def _longest_label(axis: Axis) -> float:
    """Width of the longest label of the ticks of an axis, about, in points."""
    low, high = sorted(axis.get_view_interval())
    places = [float(place) for place in axis.get_majorticklocs()]
    labels = axis.get_major_formatter().format_ticks(places)
    shown = [len(label) for at, label in zip(places, labels, strict=True) if low <= at <= high]
    return LETTER * max(shown, default=0)


def extremes(y: ArrayLike, bins: int = 1000) -> Indices:
    """Ascending indices of the smallest and largest value of each bin of a series (N,); NaN are
    ignored. Of at most 4 × bins points every index is returned.
    """
    y = np.asarray(y, dtype=float)
    if y.size <= 4 * bins:
        return np.arange(y.size)
    edges = np.linspace(0, y.size, bins + 1).astype(int)
    finite = np.isfinite(y)
    low = np.where(finite, y, np.inf)
    high = np.where(finite, y, -np.inf)
    kept: list[int] = []
    for start, stop in pairwise(edges.tolist()):
        if finite[start:stop].any():
            kept.append(start + int(low[start:stop].argmin()))
            kept.append(start + int(high[start:stop].argmax()))
    return np.unique(np.asarray(kept, dtype=np.intp))


def thin_table(table: pd.DataFrame, rows: int) -> pd.DataFrame:
    """About so many rows, with the extremes of every column along the first numeric one."""
    if len(table) <= rows:
        return table
    numbers = table.select_dtypes("number").iloc[:, 1:].dropna(axis="columns", how="all")
    # Extremes of at most 4 × bins points are all of them, which here they must not be.
    bins = max(min(rows // (2 * max(numbers.shape[1], 1)), len(table) // 4 - 1), 1)
    kept = [extremes(numbers[name], bins) for name in numbers]
    return table.iloc[np.unique(np.concatenate(kept))] if kept else table.iloc[:rows]


def stems(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Vertical lines from zero to y as one broken line, which makes a single path."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    gap, zero = np.full(x.size, np.nan), np.zeros(x.size)
    return np.column_stack([x, x, gap]).ravel(), np.column_stack([zero, y, gap]).ravel()


def power_of_ten(value: float, _position: float | None = None) -> str:
    """Label of a logarithmic axis in plain characters: 0.01, 1, 100, 10⁻⁵."""
    if value <= 0:
        return ""
    exponent = float(np.log10(value))
    if -2.001 <= exponent <= 3.001:
        return f"{value:g}"
    whole = int(np.floor(exponent + 1e-9))
    factor = value / 10.0**whole
    power = f"10{superscript(whole)}"
    return power if abs(factor - 1) < 1e-6 else f"{factor:g}·{power}"


def logarithmic(axes: Axes) -> None:
    """Make the vertical axis logarithmic, with readable labels."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    decades = np.log10(high / low)
    subs = (1.0, 2.0, 5.0) if decades < 2.3 else (1.0,)
    axes.yaxis.set_major_locator(LogLocator(base=10, subs=subs, numticks=9))
    axes.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
    axes.yaxis.set_minor_formatter(NullFormatter())


def say_nothing_to_draw(axes: Axes, sentence: str) -> None:
    """Write on empty axes why there is no curve."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, sentence, transform=axes.transAxes, ha="center", va="center", color=MUTED)
