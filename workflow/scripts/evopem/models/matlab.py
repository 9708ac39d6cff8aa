"""A model as a MAT file for MATLAB."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.files.atomic import atomic_write

if TYPE_CHECKING:
    from evopem.models.polynomial import PolynomialModel
    from evopem.models.state_space import StateSpaceModel


def save_model_mat(model: PolynomialModel | StateSpaceModel, path: str | os.PathLike[str]) -> None:
    """Write the arguments of MATLAB's ``idpoly`` or ``idss`` to a v5 MAT file.

    The level of the outputs, which they do not have, is stored beside them.
    """
    from scipy.io import savemat

    with atomic_write(Path(path)) as temporary, temporary.open("wb") as stream:
        savemat(stream, model.matlab_arguments())
        # SciPy stamps the header with the time of writing; the same model must give the same
        # bytes.  The first 116 bytes are free text (MATLAB Level 5 MAT-file format).
        stream.seek(0)
        stream.write(b"MATLAB 5.0 MAT-file, written by evopem".ljust(116))
