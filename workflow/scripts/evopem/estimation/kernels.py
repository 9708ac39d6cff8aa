"""Compiled kernels of ARMAX models: residuals, loss, adjoint gradient, Gauss-Newton, stability.

Eight candidate models share one pass over the record, one in each lane of a SIMD vector, so that
the sequential recursion through 1/C costs the same for eight models as for one.  All arithmetic
is IEEE and explicitly ordered (no reassociation; fused multiply-adds where the code says so), so
the bits of a result do not depend on the width of a machine's vectors or on which models share a
pass.

The recursion works through blocks of four samples; callers pad the record accordingly (see
:func:`padded_length`).  Parameters arrive *signed*: rows ``[a, -b, -c, d]``, with C padded by zero
coefficients to :data:`MIN_NC` rows, so that every term of the recursion is an addition.  ``d``,
as many rows as C has, is the state that the unknown noise before the record left behind: ``d_i``
is added to the equation error of sample ``start + i``.

Everything compiled lives in this one file because numba's on-disk cache notices changes of the
file that defines a function, and of no other.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.extending import intrinsic, register_model

LANES = 8
BLOCK = 4
MIN_NC = BLOCK - 1

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)


class _LanesType(types.Type):
    """The numba type of one SIMD vector of eight doubles."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


_lanes = _LanesType()


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type) -> None:  # type: ignore[no-untyped-def]
        super().__init__(dmm, fe_type, _VECTOR)


def _splat(builder, scalar):  # type: ignore[no-untyped-def]
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, undefined, zeros)


def _row_pointer(context, builder, array_type, array, row):  # type: ignore[no-untyped-def]
    data = context.make_array(array_type)(context, builder, array).data
    offset = builder.mul(row, ir.Constant(row.type, LANES))
    return builder.bitcast(builder.gep(data, [offset]), _VECTOR.as_pointer())


@intrinsic
def _constant(typingctx, scalar):  # type: ignore[no-untyped-def]
    """All lanes equal to a scalar."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return _splat(builder, args[0])

    return _lanes(types.float64), codegen


@intrinsic
def _sample(typingctx, signal, index):  # type: ignore[no-untyped-def]
    """All lanes equal to ``signal[index]``; the index is trusted (no wrap-around test)."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        return _splat(builder, builder.load(builder.gep(data, [args[1]])))

    return _lanes(signal, types.intp), codegen


@intrinsic
def _load(typingctx, table, row):  # type: ignore[no-untyped-def]
    """Row of a C-contiguous (rows, LANES) table as one vector."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        pointer = _row_pointer(context, builder, signature.args[0], args[0], args[1])
        return builder.load(pointer, align=8)

    return _lanes(table, types.intp), codegen


@intrinsic
def _store(typingctx, table, row, lanes):  # type: ignore[no-untyped-def]
    """Write one vector to a row of a C-contiguous (rows, LANES) table."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        pointer = _row_pointer(context, builder, signature.args[0], args[0], args[1])
        builder.store(args[2], pointer, align=8)
        return context.get_dummy_value()

    return types.void(table, types.intp, _lanes), codegen


def _call(builder, name, arguments):  # type: ignore[no-untyped-def]
    function_type = ir.FunctionType(_VECTOR, [_VECTOR] * len(arguments))
    function = cgutils.get_or_insert_function(
        builder.module, function_type, f"llvm.{name}.v{LANES}f64"
    )
    return builder.call(function, arguments)


