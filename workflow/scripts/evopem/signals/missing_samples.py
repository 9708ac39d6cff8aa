"""Missing samples: the stretches between them, and the filling of those that are too scattered."""

from dataclasses import replace

import numpy as np

from evopem.arrays import Array, Flags
from evopem.errors import InputError
from evopem.signals.recording import Recording

OVERFLOW_CODES = (9.9e37, 9.91e37, float(np.finfo(np.float32).max), 9.969209968386869e36)
"""Numbers for overflow and "not a number" in SCPI (1999, 7.2.1), the largest number of single
precision, and the value that netCDF fills in: no samples."""

LONG_STRETCH, SHORTEST_STRETCH, MOST_MISSING = 100, 50, 0.1
"""Samples between missing ones in which the initial state of a long model settles; what is used at
least where these are too few; the largest share of samples that are not used."""

LONGEST_FILLED, MOST_FILLED = 3, 0.05
"""Missing samples in sequence that are filled at most, and their largest share of a channel."""


def without_missing(recording: Recording, source: str) -> tuple[Recording, int]:
    """The stretches of a measured recording between samples that are missing in some channel.

    Those are not finite, or numbers that instruments write for an overflow. Of all samples up to
    the share `MOST_MISSING` may be missing or in stretches of fewer than `LONG_STRETCH`. Where more
    are, single missing samples are filled; else stretches of `SHORTEST_STRETCH` samples are used.
    The second value is the number of values that are filled.
    """
    signals = np.column_stack([recording.inputs, recording.outputs])
    missing = ~np.isfinite(signals) | np.isin(np.abs(signals), OVERFLOW_CODES)
    if not missing.any():
        return recording, 0
    short = np.column_stack([_short_gaps(flags) for flags in missing.T])
    fills = bool(short.any() and short.mean(axis=0).max() <= MOST_FILLED)
    ways = [(missing, LONG_STRETCH)]
    ways += [(missing & ~short, SHORTEST_STRETCH)] * fills
    ways += [(missing, SHORTEST_STRETCH)]
    for left, least in ways:
        runs = runs_of(np.logical_not(left.any(axis=1)))
        ranges = [(first, stop) for first, stop in runs if stop - first >= least]
        lost = 1.0 - sum(stop - first for first, stop in ranges) / len(missing)
        if lost <= MOST_MISSING:
            break
    else:
        first, channel = np.argwhere(missing)[0]
        place, values = list(recording.signals.items())[channel]
        what = "missing" if np.isnan(values[first]) else f"{values[first]:g}, which is none"
        problem = (
            f"the value is {what}; without the {np.count_nonzero(missing.any(axis=1))} such samples"
            f" and what is left of fewer than {SHORTEST_STRETCH} in sequence"
            f" {100.0 * lost:.0f} % of the recording are lost, and up to"
            f" {100.0 * MOST_MISSING:g} % may be"
        )
        remedy = "repair the recording or cut that part away"
        raise InputError(source, problem, remedy, f"{place}, sample {first + 1}")
    (whole,) = recording.segments
    filled = 0
    if left is not missing:
        filled = int(short.sum())
        signals = _filled(signals, missing, short)
        inputs, outputs = np.split(signals, [recording.inputs.shape[1]], axis=1)
        whole = replace(whole, inputs=inputs, outputs=outputs)
    return recording.with_segments([whole.between(*gap) for gap in ranges]), filled


def runs_of(samples: Flags) -> list[tuple[int, int]]:
    """First sample of each run of true ones, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], samples, [False])).astype(int)))
    return [(first, stop) for first, stop in edges.reshape(-1, 2).tolist()]


def _short_gaps(missing: Flags) -> Flags:
    """The missing samples of a channel, (N,), in gaps that may be filled."""
    short = np.zeros_like(missing)
    for first, stop in runs_of(missing):
        # Beyond an end there is nothing to interpolate to.
        if stop - first <= LONGEST_FILLED and first > 0 and stop < missing.size:
            short[first:stop] = True
    return short


def _filled(signals: Array, missing: Flags, short: Flags) -> Array:
    """Signals, (N, channels), with cubic splines through the others in place of short gaps."""
    from scipy.interpolate import CubicSpline

    filled = signals.copy()
    for values, lost, gaps in zip(filled.T, missing.T, short.T, strict=True):
        if gaps.any():
            values[gaps] = CubicSpline(np.flatnonzero(~lost), values[~lost])(np.flatnonzero(gaps))
    return filled
