"""What is estimated of a recording by state-space models of any order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

from evopem.config.settings import OBJECTIVES, OutputWeighting, SearchSettings
from evopem.estimation.state_space.errors import StateSpaceErrors, scaled_recording
from evopem.models.state_space import PlainStructure, StateSpaceStructure
from evopem.signals.recording import Recording

STRUCTURES, WEIGHTINGS = get_args(StateSpaceStructure), get_args(OutputWeighting)
QUADRATIC = SearchSettings(objective="quadratic")
# Periods of the drift of structure ss_oe_drift in the longest segment, the shortest one.
DRIFT_PERIODS = 5


@dataclass(frozen=True)
class StateSpaceTask:
    """Form, delays, level, weighting of the outputs, and settings of a search.

    ``drift_period`` is the shortest period, in samples, of slow changes of the outputs that are
    estimated along with the level, and that the model does not have to explain.
    """

    structure: PlainStructure = "ss"
    delays: int | tuple[int, ...] = 1
    level: bool = True
    weighting: OutputWeighting = "determinant"
    settings: SearchSettings = QUADRATIC
    drift_period: float | None = None

    def __post_init__(self) -> None:
        given = (
            ("weighting", self.weighting, WEIGHTINGS),
            ("objective", self.settings.objective, OBJECTIVES),
        )
        for name, value, values in given:
            if value not in values:
                raise ValueError(f"{name} must be one of {values}, not {value!r}")
        if not 0.0 < self.settings.max_root_radius < 1.0:
            radius = self.settings.max_root_radius
            raise ValueError(f"max_root_radius must lie between 0 and 1, not {radius}")

    @classmethod
    def of(
        cls,
        recording: Recording,
        structure: StateSpaceStructure = "ss",
        delays: int | Sequence[int] = 1,
        level: bool = True,
        weighting: OutputWeighting = "determinant",
        settings: SearchSettings | None = None,
    ) -> StateSpaceTask:
        """The task of a structure.

        The drift of ``ss_oe_drift`` is what scores on held-out samples do not count either, which
        fit a level of its own to each held-out part.
        """
        if structure not in STRUCTURES:
            raise ValueError(f"structure must be one of {STRUCTURES}, not {structure!r}")
        return cls(
            "ss" if structure in ("ss", "ss_bj") else "ss_oe",
            delays if isinstance(delays, int) else tuple(delays),
            level,
            weighting,
            settings or QUADRATIC,
            recording.longest.samples / DRIFT_PERIODS if structure == "ss_oe_drift" else None,
        )

    def errors(self, recording: Recording, order: int) -> StateSpaceErrors:
        """The prediction-error problem of an order.

        Raises
        ------
        ValueError
            When the recording is too short for the order, or its signals cannot be used.
        """
        data = scaled_recording(recording, self.delays, self.level, self.drift_period)
        if order < 1:
            raise ValueError(f"order must be at least 1, not {order}")
        if self.structure == "ss_oe" and not recording.has_input:
            raise ValueError(
                "an output-error model needs an input; without one, use innovations form"
            )
        radius = self.settings.max_root_radius
        errors = StateSpaceErrors(data, order, self.structure, self.weighting, radius)
        needed = errors.estimated
        available = data.outputs.size
        if available <= needed or data.samples <= 2 * (order + data.inputs.shape[1]) + 2:
            raise ValueError(
                f"order {order} needs more than {needed} output values for its parameters and"
                f" initial states; the recording has {available}"
            )
        return errors
