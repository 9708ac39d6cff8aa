"""Records of several inputs and one output: checked, as arrays, and long enough for the orders."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.estimation.multi_input.errors import MultiInputRecord, multi_input_record
from evopem.models.structures import Orders

Array = NDArray[np.float64]


def records_of(
    inputs: ArrayLike | Sequence[ArrayLike], output: ArrayLike | Sequence[ArrayLike]
) -> tuple[list[Array], list[Array]]:
    """(N, nu) inputs and (N,) outputs of each record.

    Raises
    ------
    ValueError
        When they do not match, or are not finite.
    """
    several = isinstance(inputs, list | tuple) and np.ndim(inputs[0]) == 2
    us = [np.asarray(u, dtype=float) for u in (inputs if several else [inputs])]  # type: ignore[union-attr]
    ys = [np.asarray(y, dtype=float) for y in (output if several else [output])]  # type: ignore[union-attr]
    ys = [y[:, 0] if y.ndim == 2 and y.shape[1] == 1 else y for y in ys]
    if len(us) != len(ys):
        raise ValueError(f"{len(us)} records of inputs and {len(ys)} of the output do not match")
    for u, y in zip(us, ys, strict=True):
        if u.ndim != 2 or y.ndim != 1 or len(u) != len(y):
            raise ValueError(
                f"inputs must be (N, nu) and the output (N,), not {u.shape} and {y.shape}"
            )
        if not (np.isfinite(u).all() and np.isfinite(y).all()):
            raise ValueError("inputs and output must be finite")
    return us, ys


def record_for(us: Sequence[Array], ys: Sequence[Array], orders: Orders) -> MultiInputRecord:
    """The scaled record, whose residuals begin with the first one of the orders.

    Raises
    ------
    ValueError
        When it does not determine the parameters, or the output is constant.
    """
    start = orders.first_residual
    states = 1 + sum(orders.nf) + orders.noise_states
    long = [(u, y) for u, y in zip(us, ys, strict=True) if len(y) > start + states]
    available = sum(len(y) - start for _, y in long)
    needed = orders.parameters + states * len(long)
    if available <= needed:
        raise ValueError(
            f"{orders} needs more than {needed} residuals for its parameters and initial states;"
            f" the record has {max(available, 0)}"
        )
    if not any(np.ptp(y) > 0.0 for _, y in long):
        raise ValueError("the output is constant")
    return multi_input_record([u for u, _ in long], [y for _, y in long], start)
