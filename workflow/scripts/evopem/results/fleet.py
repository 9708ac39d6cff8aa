"""Many data sets: the summary of each, and one table of all their modes and checks."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from evopem.automatic.varying import Moves
from evopem.config.structures import ORDER_NAMES
from evopem.errors import InputError
from evopem.files.json_form import load
from evopem.models.modes import Mode
from evopem.models.orders import Orders
from evopem.results.identity import IncompleteDataset, incompleteness
from evopem.results.layout import DatasetFiles
from evopem.signals.recording_info import ChannelInfo
from evopem.validation.checks import Check, Evidence, checks, failed_checks
from evopem.validation.distortion import NOT_TESTED, Distortion, Floor

if TYPE_CHECKING:
    import pandas as pd

    from evopem.estimation.model_record import ModelRecord

# Text that a spreadsheet program would take for a formula when it begins a cell (OWASP, "CSV
# injection"), with the full-width forms of the signs.
_FORMULA_START = tuple("=+-@＝＋－＠\t\r\n")

# Bands of the gain in a summary.
GAIN_BANDS = 60
MODE_COLUMNS = ("frequency_hz", "frequency_se_hz", "damping_percent", "damping_se_percent")


def mode_values(mode: Mode) -> tuple[float, float, float, float]:
    """The values of a mode in :data:`MODE_COLUMNS`."""
    damping, error = 100.0 * mode.damping_ratio, 100.0 * mode.damping_se
    return mode.frequency_hz, mode.frequency_se_hz, damping, error


@dataclass(frozen=True)
class DatasetSummary:
    """The summary of one data set."""

    # file, sha256: the recorded file; None for a synthetic recording
    file: str | None
    sha256: str | None
    sampling_rate: float  # Hz, after all transforms
    estimation_samples: int
    validation_samples: int  # that are scored
    model: str  # in a few words: structure and orders
    orders: Orders | None  # None for a state-space model
    bic: float
    prediction_error_percent: float
    simulation_error_percent: float
    # Of a simulation from the state that fits the validation samples best
    fitted_state_error_percent: float
    checks: tuple[Check, ...]
    modes: tuple[Mode, ...]
    trusted: tuple[bool, ...]  # for each mode whether the data give no reason to doubt it
    # Gain of the model in decibels: the largest in each of :data:`GAIN_BANDS` equal bands from 0 Hz
    # to half the sampling rate, for a small plot. Of a model without input, of its noise filter
    gain_db: tuple[float, ...]
    distortion: Distortion = NOT_TESTED  # parts of the simulation error
    floors: tuple[Floor, ...] = ()  # the least error of linear models
    # Whether the samples are frequencies, and the simulation error is that of their responses
    of_responses: bool = False
    moves: Moves | None = None  # what a moving model says, where one was estimated
    inputs: tuple[ChannelInfo, ...] = ()  # as recorded

    @property
    def failed(self) -> list[Check]:
        """The checks that headlines count as failed."""
        return failed_checks(self.checks)

    @property
    def reservations(self) -> list[Check]:
        """Those, and failed checks that leave the model usable with care."""
        return [check for check in self.checks if check.word in ("Failed", "Caution")]

    def n_checks(self, passed: bool | None) -> int:
        """Number of checks with an outcome: passed, failed whatever their grade, not judged."""
        return sum(check.passed is passed for check in self.checks)


Entry = DatasetSummary | IncompleteDataset  # a data set in a list of all data sets


def summarize(evidence: Evidence, moves: Moves | None = None) -> DatasetSummary:
    """Summarize one data set."""
    model, validation, files = evidence.model, evidence.validation, evidence.recording.files
    of_responses = bool(validation.checks)
    rate = evidence.recording.sampling_rate if of_responses else model.sampling_rate
    return DatasetSummary(
        file=", ".join(file.path for file in files) or None,
        sha256=", ".join(file.sha256 for file in files) or None,
        sampling_rate=rate,
        estimation_samples=model.transforms.estimation_samples,
        validation_samples=validation.samples,
        model=model.text,
        orders=model.orders,
        bic=model.bic,
        **{error: getattr(validation, error) for error in _ERRORS},
        checks=tuple(checks(evidence)),
        modes=tuple(mode.mode for mode in validation.modes.modes),
        trusted=tuple(mode.trusted for mode in validation.modes.modes),
        gain_db=_gain_outline(model, rate / 2),
        distortion=replace(validation.distortion, levels=()),
        floors=validation.floors,
        moves=moves,
        inputs=evidence.recording.inputs,
        of_responses=of_responses,
    )


def _gain_outline(record: ModelRecord, highest: float) -> tuple[float, ...]:
    """The largest singular value of each band, in decibels to one decimal."""
    bands = np.linspace(0.0, highest, 32 * GAIN_BANDS + 1)[1:]
    model = record.model
    response = model.frequency_response if record.has_input else model.noise_response
    with np.errstate(divide="ignore", invalid="ignore"):
        gains = np.nan_to_num(response(bands), nan=np.inf, posinf=np.inf)
        finite = np.isfinite(gains).all(axis=(1, 2))
        largest = np.full(len(bands), np.inf)
        largest[finite] = np.linalg.svd(gains[finite], compute_uv=False)[:, 0]
        outline = 20.0 * np.log10(largest.reshape(GAIN_BANDS, -1).max(axis=1))
    return tuple(np.round(outline, 1).tolist())


def read_entry(files: DatasetFiles, required: Collection[str] = (), pending: bool = False) -> Entry:
    """Read the summary of a data set, or find out why its results are not whole."""
    try:
        fault = incompleteness(files, required, pending)
        return load(DatasetSummary, files.summary) if fault is None else fault
    except InputError as error:
        return IncompleteDataset("failed", str(error))
    except Exception as error:
        return IncompleteDataset("failed", f"{files.folder}: cannot be read ({error}).")


def fleet_table(entries: Mapping[str, Entry]) -> pd.DataFrame:
    """A row for each mode of each data set, or one row without; by the names of the data sets."""
    import pandas as pd

    rows = [row for name, entry in entries.items() for row in _rows(name, entry)]
    of_checks = [key for row in rows for key in row if key not in _COLUMN_TYPES]
    types = _COLUMN_TYPES | dict.fromkeys(of_checks, "boolean")
    return pd.DataFrame(rows, columns=list(types)).astype(types)


def without_formulas(table: pd.DataFrame) -> pd.DataFrame:
    """Put an apostrophe before text that a spreadsheet program would take for a formula."""
    safe = table.copy()
    for column in table.columns[table.dtypes == "string"]:
        text = table[column]
        safe[column] = text.mask(text.str.startswith(_FORMULA_START, na=False), "'" + text)
    return safe


def check_column(name: str) -> str:
    """Name of a check's column in the table."""
    return "check_" + re.sub(r"\W+", "_", name.lower()).strip("_")


