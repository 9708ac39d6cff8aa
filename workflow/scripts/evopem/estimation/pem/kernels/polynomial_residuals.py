"""Residuals of eight general polynomial models in one pass, and which models are allowed."""

from __future__ import annotations

import numpy as np

from evopem.estimation.pem.kernels.cache import cached_njit, njit
from evopem.estimation.pem.kernels.record import BLOCK, all_finite, fill
from evopem.estimation.pem.kernels.residuals import filter_block, store_block
from evopem.estimation.pem.kernels.simd import (
    add,
    constant,
    fma,
    load,
    load_either,
    sample,
)
from evopem.estimation.pem.kernels.stability import step_down


@njit
def _add_impulses(parameters, row, last, s0, s1, s2, s3):
    """Add the rows ``row ... row + 3`` of a state, as far as ``last``, to four samples."""
    if row <= last:
        s0 = add(s0, load(parameters, row))
    if row + 1 <= last:
        s1 = add(s1, load(parameters, row + 1))
    if row + 2 <= last:
        s2 = add(s2, load(parameters, row + 2))
    if row + 3 <= last:
        s3 = add(s3, load(parameters, row + 3))
    return s0, s1, s2, s3


@njit
def _add_lags(parameters, at, count, signal, q, s0, s1, s2, s3, s4, s5, s6, s7):
    """Add ``sum_j parameters[at + j] signal[q + i - j]`` to the i-th of eight samples.

    Of a signal that all models share or of a table of their own ones.
    """
    w1, w2, w3 = load_either(signal, q + 1), load_either(signal, q + 2), load_either(signal, q + 3)
    w4, w5, w6 = load_either(signal, q + 4), load_either(signal, q + 5), load_either(signal, q + 6)
    w7 = load_either(signal, q + 7)
    for j in range(count):
        p, w0 = load(parameters, at + j), load_either(signal, q - j)
        s0, s1, s2, s3 = fma(p, w0, s0), fma(p, w1, s1), fma(p, w2, s2), fma(p, w3, s3)
        s4, s5, s6, s7 = fma(p, w4, s4), fma(p, w5, s5), fma(p, w6, s6), fma(p, w7, s7)
        w1, w2, w3, w4, w5, w6, w7 = w0, w1, w2, w3, w4, w5, w6
    return s0, s1, s2, s3, s4, s5, s6, s7


@njit
def _add_output(y, t, level, s0, s1, s2, s3):
    """Add the level and four samples of the output."""
    s0, s1 = add(add(s0, sample(y, t)), level), add(add(s1, sample(y, t + 1)), level)
    s2, s3 = add(add(s2, sample(y, t + 2)), level), add(add(s3, sample(y, t + 3)), level)
    return s0, s1, s2, s3


@njit
def _residuals(record, parameters, x, v, e, before, begin, end):
    """x, v and e of eight models at ``begin <= t < end``, whole pairs of blocks.

    Row ``t - before`` of a table is sample t; the ``history`` rows before the first are known.
    Eight samples at a time keep the processor busy while a recursion waits for itself.
    """
    y, u, start = record.y, record.u, record.residual_start
    na, nb, nc, nd, nf = record.na, record.nb, record.nc, record.nd, record.nf
    at_c, at_f, rows_c, rows_f = record.at_c, record.at_f, record.rows_c, record.rows_f
    zero = constant(0.0)
    level = load(parameters, record.at_level) if record.level else zero
    for t in range(begin, end, 2 * BLOCK):
        row = t - before
        other = row + BLOCK
        s0, s1, s2, s3, s4, s5, s6, s7 = _add_lags(
            parameters, na, nb, u, t - record.nk, zero, zero, zero, zero, zero, zero, zero, zero
        )
        if nf > 0:
            if t < start + nf:
                state, last = record.at_g + t - start, record.at_g + nf - 1
                s0, s1, s2, s3 = _add_impulses(parameters, state, last, s0, s1, s2, s3)
                s4, s5, s6, s7 = _add_impulses(parameters, state + BLOCK, last, s4, s5, s6, s7)
            s0, s1, s2, s3 = filter_block(parameters, at_f, rows_f, s0, s1, s2, s3, x, row)
            s4, s5, s6, s7 = filter_block(parameters, at_f, rows_f, s4, s5, s6, s7, x, other)
        s0, s1, s2, s3 = _add_output(y, t, level, s0, s1, s2, s3)
        s4, s5, s6, s7 = _add_output(y, t + BLOCK, level, s4, s5, s6, s7)
        if na > 0:
            s0, s1, s2, s3, s4, s5, s6, s7 = _add_lags(
                parameters, 0, na, y, t - 1, s0, s1, s2, s3, s4, s5, s6, s7
            )
        if nd > 0:
            store_block(v, row, s0, s1, s2, s3)
            store_block(v, other, s4, s5, s6, s7)
            s0, s1, s2, s3, s4, s5, s6, s7 = _add_lags(
                parameters, record.at_d, nd, v, row - 1, s0, s1, s2, s3, s4, s5, s6, s7
            )
        if t < start + record.states:
            state, last = record.at_s + t - start, record.at_s + record.states - 1
            s0, s1, s2, s3 = _add_impulses(parameters, state, last, s0, s1, s2, s3)
            s4, s5, s6, s7 = _add_impulses(parameters, state + BLOCK, last, s4, s5, s6, s7)
        if nc > 0:
            filter_block(parameters, at_c, rows_c, s0, s1, s2, s3, e, row)
            filter_block(parameters, at_c, rows_c, s4, s5, s6, s7, e, other)
        else:
            store_block(e, row, s0, s1, s2, s3)
            store_block(e, other, s4, s5, s6, s7)


@njit
def all_polynomial_residuals(record, workspace):
    """x, v and e of the loaded models; sample t is row ``t - residual_start + history``."""
    x, v, e = workspace.x, workspace.v, workspace.e
    start, history = record.residual_start, record.history
    if record.nf > 0:
        fill(x, 0, history, 0.0)
    if record.nd > 0:
        fill(v, 0, history, 0.0)
    fill(e, 0, history, 0.0)
    _residuals(record, workspace.parameters, x, v, e, start - history, start, record.y.size)


@cached_njit
def feasible_polynomials(record, objective, points):
    """Whether all roots of each row lie where the objective allows them, and all is finite."""
    c = record.na + record.nb
    d = c + record.nc
    f = d + record.nd
    order = max(record.na, record.nc, record.nd, record.nf)
    work = np.empty((order + 1, order))
    plant, noise = objective.plant_radius, objective.noise_radius
    feasible = np.empty(points.shape[0], dtype=np.bool_)
    for r in range(feasible.size):
        feasible[r] = (
            step_down(points[r, : record.na], plant, work)
            and step_down(points[r, c:d], noise, work)
            and step_down(points[r, d:f], noise, work)
            and step_down(points[r, f : f + record.nf], plant, work)
            and all_finite(points[r])
        )
    return feasible
