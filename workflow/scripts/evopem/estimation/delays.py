"""Delays of the inputs, from ARX models of several orders."""

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from evopem.arrays import Array, one_blas_thread
from evopem.estimation.impulse_response import LAGS, PAST, delay_evidence
from evopem.signals.least_squares import chunks, triangle_of
from evopem.signals.recording import Recording, Segment, total_samples

# Orders of the ARX models.  A disturbance at the output needs many lags in an ARX model; with few
# of them, later lags of the input seem to explain what is missing.
ORDERS = (1, 2, 3, 4, 6, 8, 12, 16)
LONGEST_DELAY, SHORT_DELAY = 200, 10
# A delay takes up to this share of the samples away from the comparison: of 120 recordings of 160
# to 1,200 samples with delays to 60, 3 were wrong by more than 2 with a fifth, none with a third.
LONGEST_SHARE = 3
SAMPLES_PER_COEFFICIENT = 5  # samples for each coefficient of an output
# Difference of BIC, times the samples, that decides nothing: the smallest of such delays is taken.
AS_WELL = 2.0
# Probability of delays that are called likely together, and score up to which there is little
# evidence against one of a slow input, whose first coefficients hardly count: odds of 12 to 1.
LIKELY, LITTLE = 0.95, 5.0
# Score of all but the best delay and its neighbours that leaves no doubt of ARX models; they are
# doubted where an input has less than this share of its power in the upper half of the frequencies.
CLEAR, SLOW = 20.0, 0.1
CERTAIN_DELAY = 2  # delay of slow inputs of several channels up to which ARX models are not doubted
# Shares of a lag's size, and of the outputs' power, that are rounding.
DEPENDENT, FLOOR = 1e-9, 1e-14
ROUNDS = 5  # rounds over the inputs; the choice hardly ever changes after the second one


