"""What a figure shows, apart from how it is drawn: a table, and panels of curves from its columns.

matplotlib draws a chart for files and papers (:mod:`evopem.figures.draw`); a page draws the same
chart again from its table, for a reader to zoom.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, Self

import numpy as np
import pandas as pd

from evopem.results.channel_labels import Channel
from evopem.results.dataset import DatasetResults

Role = Literal["ink", "muted", "model", "error", "truth", "fourth", "fifth"]
Kind = Literal["line", "points", "stems", "steps"]
Scale = Literal["linear", "logarithmic", "phase"]
Plane = Literal["", "z", "complex"]

# Roles of the curves of a family.
FAMILY: tuple[Role, ...] = ("model", "error", "truth", "fourth", "fifth", "muted")
FAMILY_MARKERS = ("o", "s", "^", "D", "v", "P")
# Panels of a figure at most; the table has all pairs of channels.
MOST_PANELS = 60
FREQUENCY = "Frequency (Hz)"
TIME = "Time (s)"

Where = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Curve:
    """One curve of a panel."""

    label: str  # empty for a curve that belongs to the one before it
    column: str  # column of the ordinate
    colour: Role  # role of the colour, as in :mod:`evopem.figures.style`
    kind: Kind = "line"
    dashed: bool = False
    band: tuple[str, ...] = ()  # columns of the lower and upper limit of its band; empty for none
    where: Where = ()  # rows that belong to the curve; all of them by default
    factor: float = 1.0  # on the ordinate
    # Figure that has the column in its table, on a logarithmic scale of its own without an axis.
    source: str = ""
    # Marker of its points, in the notation of matplotlib; "open" before it leaves them empty.
    marker: str = ""
    # Columns of the standard errors along the abscissa and the ordinate, for 95 % intervals.
    errors: tuple[str, ...] = ()
    # Columns of the variances of both coordinates and of their covariance, for 95 % ellipses.
    ellipse: tuple[str, ...] = ()
    # Column with the limit of the ordinate to either side; what exceeds it stands out.
    bounds: str = ""
    names: str = ""  # column with words to write at the points


@dataclass(frozen=True)
class Mark:
    """A place on an axis that a line marks, with its word; an empty one continues the last."""

    value: float
    label: str = ""
    colour: Role = "model"


@dataclass(frozen=True)
class Panel:
    """A panel: curves over one abscissa."""

    title: str
    x: str  # column of the abscissa, and the labels of the axes
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    # Of the ordinate; a phase is an angle in degrees, drawn from −180 to 180.
    scale: Scale = "linear"
    limits: tuple[float, ...] = ()  # fixed limits of the ordinate; empty where the data set them
    highest: float = 0.0  # largest abscissa that is drawn; 0 where the data set it
    height: int = 220  # pixels
    marks: tuple[Mark, ...] = ()  # places on the abscissa and the ordinate that lines mark
    levels: tuple[Mark, ...] = ()
    linked: str = ""  # panels of the page with the same word show the same part of their abscissa
    # Abscissa up to which the drawing shows the curves; 0 for all.  The page shows all.
    shown: float = 0.0
    whole: bool = False  # whether the abscissa are whole numbers
    counted: bool = False  # whether the ordinates are
    decades: bool = False  # whether the abscissa is logarithmic
    # Whether both axes have one scale: a plane with the unit circle, or without it.
    plane: Plane = ""
    rate: float = 0.0  # sampling rate in Hz, for the frequencies on the unit circle


@dataclass(frozen=True, eq=False)
class Chart:
    """A figure: its table, and the panels that show it."""

    table: pd.DataFrame  # what is drawn, as it is offered for download
    panels: tuple[Panel, ...]  # row by row
    columns: int = 1  # panels of a row
    nothing: str = ""  # what is said where there is nothing to draw

    def only(self, kind: str) -> Self:
        """The panels of one kind of column, one above the other."""
        kept = tuple(panel for panel in self.panels if panel.curves[0].column.endswith(kind))
        return replace(self, panels=kept, columns=1)

    def page_form(self) -> list[dict[str, Any]]:
        """The panels as the page reads them; none where it does not draw them."""
        if self.nothing or len(self.panels) > MOST_PANELS:
            return []
        return [asdict(panel, dict_factory=_stated) for panel in self.panels]


def _stated(entries: list[tuple[str, Any]]) -> dict[str, Any]:
    """Without what is empty, which the page takes for granted."""
    return {key: value for key, value in entries if value or key == "value"}


def nothing(sentence: str) -> Chart:
    """A chart that says why there is nothing to draw."""
    return Chart(pd.DataFrame(), (Panel("", "", "", "", ()),), nothing=sentence)


def of_pair(output: Channel, source: Channel | None = None) -> Where:
    """The rows of an output, or of an output and an input, in a table."""
    pair = (("output", output.name),)
    return pair if source is None else (*pair, ("input", source.name))


def rows_of(table: pd.DataFrame, where: Where) -> pd.DataFrame:
    """The rows with these values in these columns, compared as text."""
    for column, value in where:
        table = table[table[column].astype(str) == value]
    return table


def family(column: str, rows: Mapping[str, Where]) -> tuple[Curve, ...]:
    """A curve for each label and its rows, distinguished by colour, marker and dashes."""
    return tuple(
        Curve(
            *(label, column, FAMILY[place % len(FAMILY)]),
            where=where,
            dashed=place % 2 == 1,
            marker=FAMILY_MARKERS[(place + place // len(FAMILY)) % len(FAMILY_MARKERS)],
        )
        for place, (label, where) in enumerate(rows.items())
    )


def scale_of(values: pd.Series) -> Scale:
    """Logarithmic where one bad value would flatten all others on a linear axis."""
    finite = values[np.isfinite(values)]
    wide = len(finite) and finite.min() > 0 and finite.max() > 8 * finite.min()
    return "logarithmic" if wide else "linear"


def around(values: pd.Series, factor: float = 4.0) -> tuple[float, ...]:
    """Limits of a logarithmic axis around positive finite values; none where there are none."""
    positive = values[(values > 0) & np.isfinite(values)]
    if not len(positive):
        return ()
    return float(positive.min()) / factor, float(positive.max()) * factor


def columns_of(results: DatasetResults, panels: Sequence[Panel]) -> int:
    """Panels of a row: one for each input, else as many as leave them room."""
    if 2 <= len(results.inputs) <= 4 and len(panels) % len(results.inputs) == 0:
        return len(results.inputs)
    return across(panels)


def across(panels: Sequence[Panel]) -> int:
    """Panels of a row where each is of one channel."""
    return 2 if len(panels) == 4 else min(len(panels), 3)


def small(panels: Sequence[object], height: int) -> int:
    """The height of a panel, less where there are many."""
    return height if len(panels) <= 2 else max(120, round(height * 0.65))
