"""Figures of the order search, and of poles and zeros."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from evopem.config.structures import ORDER_NAMES, STRUCTURES, phases_of, plant_order, varied_order
from evopem.figures.chart import Chart, Curve, Mark, Panel, Role, Where, family, nothing, scale_of
from evopem.figures.draw import FRAME
from evopem.figures.frequency_domain import true_modes
from evopem.results.dataset import DatasetResults
from evopem.results.fleet import MODE_COLUMNS, mode_values

SCORES = {"rss": "RSS (%)", "bic": "BIC", "error_percent": "Error on held-out samples (%)"}
CRITERIA = ("rss", "bic")
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
SMALLEST_SPAN = 0.01  # smallest height of the plot of a search, as a share of the objective


def tied_text(structure: str) -> str:
    """The orders that equal the plant order k, such as "na = nb = nc = k"."""
    plant = ("nb", "nf") if "nf" in STRUCTURES[structure] else ("na", "nb")
    noise = {"arma": ("nc",), "armax": ("nc",)}.get(structure, ())
    tied = [name for name in (*plant, *noise) if name in STRUCTURES[structure]]
    return " = ".join([*tied, "k"])


def _scores(
    table: pd.DataFrame,
    x: tuple[str, str],
    column: str,
    series: Mapping[str, Where],
    line: str = "",
    **options: Any,
) -> Panel:
    """A score over an order, given by its column and label: a line for each series of rows.
    ``line``: the column that is joined by lines, where it is another than that of the score."""
    where = next(iter(series.values())) if len(series) == 1 else ()
    marked = (*where, ("selected", "True"))
    selected = Curve("selected", column, "error", "points", where=marked, marker="o")
    curves = (*family(line or column, series), selected)
    options = {"scale": scale_of(table[column]), **options}
    return Panel("", *x, SCORES[column], curves, **options, whole=True)


def delay(results: DatasetResults) -> Chart:
    """RSS and BIC against the order, one line for each delay."""
    if "delay" not in set(results.candidates.get("phase", ())):
        return nothing("There are no candidates of the delay search.")
    structure, table = results.model.structure, results.candidates
    order = plant_order(structure)
    table = table[table["phase"] == "delay"].sort_values(["nk", order])
    x = order, f"Order k, {tied_text(structure)}"
    rows: dict[str, Where] = {f"nk = {nk}": (("nk", str(nk)),) for nk in table["nk"].unique()}
    panels = tuple(_scores(table, x, column, rows) for column in CRITERIA)
    return Chart(table[[*ORDER_NAMES, *CRITERIA, "selected"]], panels, columns=2)


def phases(results: DatasetResults) -> Chart:
    """What the orders were selected by: scores or criteria, the selection marked."""
    if not results.phases:
        return _held_out(results)
    structure, table = results.model.structure, results.candidates
    varied = {
        phase: varied_order(phase, structure) for phase in phases_of(structure) if phase != "delay"
    }
    tables = {
        phase: table[table["phase"] == phase].sort_values(order) for phase, order in varied.items()
    }
    panels = []
    for column in CRITERIA:
        for phase, rows in tables.items():
            where: Where = (("phase", phase),)
            panel = _scores(rows, (varied[phase], "k"), column, {"": where}, height=180)
            title = TITLES.get(phase, f"Plant order: {tied_text(structure)}")
            panels.append(replace(panel, title=title if column == CRITERIA[0] else ""))
    together = pd.concat(tables.values())[["phase", *ORDER_NAMES, *CRITERIA, "selected"]]
    return Chart(together, tuple(panels), columns=len(tables))


def _held_out(results: DatasetResults) -> Chart:
    """Errors on held-out samples and BIC over the order; a line joins the best of a structure."""
    if results.scores.empty or results.scores["order"].nunique() < 2:
        return nothing("No orders were compared.")
    table = results.scores.sort_values(["structure", "order"])
    series: dict[str, Where] = {
        structure: (("structure", structure),) for structure in table["structure"].unique()
    }
    errors = table["error_percent"]
    highest = 1.05 * float(min(errors.max(), 4.0 * errors.min()))
    limits = (0.0, highest) if 0 < highest < np.inf else ()
    panels = []
    for column, options in (("error_percent", {"limits": limits, "scale": "linear"}), ("bic", {})):
        best = table.groupby(["structure", "order"])[column].transform("min")
        lowest = f"lowest_{column}"
        table[lowest] = table[column].where(table[column] == best)
        x = "order", "Order"
        panels.append(_scores(table, x, column, series, lowest, height=280, **options))
    return Chart(table, tuple(panels), columns=2)


def convergence(results: DatasetResults) -> Chart:
    """Lowest objective after each generation and each final descent."""
    history = results.model.search.diagnostics.convergence
    if not history:
        return nothing("The history of the search is empty.")
    table = pd.DataFrame(history, columns=["evaluations", "lowest_objective"])
    table["last"] = ""
    table.loc[table.index[-1], "last"] = f"{table['lowest_objective'].iloc[-1]:.6g}"
    best = table["lowest_objective"]
    limits: tuple[float, ...] = ()
    if np.ptp(best) < SMALLEST_SPAN * abs(best.iloc[-1]):
        # Differences in the last digits alone must not look like a descent.
        middle, half = float(best.mean()), SMALLEST_SPAN / 2 * abs(float(best.iloc[-1]))
        limits = (middle - half, middle + half)
    curves = (
        Curve("lowest objective", "lowest_objective", "model", "steps"),
        Curve("", "lowest_objective", "error", "points", marker=".", names="last"),
    )
    panel = Panel("", "evaluations", "Objective evaluations", "Lowest objective", curves)
    return Chart(table, (replace(panel, scale=scale_of(best), limits=limits),))


def stabilization(results: DatasetResults) -> Chart:
    """Natural frequencies over the model order, the spectrum of the output behind."""
    columns = ["order", "frequency_hz", "damping_ratio", "status"]
    table = pd.DataFrame([vars(pole) for pole in results.validation.modes.poles], columns=columns)
    if table.empty:
        return nothing("No candidate has an oscillating mode.")
    table.insert(2, "damping_percent", 100 * table.pop("damping_ratio"))
    curves = [
        Curve(label, "order", colour, "points", where=(("status", status),), marker=marker)
        for status, label, colour, marker in STATUSES
    ]
    if len(results.outputs) == 1 and not results.of_responses:
        curves.insert(0, Curve("spectrum of the output", "density", "muted", source="spectrum"))
    order = "Order of the plant" if results.model.orders else "Order n"
    panel = Panel(
        *("", "frequency_hz", "Natural frequency (Hz)", order, tuple(curves)),
        height=280,
        highest=results.highest_hz,
        marks=true_modes(results),
        levels=(Mark(float(results.validation.modes.order), "selected", "error"),),
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


def poles_zeros(results: DatasetResults) -> Chart:
    """Roots with 95 % ellipses, and damping over frequency with 95 % intervals."""
    roots, rate = results.roots, results.model.sampling_rate
    kinds = set(roots["kind"])
    curves = tuple(
        Curve(
            *(label, "imag", colour, "points"),
            where=(("kind", kind),),
            marker=marker,
            ellipse=ELLIPSE if colour in ("model", "error") else (),
        )
        for kind, label, colour, marker in KINDS
        if kind in kinds
    )
    beyond = int((roots[["real", "imag"]].abs().max(axis="columns") > FRAME).sum())
    outside = f" ({beyond} root{'s' if beyond > 1 else ''} outside)" if beyond else ""
    x_label = f"Real part{outside}"
    circle = Panel("", "real", x_label, "Imaginary part", curves, plane="z", rate=rate, height=300)
    both = {"mode": results.modes, "true mode": results.true_modes}
    rows = [(kind, *mode_values(mode)) for kind, modes in both.items() for mode in modes]
    modes = pd.DataFrame(rows, columns=["kind", *MODE_COLUMNS]).replace([np.inf, -np.inf], np.nan)
    table = pd.concat([roots, modes], ignore_index=True)
    if not results.modes:
        return Chart(table, (circle,), 1)
    drawn = Curve("estimate", "damping_percent", "model", "points", where=(("kind", "mode"),))
    estimate = replace(drawn, marker="x", errors=("frequency_se_hz", "damping_se_percent"))
    where = (("kind", "true mode"),)
    truth = replace(drawn, label="truth", colour="truth", where=where, marker="opens")
    damping = Panel(
        *("Modes, with 95 % intervals", "frequency_hz", "Natural frequency (Hz)"),
        "Damping ratio (%)",
        (estimate, truth) if results.true_modes else (estimate,),
        scale="logarithmic" if min(m.damping_ratio for m in results.modes) > 0 else "linear",
        highest=1.04 * results.highest_hz,
        height=300,
    )
    return Chart(table, (circle, damping), 2)
