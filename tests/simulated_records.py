"""Records of polynomial models, for tests and benchmarks."""

import numpy as np

from evopem.arrays import Array
from evopem.models.polynomial import PolynomialModel
from evopem.synthesis import WARM_UP


def polynomial_record(
    model: PolynomialModel, samples: int, noise_percent: float, generator: np.random.Generator
) -> tuple[Array, Array, float]:
    """Input, (N,), output, (N,), and variance of the innovations of a record of a stable model.

    The input is white noise of unit variance; the innovations are Gaussian, so large that the noise
    in the output has ``noise_percent`` of the standard deviation of the noise-free output.  Without
    an input the innovations have unit variance.
    """
    from scipy.signal import lfilter

    u, e = generator.standard_normal((2, WARM_UP + samples))
    simulated = model.simulate(u)
    noise = lfilter(model.C, model.noise_denominator, e)
    scale = 1.0
    if model.has_input:
        ratio = float(np.std(simulated[WARM_UP:]) / np.std(noise[WARM_UP:]))
        scale = noise_percent / 100.0 * ratio
    output = simulated + scale * noise
    return u[WARM_UP:], output[WARM_UP:], scale**2
