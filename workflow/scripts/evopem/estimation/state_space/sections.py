"""Block-diagonal coordinates of state space: pairs of poles, their inputs and initial states.

A section is a pair of poles ``sigma +- sqrt(delta)``, complex for a negative delta, with the state
matrix ``[[sigma, s], [delta / s, sigma]]``.  Its entries depend smoothly on (sigma, delta), where
a pair of complex poles becomes one of real poles as well.  An odd order has one real pole more.

The redundancy of state space is the freedom to choose a basis of the states.  Away from repeated
poles, changes of basis move the state matrix in all directions but the block-diagonal ones.
Sections are therefore local coordinates of A, and what is left of the freedom is two directions a
section, which Levenberg-Marquardt steps never take: the errors do not depend on them.  The output
matrices are no coordinates: given the states, they follow by linear least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Least magnitude of delta for which s = sqrt(|delta|), which makes a section's two states of one
# size; s stays as it is below.
SMALLEST_DELTA = 1e-6
# Half the distance that two real poles of a section get at least when a model is converted.
SEPARATION = 2e-3


@dataclass(frozen=True)
class Layout:
    """Where the coordinates of a model of some order stand in a point.

    A point holds ``[sigma, delta, b1 (drives), b2 (drives)]`` for each pair, then
    ``[sigma, b (drives)]`` of the real pole of an odd order.  Drives are inputs, for innovations
    form outputs, and a pulse for the initial state of each segment.
    """

    order: int
    drives: int

    @property
    def pairs(self) -> int:
        """Number of pairs of poles."""
        return self.order // 2

    @property
    def single(self) -> bool:
        """Whether there is a real pole more."""
        return self.order % 2 == 1

    @property
    def sections(self) -> int:
        """Pairs, and the single pole."""
        return self.pairs + int(self.single)

    @property
    def pair_length(self) -> int:
        """Coordinates of a pair."""
        return 2 + 2 * self.drives

    @property
    def dimension(self) -> int:
        """Length of a point."""
        return self.pairs * self.pair_length + int(self.single) * (1 + self.drives)

    def pair_rows(self, point: Array) -> Array:
        """View of the coordinates of the pairs, (pairs, pair_length)."""
        return point[: self.pairs * self.pair_length].reshape(self.pairs, self.pair_length)

    def single_row(self, point: Array) -> Array:
        """View of the coordinates of the single pole, (1 + drives,), or empty."""
        return point[self.pairs * self.pair_length :]


@dataclass(frozen=True, eq=False)
class Sections:
    """The sections of a point as arrays, (sections,); the single pole is one without coupling."""

    sigma: Array
    coupling: Array  # s
    back: Array  # delta / s
    ratio: Array  # delta / s**2, between -1 and 1
    b1: Array  # (sections, drives): input matrix of the first states
    b2: Array


def scale_of(delta: Array) -> Array:
    """``s`` of sections, (m,)."""
    return np.sqrt(np.maximum(np.abs(delta), SMALLEST_DELTA))


def sections_of(layout: Layout, point: Array, coupling: Array | None = None) -> Sections:
    """Read the sections of a point; their s may be given."""
    pairs, drives = layout.pair_rows(point), layout.drives
    sigma, delta = pairs[:, 0], pairs[:, 1]
    coupling = scale_of(delta) if coupling is None else coupling[: layout.pairs]
    b1, b2 = pairs[:, 2 : 2 + drives], pairs[:, 2 + drives :]
    back = delta / coupling
    ratio = back / coupling
    if layout.single:
        row = layout.single_row(point)
        sigma = np.append(sigma, row[0])
        coupling, back = np.append(coupling, 0.0), np.append(back, 0.0)
        ratio = np.append(ratio, 0.0)
        b1 = np.vstack([b1, row[1:]])
        b2 = np.vstack([b2, np.zeros(drives)])
    return Sections(sigma, coupling, back, ratio, b1, b2)


def moved(layout: Layout, point: Array, step: Array) -> Array:
    """A point after a step in which the scale s of each section was held.

    The second state is rescaled to the new s.
    """
    after = point + step
    if layout.pairs:
        old = scale_of(layout.pair_rows(point)[:, 1])
        rows = layout.pair_rows(after)
        rows[:, 2 + layout.drives :] *= (old / scale_of(rows[:, 1]))[:, None]
    return after


def normalised(layout: Layout, point: Array) -> Array:
    """The point with inputs of unit size for each section, and sections by angle of their poles."""
    point = point.copy()
    rows = layout.pair_rows(point)
    sizes = np.linalg.norm(rows[:, 2:], axis=1)
    rows[:, 2:] /= np.where(sizes > 0.0, sizes, 1.0)[:, None]
    angles = np.where(
        rows[:, 1] < 0.0, np.arctan2(np.sqrt(np.abs(rows[:, 1])), rows[:, 0]), -rows[:, 0] - 10.0
    )
    rows[:] = rows[np.argsort(angles, kind="stable")]
    if layout.single:
        row = layout.single_row(point)
        size = np.linalg.norm(row[1:])
        row[1:] /= size if size > 0.0 else 1.0
    return point


def largest_radius(layout: Layout, point: Array) -> float:
    """Largest radius of the poles of a point."""
    rows = layout.pair_rows(point)
    radii = np.where(
        rows[:, 1] < 0.0,
        np.sqrt(np.maximum(rows[:, 0] ** 2 - rows[:, 1], 0.0)),
        np.abs(rows[:, 0]) + np.sqrt(np.maximum(rows[:, 1], 0.0)),
    )
    if layout.single:
        radii = np.append(radii, abs(layout.single_row(point)[0]))
    return float(np.max(radii))


def inside(layout: Layout, point: Array, radius: float) -> Array:
    """The point with poles beyond a radius moved to it along their rays."""
    if largest_radius(layout, point) <= radius:
        return point
    point = point.copy()
    for row in layout.pair_rows(point):
        if row[1] < 0.0:
            size = np.sqrt(row[0] ** 2 - row[1])
            if size > radius:
                factor = radius / size
                old = scale_of(row[1])
                row[0], row[1] = row[0] * factor, row[1] * factor**2
                row[2 + layout.drives :] *= old / scale_of(row[1])
        else:
            half = np.sqrt(row[1])
            high = np.clip(row[0] + half, -radius, radius)
            low = np.clip(row[0] - half, -radius, radius)
            old = scale_of(row[1])
            row[0], row[1] = 0.5 * (high + low), 0.25 * (high - low) ** 2
            row[2 + layout.drives :] *= old / scale_of(row[1])
    if layout.single:
        row = layout.single_row(point)
        row[0] = np.clip(row[0], -radius, radius)
    return point


def state_matrix(sections: Sections, layout: Layout) -> Array:
    """Block-diagonal state matrix of a point, (n, n)."""
    A = np.zeros((layout.order, layout.order), dtype=sections.sigma.dtype)
    for m in range(layout.pairs):
        i = 2 * m
        A[i, i] = A[i + 1, i + 1] = sections.sigma[m]
        A[i, i + 1] = sections.coupling[m]
        A[i + 1, i] = sections.back[m]
    if layout.single:
        A[-1, -1] = sections.sigma[-1]
    return A


def input_matrix(sections: Sections, layout: Layout) -> Array:
    """Columns by which the drives enter the states, (n, drives)."""
    B = np.zeros((layout.order, layout.drives), dtype=sections.b1.dtype)
    B[0 : 2 * layout.pairs : 2] = sections.b1[: layout.pairs]
    B[1 : 2 * layout.pairs : 2] = sections.b2[: layout.pairs]
    if layout.single:
        B[-1] = sections.b1[-1]
    return B


def grouped_poles(poles: Complex) -> tuple[Complex, Array]:
    """Upper poles of complex pairs, and real poles in ascending order."""
    upper = poles[poles.imag > 0.0]
    real = np.sort(poles[poles.imag == 0.0].real)
    return upper, real


def separated(poles: Complex) -> Complex:
    """Poles with the real ones moved apart where they almost coincide."""
    upper, real = grouped_poles(poles)
    real = real.copy()
    for k in range(1, len(real)):
        real[k] = max(real[k], real[k - 1] + 2.0 * SEPARATION)
    return np.concatenate([upper, upper.conj(), real])


def poles_only(layout: Layout, poles: Complex) -> Array:
    """A point with some poles, (order,), complex ones in conjugate pairs, and no inputs."""
    upper, real = grouped_poles(separated(poles))
    point = np.zeros(layout.dimension)
    if layout.single:
        # The real pole farthest from the origin stays alone; neighbours share a section.
        alone = int(np.argmax(np.abs(real)))
        layout.single_row(point)[0] = real[alone]
        real = np.delete(real, alone)
    rows = layout.pair_rows(point)
    rows[: len(upper), 0], rows[: len(upper), 1] = upper.real, -(upper.imag**2)
    low, high = real[0::2], real[1::2]
    rows[len(upper) :, 0] = 0.5 * (low + high)
    rows[len(upper) :, 1] = 0.25 * (high - low) ** 2
    return point


def point_of(layout: Layout, A: Array, B: Array) -> Array:
    """The point of a state matrix, (n, n), and the columns of its drives, (n, drives).

    Poles that coincide are moved apart a little, so that the conversion exists.
    """
    poles, vectors = np.linalg.eig(A)
    driven = np.linalg.lstsq(vectors, B.astype(complex), rcond=1e-12)[0]
    upper = np.flatnonzero(poles.imag > 0.0)
    real = np.flatnonzero(poles.imag == 0.0)
    real = real[np.argsort(poles[real].real, kind="stable")]
    apart = separated(poles)
    point = poles_only(layout, apart)
    rows, drives = layout.pair_rows(point), layout.drives
    for row, k in zip(rows, upper, strict=False):
        # x = 2 Re(v q): the states (Re q, -Im q) turn by [[Re, Im], [-Im, Re]].
        row[2 : 2 + drives] = driven[k].real
        row[2 + drives :] = -driven[k].imag * (poles[k].imag / scale_of(row[1]))
    values = apart[2 * len(upper) :].real
    if layout.single:
        alone = int(np.argmax(np.abs(values)))
        layout.single_row(point)[1:] = driven[real[alone]].real
        real = np.delete(real, alone)
    for row, low, high in zip(rows[len(upper) :], real[0::2], real[1::2], strict=True):
        # q_low = p - r, q_high = p + r up to a factor of 2.
        row[2 : 2 + drives] = (driven[high] + driven[low]).real
        row[2 + drives :] = (driven[high] - driven[low]).real
    return point
