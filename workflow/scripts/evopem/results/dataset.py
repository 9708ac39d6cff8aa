"""All results of one data set, read once for figures and report."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from evopem.automatic.candidates import Candidate as ScoredCandidate
from evopem.automatic.candidates import StructureSearch
from evopem.automatic.decision import DecisionRecord
from evopem.automatic.revisions import Revised
from evopem.automatic.varying import Varying
from evopem.config.defaults import read_settings
from evopem.config.order_grid import phases_of_dataset
from evopem.config.settings import DatasetSettings
from evopem.config.structures import WITHOUT_POLES, searched_forms, structure_name
from evopem.errors import InputError
from evopem.estimation.model_record import FORMS, ModelRecord, load_record
from evopem.estimation.order_candidate import PhaseSelection
from evopem.files.checksums import rewritten
from evopem.files.json_form import load
from evopem.models.mode_matching import match_modes, mode_distance
from evopem.models.modes import Mode
from evopem.models.parameter_covariance import NORMAL_95
from evopem.models.setups import Setup
from evopem.results.channel_labels import Channel, Pair
from evopem.results.identity import check_results
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared
from evopem.signals.recording import Recording, load_recording
from evopem.signals.recording_info import FileOrigin, RecordingInfo
from evopem.signals.spectrum_summary import SpectrumSummary
from evopem.synthesis import Truth
from evopem.validation.checks import Check, Evidence, OrderRange, checks
from evopem.validation.checks.search import ranges_of_phases
from evopem.validation.validation import (
    OutputValidation,
    RecordedErrors,
    Validation,
    ValidationTables,
)

ROOTS = (
    ("a", "pole"),
    ("f", "pole of the plant"),
    ("b", "zero"),
    ("c", "root of C"),
    ("d", "pole of the noise filter"),
)
UNKNOWN = np.full((2, 2), np.nan)
NO_SERIES = ValidationTables(*[pd.DataFrame()] * 4)
_RESPONSE = ("gain", "gain_lower", "gain_upper", "phase_deg")
# Within so many half bands of their real part are 95 % of complex errors whose parts are alike.
CIRCULAR_95 = math.sqrt(2.0 * math.log(20.0)) / NORMAL_95


@dataclass(frozen=True)
class StatedDelay:
    """The delay of an input."""

    input: str
    """name"""
    samples: int
    """of the model, until the input acts"""
    likely: tuple[int, ...] | None
    """those with 95 % of the probability together; null where they were not compared"""


@dataclass(frozen=True, eq=False)
class DatasetResults:
    """The results of one data set, as typed objects and tables."""

    settings: DatasetSettings
    recording: Recording | None  # None, like what is prepared, of frequency responses
    recording_info: RecordingInfo
    validation_recording_info: RecordingInfo | None
    prepared: PreparedData | None
    # candidates, frequency_response: as in the CSV files of these names
    candidates: pd.DataFrame
    frequency_response: pd.DataFrame
    model: ModelRecord
    validation: Validation
    validation_tables: ValidationTables
    truth: Truth | None
    decisions: DecisionRecord | None  # of the automatic recipe
    # spectrum, time_response: as in their CSV files, of one channel of each kind
    spectrum: pd.DataFrame
    time_response: pd.DataFrame
    spectrum_summaries: tuple[SpectrumSummary, ...]  # of each output
    # By the names of the phases of the order search, in their order
    phases: dict[str, PhaseSelection]
    searches: tuple[StructureSearch, ...] = ()  # of the automatic recipe, like the revisions
    revised: Revised | None = None
    varying: Varying | None = None  # what moves, where it was tried

    @property
    def name(self) -> str:
        """Name of the data set."""
        return self.settings.name

    @property
    def files(self) -> tuple[FileOrigin, ...]:
        """All recorded files, those for validation last."""
        validation = self.validation_recording_info
        return self.recording_info.files + (validation.files if validation else ())

    @property
    def evidence(self) -> Evidence:
        """What the checks judge; without phases it is the choice of the automatic recipe."""
        given = self.model, self.validation, self.recording_info
        if self.revised is None:
            return Evidence(*given, ranges_of_phases(self.phases))
        ranges = _searched_range(self.revised.choice.candidate, self.searches)
        return Evidence(*given, ranges, tuple(trial.check for trial in self.revised.trials))

    @cached_property
    def checks(self) -> list[Check]:
        """The checks of the model."""
        return checks(self.evidence)

    @cached_property
    def outputs(self) -> tuple[Channel, ...]:
        """The outputs as recorded and as prepared."""
        known = self.recording or self.model
        named = zip(known.output_names, known.output_units, strict=True)
        return tuple(Channel.of_output(*names, self.model.transforms) for names in named)

    @cached_property
    def inputs(self) -> tuple[Channel, ...]:
        """The inputs of the model alike."""
        known = self.recording or self.model
        named = zip(known.input_names, known.input_units, strict=True)
        channels = tuple(Channel.of_input(*names, self.model.transforms) for names in named)
        return channels[: self.model.model.inputs]

    @property
    def of_responses(self) -> bool:
        """Whether the data are frequency responses."""
        return self.recording is None

    @property
    def delays(self) -> tuple[StatedDelay, ...]:
        """Of each input; none of frequency responses."""
        names = () if self.of_responses else self.model.input_names
        likely = self.decisions.likely_delays if self.decisions else ()
        listed = zip_longest(names, self.model.delays[: len(names)], likely[: len(names)])
        return tuple(StatedDelay(*of_input) for of_input in listed)

    @property
    def highest_hz(self) -> float:
        """The highest frequency that is shown."""
        return (self.recording_info if self.of_responses else self.model).sampling_rate / 2

    @property
    def is_single(self) -> bool:
        """Whether there is one output and at most one input."""
        return len(self.outputs) == 1 and len(self.inputs) <= 1

    @property
    def pairs(self) -> list[Pair]:
        """Every output with every input; each output alone where there is no input."""
        sources = self.inputs or (None,)
        return [(output, source) for output in self.outputs for source in sources]

    def pair_title(self, output: Channel, source: Channel | None = None) -> str:
        """What a panel of a pair is called; empty where there is one pair."""
        if len(self.pairs) == 1:
            return ""
        return output.name if source is None else f"{output.name} ← {source.name}"

    @property
    def model_source(self) -> tuple[str, str]:
        """The rows of the model in a table of frequency responses, and how it is labelled."""
        has_input = self.model.has_input
        return ("model", "model G") if has_input else ("noise filter", "noise filter H")

    @property
    def modes(self) -> list[Mode]:
        """The modes that the validation has judged."""
        return [mode.mode for mode in self.validation.modes.modes]

    def setup(self, name: str) -> Setup:
        """What its trusted modes say beside other set-ups of one structure."""
        outputs, inputs = (tuple(c.name for c in side) for side in (self.outputs, self.inputs))
        model = replace(self.model.plant, output_names=outputs, input_names=inputs)
        modes, trusted = model.modes(), self.validation.modes.trusted
        pairs = match_modes(modes, trusted).items()
        alike = [k for k, of in pairs if mode_distance(modes[k], trusted[of]) <= 1.0]
        return Setup.of(name, model, [modes[k] for k in sorted(alike)])

    @property
    def true_modes(self) -> tuple[Mode, ...]:
        """The modes of the truth, where there is one."""
        return self.truth.modes if self.truth else ()

    @property
    def recorded(self) -> RecordedErrors | None:
        """Errors of the only output in recorded units, where these are others."""
        shown = self.model.transforms.changes_output and self.is_single
        return self.validation.outputs[0].recorded if shown else None

    @property
    def worst_first(self) -> list[tuple[Channel, OutputValidation]]:
        """The outputs by decreasing error of the simulation, without an input of the prediction."""
        kind = "simulation" if self.model.has_input else "prediction"

        def severity(pair: tuple[Channel, OutputValidation]) -> float:
            error = getattr(pair[1], f"{kind}_error_percent")
            return -error if np.isfinite(error) else -np.inf

        return sorted(zip(self.outputs, self.validation.outputs, strict=True), key=severity)

    @cached_property
    def scores(self) -> pd.DataFrame:
        """Errors on held-out samples by structure and order, the choice of the recipe selected."""
        if self.revised is None:
            return pd.DataFrame()
        error = f"{self.revised.choice.kind}_error_percent"
        table = self.candidates
        table = table[(table["step"] != "revision") & table[error].notna()]
        table = table.rename(columns={error: "error_percent"}).reset_index(drop=True)
        names = {name: FORMS.get(name) or structure_name(name) for name in set(table["structure"])}
        columns = ["structure", "order", "model", "error_percent", "bic", "selected"]
        return table.replace({"structure": names})[columns]

    @cached_property
    def responses(self) -> pd.DataFrame:
        """Of the model, its noise filter and the data; without an input of the noise filter."""
        table = self.frequency_response
        noise = _response(table, "noise filter", "noise_")
        if not self.inputs:
            return noise.drop(columns=["input", "coherence"])
        measured = _response(self.spectrum, "measured", "frequency_response_")
        model = _response(table, "model", "").assign(coherence=np.nan)
        return pd.concat([model, noise.assign(coherence=np.nan), measured], ignore_index=True)

    @property
    def lowest_hz(self) -> float:
        """That of a period as long as the longest stretch, or the lowest one of responses."""
        longest = max((origin.samples for origin in self.model.transforms.estimation), default=0)
        samples = min(self.validation.residual_samples, longest)
        measured = self.spectrum["frequency_hz"]
        return self.model.sampling_rate / samples if samples else measured[measured > 0.0].min()

    @cached_property
    def roots(self) -> pd.DataFrame:
        """Roots of polynomials of one input with covariances, else poles of model and predictor."""
        record = self.model
        if record.orders is not None and record.model.inputs <= 1:
            table = [
                (kind, *root)
                for letter, kind in ROOTS
                for root in record.polynomials.uncertain_roots(letter)
            ]
        else:
            model = record.state_space
            kinds = {"pole": model.poles()}
            if record.has_noise_model:
                kinds["root of C"] = model.noise_zeros()
            table = [(kind, root, UNKNOWN) for kind, values in kinds.items() for root in values]
        for mode in self.true_modes:
            table += [("true pole", z, UNKNOWN) for z in (mode.pole, mode.pole.conjugate())]
        rows = [
            (kind, root.real, root.imag, abs(root), c[0, 0], c[1, 1], c[0, 1])
            for kind, root, c in table
        ]
        columns = ["kind", "real", "imag", "radius", "variance_real", "variance_imag", "covariance"]
        return pd.DataFrame(rows, columns=columns)


class ResponseErrors(NamedTuple):
    """How well the response of a pair is known."""

    half_band: float  # median half width of the 95 % band of the gain, %; NaN where not known
    percent: float  # 95 % error of all of it
    place: float  # Hz, where most of that is


def response_errors(table: pd.DataFrame, lowest: float) -> list[ResponseErrors]:
    """Of each pair; 0 Hz aside.  The power of errors and of the response are those in a Bode
    diagram from a frequency on, or of a spectrum where that is 0."""
    errors = []
    for _, pair in table.groupby([column for column in ("output", "input") if column in table]):
        inside = pair[(pair["gain"] > 0) & pair["gain_lower"].notna() & (pair["frequency_hz"] > 0)]
        half, f = np.log(inside["gain_upper"] / inside["gain_lower"]) / 2.0, inside["frequency_hz"]
        axis, factor = (np.log(f), CIRCULAR_95) if lowest else (f, 1.0)  # a spectrum has no phase
        power = inside["gain"] ** 2 * (f >= lowest) * (np.gradient(axis) if len(f) > 1 else 1.0)
        squares = power * half**2
        off = factor * math.sqrt(squares.sum() / max(power.sum(), 1e-300))
        place = f.iloc[squares.argmax()] if len(f) else 0.0
        errors.append(ResponseErrors(100.0 * half.median(), 100.0 * off, place))
    return errors


def _response(table: pd.DataFrame, source: str, prefix: str) -> pd.DataFrame:
    """The columns of one response of a table, whose names begin with a prefix."""
    keys = [name for name in ("output", "input", "frequency_hz", "coherence") if name in table]
    values = [f"{prefix}{name}" for name in _RESPONSE if f"{prefix}{name}" in table]
    response = table[[*keys, *values]].rename(columns=lambda name: name.removeprefix(prefix))
    columns = ["source", "output", "input", "frequency_hz", *_RESPONSE, "coherence"]
    return response.assign(source=source).reindex(columns=columns)


def _searched_range(
    chosen: ScoredCandidate, searches: Iterable[StructureSearch]
) -> tuple[OrderRange, ...]:
    """The range of the orders of a structure that were searched; none where it came of a revision.
    A range that nobody gives begins with 1 or 2, of many states of outputs alone further up."""
    tried = [order for s in searches if s.structure == chosen.structure for order in s.orders]
    if not tried:
        return ()
    name, key = "states of the plant", "orders.nx"
    if chosen.polynomials is not None:
        key = "orders.plant"
        without = chosen.structure in WITHOUT_POLES
        name = "coefficients of B" if without else "largest degree of A and F"
    return (OrderRange(name, key, chosen.order, min(tried), max(tried), least=2),)


def read_whole_results(files: DatasetFiles) -> DatasetResults:
    """The results of one data set, read from outside their run: refused unless they are whole."""
    check_results(files)
    return read_results(files)


def read_results(files: DatasetFiles, **known: Any) -> DatasetResults:
    """The results of one data set; an `InputError` names a file that is missing or damaged.

    ``known``: fields that are at hand and need not be read.
    """
    settings = known.get("settings") or read_settings(files.config)
    in_time = settings.channels.frequency is None
    validation_info = files.validation_recording_info
    has_validation = getattr(settings.source, "validation_files", ())

    def of(name: str, read: Callable[..., Any], *arguments: Any, where: Any = True) -> Any:
        if not where:
            return None
        return known[name] if name in known else read(*arguments)

    def tables(*names: str) -> dict[str, pd.DataFrame]:
        return {name: read_table(getattr(files, name)) for name in names}

    def series() -> ValidationTables:
        names = "residual_autocorrelation", "cross_correlation", "simulation", "horizons"
        return ValidationTables(**tables(*names)) if in_time else NO_SERIES

    prepared = of("prepared", load_prepared, files.prepared, files.transforms, where=in_time)
    # An estimate that holds no samples out is one of given orders.
    searched = prepared is None or prepared.transforms.holds_out
    is_automatic = in_time and searched and settings.automatic is not None
    phases = phases_of_dataset(settings) if searched else ()
    summaries, forms = tuple[SpectrumSummary, ...], searched_forms(settings) if is_automatic else ()
    return DatasetResults(
        settings=settings,
        recording=of("recording", load_recording, files.recording, where=in_time),
        recording_info=of("recording_info", load, RecordingInfo, files.recording_info),
        validation_recording_info=of(
            "", load, RecordingInfo, validation_info, where=has_validation
        ),
        prepared=prepared,
        model=of("model", load_record, files.model),
        validation=of("validation", load, Validation, files.validation),
        validation_tables=of("validation_tables", series),
        **tables("candidates", "frequency_response", "spectrum", "time_response"),
        truth=of("truth", load, Truth, files.truth, where=not settings.source.all_files),
        decisions=of("decisions", load, DecisionRecord, files.decisions, where=is_automatic),
        spectrum_summaries=of("", load, summaries, files.spectrum_summary, where=in_time) or (),
        phases=known.get("phases")
        or {phase: load(PhaseSelection, files.phase(phase)) for phase in phases},
        searches=known.get("searches")
        or tuple(load(StructureSearch, files.search(name)) for name in forms),
        revised=of("revised", load, Revised, files.decision("revisions"), where=is_automatic),
        varying=of(
            "varying", load, Varying, files.varying, where=in_time and searched and settings.varying
        ),
    )


def read_table(path: str) -> pd.DataFrame:
    """Read a CSV table of the results."""
    try:
        return pd.read_csv(path)
    except (OSError, ValueError):
        raise InputError(path, "is not a readable table", rewritten(path)) from None
