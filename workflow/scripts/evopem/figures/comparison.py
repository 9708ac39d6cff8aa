"""Several models side by side: their errors, their modes matched by frequency, and overlays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import fmean
from typing import Any, Self, TypeVar

import numpy as np
import pandas as pd

from evopem.errors import InputError
from evopem.figures.chart import FAMILY, MOST_PANELS, Chart, Curve, Panel, across, family, nothing
from evopem.figures.frequency_domain import gain_panels, phase_panels, thinned
from evopem.figures.time_domain import VALIDATION_TIME, shown_samples
from evopem.models.merged_modes import MergedModes, merge_setups
from evopem.models.mode_matching import matched_modes
from evopem.models.modes import Mode
from evopem.results.channel_labels import Channel, Pair
from evopem.results.dataset import DatasetResults
from evopem.results.fleet import MODE_COLUMNS, mode_values
from evopem.validation.checks import failed_checks

T = TypeVar("T")
MOST = 6
"""More models than colours that can be told apart are not compared."""


def spread_percent(modes: Sequence[Mode | None]) -> float:
    """Largest less smallest frequency, in percent of their mean; NaN for one model."""
    hertz = [mode.frequency_hz for mode in modes if mode is not None]
    return 100.0 * (max(hertz) - min(hertz)) / fmean(hertz) if len(hertz) > 1 else float("nan")


@dataclass(frozen=True, eq=False)
class Comparison:
    """Models side by side, of the channels that all of them have."""

    labels: tuple[str, ...]  # one for each model, all different
    models: tuple[DatasetResults, ...]
    # The models as set-ups of one structure, their modes merged
    merged: MergedModes | None = None

    @classmethod
    def of(
        cls, results: Sequence[DatasetResults], labels: Sequence[str] = (), setups: bool = False
    ) -> Self:
        """Compare data sets, by default under their names and, where these agree, their models.

        With ``setups`` their modes are merged.  `InputError` for fewer than two, more than
        :data:`MOST`, labels that do not tell them apart, models without a common output, or set-ups
        that cannot be merged; these may be more, and have common inputs instead.
        """
        if len(results) < 2 or (len(results) > MOST and not setups):
            problem = f"there are {len(results)} models"
            raise InputError("compare", problem, f"give 2 to {MOST} of them")
        chosen = tuple(labels) or _labels(results)
        if len(chosen) != len(results) or len(set(chosen)) != len(chosen):
            problem = "they are not one for each model, all different"
            raise InputError("labels", problem, "correct them")
        named = zip(chosen, results, strict=True)
        merged = merge_setups([model.setup(name) for name, model in named]) if setups else None
        compared = cls(chosen, tuple(results), merged)
        if not compared.outputs and not setups:
            problem = "the models have no output in common"
            raise InputError("compare", problem, "compare models of one system")
        return compared

    @cached_property
    def outputs(self) -> list[tuple[Channel, ...]]:
        """Each common output as every model has it, found by name; a single one by whatever."""
        return _common([{output.name: output for output in model.outputs} for model in self.models])

    @cached_property
    def pairs(self) -> list[tuple[Pair, ...]]:
        """Each common pair of output and input as every model has it."""
        return _common(
            [{(o.name, s.name if s else ""): (o, s) for o, s in m.pairs} for m in self.models]
        )

    @property
    def has_same_validation(self) -> bool:
        """Whether all models were validated on the same samples, at the same rate."""
        if not self.outputs or any(model.of_responses for model in self.models):
            return False
        first, *others = (
            model.validation_tables.simulation[["time_s", *(f"output_{o.name}" for o in outputs)]]
            for model, outputs in zip(self.models, zip(*self.outputs, strict=True), strict=True)
        )
        return all(
            first.shape == table.shape and np.allclose(first, table, rtol=1e-9, equal_nan=True)
            for table in others
        )

    @cached_property
    def matched(self) -> list[tuple[Mode | None, ...]]:
        """Each mode as every model has it, matched by frequency, in its order, or as merged."""
        if self.merged:
            return list(self.merged.by_setup)
        return matched_modes([model.modes for model in self.models])

    @cached_property
    def trusted(self) -> set[Mode]:
        """The modes of all models that nothing speaks against; of set-ups, the merged ones."""
        if self.merged:
            return {mode for modes in self.matched for mode in modes if mode is not None}
        return {mode for model in self.models for mode in model.validation.modes.trusted}

    @property
    def table(self) -> pd.DataFrame:
        """A row for each model: its orders, errors, criteria and checks."""
        rows = [
            {
                "model": model.model.text,
                "parameters": model.model.model.parameters.size,
                "estimation_samples": model.model.transforms.estimation_samples,
                "sampling_rate_hz": model.model.sampling_rate,
                "simulation_error_percent": model.validation.simulation_error_percent,
                "prediction_error_percent": model.validation.prediction_error_percent,
                "bic": model.model.bic,
                "failed_checks": len(failed_checks(model.checks)),
                "trusted_modes": len(model.validation.modes.trusted),
            }
            for model in self.models
        ]
        return pd.DataFrame(rows, index=pd.Index(self.labels, name="data set"))

    @property
    def modes(self) -> pd.DataFrame:
        """A row for each mode of each model: number of the matched mode, values and errors."""
        rows = [
            (number, label, *mode_values(mode), mode in self.trusted)
            for number, modes in enumerate(self.matched, start=1)
            for label, mode in zip(self.labels, modes, strict=True)
            if mode is not None
        ]
        return pd.DataFrame(rows, columns=["mode", "data set", *MODE_COLUMNS, "trusted"])


def _common(named: Sequence[Mapping[Any, T]]) -> list[tuple[T, ...]]:
    """The values of the keys that all have, in the order of the first; of one each, these."""
    if all(len(by_name) == 1 for by_name in named):
        return [tuple(next(iter(by_name.values())) for by_name in named)]
    keys = [key for key in named[0] if all(key in by_name for by_name in named)]
    return [tuple(by_name[key] for by_name in named) for key in keys]


def _labels(models: Sequence[DatasetResults]) -> tuple[str, ...]:
    """Names; with the orders where names agree, and a number where these agree as well."""
    names = [model.name for model in models]
    if len(set(names)) < len(names):
        names = [f"{model.name}, {model.model.text}" for model in models]
    return tuple(
        f"{name} ({names[:place].count(name) + 1})" if names.count(name) > 1 else name
        for place, name in enumerate(names)
    )


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
        panels.append(Panel("", "time_s", VALIDATION_TIME, label, tuple(curves), height=250))
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
