"""Figures of the order search, and of poles and zeros."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from evopem.config.structures import (
    AUTOMATIC_PHASES,
    ORDER_NAMES,
    STRUCTURES,
    phases_of,
    plant_order,
    varied_order,
)
from evopem.figures.chart import (
    Chart,
    Curve,
    Mark,
    Panel,
    ReportFigure,
    Role,
    Where,
    family,
    nothing,
    scale_of,
)
from evopem.figures.draw import FRAME
from evopem.figures.frequency_domain import true_modes
from evopem.figures.view import View
from evopem.results.fleet import MODE_COLUMNS, mode_values

CRITERIA = (("rss", "RSS (%)"), ("bic", "BIC"))
ORDERS = list(ORDER_NAMES)
TITLES = {
    "nc": "Order of C: nc = k",
    "nd": "Order of D: nd = k",
    "na": "Order of A: na = k",
    "nb": "Coefficients of B: nb = k",
}
# Status of a pole, label, role of the colour, marker.
STATUSES: tuple[tuple[str, str, Role, str], ...] = (
    ("new", "new", "muted", "openo"),
    ("frequency", "stable in frequency", "fourth", "openD"),
    ("stable", "stable in frequency and damping", "model", "o"),
)
# Smallest height of the plot of a search, as a share of the objective.
SMALLEST_SPAN = 0.01


def tied_text(structure: str) -> str:
    """The orders that equal the plant order k, such as "na = nb = nc = k"."""
    plant = ("nb", "nf") if "nf" in STRUCTURES[structure] else ("na", "nb")
    noise = {"arma": ("nc",), "armax": ("nc",)}.get(structure, ())
    tied = [name for name in (*plant, *noise) if name in STRUCTURES[structure]]
    return " = ".join([*tied, "k"])


def delay(view: View) -> Chart:
    """RSS and BIC against the order, one line for each delay."""
    if view.candidates is None or not (view.candidates["phase"] == "delay").any():
        return nothing("There are no candidates of the delay search.")
    order = plant_order(view.structure)
    table = view.candidates[view.candidates["phase"] == "delay"].sort_values(["nk", order])
    selected = set(table["nk"][table["selected"]])
    rows: dict[str, Where] = {
        f"nk = {nk}" + (" (selected)" if nk in selected else ""): (("nk", str(nk)),)
        for nk in table["nk"].unique()
    }
    panels = tuple(
        _scores(
            table, (order, f"Order k, {tied_text(view.structure)}"), score, family(score[0], rows)
        )
        for score in CRITERIA
    )
    return Chart(table[[*ORDERS, "rss", "bic", "selected"]], panels, columns=2)


def phases(view: View) -> Chart:
    """What the orders were selected by: scores or criteria, the selection marked."""
    if view.candidates is None:
        return _held_out(view)
    table = view.candidates[view.candidates["phase"] != "delay"]
    if (table["phase"] == AUTOMATIC_PHASES[0]).any():
        return _structures(table)
    names = [phase for phase in phases_of(view.structure) if phase != "delay"]
    ordered = [
        table[table["phase"] == phase].sort_values(varied_order(phase, view.structure))
        for phase in names
    ]
    panels = []
    for score in CRITERIA:
        for phase, rows in zip(names, ordered, strict=True):
            where = (("phase", phase),)
            curves = (
                Curve("", score[0], "model", where=where, marker="o"),
                _selected(score[0], where),
            )
            panel = _scores(rows, (varied_order(phase, view.structure), "k"), score, curves)
            title = TITLES.get(phase, f"Plant order: {tied_text(view.structure)}")
            shown = title if score is CRITERIA[0] else ""
            panels.append(replace(panel, title=shown, height=180))
    together = pd.concat(ordered)[["phase", *ORDERS, "rss", "bic", "selected"]]
    return Chart(together, tuple(panels), columns=len(names))


def _scores(
    table: pd.DataFrame, x: tuple[str, str], y: tuple[str, str], curves: tuple[Curve, ...]
) -> Panel:
    """A score over an order, each given by its column and its label."""
    return Panel("", *x, y[1], curves, scale=scale_of(table[y[0]]), whole=True)


def _selected(column: str, where: Where = ()) -> Curve:
    where = (*where, ("selected", "True"))
    return Curve("selected", column, "error", "points", where=where, marker="o")


def _of_structures(table: pd.DataFrame, column: str) -> tuple[Curve, ...]:
    return family(
        column, {name: (("structure", name),) for name in dict.fromkeys(table["structure"])}
    )


def _structures(table: pd.DataFrame) -> Chart:
    """Criteria over the number of coefficients; a line joins the best models of a structure."""
    tried = table[table["phase"] == AUTOMATIC_PHASES[0]]
    names = [name for name in ORDERS if name != "nk"]
    tried = tried.assign(
        coefficients=tried[names].sum(axis=1), structure=tried["model"].str.split("(").str[0]
    )
    counted = tried.sort_values(["structure", "coefficients"])
    groups = counted.groupby(["structure", "coefficients"])
    panels = []
    for column, label in CRITERIA:
        best = counted[column] == groups[column].transform("min")
        counted[f"lowest_{column}"] = counted[column].where(best)
        curves = (*_of_structures(tried, f"lowest_{column}"), _selected(column))
        panel = _scores(counted, ("coefficients", "Coefficients"), (column, label), curves)
        panels.append(replace(panel, height=260))
    shown = ["structure", "coefficients", *ORDERS, "rss", "bic", "lowest_rss", "lowest_bic"]
    return Chart(counted[["phase", *shown, "selected"]], tuple(panels), columns=2)


def _held_out(view: View) -> Chart:
    """Errors on held-out samples over the order, one line for each structure."""
    table = view.scores
    if table.empty:
        return nothing("No orders were compared.")
    errors = table["error_percent"]
    highest = float(min(errors.max(), 4.0 * errors.min()))
    curves = (*_of_structures(table, "error_percent"), _selected("error_percent"))
    panel = Panel(
        *("", "order", "Order", "Error on held-out samples (%)", curves),
        limits=(0.0, 1.05 * highest) if np.isfinite(highest) and highest > 0 else (),
        height=280,
        whole=True,
    )
    return Chart(table, (panel,))


def convergence(view: View) -> Chart:
    """Lowest objective after each generation and each final descent."""
    if not view.convergence:
        return nothing("The history of the search is empty.")
    table = pd.DataFrame(view.convergence, columns=["evaluations", "lowest_objective"])
    table["last"] = ""
    table.loc[table.index[-1], "last"] = f"{table['lowest_objective'].iloc[-1]:.6g}"
    best = table["lowest_objective"]
    limits: tuple[float, ...] = ()
    if np.ptp(best) < SMALLEST_SPAN * abs(best.iloc[-1]):
        # Differences in the last digits alone must not look like a descent.
        middle, half = float(best.mean()), SMALLEST_SPAN / 2 * abs(float(best.iloc[-1]))
        limits = (middle - half, middle + half)
    panel = Panel(
        *("", "evaluations", "Objective evaluations", "Lowest objective"),
        (
            Curve("lowest objective", "lowest_objective", "model", "steps"),
            Curve("", "lowest_objective", "error", "points", marker=".", names="last"),
        ),
        scale=scale_of(best),
        limits=limits,
    )
    return Chart(table, (panel,))


def stabilization(view: View) -> Chart:
    """Natural frequencies over the model order, the spectrum of the output behind."""
    table = view.stabilization
    if table.empty:
        return nothing("No candidate has an oscillating mode.")
    panel = Panel(
        *("", "frequency_hz", "Natural frequency (Hz)", f"Order {view.order_name}"),
        (
            *(
                (Curve("spectrum of the output", "density", "muted", source="spectrum"),)
                if len(view.outputs) == 1
                else ()
            ),
            *(
                Curve(label, "order", colour, "points", where=(("status", status),), marker=marker)
                for status, label, colour, marker in STATUSES
            ),
        ),
        height=280,
        highest=view.sampling_rate / 2,
        marks=true_modes(view),
        levels=(Mark(float(view.selected_order), "selected", "error"),),
        counted=True,
        linked="frequency",
    )
    return Chart(table, (panel,))


# Kind of root, label, role of the colour and marker; those of one label together.
KINDS: tuple[tuple[str, str, Role, str], ...] = (
    ("root of C", "roots of C", "fourth", "openD"),
    ("pole of the noise filter", "roots of D", "fifth", "*"),
    ("zero", "zeros of B", "error", "openo"),
    ("pole", "poles", "model", "x"),
    ("pole of the plant", "poles of the plant", "model", "x"),
    ("true pole", "true poles", "truth", "opens"),
)
ELLIPSE = ("variance_real", "variance_imag", "covariance")


def poles_zeros(view: View) -> Chart:
    """Roots with 95 % ellipses, and damping over frequency with 95 % intervals."""
    rate = view.sampling_rate
    table = pd.concat([view.roots, _modes_table(view)], ignore_index=True)
    kinds = set(view.roots["kind"])
    roots = tuple(
        Curve(
            *(label, "imag", colour, "points"),
            where=(("kind", kind),),
            marker=marker,
            ellipse=ELLIPSE if colour in ("model", "error") else (),
        )
        for kind, label, colour, marker in KINDS
        if kind in kinds
    )
    beyond = int((view.roots[["real", "imag"]].abs().max(axis="columns") > FRAME).sum())
    outside = f"{beyond} root{'s' if beyond > 1 else ''} outside" if beyond else ""
    circle = Panel(
        *(outside, "real", "Real part", "Imaginary part", roots), plane="z", rate=rate, height=300
    )
    modes = table[table["kind"] == "mode"]
    estimate = Curve(
        *("estimate", "damping_percent", "model", "points"),
        where=(("kind", "mode"),),
        marker="x",
        errors=("frequency_se_hz", "damping_se_percent"),
    )
    where = (("kind", "true mode"),)
    truth = Curve("truth", "damping_percent", "truth", "points", where=where, marker="opens")
    damping = Panel(
        *("Modes, with 95 % intervals", "frequency_hz", "Natural frequency (Hz)"),
        "Damping ratio (%)",
        (estimate, truth) if view.truth and view.truth.modes else (estimate,),
        scale="logarithmic" if len(modes) and modes["damping_percent"].min() > 0 else "linear",
        highest=1.04 * rate / 2,
        height=300,
    )
    return Chart(table, (circle, damping) if len(modes) else (circle,), 2 if len(modes) else 1)


def _modes_table(view: View) -> pd.DataFrame:
    both = {"mode": view.modes, "true mode": view.truth.modes if view.truth else ()}
    rows = [(kind, *mode_values(mode)) for kind, modes in both.items() for mode in modes]
    table = pd.DataFrame(rows, columns=["kind", *MODE_COLUMNS])
    return table.replace([np.inf, -np.inf], np.nan)


FIGURES = (
    ReportFigure(
        *("stabilization", "modes", "Stabilization over the orders"),
        "The poles of every order; behind them the spectrum, of a single output.",
        ("validation.json",),
        stabilization,
        lambda view: view.has_poles_of_orders,
    ),
    ReportFigure(
        *("delay", "selection", "Delay"),
        "RSS and BIC against the order for each delay.",
        ("candidates.csv",),
        delay,
        lambda view: (
            view.candidates is not None and bool((view.candidates["phase"] == "delay").any())
        ),
    ),
    ReportFigure(
        *("phases", "selection", "Structures and orders"),
        "What the candidates of the order search were compared by; the selected orders are marked.",
        ("candidates.csv",),
        phases,
        lambda view: view.candidates is not None or len(set(view.scores["order"])) > 1,
    ),
    ReportFigure(
        *("convergence", "selection", "Search of the selected model"),
        "Lowest objective after each generation and after each final descent.",
        ("phases",),
        convergence,
        lambda view: bool(view.convergence) or view.candidates is not None,
    ),
    ReportFigure(
        *("poles_zeros", "modes", "Poles and zeros"),
        "Poles and zeros with 95 % confidence ellipses where they are known, and the modes.",
        ("model.json",),
        poles_zeros,
    ),
)
