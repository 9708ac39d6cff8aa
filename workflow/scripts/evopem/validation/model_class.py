"""Tests of what every model assumes: a linear system that stays as it is, and no feedback.

What a wrong class leaves in the residuals is small at each lag but has a known form.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal, Self

import numpy as np
import scipy  # whose parts load on first use
from numpy.polynomial.legendre import legvander

from evopem.arrays import Array, Flags
from evopem.models.state_space import StateSpaceModel
from evopem.signals.least_squares import ROWS, autoregression, triangle_of
from evopem.signals.spectra import goes_on, repetition_lag
from evopem.validation.held_out_tests import (
    MOST_WHITENING,
    SIGNIFICANCE,
    filtered,
    left_by,
    left_in_blocks,
    scores_statistic,
    whitened,
)
from evopem.validation.responses import HeldOut, unscored_samples

# Degree of the polynomial in time that a change of the system is sought as, and how many times one
# that comes back does so in the longest stretch.
DEGREE = 3
PERIODS = np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0])
LAGS = 4  # lags of the response, and of its powers
# Lags of all inputs, or without any of all outputs, together that a linear model may have lost, and
# samples for each of them.  Of a sweep, whose frequencies come one after the other, or of light
# modes that come and go, what is lost would look like a change.
LOST, FEWEST_PER_LAG = 30, 20
# Share of the variance of whitened residuals below which a dependence matters to no use of a model.
SMALL_SHARE = 0.01
SLOW = 0.01, 0.05  # memory of means that a gain may follow, in shares of a stretch
MOMENTS = 39  # moments at which a change is sought
LATER = 20  # later samples of an input that residuals may act on
FEWEST_PER_REGRESSOR = 10  # samples for each regressor below which there is no test


@dataclass(frozen=True)
class ResidualTest:
    """Test that residuals do not depend on something."""

    p_value: float  # NaN where no test is possible
    share: float  # of the variance of the whitened residuals that it explains, 0 to 1

    @property
    def passed(self) -> bool:
        """Whether a dependence is not significant, or matters to no use."""
        return self.p_value >= SIGNIFICANCE or self.share < SMALL_SHARE


Followed = Literal["", "constant", "linear", "feedback"]
NOT_TESTED = ResidualTest(math.nan, math.nan)
# Of inputs that repeat themselves: what follows the noise would differ from period to period.
REPEATS = ResidualTest(math.nan, 0.0)


@dataclass(frozen=True)
class ModelClass:
    """Tests of the class of a model; of several outputs the lowest p-value times their number."""

    constant: ResidualTest  # the response does not change with time
    linear: ResidualTest  # squares and cubes of inputs and response explain nothing
    without_feedback: ResidualTest  # later inputs do not depend on the residuals
    # Samples until the moment that explains as much as a gradual change, 0 where none does; NaN
    # where it was not sought
    changed_at: float = math.nan
    # Samples after which a change comes back, where that explains more than a trend; else NaN, and
    # 0 where none was sought that comes back
    period: float = math.nan
    # Shares of the residuals that squares and cubes of the response explain alone, and those of
    # the inputs before it, the most of all outputs; empty without an input or nonlinearity
    powers: tuple[float, ...] = ()
    # Of change and nonlinearity what explains less beside the other; feedback where neither is
    follows: Followed = ""


def model_class(records: Sequence[HeldOut]) -> ModelClass:
    """Test the one-step prediction errors of stretches on all samples that are known.

    Regressors are functions of the inputs and of the simulated response, which are independent of
    the noise unless there is feedback; without an input the past output takes their place.
    """
    with np.errstate(all="ignore"):
        parts = [_Stretch.of(record) for record in records]
        if not parts or not all(np.isfinite(stretch.residuals).all() for stretch in parts):
            return ModelClass(NOT_TESTED, NOT_TESTED, NOT_TESTED)
        constant, changing, period = _change(parts)
        linear = _of_outputs(parts, _nonlinear)
        changed_at = _moment(parts, constant.share) if constant.p_value < SIGNIFICANCE else math.nan
        period = math.nan if changed_at > 0.0 and period > 0.0 else period
        judged = linear.p_value < SIGNIFICANCE and bool(parts[0].of_powers)
        powers = _alone(parts, _nonlinear).max(axis=0) if judged else np.empty(0)
        given = changed_at, period, tuple(powers.tolist())
        feedback = feedback_test([(of.residuals, of.inputs) for of in parts], parts[0].direct)
        tests = ModelClass(constant, linear, feedback, *given)
        return replace(tests, follows=_following(parts, tests, changing))


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Residuals and responses of all outputs, (N, l), and the inputs, (N, m)."""

    residuals: Array
    responses: Array
    inputs: Array
    direct: Flags  # (m,): whether an input acts on the same sample
    lost: Sequence[Array]  # (N, lags) each: inputs, or outputs, of earlier samples
    # Response to the squares and to the cubes of the inputs, (N, l) each
    of_powers: tuple[Array, ...]

    @cached_property
    def whitening(self) -> tuple[Array, ...]:
        """Coefficients of the filter that makes the residuals of each output white."""
        return tuple(autoregression(e - e.mean(), MOST_WHITENING) for e in self.residuals.T)

    @classmethod
    def of(cls, record: HeldOut) -> Self:
        """Of all samples but those that states are fitted to."""
        model, u, outputs = record.plant, record.inputs, record.outputs
        first = unscored_samples(record.model, len(u))
        residuals = outputs - record.predicted_from_start()
        direct = acts_at_once(model)
        if not model.inputs:
            past = np.vstack([outputs[:1], outputs[:-1]])
            return cls(
                *(residuals[first:], past[first:], u[first:], direct, _lost(past.T, first), ())
            )
        scaled = (u - u.mean(axis=0)) / np.maximum(np.std(u, axis=0), 1e-300)
        of_powers = tuple(
            model.simulate(np.std(u, axis=0) * scaled**power)[first:] for power in (2, 3)
        )
        simulated = record.simulated_from_rest()
        late = np.maximum(np.array(model.delays) - LAGS, 0)
        lost = _lost([np.pad(u[: len(u) - d, k], (d, 0)) for k, d in enumerate(late)], first)
        return cls(residuals[first:], simulated[first:], u[first:], direct, lost, of_powers)


