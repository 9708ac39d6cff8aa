"""One SIMD vector of eight doubles as a numba type: eight models share one pass, one in each lane.
All arithmetic is explicitly ordered, with fused multiply-adds where the code says so: bits depend
neither on a machine's vectors nor on which models share a pass."""

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.extending import intrinsic, register_model

from evopem.arrays import Array

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


def _row_pointer(context, builder, array_type, array, row):
    data = context.make_array(array_type)(context, builder, array).data
    if array_type.ndim == 1:
        return builder.gep(data, [row])
    offset = builder.mul(row, ir.Constant(row.type, LANES))
    return builder.bitcast(builder.gep(data, [offset]), _VECTOR.as_pointer())


@intrinsic
def constant(typingctx, scalar):
    """All lanes equal to a scalar."""

    def codegen(context, builder, signature, args):
        return _splat(builder, args[0])

    return _lanes(types.float64), codegen


def _loaded(context, builder, array_type, array, row):
    """A row of a table as one vector, or a number of a flat array."""
    pointer = _row_pointer(context, builder, array_type, array, row)
    return builder.load(pointer, align=8)


@intrinsic
def load(typingctx, table, row):
    """Row of a C-contiguous (rows, LANES) table as one vector, or a number of a flat one."""

    def codegen(context, builder, signature, args):
        return _loaded(context, builder, signature.args[0], *args)

    return _entry_type(table)(table, types.intp), codegen


@intrinsic
def load_either(typingctx, source, row):
    """Row of a table, or all lanes equal to ``source[row]`` of a signal; not checked."""
    table = source.ndim == 2

    def codegen(context, builder, signature, args):
        loaded = _loaded(context, builder, signature.args[0], *args)
        return loaded if table else _splat(builder, loaded)

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


def _unary(name):
    @intrinsic
    def operation(typingctx, x):
        def codegen(context, builder, signature, args):
            return _call(builder, name, args)

        return _lanes(_lanes), codegen

    return operation


def _binary(instruction):
    @intrinsic
    def operation(typingctx, x, y):
        def codegen(context, builder, signature, args):
            return getattr(builder, instruction)(*args)

        return _lanes(_lanes, _lanes), codegen

    return operation


# Of every lane.
square_root, magnitude = _unary("sqrt"), _unary("fabs")
add, divide = _binary("fadd"), _binary("fdiv")


def lanes_table(rows: int) -> Array:
    """A (rows, LANES) table of zeros whose rows do not straddle cache lines."""
    line = 8 * LANES
    raw = np.zeros(LANES * (rows + 1))
    skipped = -raw.ctypes.data % line // raw.itemsize
    return np.asarray(raw[skipped : skipped + LANES * rows].reshape(rows, LANES))
