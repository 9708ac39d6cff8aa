"""A model as a MAT file for MATLAB."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from evopem.files.atomic import atomic_write
from evopem.models.polynomial import PolynomialModel

if TYPE_CHECKING:
    from evopem.models.multi_input import MultiInputModel
    from evopem.models.state_space import StateSpaceModel


def save_model_mat(model: PolynomialModel, path: str | os.PathLike[str]) -> None:
    """Write the arguments of MATLAB's ``idpoly(A,B,C,D,F,NoiseVariance,Ts)`` to a v5 MAT file.

    The level of a polynomial model, which ``idpoly`` does not have, is stored beside them.
    """
    level = {"Level": model.level} if model.level else {}
    # Without an input, B and F are empty, as idpoly takes them for a time series.
    empty = np.zeros((0, 0))
    _save(
        {
            "A": model.a[None, :],
            "B": model.delayed_b[None, :] if model.has_input else empty,
            "C": model.c[None, :],
            "D": model.d[None, :],
            "F": model.f[None, :] if model.has_input else empty,
            "NoiseVariance": model.noise_variance,
            "Ts": 1.0 / model.sampling_rate,
            **level,
        },
        path,
    )


def save_state_space_mat(model: StateSpaceModel, path: str | os.PathLike[str]) -> None:
    """Write :meth:`StateSpaceModel.idss_arguments` to a v5 MAT file."""
    _save(model.idss_arguments(), path)


def save_multi_input_mat(model: MultiInputModel, path: str | os.PathLike[str]) -> None:
    """Write :meth:`MultiInputModel.idpoly_arguments` to a v5 MAT file."""
    _save(model.idpoly_arguments(), path)


def _save(contents: Mapping[str, ArrayLike], path: str | os.PathLike[str]) -> None:
    from scipy.io import savemat

    with atomic_write(Path(path)) as temporary, temporary.open("wb") as stream:
        savemat(stream, dict(contents))
        # SciPy stamps the header with the time of writing; the same model must give the same
        # bytes.  The first 116 bytes are free text (MATLAB Level 5 MAT-file format).
        stream.seek(0)
        stream.write(b"MATLAB 5.0 MAT-file, written by evopem".ljust(116))
