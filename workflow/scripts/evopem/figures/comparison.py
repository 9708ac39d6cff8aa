"""Several models in one drawing: responses, simulations, modes."""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd

from evopem.figures.chart import FAMILY, MOST_PANELS, Chart, Curve, Panel, across, family, nothing
from evopem.figures.frequency_domain import gain_panels, phase_panels, thinned
from evopem.figures.time_domain import shown_samples, validation_time
from evopem.results.comparison import Comparison


def compared_responses(comparison: Comparison) -> Chart:
    """Gain and phase of every model and common pair, with the 95 % bands of the gains."""
    panels = []
    for panels_of, height in ((gain_panels, 260), (phase_panels, 170)):
        drawn = [
            dict(zip(model.pairs[:MOST_PANELS], panels_of(model, height), strict=True))
            for model in comparison.models
        ]
        for pair in comparison.pairs[: MOST_PANELS // 2]:
            charts = [p[name] for p, name in zip(drawn, pair, strict=True) if name in p]
            if len(charts) == len(drawn):
                panels.append(_overlaid(charts, comparison.labels))
    if not panels:
        return nothing("The models have no input in common.")
    tables = [thinned(m).assign(model=str(number)) for number, m in enumerate(comparison.models, 1)]
    table = pd.concat(tables, ignore_index=True).drop(columns="coherence", errors="ignore")
    table = table[table["source"] != "measured"]
    return Chart(table, tuple(panels), across(panels[: len(panels) // 2]))


def _overlaid(panels: Sequence[Panel], labels: Sequence[str]) -> Panel:
    """The curves of the models, one from each panel, in one."""
    curves = [
        replace(
            panel.curves[-1],
            label=label,
            colour=role,
            where=(("model", str(number)), *panel.curves[-1].where),
        )
        for number, (label, role, panel) in enumerate(zip(labels, FAMILY, panels, strict=False), 1)
    ]
    limits = [panel.limits for panel in panels if panel.limits]
    axes = {panel.y_label for panel in panels}
    return replace(
        panels[0],
        y_label=axes.pop() if len(axes) == 1 else "Gain",
        curves=tuple(curves),
        limits=(min(low for low, _ in limits), max(high for _, high in limits)) if limits else (),
        highest=max(panel.highest for panel in panels),
    )


def compared_simulations(comparison: Comparison) -> Chart:
    """Validation samples, measured and simulated by every model; without an input, predicted."""
    if not comparison.has_same_validation:
        return nothing("The models were validated on different samples.")
    first = comparison.models[0]
    time = validation_time(first)
    kind = "simulated" if first.model.has_input else "predicted"
    columns, panels = {"time_s": first.validation_tables.simulation["time_s"]}, []
    for place, outputs in enumerate(comparison.outputs[:MOST_PANELS], start=1):
        measured = f"output_{place}"
        columns[measured] = first.validation_tables.simulation[f"output_{outputs[0].name}"]
        curves = [Curve("measured", measured, "ink")]
        for number, (results, output) in enumerate(zip(comparison.models, outputs, strict=True)):
            column = f"simulated_{place}_{number + 1}"
            columns[column] = results.validation_tables.simulation[f"{kind}_{output.name}"]
            label, role = comparison.labels[number], FAMILY[number]
            curves.append(Curve(label, column, role, dashed=True))
        label = outputs[0].label
        panels.append(Panel("", "time_s", time, label, tuple(curves), height=250))
    table = pd.DataFrame(columns).dropna()
    until = float(table["time_s"].iloc[: shown_samples(first)].max())
    shown = tuple(replace(panel, shown=until) for panel in panels)
    return Chart(table, shown, min(len(shown), 2))


def compared_modes(comparison: Comparison) -> Chart:
    """Damping ratio over natural frequency with 95 % intervals; not to be trusted where open."""
    table = comparison.modes
    if table.empty:
        return nothing("No model has an oscillating mode.")
    curves: list[Curve] = []
    for curve in family("damping_percent", {n: (("data set", n),) for n in comparison.labels}):
        trusted, doubted = ((*curve.where, ("trusted", word)) for word in ("True", "False"))
        points = replace(curve, kind="points", dashed=False)
        curves += [
            replace(points, where=trusted, errors=("frequency_se_hz", "damping_se_percent")),
            replace(points, label="", where=doubted, marker=f"open{curve.marker}"),
        ]
    damping = table["damping_percent"]
    panel = Panel(
        *("", "frequency_hz", "Natural frequency (Hz)", "Damping ratio (%)", tuple(curves)),
        limits=(min(0.0, 1.2 * float(damping.min())), 1.3 * max(float(damping.max()), 1e-6)),
        highest=max(model.highest_hz for model in comparison.models),
        height=250,
    )
    return Chart(table, (panel,))
