"""What a measured file holds, before anything is known of it: time, inputs and outputs."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array, one_blas_thread
from evopem.errors import InputError
from evopem.signals.faulty_samples import MOST_MISSING
from evopem.signals.least_squares import triangle_of
from evopem.signals.measured_files import channel_names, read_channels
from evopem.signals.readers.open_file import Channel, Reference
from evopem.signals.time_units import names_time
from evopem.signals.timestamps import has_even_steps, timing
from evopem.signals.transforms import regression_rows

MOST_INCREASE = 0.95  # larger share of the steps of a time that do not decrease

# Largest order of the regressions, and samples for each of their orders at least.
MOST_LAGS, SAMPLES_PER_LAG = 30, 20
MOST_SAMPLES = 10_000  # first samples of a long recording that are enough
SIGNIFICANCE = 0.001  # level of both tests


@dataclass(frozen=True)
class SignalColumn:
    """A channel that may be an input or an output."""

    reference: Reference  # its name where that is unique in the file, else its number from 1
    unit: str  # as the file states it; empty when it does not
    samples: int
    sampling_rate: float | None  # Hz, where the file states one for this channel


@dataclass(frozen=True)
class TimeColumn:
    """A channel of uniform time stamps."""

    reference: Reference
    sampling_rate: float | None  # Hz; None where the unit of the stamps is not certain
    problem: str  # why the rate is not certain, in a sentence; empty where it is


@dataclass(frozen=True)
class FileContents:
    """What a measured file holds."""

    # channels of finite real numbers that are not constant, in the order of the file
    signals: tuple[SignalColumn, ...]
    time: TimeColumn | None  # the first channel of time stamps
    unread: InputError | None = None  # why the first channel that cannot be read cannot


def inspect_file(path: str | Path) -> FileContents:
    """Read all channels of a measured file and tell times from signals.

    A time has even steps, or holds dates, or increases and is named as one. A channel that cannot
    be read, or holds text or a constant, is left out, and one of another length than the times.
    """
    signals: list[SignalColumn] = []
    time: TimeColumn | None = None
    unread: InputError | None = None
    stamps = 0
    for reference, channel in _channels(path, lambda *_: True):
        if isinstance(channel, InputError):
            unread = unread or channel
        elif _is_time(channel) or (time is None and _is_named_time(channel)):
            stamps = stamps or channel.values.size
            time = time or _time_column(channel, reference, str(path))
        elif _is_signal(channel):
            signals.append(
                SignalColumn(reference, channel.unit, channel.values.size, channel.sampling_rate)
            )
    rates = {signal.sampling_rate for signal in signals if signal.samples == stamps}
    sampled = (x for x in signals if x.samples == stamps or x.sampling_rate not in rates)
    return FileContents(tuple(sampled), time, unread)


def time_from_file(path: str | Path, signals: Sequence[Reference]) -> Reference | None:
    """The channel of time stamps of a file that states no sampling rate; None where none is sure.

    It is none of the signals, is named as a time, and has uniform stamps of a known unit.
    """
    first = read_channels(path, signals[:1])[0]
    if first.sampling_rate is not None or first.rate_problem:
        return None

    def may_be(name: str, number: int) -> bool:
        return names_time(name) and {name, number}.isdisjoint(signals)

    for reference, channel in _channels(path, may_be):
        if isinstance(channel, InputError) or channel.values.size != first.values.size:
            continue
        rate = _time_column(channel, reference, str(path)).sampling_rate
        if rate or _is_time(channel):
            return reference if rate else None
    return None


def _channels(
    path: str | Path, wanted: Callable[[str, int], bool]
) -> Iterator[tuple[Reference, Channel | InputError]]:
    """The channels that are wanted by name and number, each with what a configuration calls it."""
    names = channel_names(path)
    for number, name in enumerate(names, start=1):
        if not wanted(name, number):
            continue
        # A name with a * would be taken for a pattern, and "none" for no input.
        plain = name.isprintable() and "*" not in name and name not in ("", "none")
        reference = name if plain and names.count(name) == 1 else number
        try:
            (channel,) = read_channels(path, [number])
        except InputError as error:
            yield reference, error
        else:
            yield reference, channel


def _is_time(channel: Channel) -> bool:
    values = channel.values
    if values.dtype.kind in "Mm":
        return values.size > 1 and values[0] != values[-1]
    if values.dtype.kind not in "fiu" or values.size < 3:
        return False
    times = values.astype(np.float64)
    return bool(np.isfinite(times).all()) and has_even_steps(times)


def _is_named_time(channel: Channel) -> bool:
    """Whether a channel is named as a time and hardly ever decreases, as times that repeat do."""
    values = channel.values
    if values.dtype.kind not in "fiu" or values.size < 3 or not names_time(channel.name):
        return False
    steps = np.diff(values.astype(np.float64))
    return bool(values[-1] > values[0]) and float(np.mean(steps >= 0.0)) > MOST_INCREASE


def _time_column(channel: Channel, reference: Reference, source: str) -> TimeColumn:
    try:
        rate = timing(channel.values, source, channel.name, channel.unit).rate
    except InputError as error:
        return TimeColumn(reference, None, f"{error.problem}; {error.remedy}.")
    return TimeColumn(reference, rate, "")


def _is_signal(channel: Channel) -> bool:
    values = channel.values
    if values.dtype.kind not in "fiub" or values.size < 2:
        return False
    finite = values[np.isfinite(values)]
    return finite.size >= (1.0 - MOST_MISSING) * values.size and np.ptp(finite.astype(float)) > 0.0


@dataclass(frozen=True)
class CausalityTest:
    """Whether the past of one channel improves predictions of the other, in both directions."""

    # p-values of the first channel's past in predictions of the second, and the reverse; NaN where
    # the recording is too short
    forward: float
    backward: float
    lags: int  # order of the regressions

    @property
    def direction(self) -> int:
        """1 where the first channel alone drives the second, -1 for the reverse, 0 for neither."""
        return int(self.forward < SIGNIFICANCE) - int(self.backward < SIGNIFICANCE)


def causality_test(first: Array, second: Array) -> CausalityTest:
    """F-tests of the past of either channel in a regression of the other on its own past.

    An input that no feedback reaches is predicted from its own past as well as from both, and an
    output is not (Granger 1969).  BIC of both regressions together chooses their order.
    """
    x, z = (_standardized(signal[:MOST_SAMPLES]) for signal in (first, second))
    most = min(MOST_LAGS, len(x) // SAMPLES_PER_LAG)
    if most < 1:
        return CausalityTest(np.nan, np.nan, 0)
    rows = len(x) - most
    with one_blas_thread():
        pairs = (x, z), (z, x)
        triangles = [triangle_of(regression_rows(u[:, None], y, most)) for u, y in pairs]

        def criterion(lags: int) -> float:
            left = [max(_remainders(triangle, lags, most)[1], 1e-300) for triangle in triangles]
            return float(np.log(left).sum()) + 4 * lags * np.log(rows) / rows

        lags = min(range(1, most + 1), key=criterion)
        freedom = rows - 2 * lags - 1
        p_values = []
        for restricted, both in (_remainders(triangle, lags, most) for triangle in triangles):
            statistic = (restricted - both) / lags / max(both / freedom, 1e-300)
            p_values.append(float(scipy.special.fdtrc(lags, freedom, max(statistic, 0.0))))
    return CausalityTest(p_values[0], p_values[1], lags)


def _standardized(signal: Array) -> Array:
    centred = np.asarray(signal - np.mean(signal), dtype=float)
    return centred / (float(np.std(centred)) or 1.0)


def _remainders(triangle: Array, lags: int, most: int) -> tuple[float, float]:
    """Sums of squares left by the target's own past, and by both."""
    left = []
    columns = [*range(lags), -2]  # and the constant
    for kept in (columns, [*columns, *range(most + 1, most + 1 + lags)]):
        rest = triangle[:, -1]
        solution = np.linalg.lstsq(triangle[:, kept], rest, rcond=1e-12)[0]
        left.append(float(np.sum((rest - triangle[:, kept] @ solution) ** 2)))
    return left[0], left[1]