Rows = Callable[[slice], tuple[Array, Array]]
"""Of some samples: known regressors, and those that are tested."""
Regressors = Callable[[_Stretch, int], Rows]  # those of an output of a stretch


def _lost(signals: Sequence[Array] | Array, first: int) -> Sequence[Array]:
    """Signals at as many lags as a linear model may have lost, from a first sample on."""
    lags = max(min(LOST, len(signals[0]) // FEWEST_PER_LAG) // len(signals), 1)
    return [_lagged(signal, lags)[first:] for signal in signals]


def _lagged(signal: Array, lags: int = LAGS) -> Array:
    """A signal without its mean at lags 0, 1, ..., (N, lags)."""
    centred = np.concatenate([np.zeros(lags - 1), signal - signal.mean()])
    return np.lib.stride_tricks.sliding_window_view(centred, lags)[:, ::-1]


def _changing(stretch: _Stretch, output: int) -> Rows:
    """The response at some lags, and its products with polynomials in time."""
    every = _lagged(stretch.responses[:, output])
    moments = np.linspace(-1.0, 1.0, len(every))

    def rows(part: slice) -> tuple[Array, Array]:
        lagged, time = every[part], legvander(moments[part], DEGREE)[:, 1:]
        products = lagged[:, :, None] * time[:, None, :]
        return np.hstack([lagged, time]), products.reshape(len(lagged), -1)

    return rows


def _waves(stretch: _Stretch, output: int, *, period: float | Array) -> Rows:
    """The response at some lags, and its products with waves of one period, or of each of some."""
    every = _lagged(stretch.responses[:, output])

    def rows(part: slice) -> tuple[Array, Array]:
        lagged = every[part]
        turns = np.arange(len(every))[part, None] / np.atleast_1d(period)
        waves = np.stack([np.cos(2.0 * np.pi * turns), np.sin(2.0 * np.pi * turns)], axis=2)
        products = (waves[:, :, :, None] * lagged[:, None, None, :]).reshape(len(lagged), -1)
        return np.hstack([lagged, waves.reshape(len(lagged), -1)]), products

    return rows


def _nonlinear(stretch: _Stretch, output: int) -> Rows:
    """The response at some lags, and squares and cubes of it and of the inputs."""
    y = stretch.responses[:, output]
    y = (y - y.mean()) / max(float(np.std(y)), 1e-300)
    lagged = [_lagged(v) for v in (y, y**2, y**3, *(of[:, output] for of in stretch.of_powers))]
    return lambda part: (lagged[0][part], np.hstack([signal[part] for signal in lagged[1:]]))


def _operating_point(stretch: _Stretch, output: int) -> Rows:
    """As :func:`_nonlinear`, and the response times slow means of it and of its size: what
    friction or an outflow adds from one level to another, which squares and cubes lack."""
    known, y, means = _nonlinear(stretch, output), stretch.responses[:, output], []
    y = (y - y.mean()) / max(float(np.std(y)), 1e-300)
    for pole in np.exp(-1.0 / np.maximum(len(y) * np.array(SLOW), 10.0)):
        means += [
            scipy.signal.lfilter([1.0 - pole], [1.0, -pole], v - v.mean()) for v in (y, np.abs(y))
        ]
    slow = np.column_stack(means)
    gain = np.hstack([slow, (_lagged(y)[:, :, None] * slow[:, None]).reshape(len(y), -1)])
    return lambda part: (known(part)[0], np.hstack([known(part)[1], gain[part]]))


def _steps(stretch: _Stretch, output: int) -> Rows:
    """The response at some lags, and from each moment on alone."""
    changing, time = _changing(stretch, output), np.arange(len(stretch.inputs))
    moments = np.arange(1, MOMENTS + 1) / (MOMENTS + 1) * len(time)

    def rows(part: slice) -> tuple[Array, Array]:
        lagged, later = changing(part)[0], time[part, None, None] >= moments[:, None]
        return lagged, (lagged[:, None, :LAGS] * later).reshape(len(lagged), -1)

    return rows


def _blocks(stretch: _Stretch, output: int, rows: Rows) -> Iterator[Array]:
    """Known regressors, tested ones and residuals, all whitened, in blocks of rows."""
    e, whitening = stretch.residuals[:, output], stretch.whitening[output]
    for first in range(0, len(e) - len(whitening) + 1, ROWS):
        part = slice(first, first + ROWS + len(whitening) - 1)
        known = [np.ones(len(e[part])), *(lagged[part] for lagged in stretch.lost)]
        yield filtered(np.column_stack([*known, *rows(part), e[part]]), whitening)


def _left(stretch: _Stretch, output: int, rows: Rows) -> tuple[Array, Array, Array] | None:
    """Residuals and tested regressors without the others, by rows of the triangle of all."""
    if not np.ptp(stretch.residuals[:, output]) > 0.0:
        return None
    triangle = triangle_of(_blocks(stretch, output, rows))
    others, tested = np.split(triangle[:, :-1], [-rows(slice(1))[1].shape[1]], axis=1)
    return left_by(others, triangle[:, -1]), left_by(others, tested), triangle


def _of_outputs(stretches: Sequence[_Stretch], regressors: Regressors) -> ResidualTest:
    """Test of regressors beside others for each output: by the likelihood ratio and by scores."""
    outputs, tests = stretches[0].residuals.shape[1], []
    for output in range(outputs):
        ratio, scores, freedom, samples = 0.0, 0.0, 0, 0
        for stretch in stretches:
            rows = regressors(stretch, output)
            if (parts := _left(stretch, output, rows)) is None:
                continue
            without, tested, triangle = parts
            count, left = tested.shape[1], left_by(tested, without)
            before, after = float(without @ without), float(left @ left)
            if len(stretch.inputs) < FEWEST_PER_REGRESSOR * count or not after > 1e-12 * before:
                continue
            n = len(stretch.residuals) - len(stretch.whitening[output]) + 1
            ratio += (n - triangle.shape[1] + 1) * math.log(before / after)
            blocks = _blocks(stretch, output, rows)
            scores += scores_statistic(left_in_blocks(blocks, triangle, count))
            freedom, samples = freedom + count, samples + n
        if freedom:
            p_value = min(outputs * float(scipy.special.chdtrc(freedom, min(ratio, scores))), 1.0)
            tests.append(ResidualTest(p_value, -math.expm1(-ratio / samples)))
    return min(tests, key=lambda test: test.p_value, default=NOT_TESTED)


def _change(stretches: Sequence[_Stretch]) -> tuple[ResidualTest, Regressors, float]:
    """Test for a trend or for a change that comes back, the more significant one, whose p-value
    counts twice; what it tests; samples after which the change comes back, NaN of a trend.  What a
    nonlinear system adds to its response to a periodic input comes back too: no such change is
    sought, and 0 stands for the samples."""
    trend = _of_outputs(stretches, _changing)
    if any(repetition_lag(u) for stretch in stretches for u in stretch.inputs.T):
        return trend, _changing, 0.0
    periods = max(len(stretch.inputs) for stretch in stretches) / PERIODS
    shares = _alone(stretches, partial(_waves, period=periods), 2 * LAGS)
    period = float(periods[np.argmax(shares.max(axis=0))])
    waves = partial(_waves, period=period)
    comes_back = _of_outputs(stretches, waves)
    if not (p_value := len(PERIODS) * comes_back.p_value) < trend.p_value:
        return replace(trend, p_value=min(2.0 * trend.p_value, 1.0)), _changing, math.nan
    return replace(comes_back, p_value=min(2.0 * p_value, 1.0)), waves, period


def _later(stretch: _Stretch, _: int) -> Rows:
    """Nothing, and the inputs at the same sample and at later ones."""
    later = [_lagged(u, LATER + 1)[::-1] for u in stretch.inputs[::-1].T]
    return lambda part: (stretch.inputs[part, :0], np.hstack([u[part] for u in later]))


def _following(stretches: Sequence[_Stretch], tests: ModelClass, changing: Regressors) -> Followed:
    """What another explains: of change and nonlinearity the one with less beside the other."""

    def beside(tested: Regressors, known: Regressors) -> ResidualTest:
        def both(stretch: _Stretch, output: int) -> Rows:
            of, others = tested(stretch, output), known(stretch, output)
            return lambda part: (np.hstack([of(part)[0], *others(part)]), of(part)[1])

        return _of_outputs(stretches, both)

    both = (changing, tests.constant), (_nonlinear, tests.linear)
    tested = [(regressors, test) for regressors, test in both if not math.isnan(test.p_value)]
    failed = [regressors for regressors, test in tested if not test.passed]
    fed_back = tests.without_feedback.p_value < SIGNIFICANCE and not tests.without_feedback.passed
    if failed and fed_back and all(beside(r, _later).passed for r in failed):
        return "feedback"
    if len(failed) < 2:
        return ""
    change, nonlinearity = beside(changing, _operating_point), beside(_nonlinear, changing)
    return "linear" if change.share > nonlinearity.share else "constant"


def _alone(stretches: Sequence[_Stretch], regressors: Regressors, size: int = LAGS) -> Array:
    """Shares of whitened residuals that each group of regressors explains alone, (l, groups)."""
    shares = []
    for output in range(stretches[0].residuals.shape[1]):
        explained, total = np.zeros(1), 0.0
        for stretch in stretches:
            if (parts := _left(stretch, output, regressors(stretch, output))) is None:
                continue
            e, tested, _ = parts
            groups = np.split(tested, tested.shape[1] // size, axis=1)
            explained = explained + [e @ e - np.sum(left_by(group, e) ** 2) for group in groups]
            total += float(e @ e)
        shares.append(explained / max(total, 1e-300))
    return np.array(shares)


def _moment(stretches: Sequence[_Stretch], gradual: float) -> float:
    """Samples until a sudden change of one stretch, 0 where it is gradual; NaN of several."""
    if len(stretches) > 1:
        return math.nan
    of_moments = _alone(stretches, _steps)
    output, place = np.unravel_index(np.argmax(of_moments), of_moments.shape)
    sudden = bool(of_moments[output, place] >= gradual)
    return sudden * float((place + 1) / (MOMENTS + 1) * len(stretches[0].inputs))


def acts_at_once(model: StateSpaceModel) -> Flags:
    """Whether each input acts on the same sample, (m,)."""
    return np.asarray(np.any(model.D, axis=0) & (np.array(model.delays) == 0))


def feedback_test(parts: Sequence[tuple[Array, Array]], direct: Flags) -> ResidualTest:
    """Test of correlations of residuals with later inputs, each whitened (Haugh 1976), by scores.

    Squares and cubes of the input's past count as known: residuals of a nonlinear system depend on
    them, and so may later samples of an input that is not normal.  Of inputs that are not
    ``direct`` those of the same sample, which most controllers act on, count too.  A periodic input
    is not tested: its later samples are earlier ones too, and its periods are alike, as those of an
    input with noise would not be.  ``parts``: residuals (N, l) and inputs (N, m) of each stretch.
    """
    tests, periodic, count = [], list[bool](), parts[0][0].shape[1] * len(direct)
    for output, place in np.ndindex(parts[0][0].shape[1], len(direct)):
        # Of the same sample, and of later ones.
        statistics, freedom, samples, explained = np.zeros(2), np.zeros(2, dtype=int), 0, 0.0
        lags = [repetition_lag(inputs[:, place]) for _, inputs in parts]
        for (residuals, inputs), lag in zip(parts, lags, strict=True):
            e, u = residuals[:, output], inputs[:, place]
            if len(e) < FEWEST_PER_REGRESSOR * LATER or not np.ptp(e) > 0.0 < np.ptp(u):
                periodic.append(False)
                continue
            if lag or len(u) < 4 * max(lags):  # too short a part of such an input repeats too
                periodic.append(not lag or goes_on(u, lag))
                continue
            e, u = whitened(e), _innovations(u)
            n = min(len(e), len(u))
            products = [e[-n : len(e) - k] * u[k - n :] for k in range(LATER + 1)]
            sizes = [np.array([p @ p + 1e-300, n * np.var(e) * np.var(u)]) for p in products]
            terms = np.array([np.sum(p) ** 2 for p in products])[:, None] / sizes
            terms[0] *= not direct[place]
            statistics += terms[0, 0], np.sum(terms[1:, 0])
            explained += float(np.sum(terms[:, 1]))
            freedom += not direct[place], LATER
            samples += n
        if freedom[1]:
            probable = scipy.special.chdtrc(np.maximum(freedom, 1), statistics)
            p_value = min(2 * count * float(np.min(probable)), 1.0)
            # Without what unrelated signals have by chance.
            beyond = max((explained - float(np.sum(freedom))) / samples, 0.0)
            tests.append(ResidualTest(p_value, beyond))
    nothing = REPEATS if periodic and all(periodic) else NOT_TESTED
    return min(tests, key=lambda test: test.p_value, default=nothing)


def _innovations(signal: Array) -> Array:
    """What the past of an input, its squares and its cubes do not predict, of the last samples."""
    white = whitened(signal)
    past = _lagged((signal - signal.mean()) / max(float(np.std(signal)), 1e-300))[:-1]
    past = past[max(len(past) - len(white), 0) :]
    powers = np.hstack([np.ones((len(past), 1)), past, past**2, past**3])
    return left_by(powers, white[len(white) - len(past) :])
