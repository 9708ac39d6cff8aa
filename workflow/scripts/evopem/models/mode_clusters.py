"""The same mode in models of several orders: poles grouped by frequency, damping and shape.

Poles of different orders belong to one mode where they agree within their standard errors or the
usual tolerances of modal analysis, and a mode has at most one pole of an order.  The nearest pairs
are joined first, so that two close modes, both of which every order has, stay apart.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.models.state_space_modes import ShapedMode, assurance

Array = NDArray[np.float64]

# Poles are the same mode within these differences, relative for frequency and damping, or within
# three standard errors of their difference.
SAME_FREQUENCY = 0.02
SAME_DAMPING = 0.3
STANDARD_ERRORS = 3.0
# Smallest modal assurance criterion of two shapes of one mode, where both are known well enough.
SAME_SHAPE = 0.8


def mode_distance(first: ShapedMode, second: ShapedMode) -> float:
    """Distance of two estimates of what may be one mode; above 1 they are not.

    The largest of three differences, each relative to what is allowed: of frequency, of damping
    ratio, and of shape, ``1 - MAC``.

    Parameters
    ----------
    first, second : ShapedMode
        With the same outputs.
    """
    frequency = 0.5 * (first.frequency_hz + second.frequency_hz)
    damping = 0.5 * (abs(first.damping_ratio) + abs(second.damping_ratio))
    return max(
        abs(first.frequency_hz - second.frequency_hz)
        / _allowed(SAME_FREQUENCY * frequency, first.frequency_se_hz, second.frequency_se_hz),
        abs(first.damping_ratio - second.damping_ratio)
        / _allowed(SAME_DAMPING * damping, first.damping_se, second.damping_se),
        (1.0 - assurance(first.shape, second.shape))
        / max(1.0 - SAME_SHAPE, _loss_by_noise(first) + _loss_by_noise(second)),
    )


def cluster_modes(modes: Mapping[int, Sequence[ShapedMode]]) -> list[dict[int, int]]:
    """Group the modes of models of several orders.

    Parameters
    ----------
    modes : mapping of int to sequence of ShapedMode
        By the order of their model.

    Returns
    -------
    list of dict of int to int
        Groups, by increasing median frequency: the index of the mode in the model of each order
        that has it.
    """
    nodes = [(order, index) for order in sorted(modes) for index in range(len(modes[order]))]
    pairs = []
    for a, (order, index) in enumerate(nodes):
        for b in range(a + 1, len(nodes)):
            other, another = nodes[b]
            if other != order:
                distance = mode_distance(modes[order][index], modes[other][another])
                if distance <= 1.0:
                    pairs.append((distance, a, b))
    group_of = list(range(len(nodes)))
    groups = {k: {order: index} for k, (order, index) in enumerate(nodes)}
    for _, a, b in sorted(pairs):
        into, from_ = group_of[a], group_of[b]
        if into == from_ or groups[into].keys() & groups[from_].keys():
            continue
        groups[into] |= groups.pop(from_)
        group_of = [into if group == from_ else group for group in group_of]

    def median_frequency(group: dict[int, int]) -> float:
        return float(np.median([modes[order][k].frequency_hz for order, k in group.items()]))

    return sorted(groups.values(), key=median_frequency)


def _allowed(relative: float, *standard_errors: float) -> float:
    """The larger of a tolerance and some standard errors of the difference, where known."""
    error = STANDARD_ERRORS * math.hypot(*standard_errors)
    return max(relative, error, 1e-300) if math.isfinite(error) else max(relative, 1e-300)


def _loss_by_noise(mode: ShapedMode) -> float:
    """Expected ``1 - MAC`` of an estimated shape with the true one; 0 where it is not known."""
    return 1.0 - mode.shape_assurance if math.isfinite(mode.shape_assurance) else 0.0
