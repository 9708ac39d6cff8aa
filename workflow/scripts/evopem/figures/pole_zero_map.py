"""Figure of poles and zeros: the unit circle, and the modes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evopem.figures.style import (
    ERROR,
    FIFTH,
    FOURTH,
    INK,
    MODEL,
    MUTED,
    TRUTH,
    Grid,
    figure_of,
    logarithmic,
    say_nothing_to_draw,
    styled,
)
from evopem.models.confidence_ellipse import UncertainRoot, uncertain_roots
from evopem.models.modes import Mode
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import roots
from evopem.synthesis.truth import Truth

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POLES_ZEROS = Grid(height=3.9, columns=2, width_ratios=(1.25, 1.0))

# Half the side of the frame around the unit circle.
FRAME = 1.3
# 95 % of a normal distribution lie within this many standard errors.
NORMAL_95 = 1.96


@styled
def draw_poles_zeros(
    model: PolynomialModel, truth: Truth | None = None, axes: Sequence[Axes] | None = None
) -> Figure:
    """Poles and zeros in the unit circle with 95 % ellipses, and the modes with 95 % intervals.

    Parameters
    ----------
    model : PolynomialModel
    truth : Truth, optional
        Its poles and modes are drawn as well.
    axes : sequence of two matplotlib.axes.Axes, optional
        Where the map and the modes are drawn; on a new figure by default.
    """
    circle, damping = POLES_ZEROS.panels(axes)
    _unit_circle(circle, model.sampling_rate)
    poles = [*uncertain_roots(model, "A"), *uncertain_roots(model, "F")]
    zeros = uncertain_roots(model, "B")
    inside = [zero for zero in zeros if _in_frame(zero.value)]
    for group, colour in ((inside, ERROR), (poles, MODEL)):
        for root in group:
            _ellipse(circle, root, colour)
    _scatter(circle, model.noise_zeros(), "D", FOURTH, "roots of C", 3.5)
    if model.orders.nd:
        _scatter(circle, roots(model.d[1:]), "*", FIFTH, "roots of D", 6.0)
    _scatter(circle, _values(inside), "o", ERROR, "zeros of B", 5.0)
    found = _values(poles)
    circle.plot(
        found.real, found.imag, "x", color=MODEL, markersize=6, mew=1.6, label="poles", zorder=4
    )
    if truth and truth.modes:
        upper = np.array([mode.pole for mode in truth.modes])
        true_poles = np.column_stack([upper, upper.conj()]).ravel()
        _scatter(circle, true_poles, "s", TRUTH, "true poles", 9.0)
    _count_beyond(circle, len(zeros) - len(inside))
    circle.legend(
        loc="lower left", bbox_to_anchor=(-0.05, 1.0), ncols=2, columnspacing=1.0, borderaxespad=0.1
    )
    _modes(damping, model.modes(), truth.modes if truth else (), model.sampling_rate / 2)
    return figure_of(circle)


def _in_frame(root: complex) -> bool:
    return abs(root.real) <= FRAME and abs(root.imag) <= FRAME


def _values(roots: Sequence[UncertainRoot]) -> NDArray[np.complex128]:
    return np.array([root.value for root in roots], dtype=complex)


def _unit_circle(axes: Axes, sampling_rate: float) -> None:
    angle = np.linspace(0, 2 * math.pi, 361)
    axes.plot(np.cos(angle), np.sin(angle), color=INK, linewidth=0.8)
    for axis_line in (axes.axhline, axes.axvline):
        axis_line(0, color=MUTED, linewidth=0.5)
    _frequency_marks(axes, sampling_rate)
    axes.set_aspect("equal")
    axes.set_xlim(-FRAME, FRAME)
    axes.set_ylim(-FRAME, FRAME)
    axes.set_xlabel("Real part")
    axes.set_ylabel("Imaginary part")
    axes.grid(False)


def _frequency_marks(axes: Axes, sampling_rate: float) -> None:
    """Label the upper half of the circle with frequencies."""
    for fraction in (0.1, 0.2, 0.3, 0.4, 0.5):
        angle = 2 * math.pi * fraction
        axes.plot(
            [math.cos(angle), 1.04 * math.cos(angle)],
            [math.sin(angle), 1.04 * math.sin(angle)],
            color=INK,
            linewidth=0.8,
        )
        axes.text(
            1.15 * math.cos(angle),
            # On the real axis the label is above the line.
            1.15 * math.sin(angle) + (0.08 if fraction == 0.5 else 0.0),
            f"{fraction * sampling_rate:.4g}" + (" Hz" if fraction == 0.1 else ""),
            ha="center",
            va="center",
            fontsize=7.5,
            color=MUTED,
        )


def _scatter(
    axes: Axes, roots: NDArray[np.complex128], marker: str, colour: str, label: str, size: float
) -> None:
    if roots.size:
        axes.plot(
            roots.real,
            roots.imag,
            marker,
            markerfacecolor="none",
            color=colour,
            markersize=size,
            label=label,
        )


def _ellipse(axes: Axes, root: UncertainRoot, colour: str) -> None:
    if root.covariance_known:
        axes.fill(*root.outline(), facecolor=colour, alpha=0.3, edgecolor=colour, linewidth=0.8)


def _count_beyond(axes: Axes, zeros: int) -> None:
    if zeros:
        axes.text(
            0.02,
            0.02,
            f"{zeros} zero{'s' if zeros > 1 else ''} outside the frame",
            transform=axes.transAxes,
            fontsize=7.5,
            color=MUTED,
        )


def _modes(axes: Axes, modes: Sequence[Mode], true_modes: Sequence[Mode], nyquist: float) -> None:
    """Damping ratio against natural frequency with 95 % intervals, up to the Nyquist frequency."""
    axes.set_title("Modes, with 95 % intervals")
    shown = [mode for mode in modes if mode.frequency_hz <= 1.04 * nyquist]
    if not shown:
        say_nothing_to_draw(axes, "The model has no oscillating mode in the band.")
        return
    damping = np.array([100 * mode.damping_ratio for mode in shown])
    along = _interval([mode.frequency_se_hz for mode in shown])
    across = _interval([100 * mode.damping_se for mode in shown])
    axes.errorbar(
        [mode.frequency_hz for mode in shown],
        damping,
        # A logarithmic axis ends above zero.
        yerr=np.vstack([np.minimum(across, 0.9 * np.abs(damping)), across]),
        xerr=along,
        fmt="x",
        color=MODEL,
        mew=1.6,
        capsize=2.5,
        elinewidth=1.0,
        label="estimate",
    )
    if true_modes:
        axes.plot(
            [mode.frequency_hz for mode in true_modes],
            [100 * mode.damping_ratio for mode in true_modes],
            "s",
            markersize=10,
            markerfacecolor="none",
            color=TRUTH,
            label="truth",
        )
        axes.legend(loc="best")
    axes.margins(x=0.12, y=0.15)
    if damping.min() > 0:
        logarithmic(axes)
    axes.set_xlim(0, 1.04 * nyquist)
    if beyond := len(modes) - len(shown):
        axes.text(
            0.98,
            0.02,
            f"{beyond} at higher frequency",
            transform=axes.transAxes,
            ha="right",
            fontsize=7.5,
            color=MUTED,
        )
    axes.set_xlabel("Natural frequency (Hz)")
    axes.set_ylabel("Damping ratio (%)")


def _interval(standard_errors: Sequence[float]) -> NDArray[np.float64]:
    """Half widths of 95 % intervals; none is drawn where the standard error is not finite."""
    errors = np.asarray(standard_errors, dtype=float)
    return np.where(np.isfinite(errors), NORMAL_95 * errors, 0.0)
