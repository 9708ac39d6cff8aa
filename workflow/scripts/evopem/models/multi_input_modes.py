"""Modes of polynomial models with several inputs: poles of A and F_i, and what drives them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evopem.models.modes import modes_of
from evopem.models.polynomials import roots
from evopem.models.state_space_modes import ShapedMode

if TYPE_CHECKING:
    from evopem.models.multi_input import MultiInputModel

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def modes_of_inputs(model: MultiInputModel) -> list[ShapedMode]:
    """Oscillating modes of a model with one output, by frequency.

    The shape of a mode at one output is 1.  The participation of an input is its residue: with
    ``participation / (z - pole)`` and its conjugate the mode adds to the response of the delayed
    input.

    Parameters
    ----------
    model : MultiInputModel
    """
    o = model.orders
    found, total = [], 0.0
    for letter, place, monic in [("a", 0, model.A), *(("f", i, f) for i, f in enumerate(model.F))]:
        known = model.covariance
        own = None if known is None else known.part(o.part(letter, place))
        for mode in modes_of(monic[1:], model.sampling_rate, own):
            driven = _participations(model, letter, place, mode.pole)
            found.append((mode, driven, _energy(mode.pole, driven)))
        for pole in roots(monic[1:]):
            total += _energy(pole, _participations(model, letter, place, pole))
    noise_poles = np.concatenate([roots(model.A[1:]), roots(model.D[1:])])
    shaped = [
        ShapedMode(
            frequency_hz=mode.frequency_hz,
            damping_ratio=mode.damping_ratio,
            pole=mode.pole,
            shape=np.ones(1, dtype=complex),
            input_participation=driven,
            noise_participation=np.array([_residue(model.C, noise_poles, mode.pole, 0)]),
            output_shares=np.array([2.0 * energy / total if total > 0.0 else 0.0]),
            phase_collinearity=1.0,
            mean_phase_deg=0.0,
            phase_deviation_deg=0.0,
            frequency_se_hz=mode.frequency_se_hz,
            damping_se=mode.damping_se,
            shape_se_real=np.zeros(1),
            shape_se_imag=np.zeros(1),
        )
        for mode, driven, energy in found
    ]
    return sorted(shaped, key=lambda mode: mode.frequency_hz)


def _energy(pole: complex, driven: Complex) -> float:
    """Energy of a pole's own impulse response from all inputs; 0 where it is unbounded."""
    decay = 1.0 - abs(pole) ** 2
    return float(np.sum(np.abs(driven) ** 2)) / decay if decay > 0.0 else 0.0


def _participations(model: MultiInputModel, letter: str, place: int, pole: complex) -> Complex:
    """Residues of the responses to all inputs at a pole of A, or of the F of one of them, (nu,)."""
    shared = roots(model.A[1:])
    found = np.zeros(len(model.B), dtype=complex)
    for i, (b, f, nk) in enumerate(zip(model.B, model.F, model.nk, strict=True)):
        if letter == "a" or i == place:
            poles = np.concatenate([shared, roots(f[1:])])
            found[i] = _residue(b, poles, pole, min(nk, 1))
    return found


def _residue(numerator: Array, poles: Complex, pole: complex, lag: int) -> complex:
    """Residue in z, at one of its poles, of ``q^-lag numerator / prod (1 - pole_k q^-1)``.

    0 where the filter does not have the pole.
    """
    gaps = np.abs(poles - pole)
    if not len(poles) or gaps.min() > 1e-9:
        return 0j
    others = np.delete(poles, np.argmin(gaps))
    below = np.prod(1.0 - others / pole)
    above = np.polynomial.polynomial.polyval(1.0 / pole, numerator) * pole ** (1 - lag)
    return complex(above / below)
