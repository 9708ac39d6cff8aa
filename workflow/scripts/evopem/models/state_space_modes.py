"""Modes of a state-space model: frequencies, damping, complex shapes, and their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Product of the left and right eigenvectors of unit length below which an eigenvalue is defective.
DEFECTIVE = 1e-13


@dataclass(frozen=True, eq=False)
class ShapedMode:
    """One oscillating mode of a model with one or more outputs.

    Attributes
    ----------
    frequency_hz : float
        Undamped natural frequency ``|s| / 2 pi``, ``s = ln(z) fs``.
    damping_ratio : float
        ``-Re(s) / |s|``.
    pole : complex
        Pole in the z plane, upper half.
    shape : (ny,) complex array
        ``C v``, v the eigenvector of A, scaled so that its largest entry is 1.
    input_participation : (nu,) complex array
        How each input drives the mode whose shape is scaled like this: ``w' B``, w the left
        eigenvector with ``w' v = 1``.
    noise_participation : (ny,) complex array
        The same of the innovations, ``w' K``.
    output_shares : (ny,) array
        Share of the mode in the sum, over all modes and real poles, of the energies of their own
        impulse responses: from the inputs, or from the innovations for a model without input.
    phase_collinearity : float
        1 for a shape whose entries move in phase or in opposite phase, 0 for a circling one
        (modal phase collinearity, Pappa, Elliott & Schenk 1993; no mean is removed).
    mean_phase_deg : float
        Angle of the straight line through the origin that fits the entries best, -90 to 90.
    phase_deviation_deg : float
        Mean angle between the entries and that line, weighed by their magnitudes.
    frequency_se_hz, damping_se : float
        Standard errors; NaN when the covariance is not known.
    shape_se_real, shape_se_imag : (ny,) arrays
        Standard errors of the shape; 0 for the entry that is 1 by definition.
    shape_assurance : float
        Modal assurance criterion that the shape is expected to have with the true one; 1 less the
        variance of its part perpendicular to the shape.  NaN when the covariance is not known.
    partner : int or None
        The mode, counted from 0 in the model, whose pole the data tell from this one least.
    equal_poles_p : float
        p-value of the hypothesis that both poles are equal (Wald's test).  Shapes of equal poles
        may be any mixture of each other.
    plane_assurance : float
        What ``shape_assurance`` is of the shape and the nearest one in the plane of both modes'
        true shapes, which a mixture of the two does not change.
    """

    frequency_hz: float
    damping_ratio: float
    pole: complex
    shape: Complex
    input_participation: Complex
    noise_participation: Complex
    output_shares: Array
    phase_collinearity: float
    mean_phase_deg: float
    phase_deviation_deg: float
    frequency_se_hz: float
    damping_se: float
    shape_se_real: Array
    shape_se_imag: Array
    shape_assurance: float = float("nan")
    partner: int | None = None
    equal_poles_p: float = float("nan")
    plane_assurance: float = float("nan")


def shaped_modes(
    A: Array,
    B: Array,
    C: Array,
    K: Array,
    levels: int,
    sampling_rate: float,
    covariance: ParameterCovariance | None = None,
) -> list[ShapedMode]:
    """Modes of ``x+ = A x + B u + K e, y = C x + ...``, by frequency.

    Parameters
    ----------
    A : (n, n) array
    B : (n, nu) array
    C : (ny, n) array
    K : (n, ny) array
    levels : int
        Entries that follow ``[A, B, C, D, K]`` in the covariance.
    sampling_rate : float
        Hz.
    covariance : ParameterCovariance, optional
        Of ``[A, B, C, D, K, level]``, row by row; propagated to first order.
    """
    poles, right, left = _eigenvectors(A)
    adjoint: Complex = left.conj().T.astype(complex)
    shapes: Complex = (C @ right).astype(complex)
    energies = _energies(poles, shapes, (adjoint @ (B if B.shape[1] else K)).astype(complex))
    total = energies.sum(axis=1)
    oscillating = np.flatnonzero(poles.imag > 0.0)
    # By frequency.
    oscillating = oscillating[np.argsort(np.abs(np.log(poles[oscillating])), kind="stable")]
    errors = [_unknown_errors(len(C))] * len(oscillating)
    neighbours = [Neighbour()] * len(oscillating)
    if covariance is not None:
        derivatives = [
            _derivatives(poles, right, left, int(k), C, levels, len(covariance))
            for k in oscillating
        ]
        errors = [
            _standard_errors(poles[k], shapes[:, k], *each, covariance, sampling_rate)
            for k, each in zip(oscillating, derivatives, strict=True)
        ]
        known = [place for place, error in enumerate(errors) if error.known]
        neighbours = _among_known(
            poles[oscillating], shapes[:, oscillating], derivatives, known, covariance
        )
    modes = []
    for k, error, neighbour in zip(map(int, oscillating), errors, neighbours, strict=True):
        scale = _scale(shapes[:, k])
        shape = shapes[:, k] / scale
        phase, deviation = mean_phase(shape)
        s = np.log(poles[k]) * sampling_rate
        # Both of a conjugate pair belong to the mode.
        share = np.divide(2.0 * energies[:, k], total, out=np.zeros(len(C)), where=total > 0.0)
        modes.append(
            ShapedMode(
                frequency_hz=float(abs(s) / (2.0 * np.pi)),
                damping_ratio=float(-s.real / abs(s)),
                pole=complex(poles[k]),
                shape=shape,
                input_participation=scale * (adjoint[k] @ B),
                noise_participation=scale * (adjoint[k] @ K),
                output_shares=share,
                phase_collinearity=phase_collinearity(shape),
                mean_phase_deg=phase,
                phase_deviation_deg=deviation,
                frequency_se_hz=error.frequency_hz,
                damping_se=error.damping,
                shape_se_real=error.shape_real,
                shape_se_imag=error.shape_imag,
                shape_assurance=neighbour.shape_assurance,
                partner=neighbour.partner,
                equal_poles_p=neighbour.equal_poles_p,
                plane_assurance=neighbour.plane_assurance,
            )
        )
    return modes


def _among_known(
    poles: Complex,
    shapes: Complex,
    derivatives: Sequence[tuple[Complex, Complex]],
    known: Sequence[int],
    covariance: ParameterCovariance,
) -> list[Neighbour]:
    """The neighbour of each mode, among those whose standard errors are known."""
    neighbours = [Neighbour()] * len(poles)
    of_known = _neighbours(
        poles[known], shapes[:, known], [derivatives[place] for place in known], covariance
    )
    for place, neighbour in zip(known, of_known, strict=True):
        partner = None if neighbour.partner is None else known[neighbour.partner]
        neighbours[place] = replace(neighbour, partner=partner)
    return neighbours


def _scale(shape: Complex) -> complex:
    """The largest entry of a shape; 1 for a shape of zeros."""
    largest = complex(shape[np.argmax(np.abs(shape))])
    return largest if largest != 0.0 else 1.0 + 0.0j


def _eigenvectors(A: Array) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues, right and left eigenvectors with ``left[:, k]^H right[:, k] = 1``.

    Left vectors of defective eigenvalues, such as repeated ones at zero, are zero: these have no
    part of their own.
    """
    from scipy.linalg import eig

    poles, left, right = eig(A, left=True, right=True)
    products = np.sum(left.conj() * right, axis=0)
    defective = np.abs(products) < DEFECTIVE
    scales = np.where(defective, np.inf, products.conj())
    return poles, right.astype(complex), left / scales


def phase_collinearity(shape: Complex) -> float:
    """Modal phase collinearity of a shape, 0 to 1.

    ``((l1 - l2) / (l1 + l2))^2`` of the eigenvalues of the second moments of real and imaginary
    parts (Pappa, Elliott & Schenk 1993).

    Examples
    --------
    >>> phase_collinearity(np.array([1.0, -0.5]) * np.exp(0.3j))
    1.0
    """
    xx, yy = float(shape.real @ shape.real), float(shape.imag @ shape.imag)
    xy = float(shape.real @ shape.imag)
    if xx + yy == 0.0:
        return float("nan")
    return round(((xx - yy) ** 2 + 4.0 * xy**2) / (xx + yy) ** 2, 15)


def mean_phase(shape: Complex) -> tuple[float, float]:
    """Angle of the best straight line through a shape, and the mean deviation, in degrees.

    Examples
    --------
    >>> mean_phase(np.array([1.0, -0.5]) * np.exp(1j * np.pi / 6))
    (30.0, 0.0)
    """
    magnitudes = np.abs(shape)
    if not magnitudes.any():
        return float("nan"), float("nan")
    angle = 0.5 * np.angle(np.sum(shape**2))
    along = np.abs((shape * np.exp(-1j * angle)).real)
    away = np.arccos(np.clip(along / np.where(magnitudes > 0.0, magnitudes, 1.0), 0.0, 1.0))
    deviation = float(np.sum(magnitudes * away) / np.sum(magnitudes))
    return round(float(np.degrees(angle)), 10), round(float(np.degrees(deviation)), 5)


def assurance(first: Complex, second: Complex) -> float:
    """Modal assurance criterion of two shapes, ``|a' b|^2 / (a'a b'b)`` (Allemang 1982)."""
    size = float(np.vdot(first, first).real * np.vdot(second, second).real)
    return float(abs(np.vdot(first, second)) ** 2 / size) if size > 0.0 else float("nan")


def _energies(poles: Complex, shapes: Complex, drives: Complex) -> Array:
    """Energy of each pole's own impulse response at each output, (ny, n); 0 where unbounded."""
    decay = 1.0 - np.abs(poles) ** 2
    finite = decay > 0.0
    driven = np.sum(np.abs(drives) ** 2, axis=1)
    per_pole = np.where(finite, driven / np.where(finite, decay, 1.0), 0.0)
    energies: Array = np.abs(shapes) ** 2 * per_pole
    return energies


@dataclass(frozen=True, eq=False)
class ModeErrors:
    """Standard errors of frequency in Hz, of damping ratio, and of a shape scaled to one, (ny,)."""

    frequency_hz: float
    damping: float
    shape_real: Array
    shape_imag: Array

    @property
    def known(self) -> bool:
        """Whether the data determine all of them."""
        numbers = [self.frequency_hz, self.damping, *self.shape_real, *self.shape_imag]
        return bool(np.isfinite(numbers).all())


@dataclass(frozen=True)
class Neighbour:
    """How well a shape is known, alone and in the plane with a partner; see :class:`ShapedMode`."""

    shape_assurance: float = float("nan")
    partner: int | None = None
    equal_poles_p: float = float("nan")
    plane_assurance: float = float("nan")


def _unknown_errors(outputs: int) -> ModeErrors:
    unknown = np.full(outputs, np.nan)
    return ModeErrors(float("nan"), float("nan"), unknown, unknown)


def _derivatives(
    poles: Complex, right: Complex, left: Complex, k: int, C: Array, levels: int, entries: int
) -> tuple[Complex, Complex]:
    """Derivatives of a pole, (entries,), and of its shape ``C v``, (ny, entries)."""
    n, ny = len(poles), len(C)
    nu = (entries - levels - n * n - 2 * n * ny) // (n + ny)
    # d pole = w' dA v; d v = sum over the other poles of v_j (w_j' dA v) / (pole - pole_j).
    d_pole = np.zeros(entries, dtype=complex)
    d_pole[: n * n] = np.outer(left[:, k].conj(), right[:, k]).ravel()
    others = np.arange(n) != k
    gaps = poles[k] - poles[others]
    spread = (C @ right[:, others] / gaps) @ left[:, others].conj().T
    d_shape = np.zeros((ny, entries), dtype=complex)
    d_shape[:, : n * n] = np.einsum("ij,k->ijk", spread, right[:, k]).reshape(ny, n * n)
    first = n * n + n * nu
    for row in range(ny):
        d_shape[row, first + row * n : first + (row + 1) * n] += right[:, k]
    return d_pole, d_shape


def _standard_errors(
    pole: complex,
    shape: Complex,
    d_pole: Complex,
    d_shape: Complex,
    covariance: ParameterCovariance,
    sampling_rate: float,
) -> ModeErrors:
    """Standard errors of frequency, damping, and the real and imaginary parts of the shape."""
    ny, largest, scale = len(shape), int(np.argmax(np.abs(shape))), _scale(shape)
    d_scaled = (d_shape - np.outer(shape / scale, d_shape[largest])) / scale
    s = np.log(pole) * sampling_rate
    ds = sampling_rate * d_pole / pole
    d_modulus = (np.conj(s) * ds).real / abs(s)
    d_damping = -ds.real / abs(s) + s.real * d_modulus / abs(s) ** 2
    # The largest entry is 1 by definition, whatever the data determine.
    d_scaled[largest] = 0.0
    gradients = np.vstack([d_modulus / (2.0 * np.pi), d_damping, d_scaled.real, d_scaled.imag])
    found = covariance.standard_errors(gradients)
    return ModeErrors(float(found[0]), float(found[1]), found[2 : 2 + ny], found[2 + ny :])


def _neighbours(
    poles: Complex,
    shapes: Complex,
    derivatives: Sequence[tuple[Complex, Complex]],
    covariance: ParameterCovariance,
) -> list[Neighbour]:
    """How well each of the shapes, (ny, modes), is known, alone and with its partner."""
    # Errors of poles and shapes for independent errors of unit variance.
    of_poles = [d_pole @ covariance.factor for d_pole, _ in derivatives]
    of_shapes = [d_shape @ covariance.factor for _, d_shape in derivatives]
    found = []
    for own, deviations in enumerate(of_shapes):
        alone = _assurance_in(shapes[:, [own]], shapes[:, own], deviations)
        equal = {
            other: _equal_poles_p(poles[own] - poles[other], of_poles[own] - of_poles[other])
            for other in range(len(poles))
            if other != own
        }
        if not equal:
            found.append(Neighbour(alone))
            continue
        partner = max(equal, key=lambda other: equal[other])
        plane = _assurance_in(shapes[:, [own, partner]], shapes[:, own], deviations)
        found.append(Neighbour(alone, partner, equal[partner], plane))
    return found


def _equal_poles_p(difference: complex, deviation: Complex) -> float:
    """p-value of a difference of two poles if it is zero."""
    parts = np.array([difference.real, difference.imag])
    half = np.vstack([deviation.real, deviation.imag])
    # The upper tail of chi-squared with two degrees of freedom.
    return float(np.exp(-0.5 * parts @ np.linalg.pinv(half @ half.T) @ parts))


def _assurance_in(space: Complex, shape: Complex, deviations: Complex) -> float:
    """Assurance expected of an estimated shape, (ny,), and the part of it in the true space.

    To first order: 1 less the variance of the part across the estimated space, (ny, 1 or 2).  The
    plane of two shapes does not depend on how the two are mixed, however close their poles are.
    """
    size = float(np.vdot(shape, shape).real)
    if size == 0.0:
        return float("nan")
    basis = np.linalg.qr(space)[0]
    across = deviations - basis @ (basis.conj().T @ deviations)
    return max(1.0 - float(np.sum(np.abs(across) ** 2)) / size, 0.0)


def plane_assurance(first: Complex, second: Complex) -> float:
    """Smallest squared cosine of the principal angles of two planes of shapes, (ny, 2) each.

    For single shapes, (ny, 1), it is the modal assurance criterion.
    """
    bases = np.linalg.qr(first)[0], np.linalg.qr(second)[0]
    cosines = np.linalg.svd(bases[0].conj().T @ bases[1], compute_uv=False)
    return float(min(cosines[-1], 1.0) ** 2)
