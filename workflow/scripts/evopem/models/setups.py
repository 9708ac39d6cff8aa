"""Set-ups of one structure: models of different channels, some of which they have in common."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from evopem.arrays import Complex
from evopem.errors import InputError
from evopem.models.mode_matching import cluster_modes
from evopem.models.modes import Mode, assurance, eigenvectors, mode_derivatives, pole_slopes
from evopem.models.state_space import StateSpaceModel

# Two set-ups have the same mode where frequencies and shapes at common outputs differ by less: wide
# enough that a set-up which contradicts the others is compared with them.
SAME_FREQUENCY, SAME_SHAPE = 0.08, 0.5
INPUT = "\0"  # what the name of an input begins with among channels: no output has it


@dataclass(frozen=True, eq=False)
class Setup:
    """A model of some channels, linearised: what it says of each of its modes."""

    name: str
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    rate: float  # Hz
    modes: tuple[Mode, ...]
    # (2 + channels,) frequency in Hz, damping ratio, shape with 1 for its largest entry, and drives
    values: tuple[Complex, ...]
    # (2 + channels, r) their errors for independent errors of unit variance
    errors: tuple[Complex, ...]

    @classmethod
    def of(cls, name: str, model: StateSpaceModel, modes: Sequence[Mode] | None = None) -> Self:
        """The set-up of a model with covariance; by default all modes whose errors are known.

        Drives are those of continuous time, of inputs that are held between samples: they depend on
        neither the rate nor the delay that a model has.
        """
        if not isinstance(model, StateSpaceModel) or model.covariance is None:
            problem = "it has no state-space model with a covariance"
            raise InputError(name, problem, "estimate it with structure: state_space")
        if not model.output_names or len(model.input_names) != model.inputs:
            raise InputError(name, "its channels have no names", "give them names")
        known = [
            mode
            for mode in (model.modes() if modes is None else modes)
            if np.isfinite([mode.frequency_se_hz, mode.damping_se, *mode.shape_se_real]).all()
        ]
        linearised = [_linearised(model, *eigenvectors(model.A), mode) for mode in known]
        values, errors = (tuple(pair[place] for pair in linearised) for place in (0, 1))
        names = model.output_names, model.input_names
        return cls(name, *names, model.sampling_rate, tuple(known), values, errors)

    @property
    def channels(self) -> list[str]:
        """Outputs and inputs; an input has a sign before its name that no output has."""
        return [*self.outputs, *(INPUT + name for name in self.inputs)]


def _linearised(
    model: StateSpaceModel, poles: Complex, right: Complex, left: Complex, mode: Mode
) -> tuple[Complex, Complex]:
    """Values of a mode and the derivatives of these times the factor of the covariance."""
    covariance = model.covariance
    assert covariance is not None
    k, rate = int(np.argmin(np.abs(poles - mode.pole))), model.sampling_rate
    slopes = mode_derivatives(poles, right, left, k, model.B, model.C, len(covariance))
    d_pole, d_shape, d_drive = (slope @ covariance.factor for slope in slopes)
    pole, shape = poles[k], model.C @ right[:, k]
    drive = left[:, k].conj() @ model.B
    largest = int(np.argmax(np.abs(shape)))
    scale = shape[largest]
    d_scaled = (d_shape - np.outer(shape / scale, d_shape[largest])) / scale
    d_scaled[largest] = 0.0
    # A held input drives the mode by (z - 1) / s times its continuous drive, later by its delay.
    delays, s = np.array(model.delays), np.log(pole) * rate
    factor = scale * pole**-delays * s / (pole - 1.0)
    relative = -delays / pole + rate / (pole * s) - 1.0 / (pole - 1.0)
    d_factor = np.outer(factor * relative, d_pole) + np.outer(factor / scale, d_shape[largest])
    d_held = factor[:, None] * d_drive + drive[:, None] * d_factor
    values = [mode.frequency_hz, mode.damping_ratio, *(shape / scale), *(factor * drive)]
    return np.array(values), np.vstack([pole_slopes(pole, d_pole, rate), d_scaled, d_held])


def check_setups(setups: Sequence[Setup]) -> None:
    """Refuse set-ups that cannot be merged whatever their modes are."""
    if len(setups) < 2:
        raise InputError("set-ups", "there are fewer than two", "give those of one structure")
    alone = set(range(len(setups))) - set(connected(setups, range(len(setups))))
    if alone:
        problem = "it has no channel in common with the others, through which its shapes are scaled"
        remedy = "give common channels the same names, or leave it out"
        raise InputError(setups[min(alone)].name, problem, remedy)


def connected(setups: Sequence[Setup], places: Sequence[int]) -> list[int]:
    """The largest part of some set-ups that common channels connect, in order of connection."""
    left, parts = list(places), []
    while left:
        part = [left.pop(0)]
        channels = set(setups[part[0]].channels)
        while near := [place for place in left if channels & set(setups[place].channels)]:
            part.append(near[0])
            left.remove(near[0])
            channels |= set(setups[near[0]].channels)
        parts.append(part)
    return max(parts, key=len, default=[])


def common_modes(setups: Sequence[Setup]) -> list[dict[int, int]]:
    """Index of each merged mode in the set-ups that have it and that common channels connect."""

    def distance(place: int, mode: Mode, second: int, later: Mode) -> float:
        common = [name for name in setups[place].outputs if name in setups[second].outputs]
        shapes = (
            seen.shape[[setups[at].outputs.index(name) for name in common]]
            for at, seen in ((place, mode), (second, later))
        )
        apart = abs(np.log(mode.frequency_hz / later.frequency_hz)) / SAME_FREQUENCY
        return float(np.fmax(apart, (1.0 - assurance(*shapes)) / (1.0 - SAME_SHAPE)))

    groups = cluster_modes(dict(enumerate(setup.modes for setup in setups)), distance)
    having = [connected(setups, sorted(group)) for group in groups]
    return [
        {place: group[place] for place in places}
        for group, places in zip(groups, having, strict=True)
        if len(places) >= max(2, len(setups) / 2)
    ]
