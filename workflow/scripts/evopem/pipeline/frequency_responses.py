"""The stage of frequency responses: from the file to a model and its tables."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import gammaincc

from evopem.config.defaults import yaml_text
from evopem.config.settings import DatasetSettings
from evopem.errors import InputError
from evopem.estimation.frequency_fit import MOST_MODES, ResponseFit, fit_responses
from evopem.estimation.model_record import ModelRecord
from evopem.files.atomic import write_table, write_text
from evopem.files.checksums import sha256_of_file
from evopem.files.json_form import save
from evopem.models.modes import Mode
from evopem.models.response_tables import shaped_modes_table
from evopem.pipeline.call import Log
from evopem.results.fleet import GAIN_BANDS, DatasetSummary, ResponseValidation
from evopem.results.layout import DatasetFiles
from evopem.signals.measured_files import format_of, local_path
from evopem.signals.prepared_data import Transforms
from evopem.signals.readers.frequency_responses import FrequencyResponses, read_responses
from evopem.signals.recording_info import ChannelInfo, FileOrigin, RecordingInfo
from evopem.validation.checks import SIGNIFICANCE, Check, failed_checks, p_text

# A mode is trusted whose frequency is known to this share of it, and its damping to that.
FREQUENCY_KNOWN, DAMPING_KNOWN = 0.1, 0.5
# Standard deviations of the correlation of neighbouring lines that chance hardly reaches (0.5 %).
CORRELATED = 2.58


def identify_responses(
    files: DatasetFiles,
    settings: DatasetSettings,
    log: Log | None = None,
    folder: str | Path = "",
) -> None:
    """Read the frequency responses of a file, fit a model, and write everything that is known."""
    (name,), given = settings.source.all_files, settings.channels
    responses = read_responses(name, given, folder)
    states = settings.automatic.orders.nx if settings.automatic else None
    modes = ((states[0] + 1) // 2, states[1] // 2) if states else (1, MOST_MODES)
    if modes[0] > modes[1]:
        problem = "a model of frequency responses has two states for each mode"
        raise InputError(f"datasets.{files.name}", problem, "give an even number", "orders.nx")
    fit = fit_responses(responses, modes, settings.search.seed, log)
    model, frequencies = fit.model, responses.frequencies
    transforms = Transforms(model.sampling_rate, None, (), (), "cut")
    sizes = np.maximum(np.linalg.norm(responses.values, axis=(0, 2)), 1e-300)
    estimate: Any = SimpleNamespace(
        model=model,
        plant_states=model.order,
        objective=fit.error_percent**2 / 100.0,
        fit_percent=100.0 - 100.0 * np.linalg.norm(fit.misfit, axis=(0, 2)) / sizes,
        bic=fit.criteria[fit.modes],
        initial_states=np.zeros(model.order),
        search=fit.search,
        at_stability_bound=False,
        constraints=None,
    )
    given_as: Any = responses  # the names and units of its channels
    record = ModelRecord.of(estimate, given_as, settings.search, transforms, weighting="noise")
    trusted = tuple(_is_trusted(mode, responses) for mode in record.modes)
    validation = ResponseValidation(
        _sentence(fit, checks := _checks(fit, modes), sum(trusted)),
        None if responses.are_absolute else fit.variance_factor,
        responses.sampling_rate is None,
    )
    path = local_path(Path(folder) / name)
    digest, count = sha256_of_file(path), len(frequencies)
    highest = (responses.sampling_rate or 2.0 * float(frequencies[-1])) / 2.0
    about = name, digest, path.stat().st_size, format_of(path), given.inputs, given.outputs, count
    inputs = zip(responses.input_names, responses.input_units, strict=True)
    outputs = zip(responses.output_names, responses.output_units, strict=True)
    roles = [tuple(ChannelInfo(*channel, 0.0) for channel in role) for role in (inputs, outputs)]
    info = RecordingInfo(count, 2.0 * highest, roles[0], roles[1], (FileOrigin(*about),))
    bands = (np.arange(8 * GAIN_BANDS) + 0.5) / (8 * GAIN_BANDS) * highest
    gains = np.linalg.norm(fit.response(bands), axis=(1, 2)).reshape(GAIN_BANDS, -1).max(axis=1)
    summary = DatasetSummary(
        *(name, digest, 2.0 * highest, count, 0, record.text, None, record.bic),
        *(np.nan, fit.error_percent, np.nan, checks, record.modes, trusted),
        tuple(np.round(20.0 * np.log10(np.maximum(gains, 1e-300)), 1).tolist()),
        of_responses=True,
    )
    _save_tables(files, fit, record, trusted)
    save(info, files.recording_info)
    save(record, files.model)
    save(validation, files.validation)
    save(summary, files.summary)
    write_text(files.config, yaml_text(settings))


def _is_trusted(mode: Mode, responses: FrequencyResponses) -> bool:
    """Whether a mode lies among the frequencies, and they determine it."""
    inside = responses.frequencies[0] <= mode.frequency_hz <= responses.frequencies[-1]
    known = mode.frequency_se_hz < FREQUENCY_KNOWN * mode.frequency_hz
    return bool(inside and known and mode.damping_se < DAMPING_KNOWN * mode.damping_ratio)


def _sentence(fit: ResponseFit, checks: Sequence[Check], trusted: int) -> str:
    failed = "; ".join(check.name for check in failed_checks(checks))
    but = f", but not all is well: {failed}" if failed else ""
    modes = f"{fit.modes} modes explain" if fit.modes > 1 else "1 mode explains"
    error = f"{fit.error_percent:.3g} %"
    return f"{modes} the frequency responses to {error}; {trusted} can be trusted{but}."


def _checks(fit: ResponseFit, modes: tuple[int, int]) -> tuple[Check, ...]:
    """The checks that apply to errors at frequencies."""
    errors, searched = fit.errors, fit.search.diagnostics
    squares, freedom = float(np.sum(np.abs(errors) ** 2)), 2 * errors.size - fit.parameters
    p = float(gammaincc(freedom / 2.0, squares / 2.0))
    size, passed = "The variances of the responses are not known: no size is expected.", None
    if fit.responses.are_absolute:
        size = f"Squared errors are {squares / freedom:.3g} times their variances ({p_text(p)})."
        passed = p >= SIGNIFICANCE
    correlation = float(np.sum((errors[:-1].conj() * errors[1:]).real)) / squares
    agreeing = searched.n_confirming + 1
    more = "More modes, a nonlinear structure, or one that changed are likely."
    windows = "Windows of analysers correlate lines as well, and make standard errors too small."
    pattern = correlation * np.sqrt(2.0 * errors.size) >= CORRELATED
    said = f"Errors at neighbouring frequencies have the correlation {correlation:.2g}."
    agreed = f"{agreeing} of {searched.n_restarts} random starts ended at the lowest optimum found."
    tried = f"{fit.modes} of {min(fit.criteria)} to {max(fit.criteria)} have the smallest BIC."
    again, wider = "Give another search.seed and compare.", "Give a wider range of orders.nx."

    def judged(name: str, good: Any, words: str, advice: str, grade: Any = "defect") -> Check:
        good = good if good is None else bool(good)
        return Check(name, good, words, "" if good is not False else advice, grade)

    return (
        judged("Size of the errors", passed, size, more),
        judged("Errors without a pattern", not pattern, said, f"{more} {windows}"),
        judged("Agreement of searches", agreeing > 1, agreed, again, "caution"),
        judged("Number of modes in its range", fit.modes < modes[1], tried, wider, "note"),
    )


def _save_tables(
    files: DatasetFiles, fit: ResponseFit, record: ModelRecord, trusted: Sequence[bool]
) -> None:
    responses, tables = fit.responses, []
    for k, output in enumerate(responses.output_names):
        for j, reference in enumerate(responses.input_names):
            measured, left = responses.values[:, k, j], fit.misfit[:, k, j]
            columns = {
                "frequency_hz": responses.frequencies,
                "output": output,
                "input": reference,
                "measured_gain": np.abs(measured),
                "measured_phase_deg": np.angle(measured, deg=True),
                "gain": np.abs(measured - left),
                "phase_deg": np.angle(measured - left, deg=True),
                "error_gain": np.abs(left),
                "standard_deviation": np.sqrt(2.0 * fit.variance_factor) / fit.weights[:, k, j],
            }
            tables.append(pd.DataFrame(columns))
    write_table(files.frequency_response, pd.concat(tables, ignore_index=True))
    rows = [(k, fit.criteria[k], *mode) for k in fit.diagram for mode in fit.diagram[k].tolist()]
    head = ["modes", "bic", "frequency_hz", "damping_ratio"]
    write_table(files.candidates, pd.DataFrame(rows, columns=head))
    shapes = shaped_modes_table(record.modes, record.input_names, record.output_names)
    shapes["trusted"] = [str(kept) for kept in trusted for _ in record.output_names]
    write_table(files.modes, shapes)
