"""What a figure shows, apart from how it is drawn: a table, and panels of curves from its columns.

matplotlib draws a chart for files and papers (:mod:`evopem.figures.draw`); a page draws the same
chart again from its table, for a reader to zoom.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
import pandas as pd

from evopem.figures.style import FAMILY_MARKERS

Role = Literal["ink", "muted", "model", "error", "truth", "fourth", "fifth"]
Kind = Literal["line", "points", "stems", "steps"]
Scale = Literal["linear", "logarithmic", "phase"]
Plane = Literal["", "z", "complex"]

# Roles of the curves of a family.
FAMILY: tuple[Role, ...] = ("model", "error", "truth", "fourth", "fifth", "muted")
# Panels beyond this number are drawn once, and not again by the page.
MOST_LIVE = 30
FREQUENCY = "Frequency (Hz)"
VALIDATION_TIME = "Time from the first validation sample (s)"
TIME = "Time (s)"

Where = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Curve:
    """One curve of a panel.

    Attributes
    ----------
    label : str
        Empty for a curve that belongs to the one before it.
    column : str
        Column of the ordinate.
    colour : str
        Role of the colour, as in :mod:`evopem.figures.style`.
    kind : {"line", "points", "stems", "steps"}
    dashed : bool
    band : tuple of str
        Columns of the lower and upper limit of its band; empty for none.
    where : tuple of (column, value)
        Rows that belong to the curve; all of them by default.
    factor : float
        On the ordinate.
    source : str
        Figure that has the column in its table, on a logarithmic scale of its own without an axis.
    marker : str
        Marker of its points, in the notation of matplotlib; "open" before it leaves them empty.
    errors : tuple of str
        Columns of the standard errors along the abscissa and the ordinate, for 95 % intervals.
    ellipse : tuple of str
        Columns of the variances of both coordinates and of their covariance, for 95 % ellipses.
    bounds : str
        Column with the limit of the ordinate to either side; what exceeds it stands out.
    names : str
        Column with words to write at the points.
    """

    label: str
    column: str
    colour: Role
    kind: Kind = "line"
    dashed: bool = False
    band: tuple[str, ...] = ()
    where: Where = ()
    factor: float = 1.0
    source: str = ""
    marker: str = ""
    errors: tuple[str, ...] = ()
    ellipse: tuple[str, ...] = ()
    bounds: str = ""
    names: str = ""


@dataclass(frozen=True)
class Mark:
    """A place on an axis that a line marks, with its word; an empty one continues the last."""

    value: float
    label: str = ""
    colour: Role = "model"


@dataclass(frozen=True)
class Panel:
    """A panel: curves over one abscissa.

    Attributes
    ----------
    title : str
    x, x_label, y_label : str
        Column of the abscissa, and the labels of the axes.
    curves : tuple of Curve
    scale : {"linear", "logarithmic", "phase"}
        Of the ordinate; a phase is an angle in degrees, drawn from −180 to 180.
    limits : tuple of float
        Fixed limits of the ordinate; empty where the data set them.
    highest : float
        Largest abscissa that is drawn; 0 where the data set it.
    height : int
        Pixels.
    marks, levels : tuple of Mark
        Places on the abscissa and the ordinate that lines mark.
    linked : str
        Panels of the page with the same word show the same part of their abscissa.
    shown : float
        Abscissa up to which the drawing shows the curves; 0 for all.  The page shows all.
    whole : bool
        Whether the abscissa are whole numbers.
    counted : bool
        Whether the ordinates are.
    decades : bool
        Whether the abscissa is logarithmic.
    plane : {"", "z", "complex"}
        Whether both axes have one scale: a plane with the unit circle, or without it.
    rate : float
        Sampling rate in Hz, for the frequencies on the unit circle.
    """

    title: str
    x: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    scale: Scale = "linear"
    limits: tuple[float, ...] = ()
    highest: float = 0.0
    height: int = 220
    marks: tuple[Mark, ...] = ()
    levels: tuple[Mark, ...] = ()
    linked: str = ""
    shown: float = 0.0
    whole: bool = False
    counted: bool = False
    decades: bool = False
    plane: Plane = ""
    rate: float = 0.0


@dataclass(frozen=True, eq=False)
class Chart:
    """A figure: its table, and the panels that show it.

    Attributes
    ----------
    table : pandas.DataFrame
        What is drawn, as it is offered for download.
    panels : tuple of Panel
        Row by row.
    columns : int
        Panels of a row.
    live : bool
        Whether a page draws it for a reader to zoom.
    nothing : str
        What is said where there is nothing to draw.
    """

    table: pd.DataFrame
    panels: tuple[Panel, ...]
    columns: int = 1
    live: bool = True
    nothing: str = ""

    def only(self, *places: int) -> Chart:
        """Some of the panels, one above the other."""
        return replace(self, panels=tuple(self.panels[k] for k in places), columns=1)

    def page_form(self) -> list[dict[str, Any]]:
        """The panels as the page reads them; none where it does not draw them."""
        plane = any(panel.plane or panel.decades for panel in self.panels)
        if not self.live or plane or len(self.panels) > MOST_LIVE or self.nothing:
            return []
        return [_compact(asdict(panel)) for panel in self.panels]


def _compact(form: Mapping[str, Any]) -> dict[str, Any]:
    """Without what is empty, which the page takes for granted."""
    kept = {
        key: [_compact(each) if isinstance(each, dict) else each for each in value]
        if isinstance(value, tuple)
        else value
        for key, value in form.items()
        if value not in ("", 0, False, (), 0.0) or key == "value"
    }
    return {key: value for key, value in kept.items() if (key, value) != ("factor", 1.0)}


def nothing(sentence: str) -> Chart:
    """A chart that says why there is nothing to draw."""
    return Chart(pd.DataFrame(), (Panel("", "", "", "", ()),), nothing=sentence)


def rows_of(table: pd.DataFrame, where: Where) -> pd.DataFrame:
    """The rows with these values in these columns, compared as text."""
    for column, value in where:
        table = table[table[column].astype(str) == value]
    return table


def family(labels: Sequence[str]) -> list[tuple[str, Role, str, bool]]:
    """Label, role, marker and whether the line is dashed, of each curve of a family."""
    return [
        (
            label,
            FAMILY[place % len(FAMILY)],
            FAMILY_MARKERS[(place + place // len(FAMILY)) % len(FAMILY_MARKERS)],
            place % 2 == 1,
        )
        for place, label in enumerate(labels)
    ]


def spans_decades(values: pd.Series) -> bool:
    """Whether one bad value would flatten all others on a linear axis."""
    finite = values[np.isfinite(values)]
    return bool(len(finite) and finite.min() > 0 and finite.max() > 8 * finite.min())


def around(values: pd.Series, factor: float = 4.0) -> tuple[float, ...]:
    """Limits of a logarithmic axis around positive finite values; none where there are none."""
    positive = values[(values > 0) & np.isfinite(values)]
    if not len(positive):
        return ()
    return float(positive.min()) / factor, float(positive.max()) * factor
