"""Tables of results in one form for any channels, which stand in the columns output and input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from evopem.config.structures import structure_name
from evopem.errors import InputError
from evopem.figures.style import with_unit
from evopem.models.mode_matching import StabilizationPole, stabilization
from evopem.results.dataset import DatasetResults
from evopem.signals.spectral.multitaper import multitaper_spectrum
from evopem.signals.spectral.peaks import spectral_peaks

if TYPE_CHECKING:
    from evopem.signals.spectral.summary import SpectralPeak

SPECTRUM_NFFT = 2048
# Samples of a time response of a state-space model at most.
RESPONSE_SAMPLES = 500
ROOTS = (
    ("a", "pole"),
    ("f", "pole of the plant"),
    ("b", "zero"),
    ("c", "root of C"),
    ("d", "pole of the noise filter"),
)
_RESPONSE = ["frequency_hz", "gain", "gain_lower", "gain_upper", "phase_deg"]


@dataclass(frozen=True)
class Channel:
    """An input or output."""

    name: str  # as recorded
    unit: str
    prepared: str  # after the transforms
    prepared_unit: str

    @property
    def recorded_label(self) -> str:
        """Name with unit, as recorded."""
        return with_unit(self.name, self.unit)

    @property
    def label(self) -> str:
        """Name with unit after the transforms."""
        return with_unit(self.prepared, self.prepared_unit)


Channels = Sequence[Channel]


_FORMS = {
    "ss": "innovations",
    "ss_oe": "output error",
    "ss_oe_drift": "output error with drift",
    "ss_bj": "plant beside a noise model",
}


def structure_words(form: str) -> str:
    """What a structure is called."""
    return _FORMS[form] if form in _FORMS else structure_name(form)


def scores(results: DatasetResults) -> pd.DataFrame:
    """Errors on held-out samples by structure and order, the choice selected."""
    choice = results.choice
    assert choice is not None
    chosen = choice.candidate.structure, choice.candidate.order
    rows = [
        (
            *(structure_words(each.structure), each.order, getattr(each.scores, choice.kind)),
            (each.structure, each.order) == chosen,
        )
        for search in results.searches
        for each in search.candidates
        if each.is_scored
    ]
    return pd.DataFrame(rows, columns=["structure", "order", "error_percent", "selected"])


def frequency_response(
    results: DatasetResults, outputs: Channels, inputs: Channels
) -> pd.DataFrame:
    """Of the model and the estimate from the data; without an input of the noise filter."""
    if results.settings.is_single_channel:
        return _response_of_one(results, outputs, inputs)
    return _responses_of_pairs(results)


def _response_of_one(results: DatasetResults, outputs: Channels, inputs: Channels) -> pd.DataFrame:
    """Of the model and its noise filter, then the multitaper estimate."""
    table, (output,) = results.frequency_response, outputs
    noise = table[["frequency_hz", *(f"noise_{name}" for name in _RESPONSE[1:])]]
    noise = noise.set_axis(_RESPONSE, axis="columns").assign(source="noise filter")
    noise = noise.assign(output=output.name)
    if not results.model.has_input:
        return noise[["source", "output", *_RESPONSE]]
    prefix = "frequency_response_"
    estimate = results.spectrum.rename(columns=lambda name: name.removeprefix(prefix))
    together = pd.concat(
        [
            table[_RESPONSE].assign(source="model"),
            noise,
            estimate[[*_RESPONSE, "coherence"]].assign(source="measured"),
        ],
        ignore_index=True,
    ).assign(output=output.name, input=inputs[0].name)
    return together[["source", "output", "input", *_RESPONSE, "coherence"]]


def _responses_of_pairs(results: DatasetResults) -> pd.DataFrame:
    """Of the model, then the measured one; without an input of the noise filter."""
    table = results.frequency_response
    if not results.model.has_input:
        return _noise_responses(results)
    names = {"measured_gain": "gain", "measured_phase_deg": "phase_deg"}
    measured = table[["output", "input", "frequency_hz", *names, "coherence"]]
    together = pd.concat(
        [
            table[["output", "input", *_RESPONSE]].assign(source="model"),
            measured.rename(columns=names).assign(source="measured"),
        ],
        ignore_index=True,
    )
    return together[["source", "output", "input", *_RESPONSE, "coherence"]]


def _noise_responses(results: DatasetResults) -> pd.DataFrame:
    """From the innovations of each output to it."""
    names = {f"noise_{name}": name for name in _RESPONSE[1:]}
    table = results.frequency_response[["output", "frequency_hz", *names]]
    table = table.rename(columns=names).assign(source="noise filter")
    return table[["source", "output", *_RESPONSE]]


def time_response(results: DatasetResults, outputs: Channels, inputs: Channels) -> pd.DataFrame:
    """Responses to a step and an impulse; without an input of the noise filter, or none."""
    if not results.settings.is_single_channel:
        return _time_responses(results, outputs, inputs)
    table = results.time_response.assign(output=outputs[0].name)
    return table.assign(input=inputs[0].name) if results.model.has_input else table


def _time_responses(results: DatasetResults, outputs: Channels, inputs: Channels) -> pd.DataFrame:
    """Responses to steps and impulses at each input; without an input none."""
    if not results.model.has_input:
        return pd.DataFrame()
    impulse = results.model.plant.impulse_response(RESPONSE_SAMPLES)
    times = np.arange(RESPONSE_SAMPLES) / results.model.sampling_rate
    unknown = {
        f"{name}_{end}": np.nan for name in ("impulse", "step") for end in ("lower", "upper")
    }
    return pd.concat(
        [
            pd.DataFrame(
                {
                    "output": output.name,
                    "input": source.name,
                    "time_s": times,
                    "impulse": impulse[:, row, column],
                    "step": np.cumsum(impulse[:, row, column]),
                    **unknown,
                }
            )
            for row, output in enumerate(outputs)
            for column, source in enumerate(inputs)
        ],
        ignore_index=True,
    )


def spectra(
    results: DatasetResults, outputs: Channels
) -> tuple[pd.DataFrame, dict[str, Sequence[SpectralPeak]]]:
    """Multitaper spectra of the prepared outputs, and the peaks of each by its name."""
    if results.settings.is_single_channel:
        table = results.spectrum[["frequency_hz", "density", "lower", "upper"]]
        peaks: dict[str, Sequence[SpectralPeak]] = {outputs[0].name: results.spectrum_summary.peaks}
        return by_output(outputs, [table]), peaks
    rate, tables, peaks = results.model.sampling_rate, [], {}
    for output, column in zip(outputs, results.prepared.estimation.longest.outputs.T, strict=True):
        table = spectrum_of(column, rate, SPECTRUM_NFFT)
        peaks[output.name] = ()
        if len(table):
            estimate = multitaper_spectrum(column, rate, nfft=SPECTRUM_NFFT)
            peaks[output.name] = spectral_peaks(estimate)
        tables.append(table.drop(columns="white_level"))
    return by_output(outputs, tables), peaks


def roots(results: DatasetResults) -> pd.DataFrame:
    """Roots of polynomials of one input with covariances, else poles of model and predictor."""
    record, unknown = results.model, np.full((2, 2), np.nan)
    if record.orders is not None and record.model.inputs <= 1:
        found = [
            (kind, *root)
            for letter, kind in ROOTS
            for root in record.polynomials.uncertain_roots(letter)
        ]
    else:
        model = record.state_space
        kinds = (("pole", model.poles()), ("root of C", model.predictor_poles()))
        shown = kinds if record.has_noise_model else kinds[:1]
        found = [(kind, root, unknown) for kind, values in shown for root in values]
    true = [mode.pole for mode in results.truth.modes] if results.truth else []
    return _roots_table(found, true)


def poles_of_orders(results: DatasetResults) -> list[StabilizationPole]:
    """Poles over the orders, each compared with the next lower order."""
    table = results.validation.modes
    by_order: dict[int, list[Any]] = {order: [] for order in table.orders}
    for pole in table.poles:
        by_order.setdefault(pole.order, []).append(pole)
    return stabilization(by_order)


def signals(results: DatasetResults, outputs: Channels, inputs: Channels) -> pd.DataFrame:
    """All channels as recorded and as used."""
    prepared, recording = results.prepared, results.recording
    begin = prepared.estimation.samples / prepared.estimation.sampling_rate
    names = [*(f"input_{each.name}" for each in inputs), *(f"output_{o.name}" for o in outputs)]
    tables = []
    for stage, part, first in (
        ("recorded", recording, 0.0),
        ("estimation", prepared.estimation, 0.0),
        ("validation", prepared.validation, begin),
    ):
        time = first + np.arange(part.samples) / part.sampling_rate
        columns = np.column_stack([part.inputs[:, : len(inputs)], part.outputs])
        table = pd.DataFrame(columns, columns=names)
        table.insert(0, "time_s", time)
        table.insert(0, "stage", stage)
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def by_output(outputs: Sequence[Channel], tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Tables of the outputs one below the other, with a first column that names the output."""
    named = [
        table.assign(output=output.name)[["output", *table.columns]]
        for output, table in zip(outputs, tables, strict=True)
    ]
    return pd.concat(named, ignore_index=True)


def spectrum_of(signal: np.ndarray, rate: float, nfft: int) -> pd.DataFrame:
    """Multitaper spectrum with its band and the level of white noise; empty for a short signal."""
    columns = ["frequency_hz", "density", "lower", "upper", "white_level"]
    try:
        found = multitaper_spectrum(signal, rate, nfft=nfft)
    except InputError:
        return pd.DataFrame(columns=columns, dtype=float)
    values = (found.frequencies, found.density, found.lower, found.upper)
    table = pd.DataFrame(dict(zip(columns, values, strict=False)))
    return table.assign(white_level=2.0 * float(np.var(signal)) / rate)


def _roots_table(
    found: Sequence[tuple[str, complex, np.ndarray]], true: Sequence[complex]
) -> pd.DataFrame:
    unknown = np.full((2, 2), np.nan)
    both = [root for pole in true for root in (pole, pole.conjugate())]
    rows = [
        (kind, root.real, root.imag, abs(root), c[0, 0], c[1, 1], c[0, 1])
        for kind, root, c in [*found, *(("true pole", root, unknown) for root in both)]
    ]
    columns = ["kind", "real", "imag", "radius", "variance_real", "variance_imag", "covariance"]
    return pd.DataFrame(rows, columns=columns)
