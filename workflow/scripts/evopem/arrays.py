"""Types of arrays, and signals as columns."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
