"""The verdict for programs: ``verdict.json``, whose form ``verdict.schema.json`` states."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from evopem.automatic.varying import Moves
from evopem.files.checksums import sha256_of_file
from evopem.report.numbers import damping_limit
from evopem.report.verdict import ModeLine, Use, mode_lines, verdict
from evopem.results.dataset import DatasetResults, StatedDelay
from evopem.results.fleet import DatasetSummary, mode_values
from evopem.results.layout import DatasetFiles
from evopem.validation.checks import Check
from evopem.version import __version__

OF_SUMMARY = (
    *("model", "checks", "estimation_samples", "validation_samples"),
    *("prediction_error_percent", "simulation_error_percent"),
)


@dataclass(frozen=True)
class ListedMode:
    """A mode of the plant, or of the noise filter alone, which is never trusted."""

    frequency_hz: float | None
    """natural frequency"""
    frequency_se_hz: float | None
    """its standard error; null where it is not known"""
    damping_percent: float | None
    """damping ratio"""
    damping_se_percent: float | None
    """its standard error; null where it is not known"""
    damping_below_percent: float | None
    """upper end of its 95 % interval where that contains 0 and not 100, else null"""
    trusted: bool
    """whether the data give no reason to doubt it"""
    shape_trusted: bool | None
    """whether its shape can be trusted, too; null for one output"""
    reason: str
    """why it is trusted or not"""


@dataclass(frozen=True)
class ListedMove:
    """A mode of a moving model, along the schedule of its coefficients."""

    from_hz: float
    """natural frequency at the start"""
    from_se_hz: float
    """its standard error"""
    to_hz: float
    """natural frequency at the end"""
    to_se_hz: float
    """its standard error"""
    moves: bool
    """whether its frequency, there or between, differs by more than its 95 % error"""


@dataclass(frozen=True)
class ListedMoves:
    """What a model with moving coefficients says beside the model of this file."""

    model: str
    """structure, orders and basis in a few words"""
    schedule: str
    """time, or the condition that the coefficients move with"""
    is_better: bool
    """whether it clearly predicts samples better that neither model saw"""
    is_stable: bool
    """whether its frozen poles are stable everywhere"""
    error_percent: float
    """of these samples' deviation, one step ahead"""
    constant_error_percent: float
    """the same of a constant model of its kind"""
    modes: tuple[ListedMove, ...]
    """those whose frequency is known, by frequency"""


@dataclass(frozen=True)
class VerdictFile:
    """What an identified model is good for. Keys may be added, and none changes its meaning."""

    version: Literal["1"]
    """of this form"""
    evopem: str
    """version of evopem"""
    dataset: str
    """name of the data set"""
    sentence: str
    """the verdict in one sentence"""
    uses: tuple[Use, ...]
    """what the model may be used for; what is not listed was not judged"""
    defects: tuple[str, ...]
    """names of the failed checks that are defects"""
    checks: tuple[Check, ...]
    """all checks, those with a lower grade and those not judged among them"""
    model: str
    """structure and orders in a few words"""
    inputs: tuple[str, ...]
    """names"""
    outputs: tuple[str, ...]
    """names"""
    delays: tuple[StatedDelay, ...]
    """of each input; empty for frequency responses"""
    sampling_rate_hz: float
    """of the model"""
    estimation_samples: int
    """that the model was estimated from"""
    validation_samples: int
    """that its errors were measured on"""
    prediction_error_percent: float | None
    """of the output's deviation, one step ahead, mean over the outputs"""
    simulation_error_percent: float | None
    """the same of the simulation from the inputs alone; null without an input"""
    modes: tuple[ListedMode, ...]
    """all modes, those not to be trusted among them"""
    moves: ListedMoves | None
    """what moves; null where no model with moving coefficients was needed"""
    recordings_sha256: dict[str, str]
    """checksums of the recorded files"""
    results_sha256: dict[str, str]
    """checksums of the results that this file goes with"""


def verdict_file(
    results: DatasetResults, summary: DatasetSummary, files: DatasetFiles
) -> VerdictFile:
    """The verdict on results that lie in files."""
    judged, model = verdict(results), results.model
    return VerdictFile(
        version="1",
        evopem=__version__,
        dataset=results.name,
        sentence=judged.sentence,
        uses=tuple(judged.uses),
        defects=tuple(check.name for check in summary.failed),
        inputs=tuple(model.input_names),
        outputs=tuple(model.output_names),
        delays=results.delays,
        sampling_rate_hz=model.sampling_rate,
        **{name: getattr(summary, name) for name in OF_SUMMARY},
        modes=tuple(_listed(line, len(results.outputs) > 1) for line in mode_lines(results)),
        moves=_moves(summary.moves) if summary.moves else None,
        recordings_sha256={file.path: file.sha256 for file in results.files},
        results_sha256={
            Path(path).name: sha256_of_file(path)
            for path in (files.model, files.validation, files.summary)
        },
    )


def _moves(moves: Moves) -> ListedMoves:
    modes = []
    for mode in moves.modes:
        ends = [(end.frequency_hz, end.frequency_se_hz) for end in (mode.modes[0], mode.modes[-1])]
        modes.append(ListedMove(*ends[0], *ends[1], mode.moves))
    same = ("schedule", "is_better", "is_stable", "error_percent", "constant_error_percent")
    of_both = {name: getattr(moves, name) for name in same}
    return ListedMoves(model=moves.text, modes=tuple(modes), **of_both)


def _listed(line: ModeLine, several: bool) -> ListedMode:
    shape_trusted = line.trusted and not line.shape_doubt if several else None
    values = *mode_values(line.mode), damping_limit(line.mode)
    return ListedMode(*values, line.trusted, shape_trusted, line.why)
