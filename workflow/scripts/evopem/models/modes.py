"""Oscillating modes: natural frequencies, damping ratios, shapes, and their uncertainty.

Of a polynomial by its roots, of a state-space model by its eigenvalues and eigenvectors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import NDArray

from evopem.arrays import Array, Complex
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial_roots import root_gradient, roots

# Product of the left and right eigenvectors of unit length below which an eigenvalue is defective.
DEFECTIVE = 1e-13


Fields = dict[str, Any]  # some fields of a :class:`Mode`


@dataclass(frozen=True, eq=False)
class Mode:
    """One oscillating mode of a model with l outputs and m inputs."""

    frequency_hz: float  # undamped natural frequency ``|s| / 2 pi``, ``s = ln(z) fs``
    damping_ratio: float  # ``-Re(s) / |s|``
    pole: complex  # in the z plane, upper half
    # frequency_se_hz, damping_se: standard errors; infinite when the data do not determine the
    # mode, NaN when the covariance is not known
    frequency_se_hz: float = float("nan")
    damping_se: float = float("nan")
    # (l,) ``C v``, v the eigenvector of A, scaled so that its largest entry is 1
    shape: Complex = field(default_factory=lambda: np.ones(1, dtype=complex))
    # shape_se_real, shape_se_imag: (l,) standard errors; 0 for the entry that is 1 by definition
    shape_se_real: Array = field(default_factory=lambda: np.zeros(1))
    shape_se_imag: Array = field(default_factory=lambda: np.zeros(1))
    # (m,) How each input drives the mode whose shape is scaled like this: ``w' B``, w the left
    # eigenvector with ``w' v = 1``; and (l,) each innovation, ``w' K``
    input_participation: Complex = field(default_factory=lambda: np.empty(0, dtype=complex))
    noise_participation: Complex = field(default_factory=lambda: np.empty(0, dtype=complex))
    # (l,) Share of the mode in the sum, over all modes and real poles, of the energies of their own
    # impulse responses: from the inputs, or from the innovations for a model without input
    output_shares: Array = field(default_factory=lambda: np.ones(1))
    # Modal assurance criterion that the shape is expected to have with the true one; 1 less the
    # variance of its part perpendicular to the shape.  NaN when the covariance is not known
    shape_assurance: float = float("nan")
    partner: int | None = None  # mode of the model whose pole the data tell from this one least
    # p-value of the hypothesis that both poles are equal (Wald's test).  Shapes of equal poles may
    # be any mixture of each other
    equal_poles_p: float = float("nan")
    # What ``shape_assurance`` is of the shape and the nearest one in the plane of both modes' true
    # shapes, which a mixture of the two does not change
    plane_assurance: float = float("nan")

    def __eq__(self, value: object) -> bool:
        return isinstance(value, Mode) and all(
            mine == theirs if name == "partner" else np.array_equal(mine, theirs, equal_nan=True)
            for (name, mine), theirs in zip(vars(self).items(), vars(value).values(), strict=True)
        )

    def __hash__(self) -> int:
        return hash((self.frequency_hz, self.damping_ratio, self.pole))

    @property
    def phase_collinearity(self) -> float:
        """1 for a shape whose entries move in phase or in opposite phase, 0 for a circling one."""
        return phase_collinearity(self.shape)

    @property
    def mean_phase_deg(self) -> float:
        """Angle of the line through the origin that fits the shape best, -90 to 90."""
        return mean_phase(self.shape)[0]

    @property
    def phase_deviation_deg(self) -> float:
        """Mean angle between the entries and that line, weighed by their magnitudes."""
        return mean_phase(self.shape)[1]


def frequency_and_damping(pole: complex, sampling_rate: float) -> tuple[float, float]:
    """Natural frequency in Hz and damping ratio of a pole in the z plane."""
    s = np.log(pole) * sampling_rate
    return float(abs(s) / (2.0 * np.pi)), float(-s.real / abs(s))


def pole_slopes(pole: complex, d_pole: NDArray, sampling_rate: float) -> Array:
    """Derivatives of frequency in Hz and damping ratio, (2, p), from those of the pole, (p,)."""
    s = np.log(pole) * sampling_rate
    ds = sampling_rate * d_pole / pole
    d_modulus = (np.conj(s) * ds).real / abs(s)
    d_damping = -ds.real / abs(s) + s.real * d_modulus / abs(s) ** 2
    return np.vstack([d_modulus / (2.0 * np.pi), d_damping])


def modes_of(coefficients: Array, sampling_rate: float) -> list[Mode]:
    """Modes of ``A = 1 + a_1 q^-1 + ...``, (na,) coefficients, by frequency."""
    poles = [complex(z) for z in roots(coefficients) if z.imag > 0.0]
    modes = [Mode(*frequency_and_damping(z, sampling_rate), z) for z in poles]
    return sorted(modes, key=lambda mode: mode.frequency_hz)


def pole_mode(coefficients: Array, pole: complex, sampling_rate: float) -> tuple[Array, Array]:
    """Frequency (Hz) and damping ratio of a root of ``1, a_1 ... a_na``, and derivatives, (2, na).

    For a pole of zero, and for a repeated one, the derivatives are taken for zero.
    """
    if pole == 0.0:
        return np.array([sampling_rate, 1.0]), np.zeros((2, len(coefficients)))
    values = np.array(frequency_and_damping(pole, sampling_rate))
    gradient = root_gradient(np.concatenate([[1.0], coefficients]), pole)[1:]
    slopes = pole_slopes(pole, gradient, sampling_rate)
    return values, np.where(np.isfinite(slopes), slopes, 0.0)


def state_space_modes(
    A: Array,
    B: Array,
    C: Array,
    K: Array,
    sampling_rate: float,
    covariance: ParameterCovariance | None = None,
) -> list[Mode]:
    """Modes of ``x+ = A x + B u + K e, y = C x + ...``, by frequency.

    The covariance is of the entries of ``[A, B, C, ...]``, row by row.
    """
    poles, right, left = eigenvectors(A)
    adjoint: Complex = left.conj().T.astype(complex)
    shapes: Complex = (C @ right).astype(complex)
    energies = _energies(poles, shapes, (adjoint @ (B if B.shape[1] else K)).astype(complex))
    total = energies.sum(axis=1)
    oscillating = np.flatnonzero(poles.imag > 0.0)
    oscillating = oscillating[np.argsort(np.abs(np.log(poles[oscillating])), kind="stable")]
    unknown = np.full(len(C), np.nan)
    errors: list[Fields] = [{"shape_se_real": unknown, "shape_se_imag": unknown}] * len(oscillating)
    neighbours: list[Fields] = [{}] * len(oscillating)
    if covariance is not None:
        derivatives = [
            mode_derivatives(poles, right, left, int(k), B, C, len(covariance)) for k in oscillating
        ]
        errors = [
            _standard_errors(poles[k], shapes[:, k], *derivative[:2], covariance, sampling_rate)
            for k, derivative in zip(oscillating, derivatives, strict=True)
        ]
        known = [
            place
            for place, error in enumerate(errors)
            if all(np.isfinite(value).all() for value in error.values())
        ]
        neighbours = neighbours_among(
            poles[oscillating], shapes[:, oscillating], derivatives, known, covariance
        )
    modes = []
    for k, error, neighbour in zip(map(int, oscillating), errors, neighbours, strict=True):
        scale = _scale(shapes[:, k])
        # Both of a conjugate pair belong to the mode.
        share = np.divide(2.0 * energies[:, k], total, out=np.zeros(len(C)), where=total > 0.0)
        frequency, damping = frequency_and_damping(poles[k], sampling_rate)
        modes.append(
            Mode(
                frequency_hz=frequency,
                damping_ratio=damping,
                pole=complex(poles[k]),
                shape=shapes[:, k] / scale,
                input_participation=scale * (adjoint[k] @ B),
                noise_participation=scale * (adjoint[k] @ K),
                output_shares=share,
                **error,
                **neighbour,
            )
        )
    return modes


def _scale(shape: Complex) -> complex:
    """The largest entry of a shape; 1 for a shape of zeros."""
    largest = complex(shape[np.argmax(np.abs(shape))])
    return largest if largest != 0.0 else 1.0 + 0.0j


def eigenvectors(A: Array) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues, right and left eigenvectors with ``left[:, k]^H right[:, k] = 1``.

    Left vectors of defective eigenvalues, such as repeated ones at zero, are zero.
    """
    poles, left, right = scipy.linalg.eig(A, left=True, right=True)
    products = np.sum(left.conj() * right, axis=0)
    defective = np.abs(products) < DEFECTIVE
    scales = np.where(defective, np.inf, products.conj())
    return poles, right.astype(complex), left / scales


