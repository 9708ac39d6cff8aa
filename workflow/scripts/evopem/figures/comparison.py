"""Several models side by side: their errors, their modes matched by frequency, and overlays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np
import pandas as pd

from evopem.errors import InputError
from evopem.figures.chart import (
    FAMILY,
    FREQUENCY,
    MOST_PANELS,
    VALIDATION_TIME,
    Chart,
    Curve,
    Panel,
    around,
    family,
    nothing,
    of_pair,
    rows_of,
)
from evopem.figures.frequency_domain import GAIN_BINS, model_source
from evopem.figures.style import extremes
from evopem.figures.time_domain import shown_samples
from evopem.models.mode_matching import matched_modes
from evopem.models.modes import Mode
from evopem.results.channels import Channel, Pair, gain_unit, with_unit
from evopem.results.dataset import DatasetResults
from evopem.results.fleet import MODE_COLUMNS, mode_values
from evopem.validation.checks import failed_checks

T = TypeVar("T")
MOST = 6
"""More models than colours that can be told apart are not compared."""


@dataclass(frozen=True)
class MatchedMode:
    """One mode as each model has it."""

    modes: tuple[Mode | None, ...]  # in the order of the models; None where a model has none
    trusted: tuple[bool, ...]

    @property
    def spread_percent(self) -> float:
        """Largest less smallest frequency, in percent of their mean; NaN for one model."""
        found = [mode.frequency_hz for mode in self.modes if mode is not None]
        spread = 100.0 * (max(found) - min(found)) / float(np.mean(found))
        return spread if len(found) > 1 else float("nan")


@dataclass(frozen=True, eq=False)
class Comparison:
    """Models side by side, of the channels that all of them have."""

    labels: tuple[str, ...]  # one for each model, all different
    models: tuple[DatasetResults, ...]

    @classmethod
    def of(cls, results: Sequence[DatasetResults], labels: Sequence[str] = ()) -> Self:
        """Compare data sets, by default under their names and, where these agree, their models.

        `InputError` for fewer than two, more than :data:`MOST`, labels that do not tell them
        apart, or models without a common output.
        """
        if not 2 <= len(results) <= MOST:
            problem = f"there are {len(results)} models"
            raise InputError("compare", problem, f"give 2 to {MOST} of them")
        chosen = tuple(labels) or _labels(results)
        if len(chosen) != len(results) or len(set(chosen)) != len(chosen):
            problem = "they are not one for each model, all different"
            raise InputError("labels", problem, "correct them")
        compared = cls(chosen, tuple(results))
        if not compared.outputs:
            problem = "the models have no output in common"
            raise InputError("compare", problem, "compare models of one system")
        return compared

    @cached_property
    def outputs(self) -> list[tuple[Channel, ...]]:
        """Each common output as every model has it, found by name; a single one by whatever."""
        return _common([{each.name: each for each in results.outputs} for results in self.models])

    @cached_property
    def pairs(self) -> list[tuple[Pair, ...]]:
        """Each common pair of output and input as every model has it."""
        return _common(
            [
                {(o.name, s.name if s else ""): (o, s) for o, s in results.pairs}
                for results in self.models
            ]
        )

    @property
    def has_same_validation(self) -> bool:
        """Whether all models were validated on the same samples, at the same rate."""
        first, *others = (
            results.validation_tables.simulation[
                ["time_s", *(f"output_{each[place].name}" for each in self.outputs)]
            ]
            for place, results in enumerate(self.models)
        )
        return all(
            first.shape == other.shape and np.allclose(first, other, rtol=1e-9, equal_nan=True)
            for other in others
        )

    @cached_property
    def matched(self) -> list[MatchedMode]:
        """The modes of all models, matched by frequency, in its order."""
        return [
            MatchedMode(
                row,
                tuple(
                    mode in results.validation.modes.trusted
                    for mode, results in zip(row, self.models, strict=True)
                ),
            )
            for row in matched_modes([results.modes for results in self.models])
        ]

    @property
    def table(self) -> pd.DataFrame:
        """A row for each model: its orders, errors, criteria and checks."""
        rows = []
        for results in self.models:
            model, validation = results.model, results.validation
            rows.append(
                {
                    "model": model.text,
                    "parameters": model.model.parameters.size,
                    "estimation_samples": model.transforms.estimation_samples,
                    "sampling_rate_hz": model.sampling_rate,
                    "simulation_error_percent": validation.simulation_error_percent,
                    "prediction_error_percent": validation.prediction_error_percent,
                    "bic": model.bic,
                    "failed_checks": len(failed_checks(results.checks)),
                    "trusted_modes": len(validation.modes.trusted),
                }
            )
        return pd.DataFrame(rows, index=pd.Index(self.labels, name="data set"))

    @property
    def modes(self) -> pd.DataFrame:
        """A row for each mode of each model: number of the matched mode, values and errors."""
        rows = [
            (number, label, *mode_values(mode), trusted)
            for number, each in enumerate(self.matched, start=1)
            for label, mode, trusted in zip(self.labels, each.modes, each.trusted, strict=True)
            if mode is not None
        ]
        return pd.DataFrame(rows, columns=["mode", "data set", *MODE_COLUMNS, "trusted"])


def _common(named: Sequence[Mapping[Any, T]]) -> list[tuple[T, ...]]:
    """The values of the keys that all have, in the order of the first; of one each, these."""
    if all(len(each) == 1 for each in named):
        return [tuple(next(iter(each.values())) for each in named)]
    keys = [key for key in named[0] if all(key in each for each in named)]
    return [tuple(each[key] for each in named) for key in keys]


def _labels(models: Sequence[DatasetResults]) -> tuple[str, ...]:
    """Names; with the orders where names agree, and a number where these agree as well."""
    names = [each.name for each in models]
    if len(set(names)) < len(names):
        names = [f"{each.name}, {each.model.text}" for each in models]
    return tuple(
        f"{name} ({names[:place].count(name) + 1})" if names.count(name) > 1 else name
        for place, name in enumerate(names)
    )


def compared_responses(comparison: Comparison) -> Chart:
    """Gain and phase of every model and common pair, with the 95 % bands of the gains."""
    columns = ["frequency_hz", "gain", "gain_lower", "gain_upper", "phase_deg"]
    highest = max(each.model.sampling_rate for each in comparison.models) / 2
    tables, gains, phases = [], [], []
    for place, pair in enumerate(comparison.pairs[: MOST_PANELS // 2]):
        units = set()
        for number, (results, (output, source)) in enumerate(
            zip(comparison.models, pair, strict=True), start=1
        ):
            table = results.responses
            where = (("source", model_source(results)[0]), *of_pair(output, source))
            rows = rows_of(table[table["frequency_hz"] > 0], where)
            kept = rows.iloc[extremes(rows["gain"], GAIN_BINS)][columns]
            tables.append(kept.assign(model=number, pair=place))
            units.add(gain_unit(output, source))
        models = [
            (label, role, (("model", str(number)), ("pair", str(place))))
            for number, (label, role) in enumerate(zip(comparison.labels, FAMILY, strict=False), 1)
        ]
        title = comparison.models[0].pair_title(*pair[0])
        gain = Panel(
            *(title, "frequency_hz", FREQUENCY),
            with_unit("Gain", units.pop() if len(units) == 1 else ""),
            tuple(
                Curve(label, "gain", role, where=where, band=("gain_lower", "gain_upper"))
                for label, role, where in models
            ),
            scale="logarithmic",
            limits=around(pd.concat(tables[-len(comparison.models) :])["gain"]),
            highest=highest,
            height=260,
            linked="frequency",
        )
        curves = [Curve(label, "phase_deg", role, "points", where=w) for label, role, w in models]
        phase = replace(gain, y_label="Phase (°)", curves=tuple(curves), scale="phase", height=170)
        gains.append(gain)
        phases.append(replace(phase, limits=(-190, 190)))
    if not tables:
        return nothing("The models have no input in common.")
    across = min(len(gains), 3)
    panels = [
        panel
        for first in range(0, len(gains), across)
        for row in (gains, phases)
        for panel in row[first : first + across]
    ]
    together = pd.concat(tables, ignore_index=True)[["model", "pair", *columns]]
    return Chart(together, tuple(panels), across)


def compared_simulations(comparison: Comparison) -> Chart:
    """Validation samples, measured and simulated by every model; without an input, predicted."""
    if not comparison.has_same_validation:
        return nothing("The models were validated on different samples.")
    first = comparison.models[0]
    kind = "simulated" if first.model.has_input else "predicted"
    table, panels = first.validation_tables.simulation[["time_s"]], []
    kept = shown_samples(first.modes, first.model.sampling_rate)
    for place, outputs in enumerate(comparison.outputs[:MOST_PANELS], start=1):
        measured = f"output_{place}"
        table = table.assign(
            **{measured: first.validation_tables.simulation[f"output_{outputs[0].name}"]}
        )
        curves = [Curve("measured", measured, "ink")]
        for number, (results, output) in enumerate(zip(comparison.models, outputs, strict=True)):
            column = f"simulated_{place}_{number + 1}"
            table = table.assign(
                **{column: results.validation_tables.simulation[f"{kind}_{output.name}"]}
            )
            label, role = comparison.labels[number], FAMILY[number]
            curves.append(Curve(label, column, role, dashed=True))
        label = outputs[0].label
        panels.append(Panel("", "time_s", VALIDATION_TIME, label, tuple(curves), height=250))
    table = table[table.notna().all(axis="columns")]
    until = float(table["time_s"].iloc[: kept or len(table)].max())
    shown = tuple(replace(panel, shown=until) for panel in panels)
    return Chart(table, shown, min(len(shown), 2))


def compared_modes(comparison: Comparison) -> Chart:
    """Damping ratio over natural frequency with 95 % intervals; not to be trusted where open."""
    table = comparison.modes
    if table.empty:
        return nothing("No model has an oscillating mode.")
    errors = ("frequency_se_hz", "damping_se_percent")
    curves: list[Curve] = []
    models = {label: (("data set", label),) for label in comparison.labels}
    for curve in family("damping_percent", models):
        trusted, doubted = ((*curve.where, ("trusted", word)) for word in ("True", "False"))
        points = replace(curve, kind="points", dashed=False)
        curves += [
            replace(points, where=trusted, errors=errors),
            replace(points, label="", where=doubted, marker=f"open{curve.marker}"),
        ]
    damping = table["damping_percent"]
    limits = (min(0.0, 1.2 * float(damping.min())), 1.3 * max(float(damping.max()), 1e-6))
    panel = Panel(
        *("", "frequency_hz", "Natural frequency (Hz)", "Damping ratio (%)", tuple(curves)),
        limits=limits,
        highest=max(each.model.sampling_rate for each in comparison.models) / 2,
        height=250,
    )
    return Chart(table, (panel,), live=False)
