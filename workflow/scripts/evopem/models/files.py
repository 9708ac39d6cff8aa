"""Models on disk: JSON for evopem and people, MAT for MATLAB."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.files.atomic import whole, write_json
from evopem.models.armax import ArmaxModel
from evopem.models.parameter_covariance import ParameterCovariance


def model_record(model: ArmaxModel) -> dict[str, Any]:
    """A model as JSON-able data: coefficients, covariance, poles, zeros and modes."""
    orders = model.orders
    covariance = model.covariance
    return {
        "orders": {"na": orders.na, "nb": orders.nb, "nc": orders.nc, "nk": orders.nk},
        "a": model.a.tolist(),
        "b": model.b.tolist(),
        "c": model.c.tolist(),
        "sampling_rate": model.sampling_rate,
        "noise_variance": _number(model.noise_variance),
        "covariance": None if covariance is None else _numbers(covariance.matrix),
        "covariance_factor": None if covariance is None else covariance.factor.tolist(),
        "unidentifiable_directions": (
            None if covariance is None else covariance.null_space.T.tolist()
        ),
        "parameter_standard_errors": (
            None
            if covariance is None
            else _numbers(covariance.standard_errors(np.eye(orders.parameters)))
        ),
        "modes": [
            {
                "frequency_hz": mode.frequency_hz,
                "damping_percent": 100.0 * mode.damping_ratio,
                "frequency_se_hz": _number(mode.frequency_se_hz),
                "damping_se_percent": _number(100.0 * mode.damping_se),
                "pole": _pair(mode.pole),
            }
            for mode in model.modes()
        ],
        "poles": [_pair(z) for z in model.poles()],
        "zeros": [_pair(z) for z in model.zeros()],
        "noise_zeros": [_pair(z) for z in model.noise_zeros()],
    }


def save_model_json(
    model: ArmaxModel, path: str | os.PathLike[str], evidence: Mapping[str, Any] | None = None
) -> None:
    """Write a model, and whatever else is known of it, as JSON; whole or not at all."""
    record = {**model_record(model), **(evidence or {})}
    write_json(Path(path), record)


def save_model_mat(model: ArmaxModel, path: str | os.PathLike[str]) -> None:
    """Write the arguments of MATLAB's ``idpoly(A,B,C,D,F,NoiseVariance,Ts)`` to a v5 MAT file."""
    from scipy.io import savemat

    with whole(Path(path)) as temporary, temporary.open("wb") as stream:
        savemat(
            stream,
            {
                "A": model.a[None, :],
                "B": model.delayed_b[None, :],
                "C": model.c[None, :],
                "D": np.ones((1, 1)),
                "F": np.ones((1, 1)),
                "NoiseVariance": model.noise_variance,
                "Ts": 1.0 / model.sampling_rate,
            },
        )
        # SciPy stamps the header with the time of writing; the same model must give the same
        # bytes.  The first 116 bytes are free text (MATLAB Level 5 MAT-file format).
        stream.seek(0)
        stream.write(b"MATLAB 5.0 MAT-file, written by evopem".ljust(116))


def load(path: str | os.PathLike[str]) -> ArmaxModel:
    """Read the model of a ``model.json``.

    Raises
    ------
    InputError
        When the file is missing or is not a model of evopem.
    """
    source = os.fspath(path)
    remedy = "give the model.json of a results folder"
    try:
        record = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(source, f"it cannot be read ({error.strerror})", remedy) from None
    except ValueError:
        raise InputError(source, "it is not JSON", remedy) from None
    try:
        variance = record["noise_variance"]
        return ArmaxModel(
            a=np.array(record["a"], dtype=float),
            b=np.array(record["b"], dtype=float),
            c=np.array(record["c"], dtype=float),
            nk=int(record["orders"]["nk"]),
            sampling_rate=float(record["sampling_rate"]),
            noise_variance=math.nan if variance is None else float(variance),
            covariance=_covariance(record),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(source, f"it is not a model of evopem ({error})", remedy) from None


def _covariance(record: Mapping[str, Any]) -> ParameterCovariance | None:
    """The covariance of a model's record; by its matrix alone where no factor is on record."""
    if record["covariance"] is None:
        return None
    if record.get("covariance_factor") is None:
        return ParameterCovariance.from_matrix(np.array(record["covariance"], dtype=float))
    factor = np.array(record["covariance_factor"], dtype=float)
    directions = np.array(record["unidentifiable_directions"], dtype=float)
    return ParameterCovariance(factor, directions.reshape(-1, len(factor)).T)


def _numbers(values: NDArray[np.float64]) -> list[Any]:
    """An array as nested lists, with None for what is not finite."""
    entries = values.astype(object)
    entries[~np.isfinite(values)] = None
    found: list[Any] = entries.tolist()
    return found


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _pair(value: complex) -> list[float]:
    return [float(value.real), float(value.imag)]
