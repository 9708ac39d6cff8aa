"""Tables of results in one form for any channels, which stand in the columns output and input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from evopem.config.structures import structure_name
from evopem.errors import InputError
from evopem.estimation.model_record import FORMS
from evopem.figures.style import with_unit
from evopem.models.mode_matching import StabilizationPole, stabilization
from evopem.results.dataset import DatasetResults
from evopem.signals.spectra import multitaper_spectrum

if TYPE_CHECKING:
    from evopem.signals.spectrum_summary import SpectralPeak

# Length of the transforms of the outputs, and of the residuals: coarse, since white noise has no
# lines.
RESIDUAL_NFFT = 1024
ROOTS = (
    ("a", "pole"),
    ("f", "pole of the plant"),
    ("b", "zero"),
    ("c", "root of C"),
    ("d", "pole of the noise filter"),
)
_RESPONSE = ("gain", "gain_lower", "gain_upper", "phase_deg")
UNKNOWN = np.full((2, 2), np.nan)


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


class Tables:
    """The tables of results, made when they are asked for."""

    def __init__(
        self, results: DatasetResults, outputs: Sequence[Channel], inputs: Sequence[Channel]
    ) -> None:
        self.results, self.outputs, self.inputs = results, tuple(outputs), tuple(inputs)
        # As in the CSV files of these names.
        self.simulation = results.validation_tables.simulation
        self.autocorrelation = results.validation_tables.residual_autocorrelation
        self.cross_correlation = results.validation_tables.cross_correlation
        self.horizons = results.validation_tables.horizons

    @cached_property
    def scores(self) -> pd.DataFrame:
        """Errors on held-out samples by structure and order, the choice selected."""
        choice = self.results.choice
        assert choice is not None
        chosen = choice.candidate.structure, choice.candidate.order
        rows = [
            (
                FORMS.get(each.structure) or structure_name(each.structure),
                *(each.order, getattr(each.scores, choice.kind)),
                (each.structure, each.order) == chosen,
            )
            for search in self.results.searches
            for each in search.candidates
            if each.is_scored
        ]
        return pd.DataFrame(rows, columns=["structure", "order", "error_percent", "selected"])

    @cached_property
    def frequency_response(self) -> pd.DataFrame:
        """Of the model, its noise filter and the data; without an input of the noise filter."""
        table = self.results.frequency_response
        noise = _response(table, "noise filter", "noise_")
        if not self.inputs:
            return noise.drop(columns=["input", "coherence"])
        measured = _response(self.results.spectrum, "measured", "frequency_response_")
        model = _response(table, "model", "").assign(coherence=np.nan)
        return pd.concat([model, noise.assign(coherence=np.nan), measured], ignore_index=True)

    @cached_property
    def time_response(self) -> pd.DataFrame:
        """Responses to a step and an impulse; without an input of the noise filter, or none."""
        return self.results.time_response

    @cached_property
    def spectrum(self) -> pd.DataFrame:
        """Multitaper spectra of the prepared outputs."""
        table = self.results.spectrum
        own = table[table["input"] == self.inputs[0].name] if self.inputs else table
        return own[["output", "frequency_hz", "density", "lower", "upper"]].reset_index(drop=True)

    @property
    def peaks(self) -> dict[str, Sequence[SpectralPeak]]:
        """Of each spectrum, by the names of the outputs."""
        summaries = self.results.spectrum_summaries
        names = [output.name for output in self.outputs]
        return {name: each.peaks for name, each in zip(names, summaries, strict=True)}

    @cached_property
    def residual_spectrum(self) -> pd.DataFrame:
        """Spectra of the one-step errors on the validation samples, by output."""
        tables = []
        for output in self.outputs:
            name, table = output.name, self.simulation
            errors = (table[f"output_{name}"] - table[f"predicted_{name}"]).dropna()
            rate = self.results.model.sampling_rate
            tables.append(spectrum_of(errors.to_numpy(dtype=float), rate, RESIDUAL_NFFT))
        return self._by_output(tables)

    def _by_output(self, tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
        """Tables of the outputs one below the other, with a first column that names the output."""
        named = [
            table.assign(output=output.name)[["output", *table.columns]]
            for output, table in zip(self.outputs, tables, strict=True)
        ]
        return pd.concat(named, ignore_index=True)

    @cached_property
    def roots(self) -> pd.DataFrame:
        """Roots of polynomials of one input with covariances, else poles of model and predictor."""
        record = self.results.model
        if record.orders is not None and record.model.inputs <= 1:
            found = [
                (kind, *root)
                for letter, kind in ROOTS
                for root in record.polynomials.uncertain_roots(letter)
            ]
        else:
            model = record.state_space
            kinds = {"pole": model.poles()}
            if record.has_noise_model:
                kinds["root of C"] = model.noise_zeros()
            found = [(kind, root, UNKNOWN) for kind, values in kinds.items() for root in values]
        for mode in self.results.truth.modes if self.results.truth else ():
            found += [("true pole", z, UNKNOWN) for z in (mode.pole, mode.pole.conjugate())]
        rows = [
            (kind, root.real, root.imag, abs(root), c[0, 0], c[1, 1], c[0, 1])
            for kind, root, c in found
        ]
        columns = ["kind", "real", "imag", "radius", "variance_real", "variance_imag", "covariance"]
        return pd.DataFrame(rows, columns=columns)

    @cached_property
    def poles_of_orders(self) -> Sequence[StabilizationPole]:
        """Poles over the orders, each compared with the next lower order."""
        table = self.results.validation.modes
        by_order: dict[int, list[Any]] = {order: [] for order in table.orders}
        for pole in table.poles:
            by_order.setdefault(pole.order, []).append(pole)
        return stabilization(by_order)

    @cached_property
    def signals(self) -> pd.DataFrame:
        """All channels as recorded and as used."""
        prepared, inputs, outputs = self.results.prepared, self.inputs, self.outputs
        begin = prepared.estimation.samples / prepared.estimation.sampling_rate
        names = [*(f"input_{each.name}" for each in inputs), *(f"output_{o.name}" for o in outputs)]
        tables = []
        for stage, part, first in (
            ("recorded", self.results.recording, 0.0),
            ("estimation", prepared.estimation, 0.0),
            ("validation", prepared.validation, begin),
        ):
            columns = np.column_stack([part.inputs[:, : len(inputs)], part.outputs])
            table = pd.DataFrame(columns, columns=names)
            table.insert(0, "time_s", first + np.arange(part.samples) / part.sampling_rate)
            table.insert(0, "stage", stage)
            tables.append(table)
        return pd.concat(tables, ignore_index=True)


def _response(table: pd.DataFrame, source: str, prefix: str) -> pd.DataFrame:
    """The columns of one response of a table, whose names begin with a prefix."""
    own = [name for name in ("output", "input", "frequency_hz", "coherence") if name in table]
    values = [f"{prefix}{name}" for name in _RESPONSE if f"{prefix}{name}" in table]
    found = table[[*own, *values]].rename(columns=lambda name: name.removeprefix(prefix))
    columns = ["source", "output", "input", "frequency_hz", *_RESPONSE, "coherence"]
    return found.assign(source=source).reindex(columns=columns)


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
