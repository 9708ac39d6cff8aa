"""Shapes of modes: how straight they are, how alike two are, and how well each is known."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from evopem.arrays import Complex
from evopem.models.parameter_covariance import ParameterCovariance


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
) -> list[dict[str, Any]]:
    """How well each shape, (l, modes), is known, alone and in the plane with a partner.

    As fields of :class:`.Mode`; nothing of those whose errors are not ``known``.
    """
    neighbours: list[dict[str, Any]] = [{}] * len(poles)
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
    """Assurance expected of an estimated shape, (l,), and the part of it in the true space.

    To first order: 1 less the variance of the part across the estimated space, (l, 1 or 2).  The
    plane of two shapes does not depend on how the two are mixed, however close their poles are.
    """
    size = float(np.vdot(shape, shape).real)
    if size == 0.0:
        return float("nan")
    basis = np.linalg.qr(space)[0]
    across = deviations - basis @ (basis.conj().T @ deviations)
    return max(1.0 - float(np.sum(np.abs(across) ** 2)) / size, 0.0)
