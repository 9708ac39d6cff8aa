"""Models of one output with a second one beside it."""

from dataclasses import replace

import numpy as np


def beside_white_noise(one):
    """The model with a second output of the same response, whose noise is white."""
    return replace(
        one,
        C=np.vstack([one.C, one.C]),
        D=np.vstack([one.D, one.D]),
        K=np.hstack([one.K, 0.0 * one.K]),
        level=np.zeros(2),
        noise_covariance=np.eye(2),
    )