def _energies(poles: Complex, shapes: Complex, drives: Complex) -> Array:
    """Energy of each pole's own impulse response at each output, (l, n); 0 where unbounded."""
    decay = 1.0 - np.abs(poles) ** 2
    finite = decay > 0.0
    driven = np.sum(np.abs(drives) ** 2, axis=1)
    per_pole = np.where(finite, driven / np.where(finite, decay, 1.0), 0.0)
    return np.asarray(np.abs(shapes) ** 2 * per_pole)


def _standard_errors(
    pole: complex,
    shape: Complex,
    d_pole: Complex,
    d_shape: Complex,
    covariance: ParameterCovariance,
    sampling_rate: float,
) -> Fields:
    """Of a mode, from the derivatives of its pole, (p,), and of its shape, (l, p)."""
    outputs, largest, scale = len(shape), int(np.argmax(np.abs(shape))), _scale(shape)
    d_scaled = (d_shape - np.outer(shape / scale, d_shape[largest])) / scale
    # The largest entry is 1 by definition, whatever the data determine.
    d_scaled[largest] = 0.0
    slopes = pole_slopes(pole, d_pole, sampling_rate)
    errors = covariance.standard_errors(np.vstack([slopes, d_scaled.real, d_scaled.imag]))
    return {
        "frequency_se_hz": float(errors[0]),
        "damping_se": float(errors[1]),
        "shape_se_real": errors[2 : 2 + outputs],
        "shape_se_imag": errors[2 + outputs :],
    }


