"""Many data sets: the summary of each, and one table of all their modes and checks."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from evopem.config.structures import ORDER_NAMES
from evopem.errors import InputError
from evopem.files.checksums import sha256_of_file
from evopem.files.json_form import load
from evopem.models.modes import Mode
from evopem.models.structures import Orders
from evopem.results.followed_modes import RecordedMode
from evopem.results.identity import IncompleteDataset, incompleteness
from evopem.results.layout import DatasetFiles
from evopem.validation.checks import Check, checks, failed_checks
from evopem.validation.mode_trust import doubts

if TYPE_CHECKING:
    import pandas as pd

    from evopem.estimation.candidate import PhaseSelection
    from evopem.estimation.model_record import ModelRecord
    from evopem.signals.recording_info import RecordingInfo
    from evopem.signals.spectral.summary import SpectrumSummary
    from evopem.validation.validation import Validation

# Text that a spreadsheet program would take for a formula when it begins a cell (OWASP, "CSV
# injection"), with the full-width forms of the signs.
_FORMULA_START = tuple("=+-@＝＋－＠\t\r\n")


# Bands of the gain in a summary.
GAIN_BANDS = 60


@dataclass(frozen=True)
class DatasetSummary:
    """The summary of one data set.

    Attributes
    ----------
    file, sha256 : str, optional
        The recorded file; None for a synthetic recording.
    sampling_rate : float
        Hz, after all transforms.
    estimation_samples, validation_samples : int
    orders : Orders, optional
        None for a model of several channels.
    bic : float
    prediction_error_percent, simulation_error_percent : float
    fitted_state_error_percent : float
        Of a simulation from the state that fits the validation samples best.
    checks : tuple of Check
    modes : tuple of Mode
    trusted : tuple of bool
        For each mode whether the data give no reason to doubt it.
    gain_db : tuple of float
        Gain of the model in decibels: the largest in each of :data:`GAIN_BANDS` equal bands from
        0 Hz to half the sampling rate, for a small plot. Of a model without input, of its noise
        filter.
    made_from : dict of str to str
        SHA-256 of files that the summary was made from, by their names in the data set's folder.
    multichannel_model : str, optional
        A model of several channels in a few words: in state space, or of polynomials.
    shapes : tuple of tuples of complex
        Of each mode the shape over several outputs; empty for one output.
    """

    file: str | None
    sha256: str | None
    sampling_rate: float
    estimation_samples: int
    validation_samples: int
    orders: Orders | None
    bic: float
    prediction_error_percent: float
    simulation_error_percent: float
    fitted_state_error_percent: float
    checks: tuple[Check, ...]
    modes: tuple[Mode, ...]
    trusted: tuple[bool, ...]
    gain_db: tuple[float, ...]
    made_from: dict[str, str]
    multichannel_model: str | None = None
    shapes: tuple[tuple[complex, ...], ...] = ()

    @property
    def model(self) -> str:
        """The model in a few words."""
        return self.multichannel_model or str(self.orders)

    @property
    def failed(self) -> list[Check]:
        """The checks that headlines count as failed."""
        return failed_checks(self.checks)

    def n_checks(self, passed: bool | None) -> int:
        """Number of checks with an outcome: passed, failed whatever their grade, not judged."""
        return sum(check.passed is passed for check in self.checks)


Entry = DatasetSummary | IncompleteDataset
"""A data set in a list of all data sets."""


def summarize(
    model: ModelRecord,
    validation: Validation,
    spectrum: SpectrumSummary,
    phases: Mapping[str, PhaseSelection],
    recording: RecordingInfo,
    made_from: Iterable[str | Path] = (),
) -> DatasetSummary:
    """Summarize one data set.

    Parameters
    ----------
    model : ModelRecord
    validation : Validation
    spectrum : SpectrumSummary
    phases : mapping of str to PhaseSelection
    recording : RecordingInfo
    made_from : iterable of path
        The files of these results; the summary holds their checksums.
    """
    return DatasetSummary(
        file=", ".join(each.path for each in recording.files) or None,
        sha256=", ".join(each.sha256 for each in recording.files) or None,
        sampling_rate=model.sampling_rate,
        estimation_samples=model.transforms.estimation_samples,
        validation_samples=model.transforms.validation_samples,
        orders=model.orders,
        bic=model.bic,
        prediction_error_percent=validation.prediction_error_percent,
        simulation_error_percent=validation.simulation_error_percent,
        fitted_state_error_percent=validation.fitted_state_error_percent,
        checks=tuple(checks(model, validation, spectrum, phases, recording)),
        modes=tuple(model.modes),
        trusted=tuple(_trusted(model, validation)),
        gain_db=_gain_outline(model),
        made_from={Path(file).name: sha256_of_file(file) for file in made_from},
    )


def _trusted(model: ModelRecord, validation: Validation) -> list[bool]:
    evidence = {each.mode.pole: each for each in validation.modes}
    return [
        mode.pole in evidence and not doubts(evidence[mode.pole], model.sampling_rate)
        for mode in model.modes
    ]


def _gain_outline(model: ModelRecord) -> tuple[float, ...]:
    """The largest gain of each band, in decibels to one decimal."""
    bands = np.linspace(0.0, model.sampling_rate / 2, 32 * GAIN_BANDS + 1)[1:]
    own = model.polynomials
    response = own.frequency_response if own.has_input else own.noise_response
    gain = np.abs(response(bands)).reshape(GAIN_BANDS, -1).max(axis=1)
    with np.errstate(divide="ignore"):
        return tuple(np.round(20.0 * np.log10(gain), 1).tolist())


def recorded_modes(summary: DatasetSummary) -> list[RecordedMode]:
    """The modes of a data set, as they are followed over recordings."""
    return [
        RecordedMode(
            mode.frequency_hz,
            mode.damping_ratio,
            mode.frequency_se_hz,
            mode.damping_se,
            trusted,
            shape,
        )
        for mode, trusted, shape in zip(
            summary.modes,
            summary.trusted,
            summary.shapes or ((),) * len(summary.modes),
            strict=True,
        )
    ]


def read_entry(files: DatasetFiles, required: Collection[str] = (), pending: bool = False) -> Entry:
    """Read the summary of a data set, or find out why its results are not whole.

    Parameters
    ----------
    files : DatasetFiles
    required, pending
        As of :func:`evopem.results.identity.incompleteness`.
    """
    try:
        fault = incompleteness(files, required, pending)
        return load(DatasetSummary, files.summary) if fault is None else fault
    except InputError as error:
        return IncompleteDataset("failed", str(error))
    except Exception as error:
        return IncompleteDataset("failed", f"{files.folder}: cannot be read ({error}).")


def fleet_table(entries: Mapping[str, Entry]) -> pd.DataFrame:
    """Put every mode of every data set into one table.

    A data set without modes, or without complete results, has one row. Cells without a value are
    missing.

    Parameters
    ----------
    entries : mapping of str to DatasetSummary or IncompleteDataset
        By the names of the data sets.

    Returns
    -------
    pandas.DataFrame
    """
    import pandas as pd

    names = dict.fromkeys(
        check.name
        for entry in entries.values()
        if isinstance(entry, DatasetSummary)
        for check in entry.checks
    )
    check_columns = [check_column(name) for name in names]
    types = _COLUMN_TYPES | dict.fromkeys(check_columns, "boolean")
    rows = [row for name, entry in entries.items() for row in _rows(name, entry)]
    return pd.DataFrame(rows, columns=list(types)).astype(types)


def without_formulas(table: pd.DataFrame) -> pd.DataFrame:
    """Put an apostrophe before text that a spreadsheet program would take for a formula.

    Numbers are not changed.
    """
    safe = table.copy()
    for column in table.columns[table.dtypes == "string"]:
        text = table[column]
        starts = text.str.startswith(_FORMULA_START, na=False)
        safe[column] = text.mask(starts, "'" + text)
    return safe


def check_column(name: str) -> str:
    """Name of a check's column in the table."""
    return "check_" + re.sub(r"\W+", "_", name.lower()).strip("_")


