"""The samples a model is estimated and validated on, and the way back to measured ones."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from evopem.arrays import Array
from evopem.files.json_form import load, save
from evopem.signals.recording import Recording, load_recordings, save_recordings
from evopem.signals.transforms import invert_box_cox, invert_difference

Rows = tuple[tuple[float, ...], ...]
_PARTS = "estimation_", "validation_"
Source = Literal["cut", "gap", "file", "recordings", "estimation"]


@dataclass(frozen=True)
class StretchOrigin:
    """Where consecutive prepared samples come from, and what was taken from their channels."""

    recording: int  # number, from 0; the files for validation go on counting
    first: int  # first sample in the recording, at the prepared rate
    start: float  # its time in the recording (s)
    samples: int
    input_means: tuple[float, ...]
    output_means: tuple[float, ...]  # levels of the outputs, see `output_level`
    input_initial: Rows = ()  # values that each difference starts from, one for each channel
    output_initial: Rows = ()


@dataclass(frozen=True)
class Transforms:
    """Every parameter that takes prepared samples back to measured ones.

    The validation samples of each recording follow its estimation samples (``cut``) or come later
    (``gap``); or they are of other files, of the last recordings of the data set, or those of the
    ``estimation`` again.
    """

    sampling_rate: float  # of the prepared samples (Hz)
    resampled_from: float | None  # rate of the recording (Hz) where it was another
    estimation: tuple[StretchOrigin, ...]
    validation: tuple[StretchOrigin, ...]
    validation_source: Source
    box_cox: float | None = None  # parameter λ of the only output
    shift: float = 0.0  # added to the output before
    difference: int = 0  # how many times the outputs were differenced
    difference_input: int = 0
    difference_pole: float = 0.0  # above 0 a high-pass filter takes the place of differences
    input_trends: tuple[float, ...] = ()  # slopes taken from the channels, units per second
    output_trends: tuple[float, ...] = ()

    @property
    def estimation_samples(self) -> int:
        """Number of prepared samples for estimation."""
        return sum(origin.samples for origin in self.estimation)

    @property
    def validation_samples(self) -> int:
        """Number of prepared samples for validation."""
        return sum(origin.samples for origin in self.validation)

    @property
    def holds_out(self) -> bool:
        """Whether the model has not seen the validation samples."""
        return self.validation_source != "estimation"

    @property
    def judging(self) -> str:
        """What the samples that judge the model are for."""
        return "validation" if self.holds_out else "estimation"

    @property
    def discard(self) -> int:
        """Samples left out at the start of the first recording, after the differences."""
        return self.estimation[0].first - max(self.difference, self.difference_input)

    @property
    def several_recordings(self) -> bool:
        """Whether there is more than one recording for either part; each has means of its own."""
        parts = self.estimation, self.validation
        most = max(len({origin.recording for origin in part}) for part in parts)
        return most > 1 or self.validation_source == "recordings"

    @property
    def has_trend(self) -> bool:
        """Whether a slope was taken from a channel."""
        return any((*self.input_trends, *self.output_trends))

    @property
    def changes_output(self) -> bool:
        """Whether the prepared outputs differ from the recorded ones by more than a level."""
        return self.box_cox is not None or self.difference > 0 or any(self.output_trends)


@dataclass(frozen=True, eq=False)
class PreparedData:
    """Samples without means, divided for estimation and validation, and what was done to them."""

    estimation: Recording
    validation: Recording
    transforms: Transforms

    @property
    def before_validation(self) -> Recording | None:
        """The samples that the validation samples continue, one segment for each segment of them.

        None where there is a gap, or the validation samples are of other recordings.
        """
        return self.estimation if self.transforms.validation_source == "cut" else None


def origins_of(recording: Recording) -> tuple[StretchOrigin, ...]:
    """Those of the segments of a recording that nothing was taken from."""
    rate = recording.sampling_rate
    means = (0.0,) * recording.inputs.shape[1], (0.0,) * recording.outputs.shape[1]
    return tuple(
        StretchOrigin(part.recording, part.first, part.first / rate, part.samples, *means)
        for part in recording.segments
    )


def measured_outputs(transforms: Transforms, origin: StretchOrigin, outputs: Array) -> Array:
    """Take prepared outputs back to the measured unit, (n + difference, l); at the prepared rate.

    The outputs, (n, l), begin with the first sample of a stretch; the first ``difference`` samples
    of the result are those just before.
    """
    initial, pole = origin.output_initial, transforms.difference_pole
    measured = invert_difference(outputs + origin.output_means, initial, pole)
    if transforms.box_cox is not None:
        measured = invert_box_cox(measured, transforms.box_cox, transforms.shift)
    if any(transforms.output_trends):
        times = origin.start + np.arange(len(measured)) / transforms.sampling_rate
        measured = measured + np.outer(times, transforms.output_trends)
    return measured


def save_prepared(prepared: PreparedData, arrays: str | Path, transforms: str | Path) -> None:
    """Write the samples to one ``.npz`` and the transforms to a JSON file."""
    parts = prepared.estimation, prepared.validation
    save_recordings(dict(zip(_PARTS, parts, strict=True)), arrays)
    save(prepared.transforms, transforms)


def load_prepared(arrays: str | Path, transforms: str | Path) -> PreparedData:
    """Read what `save_prepared` wrote; `InputError` when a file is missing or damaged."""
    estimation, validation = load_recordings(_PARTS, arrays)
    return PreparedData(estimation, validation, load(Transforms, transforms))
