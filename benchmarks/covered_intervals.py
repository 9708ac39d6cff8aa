"""Counts of the 95 % intervals of modes that cover the truth, for benchmarks of several outputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# Half width of a 95 % interval in standard errors.
HALF_WIDTH = 1.96


class CoveredIntervals:
    """Intervals of frequencies, damping ratios and entries of shapes, record by record."""

    KINDS = ("frequency", "damping", "shape")

    def __init__(self) -> None:
        self.missed = 0
        self._records: list[dict[str, list[bool]]] = []

    def begin_record(self) -> None:
        """Count what follows for a further record."""
        self._records.append({kind: [] for kind in self.KINDS})

    def add(  # type: ignore[no-untyped-def]
        self, found, frequency_hz: float, damping_ratio: float, shape: Sequence[complex] = ()
    ) -> None:
        """Compare a mode with the truth; None where it was missed.

        ``shape`` are the true entries, (ny,), of any scale; none where shapes are not compared.
        Real and imaginary parts count of all entries but the one that is 1.
        """
        if found is None:
            self.missed += 1
            return
        hits = self._records[-1]
        hits["frequency"].append(
            abs(found.frequency_hz - frequency_hz) < HALF_WIDTH * found.frequency_se_hz
        )
        hits["damping"].append(
            abs(found.damping_ratio - damping_ratio) < HALF_WIDTH * found.damping_se
        )
        if not len(shape):
            return
        one = int(np.argmax(np.abs(found.shape)))
        difference = found.shape - np.asarray(shape) / shape[one]
        for k in np.delete(np.arange(len(shape)), one):
            hits["shape"] += [
                abs(difference[k].real) < HALF_WIDTH * found.shape_se_real[k],
                abs(difference[k].imag) < HALF_WIDTH * found.shape_se_imag[k],
            ]

    def cells(self) -> str:
        """Percent by kind with the standard error over records, and the modes missed."""
        shares = []
        for kind in self.KINDS:
            each = [100.0 * np.mean(hits[kind]) for hits in self._records if hits[kind]]
            error = np.std(each) / np.sqrt(len(each)) if each else 0.0
            shares.append(f"{np.mean(each):.1f} ± {error:.1f} %" if each else "–")
        return f"{' | '.join(shares)} | {self.missed}"
