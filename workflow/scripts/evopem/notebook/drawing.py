"""Axes in a notebook: those that are given, or new ones that it shows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from evopem.figures.style import PARAMETERS, Grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# A notebook's page may be dark, and the figures are drawn for paper.
_PAPER = {"figure.facecolor": "white", "axes.facecolor": "white", "savefig.facecolor": "white"}


def pyplot_panels(grid: Grid, axes: Any = None) -> list[Axes]:
    """The given axes, or those of a new figure that pyplot keeps and a notebook shows.

    Raises
    ------
    InputError
        When there are more or fewer than the figure has.
    """
    if axes is not None:
        return grid.panels(axes)
    from matplotlib import pyplot, rc_context

    # The backend starts with the first figure and sets parameters of its own, such as that figures
    # are shown: a context around its start would take these back.
    if getattr(pyplot, "_backend_mod", None) is None:
        pyplot.close(pyplot.figure())
    with rc_context(PARAMETERS | _PAPER):
        size = (grid.width, grid.height)
        return grid.on(pyplot.figure(figsize=size, layout="constrained"))
