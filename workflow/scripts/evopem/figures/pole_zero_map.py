"""Figures of poles and zeros: the unit circle, and their stabilization over the orders."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evopem.figures.frequency_domain import mark_truth
from evopem.figures.style import (
    ERROR,
    FOURTH,
    INK,
    MODEL,
    MUTED,
    PAPER,
    TRUTH,
    decimate,
    logarithmic,
    new_figure,
    say_nothing_to_draw,
    styled,
)
from evopem.models.root_covariance import CHI_SQUARE_95, parameter_covariance, root_covariance

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# A pole is stable from one order to the next when its frequency moves by less than 1 % and its
# damping ratio by less than 10 %: the usual thresholds of modal analysis, damping being the
# harder to determine.
FREQUENCY_TOLERANCE = 0.01
DAMPING_TOLERANCE = 0.10
# Half the side of the frame around the unit circle.
FRAME = 1.3


def frequency_and_damping(
    poles: NDArray[np.complex128], sampling_rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Natural frequency in Hz and damping ratio of the oscillating poles, upper half plane.

    From s = ln(z) fs (chapter table 2).
    """
    s = np.log(poles[poles.imag > 0]) * sampling_rate
    return np.abs(s) / (2 * math.pi), -s.real / np.abs(s)


@styled
def draw_poles_zeros(model: Mapping[str, Any], truth: Mapping[str, Any] | None = None) -> Figure:
    """Poles and zeros in the unit circle with 95 % ellipses, and the modes with their errors.

    Parameters
    ----------
    model : mapping
        As in ``model.json``.
    truth : mapping, optional
        As in ``truth.json``; its modes are overlaid.
    """
    figure = new_figure(3.9)
    circle, damping = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    a, b, c = (np.asarray(model[name], dtype=float) for name in ("a", "b", "c"))
    poles, zeros, noise_zeros = roots_in_z(a), roots_in_z(b), roots_in_z(c)
    angle = np.linspace(0, 2 * math.pi, 361)
    circle.plot(np.cos(angle), np.sin(angle), color=INK, linewidth=0.8)
    for axis_line in (circle.axhline, circle.axvline):
        axis_line(0, color=MUTED, linewidth=0.5)
    _frequency_marks(circle, float(model["sampling_rate"]))
    inside = zeros[(np.abs(zeros.real) <= FRAME) & (np.abs(zeros.imag) <= FRAME)]
    for polynomial, roots, colour in (("b", inside, ERROR), ("a", poles, MODEL)):
        for root in roots:
            _ellipse(circle, complex(root), root_spread(model, polynomial, complex(root)), colour)
    _scatter(circle, noise_zeros, "D", FOURTH, "roots of C", 3.5)
    _scatter(circle, inside, "o", ERROR, "zeros of B", 5.0)
    circle.plot(
        poles.real, poles.imag, "x", color=MODEL, markersize=6, mew=1.6, label="poles", zorder=4
    )
    true_poles = _true_poles(truth, float(model["sampling_rate"]))
    if true_poles.size:
        circle.plot(
            true_poles.real,
            true_poles.imag,
            "s",
            markersize=9,
            markerfacecolor="none",
            color=TRUTH,
            label="true poles",
        )
    outside = zeros.size - inside.size
    if outside:
        circle.text(
            0.02,
            0.02,
            f"{outside} zero{'s' if outside > 1 else ''} beyond",
            transform=circle.transAxes,
            fontsize=7.5,
            color=MUTED,
        )
    circle.set_aspect("equal")
    circle.set_xlim(-FRAME, FRAME)
    circle.set_ylim(-FRAME, FRAME)
    circle.set_xlabel("Real part")
    circle.set_ylabel("Imaginary part")
    circle.grid(False)
    circle.legend(
        loc="lower left", bbox_to_anchor=(-0.05, 1.0), ncols=2, columnspacing=1.0, borderaxespad=0.1
    )
    _modes(damping, model.get("modes") or [], truth, float(model["sampling_rate"]) / 2)
    return figure


