"""A model as a MAT file for MATLAB."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from evopem.files.atomic import atomic_write
from evopem.models.polynomial import PolynomialModel


def save_model_mat(model: PolynomialModel, path: str | os.PathLike[str]) -> None:
    """Write the arguments of MATLAB's ``idpoly(A,B,C,D,F,NoiseVariance,Ts)`` to a v5 MAT file.

    The level of a polynomial model, which ``idpoly`` does not have, is stored beside them.
    """
    from scipy.io import savemat

    level = {"Level": model.level} if model.level else {}
    with atomic_write(Path(path)) as temporary, temporary.open("wb") as stream:
        savemat(
            stream,
            {
                "A": model.a[None, :],
                # Without an input, B and F are empty, as idpoly takes them for a time series.
                "B": model.delayed_b[None, :] if model.has_input else np.zeros((0, 0)),
                "C": model.c[None, :],
                "D": model.d[None, :],
                "F": model.f[None, :] if model.has_input else np.zeros((0, 0)),
                "NoiseVariance": model.noise_variance,
                "Ts": 1.0 / model.sampling_rate,
                **level,
            },
        )
        # SciPy stamps the header with the time of writing; the same model must give the same
        # bytes.  The first 116 bytes are free text (MATLAB Level 5 MAT-file format).
        stream.seek(0)
        stream.write(b"MATLAB 5.0 MAT-file, written by evopem".ljust(116))
