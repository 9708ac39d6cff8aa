"""The simulation error that no linear time-invariant model goes below, beside the model's.

Under a periodic input it is what is no linear response (:mod:`.distortion`); else what past inputs
explain of the error by no finite impulse response, whose fit has a known error.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from evopem.arrays import Array
from evopem.estimation.pem.least_squares import autoregression
from evopem.validation.distortion import Distortion
from evopem.validation.error_parts import Part, bounds_of
from evopem.validation.held_out_tests import MOST_WHITENING, left_by
from evopem.validation.responses import HeldOut

# Lags of all inputs at most, samples for each of them, and fewest of an input; samples at most.
MOST_LAGS, SAMPLES_PER_LAG, FEWEST_LAGS, MOST_SAMPLES = 300, 20, 5, 20_000
# Share of the energy of the plant's responses that later lags may have.
BEYOND = 0.01
# Share of the error from which on a floor is reached.
REACHED = 0.9


@dataclass(frozen=True)
class Floor:
    """The floor of the simulation error of an output, percent of its standard deviation."""

    name: str
    error_percent: float
    floor: Part
    rest: Part  # the model's part: the squares of both add up to that of the error

    @classmethod
    def of(cls, name: str, error: float, rest: Part) -> Self:
        """Of an error and the model's part of it."""
        left = (error**2 - part**2 for part in (rest.percent, rest.high, rest.low))
        return cls(name, error, Part(*(math.sqrt(max(x, 0.0)) for x in left)), rest)

    @property
    def reached(self) -> bool:
        """Whether the error is at the floor, with 95 % confidence."""
        return self.error_percent > 0.0 and self.floor.low >= REACHED * self.error_percent


def floors_of(
    distortion: Distortion, held_out: Sequence[HeldOut], fit_level: bool
) -> tuple[Floor, ...]:
    """The floor of each output; none where the data do not say it, as without an input.

    Feedback, which makes later inputs depend on the noise, is left to its check.
    """
    if not distortion.reason:
        known = distortion.outputs if distortion.separated else ()
        return tuple(Floor.of(x.name, x.error_percent, x.rest) for x in known)
    inputs = held_out[0].model.inputs
    samples = sum(stretch.recording.samples - stretch.unscored for stretch in held_out)
    lags = min(MOST_LAGS, samples // SAMPLES_PER_LAG) // max(inputs, 1)
    if not inputs or lags < FEWEST_LAGS or _is_longer(held_out[0], lags):
        return ()
    outputs, errors, rows = [], [], []
    for stretch in held_out:
        y, u, first = stretch.recording.outputs, stretch.inputs, stretch.unscored
        last = first + MOST_SAMPLES // len(held_out)
        padded = np.vstack([np.zeros((lags - 1, inputs)), u - u.mean(axis=0)])
        windows = np.lib.stride_tricks.sliding_window_view(padded, lags, axis=0)
        rows.append(windows[stretch.first :][first:last].reshape(-1, lags * inputs))
        errors.append((y - stretch.simulated(fit_level))[first:last])
        outputs.append(y[first:last])
    scales = np.std(np.concatenate(outputs), axis=0)
    if not all(np.isfinite(e).all() for e in errors) or not scales.all():
        return ()
    names = held_out[0].recording.output_names
    return tuple(
        _floor(name, [e[:, k] / scales[k] for e in errors], rows) for k, name in enumerate(names)
    )


def _is_longer(stretch: HeldOut, lags: int) -> bool:
    """Whether the plant remembers more than so many samples."""
    energies, rest = np.zeros(10 * lags), np.zeros((10 * lags, stretch.model.inputs))
    for impulse in np.eye(stretch.model.inputs):
        both = [stretch.plant.simulate(np.vstack([u, rest[1:]])) for u in (impulse, rest[0])]
        energies += np.sum((both[0] - both[1]) ** 2, axis=1)
    return not float(np.sum(energies[lags:])) <= BEYOND * float(np.sum(energies))


def _floor(name: str, errors: Sequence[Array], rows: Sequence[Array]) -> Floor:
    """The part of an error that inputs at some lags explain, beside a constant, and the floor."""
    from scipy.signal import lfilter

    error, columns = np.concatenate(errors), np.insert(np.concatenate(rows), 0, 1.0, axis=1)
    whitening = autoregression(left_by(columns, error), MOST_WHITENING)
    white = [
        lfilter(whitening, [1.0], np.column_stack([np.ones(len(e)), u, e]), axis=0)
        for e, u in zip(errors, rows, strict=True)
    ]
    basis, e = np.split(np.vstack([x[len(whitening) - 1 :] for x in white]), [-1], axis=1)
    inverse = np.linalg.pinv(basis.T @ basis, hermitian=True) @ basis.T
    fitted = inverse @ e[:, 0]
    # Errors whose size depends on the inputs, as distortion does (MacKinnon & White 1985, HC2).
    leverage = np.einsum("ij,ji->i", basis, inverse)
    weighted = inverse * (e[:, 0] - basis @ fitted) / np.sqrt(np.maximum(1.0 - leverage, 1e-6))
    power = columns.T @ columns / len(columns)
    product = power @ weighted @ weighted.T
    explained = float(fitted @ power @ fitted) - float(np.trace(product))
    variance = 2.0 * float(np.sum(product * product.T))
    variance += 4.0 * float(fitted @ product @ power @ fitted)
    rest = Part.of(explained, bounds_of(explained, variance))
    return Floor.of(name, 100.0 * math.sqrt(float(np.mean(error**2))), rest)
