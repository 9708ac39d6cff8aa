"""Identification of signals in memory, by the stages of the workflow in this process."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, cast

from evopem.config.channels import NONE
from evopem.config.configuration import check_environment
from evopem.config.defaults import complete
from evopem.config.keys import STATE_SPACE, one_or_list
from evopem.config.settings import FitSettings, Focus, SearchSettings
from evopem.config.source_checks import RESULTS_FOLDER
from evopem.config.strict_yaml import Keys
from evopem.config.structures import STATE_SPACE_FORMS, STRUCTURES, is_polynomial, plant_order
from evopem.errors import FOR_RESULTS, InputError, check_packages, checked_path
from evopem.files.json_form import save
from evopem.models.orders import Orders, orders_in_state_space, orders_of
from evopem.notebook.signals import DATA, GivenSignals, Wanted, alike, given_recordings
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from evopem.config.constraints import Constraints
    from evopem.config.settings import DatasetSettings
    from evopem.estimation.model_record import Estimate
    from evopem.notebook.results import Results, VaryingResults
    from evopem.signals.recording import Recording

VALIDATION = "validation"
"""What the files of the validation recordings are called, as an error calls them."""

_OWN_KEYS = ("file", "validation_file", "sampling_rate", "synthesis", "frequency")


def identify(
    data: Any,
    output: Any = None,
    sampling_rate: float | None = None,
    *,
    input: Any = None,  # noqa: A002 - the field's word
    time: Any = None,
    time_unit: str | None = None,
    validation: Any = None,
    name: str = "data",
    show_progress: bool = True,
    **keys: Any,
) -> Results:
    """Identify a system from signals in memory: one call, the automatic recipe, all results.

    Preparation, delay, structure and orders are decided from the estimation samples, the first
    80 %; the others validate the model. Levels are estimated with the model, so that offsets
    need not be removed.

    Parameters
    ----------
    data : pandas.DataFrame, pandas.Series or array_like, shape (N,) or (N, m)
        A table whose columns ``input`` and ``output`` name; or the samples of the inputs. None
        where there is no input. Several recordings of one system are a list of these.
    output : column label or list of them; or pandas.Series, DataFrame or array_like
        The outputs: labels of a table, or samples of shape (N,) or (N, l). Of several recordings
        in arrays, a list as well.
    sampling_rate : float, optional
        Hz. Left out, it is that of `time`, or of an index of dates, durations or seconds.
    input, time : column label, or list of them for several inputs, optional
        Of a table alone.
    time_unit : str, optional
        Unit of the times, where it is not stated: s, ms, us, ns, min, h or d.
    validation : pandas.DataFrame, or pair of arrays (input, output), optional
        An independent recording of the same channels for validation, or a list of tables or a
        pair of lists for several. All samples of `data` then serve estimation.
    name : str
        Heads the report.
    show_progress : bool
        A bar with the stage and the time left, written over by the next stage.
    **keys
        Keys of a data set's configuration, such as ``purpose="modes"``, ``resample=500`` or
        ``search={"seed": 2}``. ``recipe="chapter"`` takes the order search of the chapter in place
        of the automatic recipe. `structure` and `orders` are understood as by
        :func:`evopem.estimate` as well: ``structure="oe", orders=(2, 2, 1)`` is one model; a
        mapping such as ``orders={"nf": [1, 4], "nk": 1}`` holds numbers or ranges.

    Returns
    -------
    Results
        Its files lie in a temporary folder for as long as the object exists.

    Raises
    ------
    InputError
        In one sentence: for signals that cannot be used, an unknown sampling rate, an unknown key
        or value, or a package that is missing.

    Examples
    --------
    >>> import evopem, numpy, pandas
    >>> from scipy.signal import lfilter
    >>> u, e = numpy.random.default_rng(1).standard_normal((2, 400))
    >>> y = 3.0 + lfilter([0.0, 1.0], [1.0, -1.5, 0.7], u) + 0.1 * e
    >>> frame = pandas.DataFrame({"u": u, "y": y})
    >>> found = evopem.identify(
    ...     frame, input="u", output="y", sampling_rate=10.0, structure="oe", show_progress=False
    ... )
    >>> round(found.model.modes()[0].frequency_hz, 2)
    0.78
    """
    check_packages(FOR_RESULTS, "identify", "the tables of the results")
    check_environment(os.environ)
    wanted = Wanted(output, input, time, sampling_rate, time_unit)
    recorded = given_recordings(data, wanted)
    held_out = _validation_signals(validation, recorded[0], wanted)
    settings = _settings(name, recorded, held_out, keys)
    from evopem.arrays import one_blas_thread
    from evopem.notebook.results import Results
    from evopem.pipeline.identification import identify_dataset, progress
    from evopem.results.dataset import read_results

    folder = TemporaryDirectory(prefix="evopem-", ignore_cleanup_errors=True)
    root = Path(folder.name)
    for what, signals in ((DATA, recorded), (VALIDATION, held_out)):
        for signal, file in zip(signals, _files(what, signals), strict=True):
            signal.save(root / file)
    files = DatasetFiles(str(root / RESULTS_FOLDER / name))
    with one_blas_thread(), progress(show_progress) as announce:
        try:
            identify_dataset(files, settings, False, announce=announce, folder=root)
        except InputError as error:
            raise _of_signals(error, root) from None
    return Results(files, read_results(files), folder)


def estimate_varying(
    input: Any,  # noqa: A002 - the field's word
    output: Any = None,
    sampling_rate: float = 1.0,
    *,
    schedule: Any = None,
    condition: str = "time",
    orders: Orders | int = 6,
    nk: int = 1,
    basis: Literal["auto", "legendre", "cosine", "spline"] = "auto",
    dimension: int | Literal["auto"] = "auto",
) -> VaryingResults:
    """Estimate a model of one output whose coefficients move with time or with a condition.

    Parameters
    ----------
    input, output, sampling_rate
        As of :func:`evopem.estimate`; a :class:`Recording` holds several recordings as segments.
    schedule : array_like, optional
        What coefficients are functions of: a value for each sample or segment, by default the time.
    condition : str
        What the schedule is called.
    orders : Orders or int
        Those of AR, ARX, ARMA, ARMAX or output error; or the highest order up to which BIC chooses
        among these structures.
    nk : int
        Samples until the inputs act, where the orders do not say it.
    basis, dimension
        Functions of the schedule and their number, by default chosen by BIC.

    Raises
    ------
    InputError
        For several outputs, another structure, and a schedule that does not fit the signals.

    Examples
    --------
    >>> import evopem, numpy
    >>> e, y = numpy.random.default_rng(1).standard_normal(1000), numpy.zeros(1000)
    >>> for t in range(2, 1000):
    ...     y[t] = (1.2 + 0.6 * t / 1000) * y[t - 1] - 0.9 * y[t - 2] + e[t]
    >>> found = evopem.estimate_varying(None, y, 100.0, orders=evopem.Orders(na=2))
    >>> [round(found.model.frozen(t).modes()[0].frequency_hz) for t in (1.0, 9.0)]
    [14, 7]
    """
    import numpy as np

    from evopem.arrays import one_blas_thread
    from evopem.automatic.varying import moving_model
    from evopem.config.settings import VaryingSettings
    from evopem.estimation.varying import Scheduled
    from evopem.notebook.results import VaryingResults
    from evopem.signals.recording import recording_of

    recording = recording_of(input, output, sampling_rate)
    inputs, settings = recording.inputs.shape[1], VaryingSettings(basis, dimension)
    if recording.outputs.shape[1] > 1:
        raise InputError("output", "there are several outputs", "give one: a moving model has one")
    if isinstance(orders, Orders):
        shared = len({*orders.nf}) <= 1 and not (any(orders.nf) and (orders.na or orders.nc))
        if orders.nd or not shared or orders.inputs != inputs:
            remedy = f"give those of AR, ARX, ARMA, ARMAX or output error with {inputs} inputs"
            raise InputError("orders", f"coefficients of {orders} cannot move", remedy)
    scheduled = Scheduled.of(recording, schedule)
    s = scheduled.schedule
    if s.shape != (recording.samples,) or not (np.isfinite(s).all() and np.ptp(s) > 0.0):
        remedy = f"give {recording.samples} finite values, or one for each segment"
        raise InputError("schedule", f"has the shape {s.shape}, or does not vary", remedy)
    with one_blas_thread():
        named = "time" if schedule is None else condition
        varying = moving_model(scheduled, orders, (nk,) * inputs, settings, named)
    return VaryingResults(varying.reason, varying.moves, varying.model)


def read_results(folder: str | Path) -> Results:
    """Open the results that the workflow, the command or :meth:`Results.save` wrote.

    Parameters
    ----------
    folder : path
        The folder of one data set, such as ``results/arm``.

    Raises
    ------
    InputError
        When the results are unfinished, or a file is missing, changed or damaged.
    """
    check_packages(FOR_RESULTS, "read_results", "the tables of the results")
    from evopem.notebook.results import Results
    from evopem.results.dataset import read_whole_results

    files = DatasetFiles(str(checked_path("read_results", folder)))
    return Results(files, read_whole_results(files))


def results_of_estimate(
    estimate: Estimate,
    recording: Recording,
    structure: str,
    level: bool,
    search: SearchSettings | None = None,
    constraints: Constraints | None = None,
    weighting: str = "",
) -> Results:
    """The results of an estimate from all samples of a recording, which judge it as well."""
    from evopem.estimation.model_record import ModelRecord
    from evopem.notebook.results import Results
    from evopem.pipeline.complete_model import level_of, write_model
    from evopem.pipeline.spectrum import estimate_spectrum
    from evopem.pipeline.validation import complete_results
    from evopem.results.dataset import read_results
    from evopem.signals.prepared_data import PreparedData, Transforms, origins_of, save_prepared
    from evopem.signals.recording import save_recording
    from evopem.signals.recording_info import describe_recording

    folder = TemporaryDirectory(prefix="evopem-", ignore_cleanup_errors=True)
    channels = recording.sampling_rate, recording.input_names, recording.output_names
    signals = GivenSignals(recording.inputs, recording.outputs, *channels)
    settings = _settings("data", (signals,), (), {})
    fit = FitSettings(cast("Focus", estimate.focus), constraints)
    settings = replace(settings, search=search or settings.search, fit=fit, varying=None)
    files = DatasetFiles(f"{folder.name}/{RESULTS_FOLDER}/data")
    signals.save(Path(folder.name) / _files(DATA, (signals,))[0])
    origins = origins_of(recording)
    transforms = Transforms(recording.sampling_rate, None, origins, origins, "estimation")
    save_recording(recording, files.recording)
    save(describe_recording(recording), files.recording_info)
    save_prepared(PreparedData(recording, recording, transforms), files.prepared, files.transforms)
    estimate_spectrum(files, settings.spectrum)
    given = settings.search, transforms, level_of("constant" if level else "none", recording)
    record = ModelRecord.of(
        *(estimate, recording, *given), structure=structure, weighting=weighting, **vars(fit)
    )
    write_model(files, record)
    complete_results(files, settings, (), (), None, ())
    return Results(files, read_results(files), folder)


def _validation_signals(
    given: Any, first: GivenSignals, wanted: Wanted
) -> tuple[GivenSignals, ...]:
    """The signals of the validation recordings, under the names of the others."""
    if given is None:
        return ()
    tables = [given] if hasattr(given, "columns") else given
    if not isinstance(tables, tuple | list) or not tables:
        problem = "it is neither a table nor a pair of signals"
        raise InputError(VALIDATION, problem, "give (input, output)")
    are_tables = all(hasattr(table, "columns") for table in tables)
    if not are_tables or hasattr(wanted.output, "iloc"):
        if len(tables) != 2:
            raise InputError(VALIDATION, f"it has {len(tables)} signals", "give (input, output)")
        given, output = tables
        wanted = replace(wanted, output=output, input=None, time=None)
    signals = given_recordings(given, wanted, VALIDATION)
    return tuple(alike(recording, first, VALIDATION) for recording in signals)


def _settings(
    name: str, recorded: Sequence[GivenSignals], held_out: Sequence[GivenSignals], keys: Keys
) -> DatasetSettings:
    """The settings that a data set of these keys has in a configuration."""
    signals = recorded[0]
    if signals.sampling_rate is None:
        raise InputError("sampling_rate", "it is not known", "give it in Hz, or an index of times")
    for key in _OWN_KEYS:
        if key in keys:
            raise InputError(key, "it is no key of the analysis", "leave it out")
    inputs, outputs = signals.input_names, signals.output_names
    written_keys: Keys = {
        "file": one_or_list(_files(DATA, recorded)),
        "input": one_or_list(inputs) if inputs else NONE,
        "output": one_or_list(outputs),
        "sampling_rate": float(signals.sampling_rate),
    }
    keys = _as_lists(_with_ranges(keys, len(inputs)))
    if held_out:
        written_keys["validation_file"] = one_or_list(_files(VALIDATION, held_out))
    try:
        return complete({"datasets": {name: written_keys | keys}}, "identify").datasets[name]
    except InputError as error:
        key = error.place.removeprefix(f"datasets.{name}").lstrip(".")
        place = "name" if key == "datasets" else key or "identify"
        raise InputError(place, error.problem, error.remedy) from None


def _with_ranges(keys: Keys, inputs: int) -> Keys:
    """Keys with ranges in place of a structure and orders as :func:`evopem.estimate` takes them."""
    written, orders = dict(keys), keys.get("orders")
    structure: Any = written.get("structure") or getattr(orders, "structure", None)
    if structure in tuple(STATE_SPACE_FORMS) and "form" not in keys:
        written |= {"structure": STATE_SPACE, "form": structure}
    if orders is None or structure not in (None, STATE_SPACE, *STRUCTURES, *STATE_SPACE_FORMS):
        return written
    is_one = not isinstance(orders, Mapping)
    try:
        if is_one and structure is None and not isinstance(orders, int):
            raise ValueError("they are those of one structure, and none is given")
        if is_one and is_polynomial(structure or STATE_SPACE):
            model = orders_of(structure, orders, max(inputs, 1))
            orders = {name: _alone(getattr(model, name)) for name in STRUCTURES[structure]}
            if keys.get("recipe") == "chapter" and structure != "fir":
                orders["plant"] = orders.pop(plant_order(structure))
            written["structure"] = structure
        elif is_one:
            given = orders_in_state_space(structure or STATE_SPACE, orders)
            orders = {name: _alone(order) for name, order in given.items()}
        if "nk" in orders and "delay" in keys:
            raise ValueError("they hold nk, and the key delay is given as well")
    except ValueError as error:
        remedy = 'write structure="oe", orders=(2, 2, 1), or ranges by name'
        raise InputError("orders", str(error), remedy) from None
    written["orders"] = {"nx" if name == "n" else name: order for name, order in orders.items()}
    if "nk" in orders:
        written["delay"] = {"nk": written["orders"].pop("nk")}
    return written


def _alone(orders: Any) -> Any:
    """An order, or that of each input as a range; of one input as a number."""
    if not isinstance(orders, Sequence):
        return orders
    return [(n, n) for n in orders] if len(orders) > 1 else orders[0]


def _as_lists(value: Any) -> Any:
    """Keys of a configuration with lists where Python has tuples."""
    if isinstance(value, Mapping):
        return {key: _as_lists(item) for key, item in value.items()}
    return [_as_lists(item) for item in value] if isinstance(value, list | tuple) else value


def _files(what: str, recordings: Sequence[GivenSignals]) -> list[str]:
    """Names of the files of recordings, with numbers from 1 where there are several."""
    if len(recordings) == 1:
        return [f"{what}.npz"]
    return [f"{what}-{number}.npz" for number in range(1, len(recordings) + 1)]


def _of_signals(error: InputError, root: Path) -> InputError:
    """An error about a file of the signals as one about what was handed over."""
    file = Path(error.source)
    if file.parent != root:
        return error
    what, _, number = file.stem.partition("-")
    source = f"{what}, recording {number}" if number else what
    return InputError(source, error.problem, error.remedy, error.place)
