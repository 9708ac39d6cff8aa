"""Types of arrays, signals as columns, and one thread of BLAS for what is computed of them."""

import sys
from contextlib import AbstractContextManager
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import ThreadpoolController

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]
Integers = NDArray[np.int64]


def columns(signals: ArrayLike, count: int | None = None, role: str = "signals") -> Array:
    """Samples of shape (N,) or (N, channels) as columns of float64, with NaN for masked ones.

    ValueError where they have another shape, or not `count` channels.
    """
    if np.ma.isMaskedArray(signals):
        signals = np.ma.filled(np.ma.asarray(signals).astype(np.float64), np.nan)
    array: Array = np.asarray(signals, dtype=np.float64)
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or count not in (None, array.shape[1]):
        needed = "channels" if count is None else count
        raise ValueError(f"{role} must be (N, {needed}), not {np.shape(signals)}")
    return array


def one_blas_thread() -> AbstractContextManager[object]:
    """Hold all loaded libraries of linear algebra to one thread in a ``with`` block.

    The bits of a result must not depend on how many a machine would take.
    """
    # A library is loaded when a module is imported, and modules stay in the order of their import.
    limiter: AbstractContextManager[object] = _controller(
        len(sys.modules), next(reversed(sys.modules))
    ).limit(limits=1, user_api="blas")
    return limiter


@lru_cache(maxsize=1)
def _controller(_modules: int, _latest: str) -> ThreadpoolController:
    """The libraries that are loaded: looking for them takes milliseconds."""
    return ThreadpoolController()
