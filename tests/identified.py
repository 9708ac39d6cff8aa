"""One small data set, identified by the package's own numerics, for tests of what comes after.

:func:`identify` takes a synthetic ARMAX recording through every stage and writes the files of the
results. The fixture ``identified`` (``conftest.py``) keeps them for the whole test session.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from evopem.config.settings import (
    DatasetSettings,
    DelaySettings,
    OrderGrid,
    OrderSettings,
    PreparationSettings,
    ScoringWindow,
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    SyntheticSource,
)
from evopem.estimation.candidate import PhaseSelection
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_selection import (
    complete_estimate,
    estimate_candidates,
    select_candidate,
)
from evopem.files.atomic import write_table
from evopem.files.json_form import save
from evopem.models.armax import Orders
from evopem.models.response_tables import frequency_response_table, modes_table
from evopem.results.dataset import DatasetResults, read_dataset_results
from evopem.results.layout import PHASES, DatasetFiles
from evopem.signals.preparation import prepare, save_prepared
from evopem.signals.recording import Recording, save_recording
from evopem.signals.recording_info import describe_synthetic_recording
from evopem.signals.spectral.multitaper import multitaper_frequency_response, multitaper_spectrum
from evopem.signals.spectral.summary import summarize_spectrum
from evopem.synthesis import synthesize
from evopem.validation.validation import validate

# The true orders, ARMAX(7, 6, 7, 3), lie inside every range but that of the delay, which ends
# at 3: the check of the search ranges therefore fails.
SETTINGS = DatasetSettings(
    name="bench",
    source=SyntheticSource("armax", seed=1, samples=1500, noise=0.1),
    preparation=PreparationSettings(split=SplitSettings(discard=100, estimation=1000)),
    spectrum=SpectrumSettings(nfft=2048),
    order_grid=OrderGrid(
        DelaySettings(orders=(6, 7), nk=(2, 3)),
        OrderSettings(joint=(6, 8), nc=(6, 8), nb=(5, 7)),
    ),
    search=SearchSettings(evaluations=4000),
)
WINDOW = ScoringWindow(residual_start=12, loss_start=40)


def grid_of(phase: str, grid: OrderGrid, selected: Orders | None) -> list[Orders]:
    """The orders that a phase estimates."""

    def inclusive(limits: tuple[int, int]) -> range:
        return range(limits[0], limits[1] + 1)

    if selected is None:
        delay = grid.delay
        return [Orders(k, k, k, nk) for k in inclusive(delay.orders) for nk in inclusive(delay.nk)]
    values = inclusive(getattr(grid.orders, phase))
    if phase == "joint":
        return [Orders(k, k, k, selected.nk) for k in values]
    return [replace(selected, **{phase: k}) for k in values]


def candidates_table(phases: Sequence[PhaseSelection]) -> pd.DataFrame:
    """The columns of ``candidates.csv``."""
    return pd.DataFrame(
        [
            {
                "phase": phase.phase,
                "na": candidate.orders.na,
                "nb": candidate.orders.nb,
                "nc": candidate.orders.nc,
                "nk": candidate.orders.nk,
                "rss": candidate.criteria.rss,
                "bic": candidate.criteria.bic,
                "objective": candidate.criteria.objective,
                "evaluations": candidate.diagnostics.evaluations,
                "max_pole_radius": candidate.max_pole_radius,
                "selected": candidate.orders == phase.orders,
                "max_noise_zero_radius": candidate.max_noise_zero_radius,
                "n_restarts": candidate.diagnostics.n_restarts,
                "n_confirming": candidate.diagnostics.n_confirming,
                "n_local_optima": candidate.diagnostics.n_local_optima,
                "at_stability_bound": candidate.at_stability_bound,
                "n_multistart": candidate.diagnostics.n_multistart,
                "undiscovered_probability": candidate.diagnostics.undiscovered_probability,
            }
            for phase in phases
            for candidate in phase.candidates
        ]
    )


def identify(folder: Path, settings: DatasetSettings = SETTINGS) -> DatasetFiles:
    """Take a synthetic recording through every stage and write all files but figures and report."""
    files = DatasetFiles(str(folder))
    recording, truth = synthesize(settings.source, settings.preparation.transforms)
    save_recording(recording, files.recording)
    save(describe_synthetic_recording(recording), files.recording_info)
    save(truth, files.truth)
    prepared = prepare(recording, settings.preparation)
    save_prepared(prepared, files.prepared, files.transforms)
    data = prepared.estimation
    _write_spectrum(data, settings, files)

    phases: list[PhaseSelection] = []
    for phase in PHASES:
        orders = grid_of(phase, settings.order_grid, phases[-1].orders if phases else None)
        tried = estimate_candidates(data, orders, phase, settings.search, WINDOW)
        phases.append(select_candidate(tried, phase, data, settings.search, WINDOW))
        save(phases[-1], files.phase(phase))
    write_table(files.candidates, candidates_table(phases))

    estimate = complete_estimate(phases[-1].selected, data, settings.search, WINDOW)
    model = estimate.model
    save(ModelRecord.of(estimate, settings.search, prepared.transforms), files.model)
    write_table(files.modes, modes_table(model))
    write_table(files.frequency_response, frequency_response_table(model))
    validation, tables = validate(model, prepared, estimate.window.loss_start)
    save(validation, files.validation)
    write_table(files.residual_autocorrelation, tables.residual_autocorrelation)
    write_table(files.cross_correlation, tables.cross_correlation)
    write_table(files.simulation, tables.simulation)
    return files


def _write_spectrum(data: Recording, settings: DatasetSettings, files: DatasetFiles) -> None:
    chosen = (settings.spectrum.time_halfbandwidth, settings.spectrum.nfft)
    spectrum = multitaper_spectrum(data.output, data.sampling_rate, *chosen)
    response = multitaper_frequency_response(data.input, data.output, data.sampling_rate, *chosen)
    write_table(
        files.spectrum,
        {
            "frequency_hz": spectrum.frequencies,
            "density": spectrum.density,
            "lower": spectrum.lower,
            "upper": spectrum.upper,
            "input_density": multitaper_spectrum(data.input, data.sampling_rate, *chosen).density,
            "frequency_response_gain": response.gain,
            "frequency_response_gain_lower": response.gain_lower,
            "frequency_response_gain_upper": response.gain_upper,
            "frequency_response_phase_deg": response.phase_deg,
            "coherence": response.coherence,
        },
    )
    save(summarize_spectrum(spectrum), files.spectrum_summary)


@dataclass(frozen=True)
class Identified:
    """The files of an identified data set and the results read from them."""

    files: DatasetFiles
    results: DatasetResults


def identify_once(shared: Path) -> Identified:
    """Identify the data set in a folder that worker processes share, unless another one has."""
    folder = shared / SETTINGS.name
    if not folder.exists():
        own = shared / f".{os.getpid()}"
        identify(own / SETTINGS.name)
        with suppress(OSError):  # another worker was first
            (own / SETTINGS.name).rename(folder)
    files = DatasetFiles(str(folder))
    return Identified(files, read_dataset_results(files, SETTINGS))
