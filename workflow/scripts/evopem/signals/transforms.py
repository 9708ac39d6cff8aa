"""Box-Cox transform and differencing, each with its exact inverse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError

BOX_COX_RANGE = (-5.0, 5.0)
"""Where ``auto`` looks for the Box-Cox parameter."""


def positive_shift(*signals: NDArray[np.float64]) -> float:
    """The shift that makes every sample of all signals positive; 0.0 when they already are.

    The smallest shifted sample lands one standard deviation of the first signal above
    zero: a rule free of units, and far enough from the transform's singularity at zero
    that no single sample dominates.

    The signals are the outputs, (N,) each, of all recordings that share the transform.
    """
    smallest = min(float(signal.min()) for signal in signals)
    if smallest > 0.0:
        return 0.0
    return float(np.std(signals[0])) - smallest


def box_cox(
    signal: NDArray[np.float64], parameter: float, shift: float, source: str = "box_cox"
) -> NDArray[np.float64]:
    """Box-Cox transform of a shifted signal: ``((y + shift)**parameter - 1) / parameter``.

    Box & Cox (1964); the logarithm at parameter 0.

    The shift, in the signal's unit, is added first.
    """
    from scipy.special import boxcox

    shifted = signal + shift
    if shifted.min() <= 0.0:
        first = int(np.argmax(shifted <= 0.0))
        raise InputError(
            source,
            f"the output plus its shift {shift:g} is {shifted[first]:g}, and the transform needs"
            " positive values",
            "use box_cox: none",
            f"sample {first + 1}",
        )
    with np.errstate(over="ignore"):
        transformed = boxcox(shifted, parameter)
        back = invert_box_cox(transformed, parameter, shift)
    largest = float(np.max(np.abs(back - signal)))
    if not largest <= 1e-6 * float(np.ptp(signal)):
        raise InputError(
            source,
            f"the parameter {parameter:g} flattens this output so far that it could not be"
            " transformed back",
            "choose a parameter nearer to 1 or box_cox: none",
        )
    return transformed


def invert_box_cox(
    signal: NDArray[np.float64], parameter: float, shift: float
) -> NDArray[np.float64]:
    """Undo `box_cox`; NaN where a value lies outside the transform's range."""
    from scipy.special import inv_boxcox

    # boxcox takes the logarithm below 1e-19, inv_boxcox the exponential at zero only.
    return inv_boxcox(signal, parameter if abs(parameter) >= 1e-19 else 0.0) - shift


def likeliest_box_cox(signal: NDArray[np.float64], shift: float, source: str = "box_cox") -> float:
    """The Box-Cox parameter of largest likelihood for a normal distribution.

    Box & Cox (1964), searched between the bounds of `BOX_COX_RANGE`.
    """
    from scipy.optimize import minimize_scalar
    from scipy.stats import boxcox_normmax

    def within_range(negative_likelihood):  # type: ignore[no-untyped-def]
        return minimize_scalar(
            negative_likelihood, bounds=BOX_COX_RANGE, method="bounded", options={"xatol": 1e-8}
        )

    # The likelihood's maximiser does not depend on the unit; a unit scale avoids overflow.
    shifted = signal + shift
    scaled = shifted / np.exp(np.mean(np.log(shifted)))
    parameter = float(boxcox_normmax(scaled, method="mle", optimizer=within_range))
    low, high = BOX_COX_RANGE
    if not low + 1e-3 < parameter < high - 1e-3:
        raise InputError(
            source,
            f"no parameter between {low:g} and {high:g} makes the output normal",
            "give a number or box_cox: none",
        )
    return parameter


def difference(
    signals: NDArray[np.float64], times: int
) -> tuple[NDArray[np.float64], tuple[tuple[float, ...], ...]]:
    """Difference signals, (N, channels), `times` times, keeping what the inverse needs.

    `times` is less than N.  The second value holds the first sample of the signals, of their first
    differences, … (`times` rows).
    """
    initial = []
    differenced = np.array(signals, dtype=np.float64)
    for _ in range(times):
        initial.append(tuple(differenced[0].tolist()))
        differenced = np.diff(differenced, axis=0)
    return differenced, tuple(initial)


def invert_difference(
    differenced: NDArray[np.float64], initial: tuple[tuple[float, ...], ...]
) -> NDArray[np.float64]:
    """Undo `difference`: sum up once for every row of initial values, the last one first.

    There are as many samples more than in `differenced` as there are rows. Rounding errors add up
    with each summation: about ``eps * N**times`` of the largest difference.
    """
    signals = np.array(differenced, dtype=np.float64)
    for first in reversed(initial):
        signals = np.cumsum(np.vstack([first, signals]), axis=0)
    return signals
