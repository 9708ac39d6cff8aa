"""Several models side by side: their errors, and their modes matched by frequency."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from evopem.errors import InputError
from evopem.models.mode_matching import match_modes
from evopem.models.modes import Mode
from evopem.results.dataset import DatasetResults
from evopem.validation.checks import failed_checks

MOST = 6
"""More models than colours that can be told apart are not compared."""


@dataclass(frozen=True)
class MatchedMode:
    """One mode as each model has it."""

    # In the order of the models; None where a model has no such mode
    modes: tuple[Mode | None, ...]
    trusted: tuple[bool, ...]  # whether the data give no reason to doubt it, likewise

    @property
    def present(self) -> list[Mode]:
        """The mode of those models that have it."""
        return [mode for mode in self.modes if mode is not None]

    @property
    def frequency_hz(self) -> float:
        """Mean natural frequency over the models that have it."""
        return float(np.mean([mode.frequency_hz for mode in self.present]))

    @property
    def spread_percent(self) -> float:
        """Largest less smallest frequency, in percent of their mean; NaN for one model."""
        found = [mode.frequency_hz for mode in self.present]
        if len(found) < 2:
            return float("nan")
        return 100.0 * (max(found) - min(found)) / float(np.mean(found))


@dataclass(frozen=True, eq=False)
class Comparison:
    """Models side by side."""

    labels: tuple[str, ...]  # one for each model, all different
    results: tuple[DatasetResults, ...]

    @classmethod
    def of(cls, results: Sequence[DatasetResults], labels: Sequence[str] = ()) -> Comparison:
        """Compare data sets, by default under their names and, where these agree, their models.

        Raises InputError for fewer than two, more than :data:`MOST`, or labels that do not tell
        them apart.
        """
        if not 2 <= len(results) <= MOST:
            raise InputError(
                "compare", f"there are {len(results)} models", f"give 2 to {MOST} of them"
            )
        chosen = tuple(labels) or _labels(results)
        if len(chosen) != len(results) or len(set(chosen)) != len(chosen):
            raise InputError(
                "labels", "they are not one for each model, all different", "correct them"
            )
        return cls(chosen, tuple(results))

    @property
    def has_same_validation(self) -> bool:
        """Whether all models were validated on the same samples, at the same rate."""
        first, *others = (
            each.validation_tables.simulation[["time_s", f"output_{each.model.output_names[0]}"]]
            for each in self.results
        )
        return all(
            len(first) == len(other) and np.allclose(first, other, rtol=1e-9, equal_nan=True)
            for other in others
        )

    @cached_property
    def modes(self) -> list[MatchedMode]:
        """The modes of all models, matched by frequency, in its order.

        The modes of each further model are paired with those of the models before it.
        """
        size = len(self.results)
        groups: list[list[Mode | None]] = []
        for place, each in enumerate(self.results):
            found = [judged.mode for judged in each.validation.modes.modes]
            known = [next(mode for mode in group if mode is not None) for group in groups]
            pairs = match_modes(found, known)
            for index, mode in enumerate(found):
                if index in pairs:
                    groups[pairs[index]][place] = mode
                else:
                    groups.append([mode if at == place else None for at in range(size)])
        trusted = [{mode.pole for mode in each.trusted_modes} for each in self.results]
        matched = [
            MatchedMode(
                tuple(group),
                tuple(
                    mode is not None and mode.pole in known
                    for mode, known in zip(group, trusted, strict=True)
                ),
            )
            for group in groups
        ]
        return sorted(matched, key=lambda each: each.frequency_hz)

    @property
    def table(self) -> pd.DataFrame:
        """A row for each model: its orders, errors, criteria and checks."""
        rows = []
        for each in self.results:
            validation, checks = each.validation, each.checks
            rows.append(
                {
                    "model": str(each.model.orders),
                    "parameters": each.model.model.parameters.size,
                    "estimation_samples": each.model.transforms.estimation_samples,
                    "sampling_rate_hz": each.model.sampling_rate,
                    "simulation_error_percent": validation.simulation_error_percent,
                    "prediction_error_percent": validation.prediction_error_percent,
                    "bic": each.model.bic,
                    "failed_checks": len(failed_checks(checks)),
                    "trusted_modes": len(each.trusted_modes),
                }
            )
        return pd.DataFrame(rows, index=pd.Index(self.labels, name="data set"))

    @property
    def mode_table(self) -> pd.DataFrame:
        """A row for each mode of each model: number of the matched mode, values and errors."""
        columns = {
            **dict.fromkeys(("mode", "data set")),
            **dict.fromkeys(("frequency_hz", "frequency_se_hz")),
            **dict.fromkeys(("damping_percent", "damping_se_percent", "trusted")),
        }
        rows = [
            (
                *(number, label, mode.frequency_hz, mode.frequency_se_hz),
                *(100.0 * mode.damping_ratio, 100.0 * mode.damping_se, trusted),
            )
            for number, each in enumerate(self.modes, start=1)
            for label, mode, trusted in zip(self.labels, each.modes, each.trusted, strict=True)
            if mode is not None
        ]
        return pd.DataFrame(rows, columns=list(columns))


def _labels(results: Sequence[DatasetResults]) -> tuple[str, ...]:
    """Names; with the orders where names agree, and a number where these agree as well."""
    names = [each.name for each in results]
    if len(set(names)) < len(names):
        names = [f"{each.name}, {each.model.orders}" for each in results]
    often = Counter(names)
    seen: Counter[str] = Counter()
    labels = []
    for name in names:
        seen[name] += 1
        labels.append(f"{name} ({seen[name]})" if often[name] > 1 else name)
    return tuple(labels)