def roots_in_z(coefficients: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Roots of a polynomial in z, its leading coefficients passed over where they are zero."""
    return np.roots(np.trim_zeros(coefficients, "f")).astype(complex)


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
            # On the real axis the label stands above the line.
            1.15 * math.sin(angle) + (0.08 if fraction == 0.5 else 0.0),
            f"{fraction * sampling_rate:.4g}" + (" Hz" if fraction == 0.1 else ""),
            ha="center",
            va="center",
            fontsize=7.5,
            color=MUTED,
        )


def root_spread(
    model: Mapping[str, Any], polynomial: str, root: complex
) -> NDArray[np.float64] | None:
    """Covariance of a root's real and imaginary part; None where it is not known.

    Parameters
    ----------
    model : mapping
        As in ``model.json``.
    polynomial : {"a", "b", "c"}
    root : complex
        One of its roots.
    """
    sizes = (len(model["a"]) - 1, len(model["b"]), len(model["c"]) - 1)
    covariance = parameter_covariance(model.get("covariance"), sum(sizes))
    if covariance is None:
        return None
    place = "abc".index(polynomial)
    own = slice(sum(sizes[:place]), sum(sizes[: place + 1]))
    coefficients = np.asarray(model[polynomial], dtype=float)
    spread = root_covariance(coefficients, root, covariance[own, own])
    return spread if np.all(np.isfinite(spread)) else None


def ellipse_radii(root: complex, spread: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half axes of a root's 95 % confidence region, the smaller first."""
    freedom = 1 if root.imag == 0 else 2
    eigenvalues = np.linalg.eigvalsh(spread)
    radii: NDArray[np.float64] = np.sqrt(np.clip(eigenvalues, 0, None) * CHI_SQUARE_95[freedom])
    return radii


def _ellipse(axes: Axes, root: complex, spread: NDArray[np.float64] | None, colour: str) -> None:
    """Outline of the 95 % confidence region of one root."""
    if spread is None:
        return
    radii, vectors = ellipse_radii(root, spread), np.linalg.eigh(spread)[1]
    angle = np.linspace(0, 2 * math.pi, 73)
    outline = vectors @ (radii[:, np.newaxis] * np.vstack([np.cos(angle), np.sin(angle)]))
    axes.fill(
        root.real + outline[0],
        root.imag + outline[1],
        facecolor=colour,
        alpha=0.3,
        edgecolor=colour,
        linewidth=0.8,
    )


def _true_poles(truth: Mapping[str, Any] | None, sampling_rate: float) -> NDArray[np.complex128]:
    poles = []
    for mode in (truth or {}).get("modes", []):
        omega = 2 * math.pi * float(mode["frequency_hz"]) / sampling_rate
        zeta = float(mode["damping_percent"]) / 100
        z = np.exp(omega * complex(-zeta, math.sqrt(max(0.0, 1 - zeta**2))))
        poles.extend([z, z.conjugate()])
    return np.asarray(poles, dtype=complex)


def _modes(
    axes: Axes,
    modes: Sequence[Mapping[str, Any]],
    truth: Mapping[str, Any] | None,
    nyquist: float,
) -> None:
    """Damping ratio against natural frequency with 95 % intervals, up to the Nyquist frequency."""
    axes.set_title("Modes, with 95 % intervals")
    shown = [mode for mode in modes if float(mode["frequency_hz"]) <= 1.04 * nyquist]
    beyond = len(modes) - len(shown)
    modes = shown
    if not modes:
        say_nothing_to_draw(axes, "The model has no oscillating mode in the band.")
        return
    frequency = np.array([float(mode["frequency_hz"]) for mode in modes])
    damping = np.array([float(mode["damping_percent"]) for mode in modes])

    def interval(key: str) -> NDArray[np.float64]:
        errors = np.array([float(mode.get(key) or math.nan) for mode in modes])
        return np.nan_to_num(1.96 * errors)

    across, along = interval("damping_se_percent"), interval("frequency_se_hz")
    axes.errorbar(
        frequency,
        damping,
        # A logarithmic axis has no place below zero.
        yerr=np.vstack([np.minimum(across, 0.9 * np.abs(damping)), across]),
        xerr=along,
        fmt="x",
        color=MODEL,
        mew=1.6,
        capsize=2.5,
        elinewidth=1.0,
        label="estimate",
    )
    true_modes = (truth or {}).get("modes", [])
    if true_modes:
        axes.plot(
            [float(mode["frequency_hz"]) for mode in true_modes],
            [float(mode["damping_percent"]) for mode in true_modes],
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
    if beyond:
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


def stabilization(candidates: Sequence[Mapping[str, Any]], sampling_rate: float) -> pd.DataFrame:
    """Poles of models of increasing order, each compared with the next lower order's.

    Parameters
    ----------
    candidates : sequence of mapping
        Candidate records with ``na`` and ``a``; of several with one na, the one of smallest BIC
        is taken.
    sampling_rate : float
        Hz.

    Returns
    -------
    pandas.DataFrame
        ``order``, ``frequency_hz``, ``damping_percent`` and ``status``: "new", "frequency" (stable
        in frequency), "stable" (in frequency and damping).
    """
    best: dict[int, Mapping[str, Any]] = {}
    for candidate in candidates:
        if not candidate.get("a") or candidate.get("bic") is None:
            continue
        order = int(candidate["na"])
        if order not in best or float(candidate["bic"]) < float(best[order]["bic"]):
            best[order] = candidate
    rows: list[tuple[int, float, float, str]] = []
    below_f = below_z = np.empty(0)
    for order in sorted(best):
        f, z = frequency_and_damping(roots_in_z(np.asarray(best[order]["a"], float)), sampling_rate)
        for frequency, ratio in zip(f, z, strict=True):
            near = np.abs(below_f - frequency) <= FREQUENCY_TOLERANCE * frequency
            alike = near & (np.abs(below_z - ratio) <= DAMPING_TOLERANCE * abs(ratio))
            status = "stable" if alike.any() else "frequency" if near.any() else "new"
            rows.append((order, float(frequency), 100 * float(ratio), status))
        below_f, below_z = f, z
    return pd.DataFrame(rows, columns=["order", "frequency_hz", "damping_percent", "status"])


@styled
def draw_stabilization(
    poles: pd.DataFrame,
    sampling_rate: float,
    spectrum: pd.DataFrame | None = None,
    chosen_order: int | None = None,
    truth: Mapping[str, Any] | None = None,
) -> Figure:
    """Stabilization diagram: natural frequencies over the model order, the spectrum behind.

    Parameters
    ----------
    poles : pandas.DataFrame
        From `stabilization`.
    sampling_rate : float
        Hz.
    spectrum : pandas.DataFrame, optional
        As in ``spectrum.csv``; drawn behind without a scale of its own.
    chosen_order : int, optional
        na of the chosen model, marked.
    truth : mapping, optional
        As in ``truth.json``; its modes are marked.
    """
    figure = new_figure(3.5)
    axes = figure.subplots()
    if poles.empty:
        say_nothing_to_draw(axes, "No candidate has an oscillating mode.")
        return figure
    if spectrum is not None:
        behind = axes.twinx()
        shown = spectrum[(spectrum["frequency_hz"] > 0) & (spectrum["density"] > 0)]
        behind.plot(
            *decimate(shown["frequency_hz"], shown["density"], 400),
            color=MUTED,
            linewidth=0.7,
            alpha=0.6,
        )
        behind.set_yscale("log")
        behind.set_axis_off()
        axes.set_zorder(behind.get_zorder() + 1)
    mark_truth(axes, truth)
    styles: tuple[tuple[str, str, dict[str, Any]], ...] = (
        ("new", "new", {"marker": "o", "color": MUTED, "markerfacecolor": PAPER}),
        (
            "frequency",
            "stable in frequency",
            {"marker": "D", "color": FOURTH, "markerfacecolor": PAPER},
        ),
        ("stable", "stable in frequency and damping", {"marker": "o", "color": MODEL}),
    )
    for status, label, options in styles:
        rows = poles[poles["status"] == status]
        axes.plot(
            rows["frequency_hz"],
            rows["order"],
            linestyle="none",
            label=label,
            markersize=5,
            **options,
        )
    if chosen_order is not None:
        axes.axhline(chosen_order, color=ERROR, linewidth=0.9, linestyle=(0, (3, 2)), zorder=1)
        axes.annotate(
            "chosen",
            (1.0, chosen_order),
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
        )
    axes.set_xlim(0, sampling_rate / 2)
    axes.set_yticks(sorted(poles["order"].unique()))
    axes.margins(y=0.08)
    axes.set_xlabel("Natural frequency (Hz)")
    axes.set_ylabel("Order na")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1)
    return figure
