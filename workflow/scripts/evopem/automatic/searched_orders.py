"""The orders of state-space models that are tried: all that a record can determine."""

from __future__ import annotations

from evopem.automatic.multichannel_folds import fewest_fitted
from evopem.errors import InputError
from evopem.signals.recording import Recording

# Largest order tried, and output values for each parameter of the largest model.
MOST_STATES, VALUES_PER_PARAMETER = 40, 5
# Above this largest order they are tried in steps of two.
SINGLE_STEPS = 10


def searched_orders(estimation: Recording, limits: tuple[int, int] | None) -> tuple[int, ...]:
    """The orders that are tried: all that the record can determine, in steps of two where many.

    Parameters
    ----------
    estimation : Recording
    limits : (lower, upper), optional

    Raises
    ------
    InputError
        When the record is too short for any of them.
    """
    samples, ny = estimation.outputs.shape
    nu = estimation.inputs.shape[1]
    low, high = limits or (1, MOST_STATES)
    fitted = fewest_fitted(estimation)
    # Each recording has an initial state of its own.
    affordable = (
        fitted * ny // VALUES_PER_PARAMETER // (nu + 2 * ny + len(estimation.segment_starts))
    )
    affordable = min(affordable, samples // 12)
    if affordable < low:
        raise InputError(
            "orders.nx",
            f"{samples} estimation samples are too few for {low} state{'s' if low > 1 else ''} with"
            f" {nu} inputs and {ny} outputs",
            "record longer, lower orders.nx, or leave channels out",
        )
    high = min(high, affordable)
    if limits is None and high > SINGLE_STEPS:
        return tuple(range(2, high + 1, 2))
    return tuple(range(low, high + 1))