def mode_derivatives(
    poles: Complex, right: Complex, left: Complex, k: int, B: Array, C: Array, entries: int
) -> tuple[Complex, Complex, Complex]:
    """Derivatives of a pole, (entries,), its shape ``C v``, (l, entries), and its drives ``w' B``.

    By the entries of ``[A, B, C, ...]``, row by row; those of the drives are (m, entries).
    """
    n, outputs, inputs = len(poles), len(C), B.shape[1]
    # d pole = w' dA v; d v = sum over the other poles of v_j (w_j' dA v) / (pole - pole_j).
    d_pole = np.zeros(entries, dtype=complex)
    d_pole[: n * n] = np.outer(left[:, k].conj(), right[:, k]).ravel()
    others = np.arange(n) != k
    gaps, adjoint = poles[k] - poles[others], left[:, others].conj().T
    spread = (C @ right[:, others] / gaps) @ adjoint
    d_shape = np.zeros((outputs, entries), dtype=complex)
    d_shape[:, : n * n] = np.einsum("ij,k->ijk", spread, right[:, k]).reshape(outputs, n * n)
    first = n * n + n * inputs
    for row in range(outputs):
        d_shape[row, first + row * n : first + (row + 1) * n] += right[:, k]
    # d w' = sum over the other poles of (w' dA v_j) w_j' / (pole - pole_j).
    spread = (right[:, others] / gaps) @ (adjoint @ B)
    d_drive = np.zeros((inputs, entries), dtype=complex)
    d_drive[:, : n * n] = np.einsum("i,jc->cij", left[:, k].conj(), spread).reshape(inputs, n * n)
    for column in range(inputs):
        d_drive[column, n * n + column : first : inputs] = left[:, k].conj()
    return d_pole, d_shape, d_drive


