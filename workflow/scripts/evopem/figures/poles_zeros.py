"""Figure of poles and zeros in the unit circle, and of the modes with their intervals."""

from __future__ import annotations

import numpy as np
import pandas as pd

from evopem.figures.chart import Chart, Curve, Panel, Role
from evopem.figures.draw import FRAME
from evopem.figures.report_figure import ReportFigure
from evopem.figures.view import View

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
    errors = ("frequency_se_hz", "damping_se_percent")
    curves: tuple[Curve, ...] = (
        Curve(
            *("estimate", "damping_percent", "model", "points"),
            where=(("kind", "mode"),),
            marker="x",
            errors=errors,
        ),
    )
    if view.truth and view.truth.modes:
        curves += (
            Curve(
                *("truth", "damping_percent", "truth", "points"),
                where=(("kind", "true mode"),),
                marker="opens",
            ),
        )
    damping = Panel(
        *("Modes, with 95 % intervals", "frequency_hz", "Natural frequency (Hz)"),
        "Damping ratio (%)",
        curves,
        scale="logarithmic" if len(modes) and modes["damping_percent"].min() > 0 else "linear",
        highest=1.04 * rate / 2,
        height=300,
    )
    return Chart(table, (circle, damping) if len(modes) else (circle,), 2 if len(modes) else 1)


def _modes_table(view: View) -> pd.DataFrame:
    found = [("mode", each) for each in view.modes]
    true = [("true mode", each) for each in (view.truth.modes if view.truth else ())]
    rows = [
        (
            *(kind, mode.frequency_hz, mode.frequency_se_hz),
            *(100.0 * mode.damping_ratio, 100.0 * mode.damping_se),
        )
        for kind, mode in [*found, *true]
    ]
    columns = ["kind", "frequency_hz", "frequency_se_hz", "damping_percent", "damping_se_percent"]
    table = pd.DataFrame(rows, columns=columns)
    return table.replace([np.inf, -np.inf], np.nan)


FIGURES = (
    ReportFigure(
        *("poles_zeros", "modes", "Poles and zeros"),
        "Poles and zeros with 95 % confidence ellipses where they are known, and the modes.",
        ("model.json",),
        poles_zeros,
    ),
)