_ERRORS = (
    "prediction_error_percent",
    "simulation_error_percent",
    "fitted_state_error_percent",
)
_MODE = ("frequency_hz", "frequency_se_hz", "damping_percent", "damping_se_percent")
_COLUMN_TYPES = (
    dict.fromkeys(("dataset", "status", "problem", "file", "sha256"), "string")
    | {"sampling_rate": "float64"}
    | dict.fromkeys(("estimation_samples", "validation_samples"), "Int64")
    | {"model": "string"}
    | dict.fromkeys(ORDER_NAMES, "Int64")
    | dict.fromkeys(("bic", *_ERRORS), "float64")
    | dict.fromkeys(("failed_checks", "mode"), "Int64")
    | dict.fromkeys(_MODE, "float64")
)


def _rows(name: str, entry: Entry) -> list[dict[str, object]]:
    if isinstance(entry, IncompleteDataset):
        return [{"dataset": name, "status": entry.status, "problem": entry.problem}]
    own = {
        "dataset": name,
        "status": "complete",
        "file": entry.file,
        "sha256": entry.sha256,
        "sampling_rate": entry.sampling_rate,
        "estimation_samples": entry.estimation_samples,
        "validation_samples": entry.validation_samples,
        "model": entry.model,
        **(entry.orders.single._asdict() if entry.orders else dict.fromkeys(ORDER_NAMES)),
        "bic": entry.bic,
        **{error: getattr(entry, error) for error in _ERRORS},
        "failed_checks": len(entry.failed),
        **{check_column(check.name): check.passed for check in entry.checks},
    }
    modes = [
        {
            "mode": number,
            "frequency_hz": mode.frequency_hz,
            "frequency_se_hz": mode.frequency_se_hz,
            "damping_percent": 100.0 * mode.damping_ratio,
            "damping_se_percent": 100.0 * mode.damping_se,
        }
        for number, mode in enumerate(entry.modes, start=1)
    ]
    return [own | mode for mode in modes or [{}]]