INPUT_NAMES = frozenset((
    "u", "in", "input", "excitation", "command", "drive", "stimulus", "force", "torque", "voltage",
    "valve", "heater",
))  # fmt: skip
"""Words that name an input."""
OUTPUT_NAMES = frozenset((
    "y", "out", "output", "response", "acceleration", "acc", "accel", "velocity", "speed",
    "position", "displacement", "angle", "temperature", "level",
))  # fmt: skip
"""Words that name an output."""


@dataclass(frozen=True)
class ChannelRoles:
    """The channels of a file by what they are, and how that was found."""

    input: Reference
    output: Reference
    time: Reference | None  # None where the file states a sampling rate
    test: CausalityTest | None = None  # from the input to the output; None where the names tell

    @property
    def sentence(self) -> str:
        """How input and output were distinguished."""
        pair = f"“{self.input}” is the input and “{self.output}” the output"
        if self.test is None:
            return f"{pair} by their names."
        forward, backward = (
            "p < 0.0001" if p < 1e-4 else f"p = {p:.2g}"
            for p in (self.test.forward, self.test.backward)
        )
        return (
            f"{pair}: the past of the first improves predictions of the second ({forward},"
            f" {self.test.lags} lags), and not the reverse ({backward})."
        )


def roles_of(path: str | Path, timed: bool = True) -> ChannelRoles | None:
    """Tell the channels of a file with two signals, by the words of their names or by causality.

    ``timed``: only of a file with a time or a rate; None where it has none.
    """
    contents = inspect_file(path)
    has_rate = contents.time or all(signal.sampling_rate for signal in contents.signals)
    if timed and not has_rate:
        return None
    source, time = str(path), contents.time.reference if contents.time else None
    if len(contents.signals) != 2:
        names = ", ".join(repr(signal.reference) for signal in contents.signals) or "none"
        problem = f"beside the time there are {len(contents.signals)} channels ({names}), not two"
        raise InputError(source, problem, "name input and output")
    first, second = contents.signals
    inputs, outputs = (named(contents.signals, words) for words in (INPUT_NAMES, OUTPUT_NAMES))
    if len(inputs) == 1 and len(outputs) == 1 and inputs != outputs:
        return ChannelRoles(inputs[0].reference, outputs[0].reference, time)
    if first.samples != second.samples:
        raise InputError(source, "its two channels have different lengths", "name input and output")
    channels = read_channels(path, [first.reference, second.reference])
    signals = np.column_stack([channel.values.astype(float) for channel in channels])
    test = causality_test(*signals[np.isfinite(signals).all(axis=1)].T)
    if test.direction == 0:
        both = test.forward < SIGNIFICANCE
        problem = (
            f"{first.reference!r} and {second.reference!r} cannot be distinguished as input and"
            " output: their names do not say it, and the past of"
            f" {'each' if both else 'neither'} improves predictions of the other at"
            f" {100 * SIGNIFICANCE:g} %"
        )
        raise InputError(source, problem, "name input and output")
    if test.direction > 0:
        return ChannelRoles(first.reference, second.reference, time, test)
    turned = CausalityTest(test.backward, test.forward, test.lags)
    return ChannelRoles(second.reference, first.reference, time, turned)


def named(signals: Iterable[SignalColumn], words: frozenset[str]) -> list[SignalColumn]:
    """The channels whose names hold one of some words."""
    parts = {signal: re.split(r"[^a-z]+", str(signal.reference).casefold()) for signal in signals}
    return [part for part in parts if words.intersection(parts[part])]