def longest_delay(segments: Sequence[Segment]) -> int:
    """The longest delay that segments can tell, in samples."""
    return min(LONGEST_DELAY, max(segment.samples for segment in segments) // LONGEST_SHARE)


def estimate_delays(
    recording: Recording,
    largest: int | Sequence[int] | None = None,
    smallest: int | Sequence[int] = 0,
) -> tuple[int, ...]:
    """Delay nk of each input in samples, 0 for one that acts on the same sample.

    Parameters
    ----------
    recording : Recording
        Each of its recordings has a constant.
    largest, smallest : int or sequence of int
        Delays tried, both included, of all inputs or of each; up to 200 by default, and to a
        third of the samples.

    Examples
    --------
    >>> u = np.random.default_rng(1).standard_normal((500, 2))
    >>> y = np.zeros((500, 1))
    >>> y[40:, 0] = u[40:, 0] + u[:-40, 1]
    >>> y += 0.1 * np.random.default_rng(2).standard_normal((500, 1))
    >>> estimate_delays(Recording(u, y, 1.0))
    (0, 40)
    """
    count = len(recording.input_names)
    high = longest_delay(recording.segments) if largest is None else largest
    low = np.broadcast_to(smallest, count).tolist()
    limits = list(zip(low, np.broadcast_to(high, count).tolist(), strict=True))
    return tuple(known.delay for known in delays_by_criterion(recording.segments, limits))


class ArxDelay(NamedTuple):
    """The delay of an input by ARX models."""

    delay: int
    criteria: Array
    """BIC of a sample at each delay that is tried"""
    longest: int
    """the longest delay that the input may have"""


def delays_by_criterion(
    segments: Sequence[Segment], limits: Sequence[tuple[int, int]]
) -> list[ArxDelay]:
    """Delay of each input by the BIC of ARX models, the other inputs at their own delays.

    The models of a delay have orders na of :data:`ORDERS` and nb <= na; the lowest BIC counts.  Of
    an input that explains nothing, the best of many delays lowers it by up to twice the logarithm
    of their number: long delays must be better by that much, and short ones for their number.  An
    input without which BIC is lower has the smallest delay.  So it has where samples are few, and
    the criterion is NaN.  Where lags before a long delay clearly explain more beside those behind
    it, the delay is a short one.  ``limits``: delays tried of each input, both included.
    """
    lags = max((high for _, high in limits), default=0) + max(ORDERS)
    # As many rows as lags are left, whatever delays are asked for.
    lags = max(min(lags, max(segment.samples for segment in segments) // 2), 1)
    unknown = np.full(1, np.nan)
    decided = [ArxDelay(low, unknown, high) for low, high in limits]
    with one_blas_thread():
        problem = _Regression(segments, lags, min(max(ORDERS), lags))
        if problem.count < SAMPLES_PER_COEFFICIENT * problem.fewest:
            return decided
        for _ in range(ROUNDS):
            before = [known.delay for known in decided]
            for j, (low, high) in enumerate(limits):
                others = {i: known.delay for i, known in enumerate(decided) if i != j}
                decided[j] = problem.delay(j, others, low, high)
            if [known.delay for known in decided] == before or len(limits) == 1:
                break
    return decided


class InputDelay(NamedTuple):
    """The delay of an input, and what the samples tell of it."""

    delay: int
    likely: tuple[int, ...]
    """those that have 95 % of the probability together"""
    scores: Array
    """minus twice the logarithm of the probability of each delay over that of the likeliest one"""
    early: int
    """a short delay that is not clearly refuted, or the same"""


def likely_delays(
    segments: Sequence[Segment], limits: Sequence[tuple[int, int]]
) -> list[InputDelay]:
    """Delay of each input, the smallest likely one against which there is little evidence.

    A model of a shorter delay contains that of the system, one of a longer delay does not.  But 0
    has to be the likeliest: what feedback is left unnoticed acts on the same sample.
    ``limits``: delays tried of each input, in samples, both included.
    """
    several = segments[0].inputs.shape[1] * segments[0].outputs.shape[1] > 1
    # Of one channel each way the scores below hold those of ARX models.
    nothing = [ArxDelay(low, np.zeros(1), high) for low, high in limits]
    by_arx = delays_by_criterion(segments, limits) if several else nothing
    delays, decided = [known.delay for known in by_arx], []
    for place, ((low, _), known) in enumerate(zip(limits, by_arx, strict=True)):
        slow = _is_slow(segments, place)
        # Of several channels ARX models know the past of all outputs.
        doubted = not several or (slow and delays[place] > CERTAIN_DELAY)
        if doubted:
            scores = delay_scores(segments, delays, place, range(low, known.longest + 1))
        else:
            scores = np.nan_to_num(total_samples(segments) * known.criteria)
        scores = scores - scores.min()
        order, shares = np.argsort(scores), np.exp(-0.5 * np.sort(scores))
        count = int(np.searchsorted(np.cumsum(shares), LIKELY * shares.sum())) + 1
        likely = tuple(sorted((low + order[:count]).tolist()))
        if doubted:
            against = LITTLE if slow else AS_WELL
            delays[place] = next(k for k in likely if scores[k - low] <= (against if k else 0.0))
        short, early = scores[: max(SHORT_DELAY + 1 - low, 0)], delays[place]
        if early > SHORT_DELAY and np.min(short, initial=np.inf) <= CLEAR:
            early = low + int(np.argmin(short))
        decided.append(InputDelay(delays[place], likely, scores, early))
    return decided


def delay_scores(
    segments: Sequence[Segment], delays: Sequence[int], place: int, tried: range
) -> Array:
    """Minus twice the logarithm of the probability of each delay of an input, but for a constant.

    The other inputs have their ``delays``.  By ARX models and by predictors whose coefficients have
    a prior, each with half of the probability: the BIC counts each coefficient alike, and where the
    input has power at few frequencies, or the noise does not pass through the poles of the plant,
    an ARX model needs many that the samples hardly tell; a wrong delay saves some.  Where ARX
    models leave no doubt, by these alone.  Delays up to 10 samples have half of the prior
    probability.  Of several outputs the product of each alone.
    """
    longest = max(segment.samples for segment in segments)
    lags = max(min(tried[-1] + LAGS, longest // 2), 1)
    tried = range(tried[0], max(min(tried[-1], lags - 1), tried[0]) + 1)
    others = {i: delay for i, delay in enumerate(delays) if i != place}
    is_long = np.array(tried) > SHORT_DELAY
    short = max(int(np.sum(~is_long)), 1)
    total = 2.0 * np.log(max(int(np.sum(is_long)) / short, 1.0)) * is_long
    with one_blas_thread():
        for output in range(segments[0].outputs.shape[1]):
            alone = [segment.of_output(output) for segment in segments]
            problem = _Regression(alone, lags, min(PAST, lags))
            if problem.count < SAMPLES_PER_COEFFICIENT * problem.fewest:
                continue
            by_arx = problem.count * problem.criteria(place, others, tried[0], tried[-1])[0]
            apart = np.abs(np.arange(len(tried)) - int(np.argmin(by_arx))) > 1
            clear = np.all(by_arx[apart] > by_arx.min() + CLEAR) and not _is_slow(alone, place)
            by_prior = np.inf if clear else problem.evidence(place, others, tried)
            total -= 2.0 * np.logaddexp(-0.5 * by_arx, -0.5 * by_prior)
    return np.asarray(total)


def is_of_feedback(segments: Sequence[Segment]) -> bool:
    """Whether feedback explains better than a delay of 0 what inputs and outputs share at once.

    Both make their innovations correlated, of the same likelihood (Gevers & Anderson 1981). The
    BIC of ARX models of both tells which of them needs less: outputs behind a delay and inputs that
    know their same sample, or other pairs.  All channels have one model each way: of many pairs
    alone, one does so by chance, and another channel acts in place of the input's own.
    """
    pairs = [Segment(s.outputs, s.inputs, s.recording) for s in segments]
    with one_blas_thread():
        of_outputs, of_inputs = _at_once(segments), _at_once(pairs)
    others = min(of_outputs[:2]) + min(of_inputs[1:])
    return of_outputs[1] + of_inputs[0] + AS_WELL < others


def _at_once(segments: Sequence[Segment]) -> list[float]:
    """Lowest BIC of ARX models of the outputs, with lags of the inputs from 0 on, from 1 on, or
    none; infinite where too few samples, or an exact model, leave no likelihood."""
    lags = max(min(max(ORDERS), max(segment.samples for segment in segments) // 2), 1)
    problem = _Regression(segments, lags, lags)
    n, lowest, ny, m = problem.count, [math.inf] * 3, problem.outputs, problem.m
    stop = problem.triangle.shape[1] - ny
    if n < SAMPLES_PER_COEFFICIENT * problem.fewest:
        return lowest
    exact = FLOOR * np.sum(problem.triangle[:, stop:] ** 2, axis=0)
    for past in (0, *problem.orders):
        base = [*range(stop - problem.constants, stop), *range(past * ny)]
        for first in (0, 1):
            lagged = (problem._columns(i, first, max(problem.orders)) for i in range(m))
            columns = [*base, *chain(*zip(*lagged, strict=True))]
            at = [*columns, *range(stop, stop + ny)]
            rows: Array = np.asarray(np.linalg.qr(problem.triangle[:, at], mode="r"))[:, -ny:]
            left = np.cumsum((rows[:, :, None] * rows[:, None])[::-1], axis=0)[::-1]
            if len(left) < len(at) or np.any(np.diagonal(left[len(columns)]) <= exact):
                return [math.inf] * 3
            # As many lags of each input, from none on.
            counts = np.arange(len(base), len(columns) + 1, m)
            sizes = np.linalg.slogdet(left[counts] + np.diag(exact))[1]
            bic = n * sizes + math.log(n) * ny * counts
            lowest[first], lowest[2] = min(lowest[first], *bic[1:]), min(lowest[2], bic[0])
    return lowest


def _is_slow(segments: Sequence[Segment], place: int) -> bool:
    """Whether an input has hardly any power in the upper half of the frequencies."""
    powers = np.zeros(2)
    for segment in segments:
        lines = np.abs(np.fft.rfft(segment.inputs[:, place] - segment.inputs[:, place].mean())) ** 2
        powers += [lines[: len(lines) // 2].sum(), lines[len(lines) // 2 :].sum()]
    return bool(powers[1] < SLOW * powers.sum())


class _Regression:
    """All columns of the ARX models, reduced to a triangle of ``count`` rows. Past outputs by lag,
    lags of each input, constants of the recordings, and outputs."""

    def __init__(self, segments: Sequence[Segment], lags: int, past: int) -> None:
        self.lags, self.past = lags, past
        self.m, self.outputs = segments[0].inputs.shape[1], segments[0].outputs.shape[1]
        affordable = total_samples(segments) // SAMPLES_PER_COEFFICIENT
        self.orders = [
            n for n in ORDERS if n <= lags and n * (self.outputs + self.m) <= affordable
        ] or [1]
        recordings = sorted({segment.recording for segment in segments})
        self.count = sum(max(segment.samples - lags, 0) for segment in segments)
        self.triangle = triangle_of(
            self._rows(segment, recordings, first, stop)
            for segment in segments
            for first, stop in chunks(lags, segment.samples)
        )
        self.constants = len(recordings)
        self.fewest = self.outputs + self.m + self.constants

    def _rows(self, segment: Segment, recordings: Sequence[int], first: int, stop: int) -> Array:
        """The rows of samples ``first`` to before ``stop``."""
        u, y = segment.inputs, segment.outputs
        past = (y[first - k : stop - k] for k in range(1, self.past + 1))
        lagged = (u[first - k : stop - k, [j]] for j in range(self.m) for k in range(self.lags + 1))
        constants = np.tile([float(segment.recording == r) for r in recordings], (stop - first, 1))
        return np.column_stack([*past, *lagged, constants, y[first:stop]])

    def _columns(self, j: int, delay: int, count: int) -> range:
        """Columns of ``count`` lags of an input from a delay on, as far as there are any."""
        first = self.outputs * self.past + j * (self.lags + 1)
        return range(first + delay, min(first + delay + count, first + self.lags + 1))

    def delay(self, j: int, others: Mapping[int, int], low: int, high: int) -> ArxDelay:
        """That of an input from ``low`` to ``high``, beside others of known delays."""
        last = max(min(high, self.lags - 1), low)
        criteria, without = self.criteria(j, others, low, last)
        beyond = np.arange(low, last + 1) > SHORT_DELAY
        scores = criteria + 2.0 * np.log(last - low + 1) / self.count * beyond
        does_as_well = scores <= scores.min() + AS_WELL / self.count
        short = 2.0 * math.log(max(int(np.sum(~beyond)), 1)) / self.count
        explains = scores.min() + short < without
        delay = low + (int(np.argmax(does_as_well)) if explains else 0)
        if delay > SHORT_DELAY >= low:
            beside, without = self.criteria(j, {**others, j: delay}, low, low)
            if self.count * (without - beside[0]) > CLEAR:
                criteria = criteria[: SHORT_DELAY + 1 - low]
                return ArxDelay(low + int(np.argmin(criteria)), criteria, SHORT_DELAY)
        return ArxDelay(delay, criteria, high)

    def criteria(
        self, j: int, beside: Mapping[int, int], low: int, high: int
    ) -> tuple[Array, float]:
        """Lowest BIC of a sample over na and nb with lags of an input behind each delay, and
        without, ``beside`` inputs of known delays."""
        stop = self.triangle.shape[1] - self.outputs
        penalty = np.log(self.count) / self.count * self.outputs
        power = np.mean(self.triangle[:, stop:] ** 2, axis=0) + np.finfo(float).tiny
        lowest, without = [], []
        for n in self.orders:
            others = (self._columns(i, delay, n) for i, delay in beside.items())
            constants = range(stop - self.constants, stop)
            base = self.triangle[:, [*constants, *range(n * self.outputs), *chain(*others)]]
            lagged = self.triangle[:, [*self._columns(j, 0, self.lags + 1)]]
            basis = np.linalg.qr(base)[0]
            whole = np.column_stack([lagged, self.triangle[:, stop:]])
            left = triangle_of([whole - basis @ (basis.T @ whole)])
            sizes = np.append(np.linalg.norm(lagged, axis=0), np.zeros(n))
            u = np.column_stack([left[:, : self.lags + 1], np.zeros((len(left), n))])
            y = np.broadcast_to(left[:, self.lags + 1 :], (high - low + 1, len(left), self.outputs))
            lags = sliding_window_view(u, n, axis=1).swapaxes(0, 1)[low : high + 1]
            r: Array = np.asarray(np.linalg.qr(np.concatenate([lags, y], axis=2), mode="r"))
            # Lags that depend on the others explain nothing: what is left of them is rounding.
            independent = np.abs(np.diagonal(r[:, :n, :n], axis1=1, axis2=2))
            independent = independent > DEPENDENT * sliding_window_view(sizes, n)[low : high + 1]
            rows = r[:, :n, n:] * independent[:, :, None]
            explained = np.cumsum(rows[..., :, None] * rows[..., None, :], axis=1)
            alone = left[:, self.lags + 1 :].T @ left[:, self.lags + 1 :]
            errors = np.concatenate([alone[None], (alone - explained).reshape(-1, *alone.shape)])
            values = np.linalg.slogdet(errors / self.count + FLOOR * np.diag(power))[1]
            values += penalty * base.shape[1]
            without.append(values[0])
            terms = penalty * np.arange(1, n + 1)
            lowest.append(np.min(values[1:].reshape(-1, n) + terms, axis=1))
        return np.min(lowest, axis=0), float(np.min(without))

    def evidence(self, j: int, beside: Mapping[int, int], tried: range) -> Array:
        """As :func:`delay_evidence`, of one output; constants and the other inputs have a BIC."""
        stop = self.triangle.shape[1] - 1
        others = (self._columns(i, delay, max(ORDERS)) for i, delay in beside.items())
        free = [*range(stop - self.constants, stop), *chain(*others)]
        kept = [*range(self.past), *self._columns(j, 0, self.lags + 1), stop]
        left = triangle_of([self.triangle[:, [*free, *kept]]])[len(free) :, len(free) :]
        parts = left[:, : self.past], left[:, self.past : -1], left[:, -1]
        values = delay_evidence(*parts, self.count, tried)
        return values + (len(free) * np.log(self.count) - self.count * np.log(self.count))