@intrinsic
def _fma(typingctx, x, y, z):  # type: ignore[no-untyped-def]
    """``x * y + z`` rounded once."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return _call(builder, "fma", args)

    return _lanes(_lanes, _lanes, _lanes), codegen


@intrinsic
def _sqrt(typingctx, x):  # type: ignore[no-untyped-def]
    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return _call(builder, "sqrt", args)

    return _lanes(_lanes), codegen


@intrinsic
def _abs(typingctx, x):  # type: ignore[no-untyped-def]
    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return _call(builder, "fabs", args)

    return _lanes(_lanes), codegen


@intrinsic
def _add(typingctx, x, y):  # type: ignore[no-untyped-def]
    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.fadd(*args)

    return _lanes(_lanes, _lanes), codegen


@intrinsic
def _divide(typingctx, x, y):  # type: ignore[no-untyped-def]
    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.fdiv(*args)

    return _lanes(_lanes, _lanes), codegen


def padded_length(samples: int, start: int) -> int:
    """Length to which records are padded so that ``start ... end`` is whole blocks."""
    return start + BLOCK * -(-(samples - start) // BLOCK)


@njit(error_model="numpy", cache=True)
def residuals(y, u, na, nb, nc, nk, start, parameters, e):  # type: ignore[no-untyped-def]
    """Residuals ``C e = A y - B u + d`` of eight models, from zero past residuals at ``start``.

    Parameters
    ----------
    y, u : (T,) float arrays, padded to ``T = padded_length(N, start)``
    na, nb, nc, nk : int, with ``nc >= MIN_NC``
    start : int, at least ``max(na, nb + nk - 1, nc)``
    parameters : (na + nb + 2 nc, LANES) signed parameters
    e : (T, LANES), overwritten; rows beyond N are meaningless
    """
    zero = _constant(0.0)
    for t in range(start):
        _store(e, t, zero)
    c = na + nb
    c1, c2, c3 = _load(parameters, c), _load(parameters, c + 1), _load(parameters, c + 2)
    for t in range(start, y.size, BLOCK):
        s0, s1, s2, s3 = _sample(y, t), _sample(y, t + 1), _sample(y, t + 2), _sample(y, t + 3)
        if t < start + nc:
            row, last = c + nc + t - start, c + 2 * nc - 1
            s0 = _add(s0, _load(parameters, row))
            if row + 1 <= last:
                s1 = _add(s1, _load(parameters, row + 1))
            if row + 2 <= last:
                s2 = _add(s2, _load(parameters, row + 2))
            if row + 3 <= last:
                s3 = _add(s3, _load(parameters, row + 3))
        for i in range(na):
            p, q = _load(parameters, i), t - 1 - i
            s0, s1 = _fma(p, _sample(y, q), s0), _fma(p, _sample(y, q + 1), s1)
            s2, s3 = _fma(p, _sample(y, q + 2), s2), _fma(p, _sample(y, q + 3), s3)
        for j in range(nb):
            p, q = _load(parameters, na + j), t - nk - j
            s0, s1 = _fma(p, _sample(u, q), s0), _fma(p, _sample(u, q + 1), s1)
            s2, s3 = _fma(p, _sample(u, q + 2), s2), _fma(p, _sample(u, q + 3), s3)
        for k in range(nc - 1, MIN_NC - 1, -1):
            p, q = _load(parameters, c + k), t - 1 - k
            s0, s1 = _fma(p, _load(e, q), s0), _fma(p, _load(e, q + 1), s1)
            s2, s3 = _fma(p, _load(e, q + 2), s2), _fma(p, _load(e, q + 3), s3)
        e1, e2, e3 = _load(e, t - 1), _load(e, t - 2), _load(e, t - 3)
        s0 = _fma(c1, e1, _fma(c2, e2, _fma(c3, e3, s0)))
        s1 = _fma(c1, s0, _fma(c2, e1, _fma(c3, e2, s1)))
        s2 = _fma(c1, s1, _fma(c2, s0, _fma(c3, e1, s2)))
        s3 = _fma(c1, s2, _fma(c2, s1, _fma(c3, s0, s3)))
        _store(e, t, s0)
        _store(e, t + 1, s1)
        _store(e, t + 2, s2)
        _store(e, t + 3, s3)


@njit(error_model="numpy", cache=True)
def absolute_sum(e, first, last, total):  # type: ignore[no-untyped-def]
    """Sum of ``|e_t|`` over ``first <= t < last`` for eight models, into ``total`` (1, LANES)."""
    s = _constant(0.0)
    for t in range(first, last):
        s = _add(s, _abs(_load(e, t)))
    _store(total, 0, s)


@njit(error_model="numpy", cache=True)
def square_sum(e, first, last, total):  # type: ignore[no-untyped-def]
    """Sum of ``e_t**2`` over ``first <= t < last`` for eight models, into ``total`` (1, LANES)."""
    s = _constant(0.0)
    for t in range(first, last):
        v = _load(e, t)
        s = _fma(v, v, s)
    _store(total, 0, s)


@njit(error_model="numpy", cache=True)
def smoothed_absolute_slope(e, first, last, corner, slope, total):  # type: ignore[no-untyped-def]
    """Sum of ``sqrt(e_t**2 + corner**2)`` and its derivative with respect to each ``e_t``.

    ``corner`` is (1, LANES); ``slope`` is (T + nc, LANES), and its rows outside
    ``first ... last - 1`` become zero.
    """
    zero = _constant(0.0)
    corner_squared = _fma(_load(corner, 0), _load(corner, 0), zero)
    s = zero
    for t in range(first):
        _store(slope, t, zero)
    for t in range(first, last):
        v = _load(e, t)
        r = _sqrt(_fma(v, v, corner_squared))
        s = _add(s, r)
        _store(slope, t, _divide(v, r))
    for t in range(last, slope.shape[0]):
        _store(slope, t, zero)
    _store(total, 0, s)


@njit(error_model="numpy", cache=True)
def smoothed_absolute_curvature(e, first, last, width, total):  # type: ignore[no-untyped-def]
    """Sum over the samples of the second derivative of ``sqrt(e**2 + width**2)``."""
    zero = _constant(0.0)
    width_squared = _fma(_load(width, 0), _load(width, 0), zero)
    s = zero
    for t in range(first, last):
        v = _load(e, t)
        r = _fma(v, v, width_squared)
        s = _add(s, _divide(width_squared, _fma(r, _sqrt(r), zero)))
    _store(total, 0, s)


@njit(error_model="numpy", cache=True)
def square_slope(e, first, last, slope, total):  # type: ignore[no-untyped-def]
    """Sum of ``e_t**2`` and its derivative with respect to each ``e_t``."""
    zero, two = _constant(0.0), _constant(2.0)
    s = zero
    for t in range(first):
        _store(slope, t, zero)
    for t in range(first, last):
        v = _load(e, t)
        s = _fma(v, v, s)
        _store(slope, t, _fma(two, v, zero))
    for t in range(last, slope.shape[0]):
        _store(slope, t, zero)
    _store(total, 0, s)


@njit(error_model="numpy", cache=True)
def adjoint_gradient(  # type: ignore[no-untyped-def]
    y, u, e, na, nb, nc, nk, start, parameters, slope, gradient
):
    """Gradient of a sum of losses by one backward pass, whatever the number of parameters.

    ``slope`` holds the loss's derivative with respect to each residual, and ``nc`` zero rows
    more; it is filtered backwards through 1/C in place, and correlated with ``y``, ``u`` and
    ``e``.  The gradient (rows as ``parameters``) is with respect to the signed parameters.
    """
    zero = _constant(0.0)
    for row in range(na + nb + 2 * nc):
        _store(gradient, row, zero)
    c = na + nb
    c1, c2, c3 = _load(parameters, c), _load(parameters, c + 1), _load(parameters, c + 2)
    for t in range(y.size - 1, start, -BLOCK):
        s0, s1, s2, s3 = (
            _load(slope, t),
            _load(slope, t - 1),
            _load(slope, t - 2),
            _load(slope, t - 3),
        )
        for k in range(nc - 1, MIN_NC - 1, -1):
            p, q = _load(parameters, c + k), t + 1 + k
            s0, s1 = _fma(p, _load(slope, q), s0), _fma(p, _load(slope, q - 1), s1)
            s2, s3 = _fma(p, _load(slope, q - 2), s2), _fma(p, _load(slope, q - 3), s3)
        n1, n2, n3 = _load(slope, t + 1), _load(slope, t + 2), _load(slope, t + 3)
        s0 = _fma(c1, n1, _fma(c2, n2, _fma(c3, n3, s0)))
        s1 = _fma(c1, s0, _fma(c2, n1, _fma(c3, n2, s1)))
        s2 = _fma(c1, s1, _fma(c2, s0, _fma(c3, n1, s2)))
        s3 = _fma(c1, s2, _fma(c2, s1, _fma(c3, s0, s3)))
        _store(slope, t, s0)
        _store(slope, t - 1, s1)
        _store(slope, t - 2, s2)
        _store(slope, t - 3, s3)
        for i in range(na):
            q = t - 1 - i
            even = _fma(s2, _sample(y, q - 2), _fma(s0, _sample(y, q), _load(gradient, i)))
            odd = _fma(s3, _sample(y, q - 3), _fma(s1, _sample(y, q - 1), zero))
            _store(gradient, i, _add(even, odd))
        for j in range(nb):
            q = t - nk - j
            even = _fma(s2, _sample(u, q - 2), _fma(s0, _sample(u, q), _load(gradient, na + j)))
            odd = _fma(s3, _sample(u, q - 3), _fma(s1, _sample(u, q - 1), zero))
            _store(gradient, na + j, _add(even, odd))
        for k in range(nc):
            q = t - 1 - k
            even = _fma(s2, _load(e, q - 2), _fma(s0, _load(e, q), _load(gradient, c + k)))
            odd = _fma(s3, _load(e, q - 3), _fma(s1, _load(e, q - 1), zero))
            _store(gradient, c + k, _add(even, odd))
    for k in range(nc):
        _store(gradient, c + nc + k, _load(slope, start + k))


@njit(error_model="numpy", cache=True)
def _inverse_filter(source, nc, c, start, parameters, filtered):  # type: ignore[no-untyped-def]
    """Filter a (T, LANES) table through 1/C from rest at ``start``."""
    zero = _constant(0.0)
    for t in range(start):
        _store(filtered, t, zero)
    c1, c2, c3 = _load(parameters, c), _load(parameters, c + 1), _load(parameters, c + 2)
    for t in range(start, filtered.shape[0], BLOCK):
        s0, s1, s2, s3 = (
            _load(source, t),
            _load(source, t + 1),
            _load(source, t + 2),
            _load(source, t + 3),
        )
        for k in range(nc - 1, MIN_NC - 1, -1):
            p, q = _load(parameters, c + k), t - 1 - k
            s0, s1 = _fma(p, _load(filtered, q), s0), _fma(p, _load(filtered, q + 1), s1)
            s2, s3 = _fma(p, _load(filtered, q + 2), s2), _fma(p, _load(filtered, q + 3), s3)
        e1, e2, e3 = _load(filtered, t - 1), _load(filtered, t - 2), _load(filtered, t - 3)
        s0 = _fma(c1, e1, _fma(c2, e2, _fma(c3, e3, s0)))
        s1 = _fma(c1, s0, _fma(c2, e1, _fma(c3, e2, s1)))
        s2 = _fma(c1, s1, _fma(c2, s0, _fma(c3, e1, s2)))
        s3 = _fma(c1, s2, _fma(c2, s1, _fma(c3, s0, s3)))
        _store(filtered, t, s0)
        _store(filtered, t + 1, s1)
        _store(filtered, t + 2, s2)
        _store(filtered, t + 3, s3)


@njit(error_model="numpy", cache=True)
def _lag_products(x, z, i0, j0, rows, columns, first, last, out, row, column, sign):  # type: ignore[no-untyped-def]
    """``out[row + i, column + j] = sum_t x[t - i0 - i] z[t - j0 - j]`` for eight models.

    Only the first row and column are summed over the record; the others follow from their
    upper-left neighbours by exchanging the end samples.
    """
    s = _constant(sign)
    zero = _constant(0.0)
    width = out.shape[1]
    flat = out.reshape(out.shape[0] * width, LANES)
    for j in range(columns):
        even, odd = zero, zero
        for t in range(first, last - 1, 2):
            even = _fma(_load(x, t - i0), _load(z, t - j0 - j), even)
            odd = _fma(_load(x, t + 1 - i0), _load(z, t + 1 - j0 - j), odd)
        if (last - first) % 2:
            even = _fma(_load(x, last - 1 - i0), _load(z, last - 1 - j0 - j), even)
        _store(flat, row * width + column + j, _fma(s, _add(even, odd), zero))
    for i in range(1, rows):
        even, odd = zero, zero
        for t in range(first, last - 1, 2):
            even = _fma(_load(x, t - i0 - i), _load(z, t - j0), even)
            odd = _fma(_load(x, t + 1 - i0 - i), _load(z, t + 1 - j0), odd)
        if (last - first) % 2:
            even = _fma(_load(x, last - 1 - i0 - i), _load(z, last - 1 - j0), even)
        _store(flat, (row + i) * width + column, _fma(s, _add(even, odd), zero))
        for j in range(1, columns):
            g = _load(flat, (row + i - 1) * width + column + j - 1)
            head = _fma(_load(x, first - i0 - i), _load(z, first - j0 - j), zero)
            tail = _fma(_load(x, last - i0 - i), _load(z, last - j0 - j), zero)
            g = _fma(s, head, g)
            g = _fma(_constant(-sign), tail, g)
            _store(flat, (row + i) * width + column + j, g)


@njit(error_model="numpy", cache=True)
def gauss_newton(  # type: ignore[no-untyped-def]
    y, u, e, na, nb, nc, nk, start, first, last, parameters, work, yf, uf, ef, df, matrix
):
    """Upper block triangle of ``sum_t J_t J_t'`` over ``first <= t < last``.

    ``J = [y_F(t-i), -u_F(t-nk-j), -e_F(t-k), i_F(t-k)]``, with respect to ``[a, b, c, d]``, of
    signals filtered through 1/C (Ljung 1999, section 10.3), ``i`` an impulse at ``start``.
    ``matrix`` is (n, n, LANES) with n = na + nb + 2 nc; blocks below the diagonal are left alone.
    ``first`` must exceed ``start`` by at least ``max(na, nb + nk, nc)`` or so that all lags exist.
    """
    c = na + nb
    for t in range(yf.shape[0]):
        _store(work, t, _sample(y, t))
    _inverse_filter(work, nc, c, start, parameters, yf)
    for t in range(yf.shape[0]):
        _store(work, t, _sample(u, t))
    _inverse_filter(work, nc, c, start, parameters, uf)
    _inverse_filter(e, nc, c, start, parameters, ef)
    for t in range(yf.shape[0]):
        _store(work, t, _constant(1.0 if t == start else 0.0))
    _inverse_filter(work, nc, c, start, parameters, df)
    d = c + nc
    _lag_products(yf, yf, 1, 1, na, na, first, last, matrix, 0, 0, 1.0)
    _lag_products(yf, uf, 1, nk, na, nb, first, last, matrix, 0, na, -1.0)
    _lag_products(yf, ef, 1, 1, na, nc, first, last, matrix, 0, c, -1.0)
    _lag_products(uf, uf, nk, nk, nb, nb, first, last, matrix, na, na, 1.0)
    _lag_products(uf, ef, nk, 1, nb, nc, first, last, matrix, na, c, 1.0)
    _lag_products(ef, ef, 1, 1, nc, nc, first, last, matrix, c, c, 1.0)
    _lag_products(yf, df, 1, 0, na, nc, first, last, matrix, 0, d, 1.0)
    _lag_products(uf, df, nk, 0, nb, nc, first, last, matrix, na, d, -1.0)
    _lag_products(ef, df, 1, 0, nc, nc, first, last, matrix, c, d, -1.0)
    _lag_products(df, df, 0, 0, nc, nc, first, last, matrix, d, d, 1.0)


@njit(error_model="numpy", cache=True)
def schur_stable(coefficients, radius):  # type: ignore[no-untyped-def]
    """Whether all roots of ``1 + x_1 q^-1 + ... + x_m q^-m`` lie within ``radius``, row by row.

    Step-down (Schur-Cohn) test on the polynomial whose roots are divided by ``radius``.

    Parameters
    ----------
    coefficients : (models, m) float array, without the leading 1
    radius : float

    Returns
    -------
    (models,) bool array
    """
    models_count, m = coefficients.shape
    stable = np.ones(models_count, dtype=np.bool_)
    x = np.empty(m)
    for model in range(models_count):
        scale = 1.0
        for i in range(m):
            scale *= radius
            x[i] = coefficients[model, i] / scale
        for order in range(m, 0, -1):
            k = x[order - 1]
            if not abs(k) < 1.0:
                stable[model] = False
                break
            d = 1.0 / (1.0 - k * k)
            for i in range(order // 2):
                j = order - 2 - i
                head, tail = x[i], x[j]
                x[i] = (head - k * tail) * d
                x[j] = (tail - k * head) * d
    return stable


@njit(error_model="numpy", cache=True)
def stability_barrier(coefficients, radius, with_curvature):  # type: ignore[no-untyped-def]
    """``-sum log(1 - k_i**2)`` over the reflection coefficients of each row's polynomial.

    It grows without bound as a root approaches ``radius``, and is the logarithm of the variance
    of white noise filtered through the polynomial's inverse, roots divided by ``radius``.

    Parameters
    ----------
    coefficients : (models, m) float array, without the leading 1
    radius : float
    with_curvature : bool
        Whether to return the Gauss-Newton part of the second derivatives as well.

    Returns
    -------
    values (models,), infinite where a root lies outside; gradients (models, m); curvatures
    (models, m, m), zero unless asked for.
    """
    models_count, m = coefficients.shape
    values = np.zeros(models_count)
    gradients = np.zeros((models_count, m))
    curvatures = np.zeros((models_count, m if with_curvature else 0, m))
    x, next_x = np.empty(m), np.empty(m)
    slopes, next_slopes = np.empty((m, m)), np.empty((m, m))  # d x_i / d coefficient_j
    for model in range(models_count):
        scale = 1.0
        for i in range(m):
            scale *= radius
            x[i] = coefficients[model, i] / scale
            slopes[i, :] = 0.0
            slopes[i, i] = 1.0 / scale
        for order in range(m, 0, -1):
            k = x[order - 1]
            if not abs(k) < 1.0:
                values[model] = np.inf
                gradients[model] = 0.0
                if with_curvature:
                    curvatures[model] = 0.0
                break
            d = 1.0 / (1.0 - k * k)
            own = slopes[order - 1]
            values[model] -= np.log1p(-k * k)
            for j in range(m):
                gradients[model, j] += 2.0 * k * d * own[j]
            if with_curvature:
                weight = 2.0 * (1.0 + k * k) * d * d
                for i in range(m):
                    for j in range(m):
                        curvatures[model, i, j] += weight * own[i] * own[j]
            for i in range(order - 1):
                mirror = order - 2 - i
                next_x[i] = (x[i] - k * x[mirror]) * d
                for j in range(m):
                    change = slopes[i, j] - k * slopes[mirror, j]
                    change += (2.0 * k * next_x[i] - x[mirror]) * own[j]
                    next_slopes[i, j] = change * d
            for i in range(order - 1):
                x[i] = next_x[i]
                for j in range(m):
                    slopes[i, j] = next_slopes[i, j]
    return values, gradients, curvatures
