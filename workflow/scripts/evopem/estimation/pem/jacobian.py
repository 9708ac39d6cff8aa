"""Derivatives of the residuals of one model by its coefficients, its level and its states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.filtering import filter_rows
from evopem.estimation.pem.least_squares import chunks
from evopem.models.structures import Orders

Array = NDArray[np.float64]


class Copies(NamedTuple):
    """Columns that are delayed copies of a signal, each a sample later than the one before.

    ``past[j - 1]`` enters the j-th copy at the first residual, through a filter with ``response``.
    """

    signal: Array
    copies: int
    past: Array
    response: Array


def jacobian_blocks(
    orders: Orders,
    point: Array,
    level: bool,
    output: Array,
    inputs: Array,
    signals: tuple[Sequence[Array], Array, Array],
) -> Iterator[Array]:
    """Derivatives of the residuals by the entries of a point, of one model.

    These are ``[a, b_i, c, d, f_i, level, states of inputs, noise state]``.

    Columns are delayed copies of signals filtered through D/C, D/CF_i or 1/C (Ljung 1999, section
    10.3).  A copy that is delayed by one sample more differs by the sample before the first
    residual that enters it, times the response to an impulse.

    ``point`` (n,).  ``level``: whether the point has one.  ``output`` (N,), ``inputs`` (N, m).
    ``signals``: from the first residual on, of the filters in :mod:`.kernels.record`.  Yields
    (M, n): consecutive rows, as many as e has samples in all.
    """
    parts = _copied_signals(orders, point, level, output, inputs, signals)
    last = [np.zeros(part.copies) for part in parts]
    for first, stop in chunks(0, len(signals[2])):
        blocks = [_block(part, first, stop, row) for part, row in zip(parts, last, strict=True)]
        last = [block[:, -1] for block in blocks]
        yield np.concatenate(blocks).T


def _copied_signals(
    orders: Orders,
    point: Array,
    level: bool,
    output: Array,
    inputs: Array,
    signals: tuple[Sequence[Array], Array, Array],
) -> list[Copies]:
    """The signals whose delayed copies are the columns, in their order."""
    o, (xs, v, e) = orders, signals
    count, start = len(e), len(output) - len(e)
    c, d = (np.concatenate([[1.0], point[o.part(name)]]) for name in "cd")
    impulse = np.zeros(count)
    impulse[0] = 1.0
    by_c, by_noise, none = _through(impulse, c), _through(impulse, c, d), np.zeros(0)

    def past(signal: Array, lag: int, copies: int) -> Array:
        return signal[start - lag - copies + 1 : start - lag][::-1]

    of_a, of_b, of_f, of_states = [], [], [], []
    if o.na:
        entering = _through(output[start - 1 : -1], c, d)
        of_a.append(Copies(entering, o.na, past(output, 1, o.na), by_noise))
    for i in range(o.inputs):
        f, u, nk = np.concatenate([[1.0], point[o.part("f", i)]]), inputs[:, i], o.nk[i]
        by_plant = _through(by_noise, f)
        entering = -_through(_through(u[start - nk : len(u) - nk], c, d), f)
        of_b.append(Copies(entering, o.nb[i], -past(u, nk, o.nb[i]), by_plant))
        if o.nf[i]:
            filtered = -_through(_through(_before(xs[i]), c, d), f)
            of_f.append(Copies(filtered, o.nf[i], none, by_plant))
            of_states.append(Copies(by_plant, o.nf[i], none, by_plant))
    of_c = Copies(-_through(_before(e), c), o.nc, none, by_c)
    of_d = Copies(_through(_before(v), c), o.nd, none, by_c)
    constant = [Copies(-_through(np.ones(count), c, d), 1, none, by_c)] if level else []
    noise = Copies(by_c, o.noise_states, none, by_c)
    parts = [*of_a, *of_b, of_c, of_d, *of_f, *constant, *of_states, noise]
    return [part for part in parts if part.copies]


def _block(part: Copies, first: int, stop: int, last: Array) -> Array:
    """Samples of the copies of a signal, (copies, M); ``last`` is the sample before."""
    copies = np.empty((part.copies, stop - first))
    copies[0] = part.signal[first:stop]
    for j in range(1, part.copies):
        copies[j, 0] = last[j - 1]
        copies[j, 1:] = copies[j - 1, :-1]
        if len(part.past):
            copies[j] += part.past[j - 1] * part.response[first:stop]
    return copies


def _through(signal: Array, denominator: Array, numerator: Array | None = None) -> Array:
    """A signal through a filter at rest."""
    filtered = np.array(signal, dtype=float)[None, :]
    if len(denominator) > 1:
        filter_rows(filtered, denominator, np.zeros((1, len(denominator) - 1)))
    if numerator is None or len(numerator) == 1:
        return filtered[0]
    return np.convolve(numerator, filtered[0])[: len(signal)]


def _before(signal: Array) -> Array:
    """A signal one sample later, zero at first."""
    return np.concatenate([[0.0], signal[:-1]])
