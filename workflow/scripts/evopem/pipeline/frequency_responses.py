"""The stage of frequency responses: from the file to a model, its validation and its tables."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from evopem.config.defaults import yaml_text
from evopem.config.settings import DatasetSettings
from evopem.errors import InputError
from evopem.estimation.continuous import in_continuous_time
from evopem.estimation.frequency_fit import MOST_MODES, ResponseFit, fit_responses
from evopem.estimation.model_record import ModelRecord
from evopem.files.atomic import write_table, write_text
from evopem.files.checksums import sha256_of_file
from evopem.files.json_form import save
from evopem.models.parameter_covariance import NORMAL_95
from evopem.models.polynomial import save_model_mat
from evopem.models.response_tables import (
    FREQUENCIES,
    UNKNOWN,
    by_pair,
    resolving_frequencies,
    response_columns,
    time_response_table,
)
from evopem.pipeline.call import Log
from evopem.report.verdict_file import verdict_file
from evopem.results.dataset import read_results
from evopem.results.fleet import summarize
from evopem.results.layout import DatasetFiles
from evopem.signals.measured_files import format_of, local_path
from evopem.signals.prepared_data import StretchOrigin, Transforms
from evopem.signals.readers.frequency_responses import FrequencyResponses, read_responses
from evopem.signals.recording_info import (
    ChannelInfo,
    FileOrigin,
    RecordingInfo,
    check_measured_places,
)
from evopem.validation.checks import Evidence
from evopem.validation.frequency_responses import validate_responses


def identify_responses(
    files: DatasetFiles, settings: DatasetSettings, log: Log | None = None, folder: str | Path = ""
) -> None:
    """Read the frequency responses of a file, fit a model, and write everything that is known."""
    (name,), given = settings.source.all_files, settings.channels
    responses = read_responses(name, given, folder)
    place = f"datasets.{files.name}.geometry"
    check_measured_places(settings.geometry, responses.output_names, place)
    states = settings.automatic.orders.nx if settings.automatic else None
    modes = ((states[0] + 1) // 2, states[1] // 2) if states else (1, MOST_MODES)
    if modes[0] > modes[1]:
        problem = "a model of frequency responses has two states for each mode"
        raise InputError(f"datasets.{files.name}", problem, "give an even number", "orders.nx")
    fit = fit_responses(responses, modes, settings.search.seed, log)
    write_results(files, settings, fit, modes[1], local_path(Path(folder) / name))


def write_results(
    files: DatasetFiles, settings: DatasetSettings, fit: ResponseFit, most: int, path: Path
) -> None:
    """Write all that is known of a fit to the responses of a file; ``most``: modes to be tried."""
    responses = fit.responses
    means = (0.0,) * fit.model.inputs, (0.0,) * fit.model.outputs  # of no samples
    lines = StretchOrigin(0, 0, 0.0, len(responses.frequencies), *means)
    transforms = Transforms(fit.model.sampling_rate, None, (lines,), (), "cut")
    record = ModelRecord.of(fit.estimate, responses, settings.search, transforms, weighting="noise")
    if hold := settings.continuous_time:
        hold = hold if responses.sampling_rate else "zero-order"  # that of the equivalent
        in_s = in_continuous_time(fit.model, None, hold, settings.search)
        record = replace(record, continuous=in_s)
    validation = validate_responses(fit, record.modes, most)
    info = _described(responses, settings, path)
    summary = summarize(Evidence(record, validation, info))
    save(info, files.recording_info)
    save(record, files.model)
    save(validation, files.validation)
    save(summary, files.summary)
    save_model_mat(record.model, files.model_mat, record.continuous)
    _save_tables(files, fit, record, info.sampling_rate / 2.0)
    write_table(files.modes, validation.modes.rows(record.input_names, record.output_names))
    write_text(files.config, yaml_text(settings))
    known = {"settings": settings, "model": record, "validation": validation}
    results = read_results(files, recording_info=info, **known)
    save(verdict_file(results, summary, files), files.verdict)


def _described(
    responses: FrequencyResponses, settings: DatasetSettings, path: Path
) -> RecordingInfo:
    """Origin and channels of responses; the rate is the least that has their frequencies."""
    (name,), given, count = settings.source.all_files, settings.channels, len(responses.frequencies)
    about = sha256_of_file(path), path.stat().st_size, format_of(path)
    origin = FileOrigin(name, *about, given.inputs, given.outputs, count)
    inputs = zip(responses.input_names, responses.input_units, strict=True)
    outputs = zip(responses.output_names, responses.output_units, strict=True)
    roles = [tuple(ChannelInfo(*channel, 0.0) for channel in role) for role in (inputs, outputs)]
    rate = responses.sampling_rate or 2.0 * float(responses.frequencies[-1])
    return RecordingInfo(count, rate, roles[0], roles[1], (origin,))


def _save_tables(files: DatasetFiles, fit: ResponseFit, record: ModelRecord, most: float) -> None:
    """Measured responses, those of the fit up to a frequency (Hz), and what orders were compared.

    Where inputs are held between samples, the model of the record has other responses than the fit.
    """
    responses, shown = fit.responses, resolving_frequencies(record.model, FREQUENCIES)
    names, along = (record.output_names, record.input_names), "frequency_hz"
    error = NORMAL_95 * np.sqrt(fit.variance_factor) / fit.weights
    gain = np.abs(responses.values)
    measured = {
        "frequency_response_gain": gain,
        "frequency_response_gain_lower": np.maximum(gain - error, 0.0),
        "frequency_response_gain_upper": gain + error,
        "frequency_response_phase_deg": np.angle(responses.values, deg=True),
        "coherence": UNKNOWN,
    }
    write_table(files.spectrum, by_pair(*names, along, responses.frequencies, measured))
    shown = shown[shown <= most]
    response, (error, phase_error) = fit.response(shown), fit.relative_errors(shown)
    gain, factor = np.abs(response), np.exp(NORMAL_95 * error)
    of_fit = response_columns(response, gain / factor, gain * factor, phase_error)
    write_table(files.frequency_response, by_pair(*names, along, shown, of_fit))
    times = time_response_table(record.model, *names[::-1], record.plant)
    write_table(files.time_response, times)
    counts = list(fit.criteria)
    columns = {"modes": counts, "bic": list(fit.criteria.values())}
    write_table(files.candidates, columns | {"selected": [str(n == fit.sections) for n in counts]})
