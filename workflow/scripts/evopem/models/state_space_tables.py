"""Modes, shapes and frequency responses of a state-space model as tables."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evopem.models.modes import Mode
from evopem.models.state_space import StateSpaceModel

NORMAL_95 = 1.959963984540054
"""97.5 % point of the standard normal distribution."""

Array = NDArray[np.float64]
Column = list[float] | list[str] | list[int] | Array


def shaped_modes_table(
    modes: Sequence[Mode], input_names: Sequence[str], output_names: Sequence[str]
) -> dict[str, Column]:
    """One row for each mode and output: what holds of the mode stands in each of its rows."""
    rows = [
        (number, mode, place)
        for number, mode in enumerate(modes, 1)
        for place in range(len(output_names))
    ]
    drives = {
        f"participation_{part}_{name}": [
            getattr(mode.input_participation[column], part) for _, mode, _ in rows
        ]
        for column, name in enumerate(input_names)
        for part in ("real", "imag")
    }
    return {
        "mode": [number for number, _, _ in rows],
        "frequency_hz": [mode.frequency_hz for _, mode, _ in rows],
        "frequency_se_hz": [mode.frequency_se_hz for _, mode, _ in rows],
        "damping_percent": [100.0 * mode.damping_ratio for _, mode, _ in rows],
        "damping_se_percent": [100.0 * mode.damping_se for _, mode, _ in rows],
        "pole_real": [mode.pole.real for _, mode, _ in rows],
        "pole_imag": [mode.pole.imag for _, mode, _ in rows],
        "phase_collinearity": [mode.phase_collinearity for _, mode, _ in rows],
        "mean_phase_deg": [mode.mean_phase_deg for _, mode, _ in rows],
        "phase_deviation_deg": [mode.phase_deviation_deg for _, mode, _ in rows],
        "output": [output_names[place] for _, _, place in rows],
        "shape_real": [float(mode.shape[place].real) for _, mode, place in rows],
        "shape_imag": [float(mode.shape[place].imag) for _, mode, place in rows],
        "shape_se_real": [float(mode.shape_se_real[place]) for _, mode, place in rows],
        "shape_se_imag": [float(mode.shape_se_imag[place]) for _, mode, place in rows],
        "output_share": [float(mode.output_shares[place]) for _, mode, place in rows],
        **drives,
    }


def gain_intervals(model: StateSpaceModel, frequencies: Array) -> tuple[Array, Array]:
    """Lower and upper ends of 95 % intervals of the gains, (frequencies, ny, nu).

    To first order in the entries of the model for ``ln |G|``, so that no end is negative; NaN
    without a covariance and where the gain is zero.  Frequencies in Hz.
    """
    response = model.frequency_response(frequencies)
    errors = np.full(response.shape, np.nan)
    if model.covariance is not None:
        for place, frequency in enumerate(frequencies):
            errors[place] = _gain_errors(model, float(frequency))
    gain = np.abs(response)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        spread = np.exp(NORMAL_95 * errors / gain)
        return gain / spread, gain * spread


def _gain_errors(model: StateSpaceModel, frequency: float) -> Array:
    """Standard errors of all gains at one frequency, (ny, nu).

    ``dG = C R dA R B + dC R B + C R dB + dD`` with ``R = (zI - A)^-1``; a delay turns the phase
    alone.
    """
    n, ny, nu = model.order, model.outputs, model.inputs
    assert model.covariance is not None
    z = np.exp(2j * np.pi * frequency / model.sampling_rate)
    resolvent = np.linalg.inv(z * np.eye(n) - model.A)
    left, right = model.C @ resolvent, resolvent @ model.B
    G = left @ model.B + model.D
    size = np.abs(G)
    turned = np.conj(G) / np.where(size > 0.0, size, 1.0)
    ends = np.cumsum([0, n * n, n * nu, ny * n, ny * nu, n * ny, ny])
    factor = model.covariance.factor
    rank = factor.shape[1]
    parts = [factor[a:b] for a, b in pairwise(ends[:5])]
    dA = parts[0].reshape(n, n, rank)
    dB = parts[1].reshape(n, nu, rank)
    dC = parts[2].reshape(ny, n, rank)
    dD = parts[3].reshape(ny, nu, rank)
    change = np.einsum("ik,klr,lj->ijr", left, dA, right, optimize=True)
    change += np.einsum("ik,kjr->ijr", left, dB, optimize=True)
    change += np.einsum("ikr,kj->ijr", dC, right, optimize=True)
    change += dD
    along = (turned[:, :, None] * change).real
    errors: Array = np.linalg.norm(along, axis=2)
    return errors
