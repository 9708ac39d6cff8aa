"""Missing samples, and single wrong ones of an output that their neighbours replace.

A sample that is wrong alone disturbs the prediction of the samples after it too, by the
coefficients of A, and leaves what the system does unchanged; a disturbance that passes through the
system does not look like that (additive and innovational outliers: Chang, Tiao & Chen 1988; Chen &
Liu 1993).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load on first use
from numpy.lib.stride_tricks import sliding_window_view

from evopem.arrays import Array, Flags
from evopem.errors import InputError
from evopem.signals.least_squares import chunks, triangle_of
from evopem.signals.recording import Recording, Segment

OVERFLOW_CODES = (9.9e37, 9.91e37, float(np.finfo(np.float32).max), 9.969209968386869e36)
"""Numbers for overflow and "not a number" in SCPI (1999, 7.2.1), the largest number of single
precision, and the value that netCDF fills in: no samples."""

LONG_STRETCH, SHORTEST_STRETCH, MOST_MISSING = 100, 50, 0.1
"""Samples between missing ones in which the initial state of a long model settles; what is used at
least where these are too few; the largest share of samples that are not used."""

LONGEST_FILLED, LONGEST_PREDICTED, MOST_FILLED, FILLINGS = 3, 10, 0.05, 3
"""Missing samples in sequence filled at most, and of outputs where else too many are lost; their
largest share, and rounds of models."""


def without_missing(recording: Recording, source: str) -> tuple[Recording, int]:
    """The stretches of a measured recording between samples that are missing in some channel.

    Those are not finite, or numbers that instruments write for an overflow. Of all samples up to
    the share `MOST_MISSING` may be missing or in stretches of fewer than `LONG_STRETCH`. Where more
    are, short gaps are filled; else stretches of `SHORTEST_STRETCH` samples are used; else longer
    gaps of outputs are filled too. The second value is the number of values that are filled.
    """
    signals = np.column_stack([recording.inputs, recording.outputs])
    missing = ~np.isfinite(signals) | np.isin(np.abs(signals), OVERFLOW_CODES)
    if not missing.any():
        return recording, 0
    nothing, inputs = np.zeros_like(missing), recording.inputs.shape[1]
    short = [_short_gaps(missing, inputs, most) for most in (LONGEST_FILLED, LONGEST_PREDICTED)]
    some, more = [gaps * (gaps.mean(axis=0).max() <= MOST_FILLED) for gaps in short]
    ways = [(nothing, LONG_STRETCH), *((gaps, SHORTEST_STRETCH) for gaps in (some, nothing, more))]
    shares = []
    for gaps, least in ways:
        left = missing & ~gaps
        runs = runs_of(np.logical_not(left.any(axis=1)))
        ranges = [(first, stop) for first, stop in runs if stop - first >= least]
        shares.append(1.0 - sum(stop - first for first, stop in ranges) / len(missing))
        if shares[-1] <= MOST_MISSING:
            break
    else:
        first, channel = np.argwhere(missing)[0]
        place, values = list(recording.signals.items())[channel]
        what = "missing" if np.isnan(values[first]) else f"{values[first]:g}, which is none"
        problem = (
            f"the value is {what}; without the {np.count_nonzero(missing.any(axis=1))} such samples"
            f" and what is left of fewer than {SHORTEST_STRETCH} in sequence"
            f" {100.0 * max(shares[1:]):.0f} % of the recording are lost, and up to"
            f" {100.0 * MOST_MISSING:g} % may be"
        )
        remedy = "repair the recording or cut that part away"
        raise InputError(source, problem, remedy, f"{place}, sample {first + 1}")
    (whole,) = recording.segments
    if gaps.any():
        signals = _filled(signals, missing, gaps)
        whole = replace(whole, inputs=signals[:, :inputs], outputs=signals[:, inputs:])
        whole = replace(whole, outputs=_predicted(whole, gaps[:, inputs:]))
    return recording.with_segments([whole.between(*used) for used in ranges]), int(gaps.sum())


def runs_of(samples: Flags) -> list[tuple[int, int]]:
    """First sample of each run of true ones, and the one after its last."""
    edges = np.flatnonzero(np.diff(samples, prepend=False, append=False))
    return [(first, stop) for first, stop in edges.reshape(-1, 2).tolist()]


def _short_gaps(missing: Flags, inputs: int, longest: int) -> Flags:
    """The missing samples of channels, (N, m + l), in gaps that may be filled: of ``longest``
    samples in outputs, and of ``LONGEST_FILLED`` in inputs, which no model predicts."""
    short = np.zeros_like(missing)
    for channel, flags in enumerate(missing.T):
        most = LONGEST_FILLED if channel < inputs else longest
        for first, stop in runs_of(flags):
            # Beyond an end there is nothing to interpolate to.
            if stop - first <= most and first > 0 and stop < flags.size:
                short[first:stop, channel] = True
    return short


def _filled(signals: Array, missing: Flags, short: Flags) -> Array:
    """Signals, (N, channels), with cubic splines through the others in place of short gaps."""
    filled = signals.copy()
    for values, lost, gaps in zip(filled.T, missing.T, short.T, strict=True):
        if gaps.any():
            spline = scipy.interpolate.CubicSpline(np.flatnonzero(~lost), values[~lost])
            values[gaps] = spline(np.flatnonzero(gaps))
    return filled


# Lags of the ARX model, and samples for each of its coefficients.
MOST_LAGS, SAMPLES_PER_COEFFICIENT = 16, 20
# Standard errors by which a sample is off, and twice the logarithm of the likelihood ratio to a
# disturbance through the system: very strong evidence (Kass & Raftery 1995).
LEAST_DEVIATION, LEAST_EVIDENCE = 5.0, 10.0
# The least ratio of what is to be compared, and standard errors that need no such evidence.
AS_LIKELY, FAR_OFF = 0.9, 10.0
# Rounds of estimates and replacements; those of one round are not much smaller than its largest.
MOST_ROUNDS, OF_LARGEST = 25, 0.3
# Rounds of Tukey's bisquare weights before the first replacements, with his constant for 95 %
# efficiency; the standard deviation of a normal variable over its median absolute deviation.
WEIGHTINGS, BISQUARE, NORMAL_MAD = 5, 4.685, 1.4826
# Level at which the residuals around a replaced sample are those of all others; the share of its
# power that they may have where it is large, of an interpolation that is off by 3 % of the change;
# the largest share of the power of changes where they are more, and that of replaced samples.
UNEXPLAINED_LEVEL, LEFT, MOST_UNEXPLAINED, MOST_REPLACED = 1e-3, 1e-3, 0.25, 0.05
LONGEST_PIECE = 50_000  # samples that one model is estimated from


class Cleaned(NamedTuple):
    """Outputs with replaced samples, and which these are."""

    outputs: list[Array]  # (N, l) of each segment
    replaced: list[Flags]  # (N, l) of each segment


def without_outliers(segments: Sequence[Segment]) -> Cleaned:
    """Replace single wrong samples of each output by their interpolation.

    Nothing is replaced where what is left around such samples is not like elsewhere: it is then
    the system, its unmeasured input or a step that is unusual, and not the measurement of a sample.
    Samples that are not finite divide a segment.
    """
    outputs = [segment.outputs.copy() for segment in segments]
    replaced = [np.zeros(segment.outputs.shape, bool) for segment in segments]
    for group in _pieces(segments):
        for channel in range(outputs[0].shape[1]):
            parts = [(segments[k].inputs[a:b], outputs[k][a:b, channel]) for k, a, b in group]
            for (k, a, b), (y, mask) in zip(group, _replacements(parts), strict=True):
                outputs[k][a:b, channel] = y
                replaced[k][a:b, channel] |= mask
    return Cleaned(outputs, replaced)


def _pieces(segments: Sequence[Segment]) -> Iterator[list[tuple[int, int, int]]]:
    """Stretches of finite samples as (segment, first, stop), in groups for one model each. A
    stretch begins before the end of the one before it: no sample is replaced at an end."""
    group: list[tuple[int, int, int]] = []
    for k, segment in enumerate(segments):
        good = np.isfinite(np.column_stack([segment.inputs, segment.outputs]).sum(axis=1))
        for begin, stop in runs_of(good):
            for first in range(begin, stop, LONGEST_PIECE):
                before = max(begin, first - 2 * MOST_LAGS)
                group.append((k, before, min(first + LONGEST_PIECE, stop)))
                if sum(b - a for _, a, b in group) >= LONGEST_PIECE:
                    yield group
                    group = []
    if group:
        yield group


Part = tuple[Array, Array]  # inputs (N, m) and one output (N,), without gaps


class _Arx(NamedTuple):
    """An ARX model with as many lags of the output as of each input, and a constant."""

    lags: int
    coefficients: Array
    scale: float  # robust standard deviation of its residuals

    def residuals(self, part: Part) -> Array:
        """One-step errors (N,) in standard deviations; zeros for the first, which none predicts."""
        errors = part[1][self.lags :] - _regressors(part, self.lags) @ self.coefficients
        return np.concatenate([np.zeros(self.lags), errors / self.scale])


def _lags_for(parts: Sequence[Part]) -> int:
    """The lags of an ARX model that the samples carry."""
    samples = sum(len(y) for _, y in parts)
    return min(MOST_LAGS, samples // (SAMPLES_PER_COEFFICIENT * (parts[0][0].shape[1] + 1)))


def _replacements(parts: Sequence[Part]) -> list[tuple[Array, Flags]]:
    """The output of each part with replaced samples, and which these are."""
    kept = [(y, np.zeros(len(y), bool)) for _, y in parts]
    samples, lags = sum(len(y) for _, y in parts), _lags_for(parts)
    long = [k for k, (_, y) in enumerate(parts) if len(y) > 2 * lags]
    if lags < 1 or not long:
        return kept
    current = [(parts[k][0], parts[k][1].copy()) for k in long]
    masks = [np.zeros(len(y), bool) for _, y in current]
    for number in range(MOST_ROUNDS):
        model = _arx(current, lags, 0 if number else WEIGHTINGS)
        if model.scale == 0.0:
            return kept
        news = [_replace(part, mask, model) for part, mask in zip(current, masks, strict=True)]
        if not any(news):
            break
    marks = sum(mask.sum() for mask in masks)
    if not 0 < marks <= MOST_REPLACED * samples:
        return kept
    model = _arx(current, lags, 0)
    judged = [
        _judged(part, parts[k][1], mask, model)
        for k, part, mask in zip(long, current, masks, strict=True)
    ]
    explained, unexplained = np.sum([energies for _, *energies in judged], axis=0)
    if unexplained > MOST_UNEXPLAINED * (explained + unexplained):
        return kept
    for k, (_, y), (wrong, *_) in zip(long, current, judged, strict=True):
        kept[k] = np.where(wrong, y, parts[k][1]), wrong
    return kept


def _predicted(segment: Segment, gaps: Flags) -> Array:
    """Outputs, (N, l), gaps filled by an ARX model: a spline knows nothing of inputs and modes."""
    outputs = segment.outputs.copy()
    for group in _pieces([replace(segment, outputs=outputs)]):
        for channel, flags in enumerate(gaps.T):
            parts = [(segment.inputs[a:b], outputs[a:b, channel]) for _, a, b in group]
            masks, lags = [flags[a:b] for _, a, b in group], _lags_for(parts)
            long = [(p, m) for p, m in zip(parts, masks, strict=True) if len(m) > 2 * lags]
            for _ in range(FILLINGS if lags and any(m.any() for _, m in long) else 0):
                model = _arx([part for part, _ in long], lags, WEIGHTINGS)
                for part, mask in long if model.scale > 0.0 else ():
                    _fill(part, mask, model)
    return outputs


def _fill(part: Part, gaps: Flags, model: _Arx) -> None:
    """Put into gaps with neighbours on both sides, in place, what makes the errors smallest."""
    y, lags, errors = part[1], model.lags, model.residuals(part) * model.scale
    a = np.concatenate([[1.0], -model.coefficients[:lags]])
    for first, stop in runs_of(gaps):
        end = min(stop + lags, len(y))
        if first >= lags and end > stop:
            effects = scipy.linalg.toeplitz(
                np.pad(a, (0, stop - first))[: end - first], np.zeros(stop - first)
            )
            step = np.linalg.lstsq(effects, -errors[first:end], rcond=None)[0]
            y[first:stop] += step
            errors[first:end] += effects @ step


def _regressors(part: Part, lags: int) -> Array:
    """Past outputs, present and past inputs, and a constant, of all samples but the first."""
    u, y = part
    past = sliding_window_view(y[:-1], lags)[:, ::-1]
    given = sliding_window_view(u, lags + 1, axis=0).reshape(len(past), -1)
    return np.column_stack([past, given, np.ones(len(past))])


def _arx(parts: Sequence[Part], lags: int, weightings: int) -> _Arx:
    """Least squares, after some rounds of weights that leave outliers out."""
    x = np.concatenate([_regressors(part, lags) for part in parts])
    y = np.concatenate([part[1][lags:] for part in parts])
    size = np.maximum(np.linalg.norm(x, axis=0), np.finfo(float).tiny)
    columns, weights = np.column_stack([x / size, y]), np.ones((len(y), 1))
    for left in range(weightings, -1, -1):
        parts_of_rows = (slice(*rows) for rows in chunks(0, len(y)))
        triangle = triangle_of(columns[rows] * weights[rows] for rows in parts_of_rows)
        solved = np.linalg.lstsq(triangle[:, :-1], triangle[:, -1], rcond=1e-10)[0]
        residuals = y - columns[:, :-1] @ solved
        scale = NORMAL_MAD * float(np.median(np.abs(residuals)))
        if left and scale:
            tukey = np.clip(1.0 - (residuals / (BISQUARE * scale)) ** 2, 0.0, None)
            weights = tukey[:, None]
    return _Arx(lags, solved / size, scale)


def _replace(part: Part, mask: Flags, model: _Arx) -> bool:
    """Replace the samples that are off in place, and mark them; whether there are any."""
    y, lags, residuals = part[1], model.lags, model.residuals(part)
    a = np.concatenate([[1.0], -model.coefficients[:lags]])
    later = sliding_window_view(np.concatenate([residuals, np.zeros(lags)]), lags + 1)
    predicted = np.concatenate([np.zeros(lags), np.ones(len(y) - lags), np.zeros(lags)])
    weight = np.sqrt(sliding_window_view(predicted, lags + 1) @ a**2)
    deviations = later @ a / np.maximum(weight, np.finfo(float).tiny)
    alone = deviations**2 > AS_LIKELY * residuals**2
    off = np.flatnonzero((np.abs(deviations) > LEAST_DEVIATION) & alone)
    inside = (off >= lags) & (off < len(y) - lags)  # with neighbours on both sides
    size = np.abs(deviations[off])
    least = OF_LARGEST * size[inside].max(initial=0.0)
    apart: list[int] = []
    for at in off[np.argsort(-size, kind="stable")].tolist():
        if abs(deviations[at]) >= least and all(abs(at - before) > lags for before in apart):
            apart.append(at)
    taken = [at for at in apart if lags <= at < len(y) - lags]
    y[taken] -= model.scale * deviations[taken] / weight[taken]
    mask[taken] = True
    return bool(taken)


def _judged(part: Part, before: Array, mask: Flags, model: _Arx) -> tuple[Flags, float, float]:
    """Replaced samples that were wrong, and the power of explained and unexplained changes. Around
    an explained one the residuals are like elsewhere.  It may be a large disturbance as well
    without very strong evidence; where disturbances hardly pass through poles, the two are one."""
    residuals, lags = model.residuals(part), model.lags
    changes = (before - part[1]) / model.scale
    weight = 1.0 + np.sum(model.coefficients[:lags] ** 2)
    alone, passed = weight * changes**2, (residuals + changes) ** 2
    clear = (alone - passed > LEAST_EVIDENCE) | (np.abs(changes) > FAR_OFF)
    wrong, powers = np.zeros(len(mask), bool), [0.0, 0.0]
    for at in np.flatnonzero(mask):
        near = residuals[max(at - lags, lags) : at + lags + 1]
        by_chance = scipy.special.chdtri(len(near), UNEXPLAINED_LEVEL)
        strange = np.sum(near**2) > max(by_chance, LEFT * alone[at])
        powers[int(strange)] += changes[at] ** 2
        wrong[at] = not strange and clear[at] and alone[at] > AS_LIKELY * passed[at]
    return wrong, powers[0], powers[1]
