"""Records of general polynomial models with known parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel

Array = NDArray[np.float64]

# Samples before the record, for the transients to decay.
RUN_IN = 2000


def polynomial_record(
    model: PolynomialModel, samples: int, noise_percent: float, generator: np.random.Generator
) -> tuple[Array, Array, float]:
    """Input, output and variance of the innovations of a record of a model.

    The input is white noise of unit variance; the innovations are Gaussian, so large that the noise
    in the output has ``noise_percent`` of the standard deviation of the noise-free output.  Without
    an input the innovations have unit variance.

    Parameters
    ----------
    model : PolynomialModel
        Stable.
    samples : int
    noise_percent : float
    generator : numpy.random.Generator

    Returns
    -------
    input (N,), output (N,), variance
    """
    from scipy.signal import lfilter

    u, e = generator.standard_normal((2, RUN_IN + samples))
    simulated = model.simulate(u)
    noise = lfilter(model.c, model.noise_denominator, e)
    scale = 1.0
    if len(model.b):
        kept = slice(RUN_IN, None)
        scale = noise_percent / 100.0 * float(np.std(simulated[kept]) / np.std(noise[kept]))
    output = simulated + scale * noise
    return u[RUN_IN:], output[RUN_IN:], scale**2
