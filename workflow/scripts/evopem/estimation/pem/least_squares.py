"""Least squares over records of any length, a bounded number of rows at a time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CHUNK = 8192


def chunks(start: int, stop: int) -> Iterator[tuple[int, int]]:
    """Neighbouring ranges of at most :data:`CHUNK` samples."""
    for first in range(start, stop, CHUNK):
        yield first, min(first + CHUNK, stop)


def triangle_of(blocks: Iterable[Array]) -> Array:
    """R of the QR decomposition of a matrix that comes in blocks of rows."""
    triangle = np.zeros((0, 0))
    for block in blocks:
        rows = np.concatenate([triangle, block]) if triangle.size else block
        triangle = np.asarray(np.linalg.qr(rows, mode="r"))
    return triangle