def phase_collinearity(shape: Complex) -> float:
    """Modal phase collinearity of a shape, 0 to 1.

    ``((l1 - l2) / (l1 + l2))^2`` of the eigenvalues of the second moments of real and imaginary
    parts (Pappa, Elliott & Schenk 1993).
    """
    xx, yy = float(shape.real @ shape.real), float(shape.imag @ shape.imag)
    xy = float(shape.real @ shape.imag)
    if xx + yy == 0.0:
        return float("nan")
    return round(((xx - yy) ** 2 + 4.0 * xy**2) / (xx + yy) ** 2, 15)


def mean_phase(shape: Complex) -> tuple[float, float]:
    """Angle of the best straight line through a shape, and the mean deviation, in degrees."""
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


def assurances(shapes: Sequence[Complex]) -> tuple[tuple[float, ...], ...]:
    """That of each pair of shapes, to twelve decimals."""
    return tuple(tuple(round(assurance(a, b), 12) for b in shapes) for a in shapes)


def plane_assurance(first: Complex, second: Complex) -> float:
    """Smallest squared cosine of the principal angles of two planes of shapes, (l, 2) each.

    For single shapes, (l, 1), it is the modal assurance criterion.
    """
    bases = np.linalg.qr(first)[0], np.linalg.qr(second)[0]
    cosines = np.linalg.svd(bases[0].conj().T @ bases[1], compute_uv=False)
    return float(min(cosines[-1], 1.0) ** 2)


def neighbours_among(
    poles: Complex,
    shapes: Complex,
    derivatives: Sequence[tuple[Complex, ...]],
    known: Sequence[int],
    covariance: ParameterCovariance,
) -> list[Fields]:
    """How well each shape, (l, modes), is known, alone and in the plane with a partner.

    As fields of :class:`.Mode`; nothing of those whose errors are not ``known``.
    """
    neighbours: list[Fields] = [{}] * len(poles)
    # Errors of poles and shapes for independent errors of unit variance.
    of_poles = {place: derivatives[place][0] @ covariance.factor for place in known}
    for row in known:
        deviations = derivatives[row][1] @ covariance.factor
        neighbours[row] = {
            "shape_assurance": _assurance_in(shapes[:, [row]], shapes[:, row], deviations)
        }
        equal = {
            near: _equal_poles_p(poles[row] - poles[near], of_poles[row] - of_poles[near])
            for near in known
            if near != row
        }
        if equal:
            partner = max(equal, key=lambda near: equal[near])
            plane = _assurance_in(shapes[:, [row, partner]], shapes[:, row], deviations)
            neighbours[row] |= {
                "partner": partner,
                "equal_poles_p": equal[partner],
                "plane_assurance": plane,
            }
    return neighbours


def _equal_poles_p(difference: complex, deviation: Complex) -> float:
    """p-value of a difference of two poles if it is zero."""
    parts = np.array([difference.real, difference.imag])
    half = np.vstack([deviation.real, deviation.imag])
    # The upper tail of chi-squared with two degrees of freedom.
    return float(np.exp(-0.5 * parts @ np.linalg.pinv(half @ half.T) @ parts))


def _assurance_in(space: Complex, shape: Complex, deviations: Complex) -> float:
    """Assurance expected of an estimated shape, (l,), and the part of it in the true space. To
    first order: 1 less the variance of the part across the estimated space, (l, 1 or 2).  The plane
    of two shapes does not depend on how the two are mixed, however close their poles are."""
    size = float(np.vdot(shape, shape).real)
    if size == 0.0:
        return float("nan")
    basis = np.linalg.qr(space)[0]
    across = deviations - basis @ (basis.conj().T @ deviations)
    return max(1.0 - float(np.sum(np.abs(across) ** 2)) / size, 0.0)
