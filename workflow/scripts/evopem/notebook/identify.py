"""Identification of signals in memory, by the stages of the workflow in this process."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from evopem.config.dataset_names import RESULTS_FOLDER
from evopem.config.defaults import complete
from evopem.config.environment import check_environment
from evopem.config.schema import schema_file
from evopem.config.settings import DatasetSettings
from evopem.config.yaml_form import read_settings
from evopem.errors import InputError
from evopem.notebook.signals import DATA, GivenSignals, given_recordings, given_signals
from evopem.pipeline.packages import FOR_RESULTS, check_packages
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from evopem.notebook.results import IdentificationResults

RECORDED, VALIDATION = "data.npz", "validation.npz"
"""The files of the signals in the folder of the results."""

_OWN_KEYS = ("file", "validation_file", "input", "output", "time", "sampling_rate", "synthesis")


def identify(
    data: Any,
    output: Any,
    sampling_rate: float | None = None,
    *,
    input: Any = None,  # noqa: A002 - the field's word
    time: Any = None,
    validation: Any = None,
    name: str = "data",
    show_progress: bool = True,
    **keys: Any,
) -> IdentificationResults:
    """Identify a system from signals in memory: one call, the automatic recipe, all results.

    Preparation, delay, structure and orders are decided from the estimation samples, the first
    80 %; the others validate the model. Levels are estimated with the model, so that offsets
    need not be removed.

    Parameters
    ----------
    data : pandas.DataFrame, pandas.Series or array_like, shape (N,)
        A table whose columns ``input`` and ``output`` name; or the samples of the input. None
        where there is no input. A list of tables, or of arrays, is several recordings of one
        system, each with its own initial state and level; the last ones validate.
    output : column label, or pandas.Series or array_like, shape (N,)
        A list of arrays where ``data`` is one.
    sampling_rate : float, optional
        Hz. Left out, it is that of `time`, or of an index of dates, durations or seconds.
    input, time : column label, optional
        Of a table alone.
    validation : pandas.DataFrame, or pair of arrays (input, output), optional
        An independent recording of the same channels for validation. All samples of `data` then
        serve estimation.
    name : str
        Heads the report.
    show_progress : bool
        A bar where tqdm or rich is installed, else a line on standard error.
    **keys
        Keys of a data set's configuration, such as ``structure="oe"``, ``purpose="modes"``,
        ``resample=500`` or ``search={"seed": 2}``. ``recipe="chapter"`` takes the order search of
        the chapter in place of the automatic recipe.

    Returns
    -------
    IdentificationResults
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
    recordings = [
        given_signals(own, target, input, time, sampling_rate, source)
        for own, target, source in given_recordings(data, output)
    ]
    signals = recordings[0]
    held_out = _validation_signals(validation, signals, output, input, time, sampling_rate)
    files_of_signals = [f"{number}-{RECORDED}" for number in range(1, len(recordings) + 1)]
    if len(recordings) == 1:
        files_of_signals = [RECORDED]
    settings = _settings(name, signals, files_of_signals, held_out is not None, keys)
    from threadpoolctl import threadpool_limits

    from evopem.notebook.progress import progress
    from evopem.notebook.results import IdentificationResults
    from evopem.pipeline.identification import identify_recording

    folder = TemporaryDirectory(prefix="evopem-", ignore_cleanup_errors=True)
    root = Path(folder.name)
    for own, file in zip(recordings, files_of_signals, strict=True):
        replace(own, input_name=signals.input_name, output_name=signals.output_name).save(
            root / file
        )
    if held_out is not None:
        held_out.save(root / VALIDATION)
    files = DatasetFiles(str(root / RESULTS_FOLDER / name))
    with threadpool_limits(limits=1, user_api="blas"), progress(show_progress) as announce:
        try:
            identify_recording(files, settings, False, announce=announce, folder=root)
        except InputError as error:
            raise _of_signals(error, files_of_signals) from None
    return IdentificationResults.of(files, settings, folder)


def read_results(folder: str | Path) -> IdentificationResults:
    """Open the results that the workflow, the command or :meth:`IdentificationResults.save` wrote.

    Parameters
    ----------
    folder : path
        The folder of one data set, such as ``results/arm``.

    Raises
    ------
    InputError
        When a file is missing or damaged.
    """
    check_packages(FOR_RESULTS, "read_results", "the tables of the results")
    from evopem.notebook.results import IdentificationResults

    files = DatasetFiles(str(folder))
    return IdentificationResults.of(files, read_settings(files.config))


def _validation_signals(
    given: Any,
    signals: GivenSignals,
    output: Any,
    input: Any,  # noqa: A002
    time: Any,
    sampling_rate: float | None,
) -> GivenSignals | None:
    """The signals of the validation recording, under the names of the others."""
    if given is None:
        return None
    source = "validation"
    if isinstance(given, tuple | list) and len(given) == 2:
        first, second = given
        found = given_signals(first, second, sampling_rate=sampling_rate, source=source)
    elif hasattr(given, "columns"):
        found = given_signals(given, output, input, time, sampling_rate, source)
    else:
        raise InputError(
            source, "it is neither a table nor a pair of signals", "give (input, output)"
        )
    if (
        found.sampling_rate
        and signals.sampling_rate
        and (abs(found.sampling_rate / signals.sampling_rate - 1.0) > 1e-6)
    ):
        raise InputError(
            source,
            f"its sampling rate is {found.sampling_rate:g} Hz, and that of the data is"
            f" {signals.sampling_rate:g} Hz",
            "give recordings of one rate",
        )
    if (found.input is None) != (signals.input is None):
        raise InputError(
            source, "one of the recordings has no input", "give both an input, or none"
        )
    return replace(found, input_name=signals.input_name, output_name=signals.output_name)


def _settings(
    name: str,
    signals: GivenSignals,
    recorded: Sequence[str],
    validated: bool,
    keys: Mapping[str, Any],
) -> DatasetSettings:
    """The settings that a data set of these keys has in a configuration."""
    if signals.sampling_rate is None:
        raise InputError("sampling_rate", "it is not known", "give it in Hz, or an index of times")
    for key in _OWN_KEYS:
        if key in keys:
            raise InputError(key, "it is no key of the analysis", "leave it out")
    own: dict[str, Any] = {
        "recipe": "auto",
        "file": list(recorded),
        "output": signals.output_name,
        "sampling_rate": float(signals.sampling_rate),
    }
    if signals.input is not None:
        own["input"] = signals.input_name
    if validated:
        own["validation_file"] = VALIDATION
    try:
        content = {"datasets": {name: own | dict(keys)}}
        return complete(content, schema_file(), "identify").datasets[name]
    except InputError as error:
        key = error.place.removeprefix(f"datasets.{name}").lstrip(".")
        place = "name" if key == "datasets" else key or "identify"
        raise InputError(place, error.problem, error.remedy) from None


def _of_signals(error: InputError, recorded: Sequence[str]) -> InputError:
    """An error about a file of the signals as one about what was handed over."""
    names = {VALIDATION: "validation"}
    several = len(recorded) > 1
    names |= {file: f"{DATA}[{n}]" if several else DATA for n, file in enumerate(recorded)}
    source, problem = names.get(Path(error.source).name, error.source), error.problem
    for file, name in names.items():
        problem = problem.replace(file, name)
    return InputError(source, problem, error.remedy, error.place)