_ERRORS = tuple(f"{kind}_error_percent" for kind in ("prediction", "simulation", "fitted_state"))
_COPIED = ("file", "sha256", "sampling_rate", "estimation_samples", "validation_samples", "model")
_COLUMN_TYPES = (
    dict.fromkeys(("dataset", "status", "problem", "file", "sha256"), "string")
    | {"sampling_rate": "float64"}
    | dict.fromkeys(("estimation_samples", "validation_samples"), "Int64")
    | {"model": "string"}
    | dict.fromkeys(ORDER_NAMES, "Int64")
    | dict.fromkeys(("bic", *_ERRORS), "float64")
    | dict.fromkeys(("failed_checks", "mode"), "Int64")
    | dict.fromkeys(MODE_COLUMNS, "float64")
)


def _rows(name: str, entry: Entry) -> list[dict[str, object]]:
    if isinstance(entry, IncompleteDataset):
        return [{"dataset": name, "status": entry.status, "problem": entry.problem}]
    is_single = entry.orders is not None and entry.orders.inputs <= 1
    orders = entry.orders.single._asdict() if entry.orders and is_single else {}
    row = {
        "dataset": name,
        "status": "complete",
        **{copied: getattr(entry, copied) for copied in (*_COPIED, "bic", *_ERRORS)},
        **orders,  # of polynomials with at most one input
        "failed_checks": len(entry.failed),
        **{check_column(check.name): check.passed for check in entry.checks},
    }
    modes = [
        {"mode": number, **dict(zip(MODE_COLUMNS, mode_values(mode), strict=True))}
        for number, mode in enumerate(entry.modes, start=1)
    ]
    return [row | mode for mode in modes or [{}]]
