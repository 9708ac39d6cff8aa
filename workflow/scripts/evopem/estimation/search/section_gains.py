"""What a further section may explain at each of many places: a small change of the coefficients of
a shared one adds residuals and input, filtered through its resonance.  How far these explain the
slopes of the loss is a score test (Söderström & Stoica 1989, section 11.5) by three spectra."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from evopem.arrays import Array, Complex, Indices
from evopem.estimation.pem.derived_errors import divided
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.pem.stretch_errors import StretchErrors

# Distances of a pair of roots from the unit circle, each twice the last, and how far apart places
# lie in these distances: a resonance is as wide as it is distant.
NEAREST, FARTHEST, SPACING = 0.005, 0.45, 2.0
OF_REAL_ROOTS = (0.01, 0.04, 0.12, 0.3, 0.6)  # distances of real roots, taken in pairs
# Frequencies that spectra are summed to: half as far apart as the nearest places are wide.
BINS = 1257
DAMPING = 1e-3  # added to the unit diagonal of the products of the signals of one place
# Mean second derivative of the absolute value of Gaussian residuals is this over their mean.
CURVATURE_OF_ABSOLUTE = 2.0 / np.pi


@lru_cache(maxsize=1)
def grid() -> Array:
    """Monic sections, (K, 3), at all places."""
    places, distance = [], NEAREST
    while distance < FARTHEST:
        count = int(np.ceil(np.pi / (SPACING * distance)))
        angles = np.pi * (np.arange(count) + 0.5) / count
        radii = np.full(count, 1.0 - distance)
        places.append(np.column_stack([np.ones(count), -2.0 * radii * np.cos(angles), radii**2]))
        distance *= 2.0
    roots = np.array([sign * (1.0 - away) for away in OF_REAL_ROOTS for sign in (1.0, -1.0)])
    first, second = roots[np.array(np.triu_indices(len(roots)))]
    places.append(np.column_stack([np.ones(len(first)), -first - second, first * second]))
    return np.concatenate(places)


@lru_cache(maxsize=1)
def _responses(bins: int) -> tuple[NDArray[np.complex64], NDArray[np.float32]]:
    """Frequency response of the inverse of each section of the grid, and its square."""
    delay = np.exp(-1j * np.pi * (np.arange(bins) + 0.5) / bins)
    sections = grid()
    response = 1.0 / (sections[:, :1] + sections[:, 1:2] * delay + sections[:, 2:] * delay**2)
    return response.astype(np.complex64), (np.abs(response) ** 2).astype(np.float32)


def gains(
    errors: PolynomialErrors, point: Array, shared: Sequence[tuple[str, int]], places: Indices
) -> Array:
    """Part of the objective that a shared section explains at each of some places, (M,).
    ``shared``: polynomials with it, by letter and input.  ``places`` (M,): rows of grid."""
    stretches = list(errors.of_stretches(point))
    samples = max(stretch_errors.samples for stretch_errors, _ in stretches)
    signals = [_slopes_and_signals(s, stretch_point, shared) for s, stretch_point in stretches]
    slopes = np.concatenate([signal[0] for signal in signals])
    # One row for each signal, in it one for each stretch.
    spectra = np.stack([np.fft.rfft(signal, samples) for signal in signals], axis=1)
    frequencies = spectra.shape[2]
    bins = min(BINS, frequencies)
    first_of_bin = -(-np.arange(bins) * frequencies // bins)
    response, power = (response[places] for response in _responses(bins))
    delay = np.exp(-1j * np.pi * np.arange(frequencies) / frequencies)

    def summed(*products: Complex) -> Complex:
        return np.add.reduceat(np.stack(products), first_of_bin, axis=1).T

    count = len(spectra) - 1
    scores = np.empty((len(places), 2 * count))
    matrices = np.empty((len(places), 2 * count, 2 * count))
    for i, spectrum in enumerate(spectra[1:]):
        cross = np.sum(spectra[0].conj() * spectrum, axis=0)
        both = summed(cross * delay, cross * delay**2).astype(np.complex64)
        scores[:, 2 * i : 2 * i + 2] = (response @ both).real
        for j, earlier_spectrum in enumerate(spectra[1 : i + 2]):
            cross = np.sum(spectrum * earlier_spectrum.conj(), axis=0)
            lags = summed(cross, cross * delay, cross * delay.conj()).real.astype(np.float32)
            same, later, earlier = (power @ lags).T
            block = np.array([[same, earlier], [later, same]]).transpose(2, 0, 1)
            rows, columns = slice(2 * i, 2 * i + 2), slice(2 * j, 2 * j + 2)
            matrices[:, rows, columns] = block
            matrices[:, columns, rows] = block.transpose(0, 2, 1)
    size = np.sqrt(np.einsum("ijj->ij", matrices))
    size[size == 0.0] = 1.0
    matrices /= size[:, :, None] * size[:, None, :]
    matrices += DAMPING * np.eye(2 * count)
    scores /= size
    solved = np.linalg.solve(matrices, scores[:, :, None])[:, :, 0]
    explained: Array = np.einsum("ij,ij->i", scores, solved) * 2.0 / samples
    if errors.objective == "absolute":
        return explained / (2.0 * CURVATURE_OF_ABSOLUTE * np.count_nonzero(slopes))
    return explained / float(slopes @ slopes)


def _slopes_and_signals(
    errors: StretchErrors, point: Array, shared: Sequence[tuple[str, int]]
) -> list[Array]:
    """Slopes; residuals and inputs as the coefficients of the shared polynomials would add them."""
    residuals = errors.residuals(point)
    slopes = np.sign(residuals) if errors.objective.absolute else residuals.copy()
    slopes[: errors.loss_start] = 0.0
    c, d = (np.append(1.0, point[errors.orders.part(name)]) for name in "cd")
    signals = [slopes]
    if ("c", 0) in shared:
        signals.append(divided(residuals, c))
    for place in (place for letter, place in shared if letter == "b"):
        f = np.append(1.0, point[errors.orders.part("f", place)])
        above = np.convolve(errors.inputs[:, place], d)[: len(residuals)]
        signals.append(divided(above, np.convolve(c, f)))
    return signals
