"""What lies between recorded signals and those of an exported model."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from evopem.estimation.model_record import ModelRecord
from evopem.models.polynomial import Model
from evopem.signals.prepared_data import Rows
from evopem.signals.transforms import invert_difference


@dataclass(frozen=True)
class Channel:
    """An input or output as it was recorded, and what was taken from it."""

    name: str
    unit: str = ""
    level: float = 0.0  # in the model's unit
    trend: float = 0.0  # units per second
    # Of the signal, of its first differences ...: the last one before the estimation samples, or
    # the level of a high-pass filter
    last: tuple[float, ...] = ()

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name}, {self.unit}" if self.unit else self.name


@dataclass(frozen=True)
class Signals:
    """Channels of a model, and the transforms of its estimation samples."""

    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    difference: int = 0  # how many times the outputs were differenced
    difference_input: int = 0
    difference_pole: float = 0.0  # above 0 that of a high-pass filter in place of differences
    box_cox: float | None = None  # parameter of the transform of the output
    shift: float = 0.0  # added to the output before
    start: float = 0.0  # s: time of the first estimation sample in its recording
    resampled_from: float | None = None  # rate of the recording (Hz) where it was another
    recordings: int = 0  # behind the estimation samples; 0 where they are not known
    own_levels: bool = False  # whether other recordings have levels of their own

    @classmethod
    def of_record(cls, record: ModelRecord) -> Self:
        """The signals of results, from the first estimation samples on.

        ValueError where the transforms do not fit the channels.
        """
        about = record.transforms
        if not about.estimation:
            raise ValueError("the transforms have no estimation samples")
        origin = about.estimation[0]
        times = about.difference_input if record.has_input else 0
        return cls(
            _channels(
                *(record.input_names, record.input_units, origin.input_means),
                *(about.input_trends, origin.input_initial, times),
            ),
            _channels(
                *(record.output_names, record.output_units, origin.output_means),
                *(about.output_trends, origin.output_initial, about.difference),
            ),
            *(about.difference, times, about.difference_pole, about.box_cox, about.shift),
            *(origin.start, about.resampled_from),
            len({origin.recording for origin in about.estimation}),
            own_levels=record.level_of_simulation == "state",
        )

    @classmethod
    def of_model(cls, model: Model) -> Self:
        """The signals of a model without a record: those that it was estimated from."""
        inputs = model.input_names or [f"input {i + 1}" for i in range(model.inputs)]
        outputs = model.output_names or [f"output {j + 1}" for j in range(model.outputs)]
        return cls(tuple(map(Channel, inputs)), tuple(map(Channel, outputs)))

    @property
    def has_trend(self) -> bool:
        """Whether a slope is taken from a channel."""
        return any(channel.trend for channel in (*self.inputs, *self.outputs))

    @property
    def lost(self) -> int:
        """Samples that the differences of a recording take at its beginning."""
        return max(self.difference, self.difference_input)


def _channels(
    names: Sequence[str],
    units: Sequence[str],
    levels: Sequence[float],
    trends: Sequence[float],
    initial: Rows,
    times: int,
) -> tuple[Channel, ...]:
    """Channels that were differenced some times, from the ``initial`` values on."""
    slopes = trends or (0.0,) * len(names)
    if len(initial) != times or {*map(len, (levels, slopes, *initial))} != {len(names)}:
        raise ValueError("the transforms do not fit the channels")
    last: list[tuple[float, ...]] = [()] * len(names)
    if times:
        before = invert_difference(np.empty((0, len(names))), initial)
        last = [*zip(*(np.diff(before, k, axis=0)[-1] for k in range(times)), strict=True)]
    columns = zip(names, units, levels, slopes, last, strict=True)
    return tuple(Channel(*column) for column in columns)
