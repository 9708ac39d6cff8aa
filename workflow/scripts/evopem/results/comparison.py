"""Several models side by side: errors, modes matched by frequency, and what these follow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import fmean
from typing import Any, Self, TypeVar

import numpy as np
import pandas as pd

from evopem.arrays import Array
from evopem.errors import InputError
from evopem.models.merged_modes import MergedModes, merge_setups
from evopem.models.mode_matching import matched_modes
from evopem.models.modes import Mode
from evopem.results.channel_labels import Channel, Pair
from evopem.results.dataset import DatasetResults
from evopem.results.fleet import MODE_COLUMNS, mode_values
from evopem.validation.checks import failed_checks
from evopem.validation.level_changes import FEWEST, fits

T = TypeVar("T")
Modes = Sequence[Mode | None]  # a mode as each of some models has it
MOST = 6  # more models than colours that a reader can distinguish are not compared


def spread_percent(modes: Modes) -> float:
    """Largest less smallest frequency, in percent of their mean; NaN for one model."""
    hertz = [mode.frequency_hz for mode in modes if mode is not None]
    return 100.0 * (max(hertz) - min(hertz)) / fmean(hertz) if len(hertz) > 1 else float("nan")


@dataclass(frozen=True)
class Dependence:
    """How the frequency of a mode goes with a level of an input over recordings of one machine.

    By a regression weighted by standard errors and the scatter beyond them.
    """

    input_name: str
    of: str  # "standard deviation" or "mean"
    lowest: float  # level
    highest: float
    frequency_hz: float  # mean over the recordings
    change_hz: float  # of the frequency, from the lowest level to the highest
    standard_error_hz: float
    p_value: float

    @classmethod
    def fitted(
        cls, input_name: str, of: str, x: Array, modes: Modes, beside: Sequence[Array] = ()
    ) -> Self:
        """Of a mode in n recordings, and the levels of an input there, beside conditions, (n,)."""
        design = np.column_stack([np.ones(len(x)), *beside, (x - x.mean()) / np.ptp(x)])
        hertz, errors = np.array([mode_values(mode)[:2] for mode in modes if mode]).T
        slopes, covariances, p_values, _ = fits(hertz, errors, design[None], 1)
        return cls(
            *(input_name, of, float(x.min()), float(x.max()), float(hertz.mean())),
            *(float(slopes[0, -1]), float(covariances[0, -1, -1]) ** 0.5, float(p_values[0])),
        )


@dataclass(frozen=True, eq=False)
class Comparison:
    """Models side by side, of the channels that all of them have."""

    labels: tuple[str, ...]  # one for each model, all different
    models: tuple[DatasetResults, ...]
    merged: MergedModes | None = None  # the models as set-ups of one structure, their modes merged

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
            problem = f"the number of models is {len(results)}"
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
    def dependences(self) -> list[Dependence]:
        """Of every trusted mode that all have, on standard deviation and mean of every input.

        None with fewer recordings than :data:`FEWEST`, or models without one.
        """
        recordings = [model.recording for model in self.models if model.recording]
        if len(recordings) < max(FEWEST, len(self.models)):
            return []
        signals = zip(*(recording.inputs.T for recording in recordings), strict=False)
        levels = [
            (name, of, np.array([float(level(signal)) for signal in of_input]))
            for name, of_input in zip(recordings[0].input_names, signals, strict=False)
            for of, level in (("standard deviation", np.std), ("mean", np.mean))
        ]
        everywhere = [modes for modes in self.matched if self.trusted.issuperset(modes)]
        return [
            Dependence.fitted(*level, modes)
            for level in levels
            for modes in everywhere
            if np.ptp(level[2]) > 0.0
        ]

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
