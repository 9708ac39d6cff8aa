"""One SIMD vector of eight doubles as a numba type, and its arithmetic.

Eight candidate models share one pass over the record, one in each lane of a vector, so that a
sequential recursion costs the same for eight models as for one.  All arithmetic is IEEE and
explicitly ordered (no reassociation; fused multiply-adds where the code says so), so the bits of a
result do not depend on the width of a machine's vectors or on which models share a pass.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.extending import intrinsic, register_model
from numpy.typing import NDArray

LANES = 8

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)


class _LanesType(types.Type):
    """The numba type of one SIMD vector of eight doubles."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


_lanes = _LanesType()


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type) -> None:
        super().__init__(dmm, fe_type, _VECTOR)


def _splat(builder, scalar):
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, undefined, zeros)


def _entry_type(table):
    return _lanes if table.ndim == 2 else types.float64


def _run_pointer(context, builder, array_type, array, index):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _VECTOR.as_pointer())


def _row_pointer(context, builder, array_type, array, row):
    if array_type.ndim == 1:
        data = context.make_array(array_type)(context, builder, array).data
        return builder.gep(data, [row])
    offset = builder.mul(row, ir.Constant(row.type, LANES))
    return _run_pointer(context, builder, array_type, array, offset)


@intrinsic
def constant(typingctx, scalar):
    """All lanes equal to a scalar."""

    def codegen(context, builder, signature, args):
        return _splat(builder, args[0])

    return _lanes(types.float64), codegen


@intrinsic
def sample(typingctx, signal, index):
    """All lanes equal to ``signal[index]``; the index is not checked."""

    def codegen(context, builder, signature, args):
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        return _splat(builder, builder.load(builder.gep(data, [args[1]])))

    return _lanes(signal, types.intp), codegen


@intrinsic
def load(typingctx, table, row):
    """Row of a C-contiguous (rows, LANES) table as one vector, or a number of a flat one."""

    def codegen(context, builder, signature, args):
        pointer = _row_pointer(context, builder, signature.args[0], args[0], args[1])
        return builder.load(pointer, align=8)

    return _entry_type(table)(table, types.intp), codegen


@intrinsic
def load_either(typingctx, source, row):
    """:func:`load` of a table, :func:`sample` of a signal."""
    table = source.ndim == 2

    def codegen(context, builder, signature, args):
        array_type = signature.args[0]
        if table:
            pointer = _row_pointer(context, builder, array_type, args[0], args[1])
            return builder.load(pointer, align=8)
        data = context.make_array(array_type)(context, builder, args[0]).data
        return _splat(builder, builder.load(builder.gep(data, [args[1]])))

    return _lanes(source, types.intp), codegen


@intrinsic
def store(typingctx, table, row, entry):
    """Write what :func:`load` reads."""

    def codegen(context, builder, signature, args):
        pointer = _row_pointer(context, builder, signature.args[0], args[0], args[1])
        builder.store(args[2], pointer, align=8)
        return context.get_dummy_value()

    return types.void(table, types.intp, _entry_type(table)), codegen


def _call(builder, name, arguments):
    kind = arguments[0].type
    suffix = f"v{LANES}f64" if kind == _VECTOR else "f64"
    function_type = ir.FunctionType(kind, [kind] * len(arguments))
    function = cgutils.get_or_insert_function(
        builder.module, function_type, f"llvm.{name}.{suffix}"
    )
    return builder.call(function, arguments)


@intrinsic
def fma(typingctx, x, y, z):
    """``x * y + z`` rounded once, of vectors or numbers."""

    def codegen(context, builder, signature, args):
        return _call(builder, "fma", args)

    return x(x, x, x), codegen


@intrinsic
def square_root(typingctx, x):
    """Square root of every lane."""

    def codegen(context, builder, signature, args):
        return _call(builder, "sqrt", args)

    return _lanes(_lanes), codegen


@intrinsic
def magnitude(typingctx, x):
    """Absolute value of every lane."""

    def codegen(context, builder, signature, args):
        return _call(builder, "fabs", args)

    return _lanes(_lanes), codegen


@intrinsic
def add(typingctx, x, y):
    """``x + y``."""

    def codegen(context, builder, signature, args):
        return builder.fadd(*args)

    return _lanes(_lanes, _lanes), codegen


@intrinsic
def divide(typingctx, x, y):
    """``x / y``."""

    def codegen(context, builder, signature, args):
        return builder.fdiv(*args)

    return _lanes(_lanes, _lanes), codegen


def lanes_table(rows: int) -> NDArray[np.float64]:
    """A (rows, LANES) table of zeros whose rows do not straddle cache lines."""
    line = 8 * LANES
    raw = np.zeros(LANES * (rows + 1))
    skipped = -raw.ctypes.data % line // raw.itemsize
    table: NDArray[np.float64] = raw[skipped : skipped + LANES * rows].reshape(rows, LANES)
    return table
