"""What every estimate requires of its signals and of the settings of its search."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import OBJECTIVES, ScoringWindow, SearchSettings
from evopem.estimation.search.armax_problem import INITIALIZATIONS
from evopem.estimation.search.memetic import REFINE
from evopem.models.structures import Orders

Array = NDArray[np.float64]


def check_signals(u: Array, y: Array) -> None:
    """Refuse signals of different lengths, or with samples that are not finite.

    Raises
    ------
    ValueError
    """
    if u.ndim != 1 or u.shape != y.shape:
        raise ValueError(f"input and output must be of one length, not {u.shape} and {y.shape}")
    if not (np.isfinite(u).all() and np.isfinite(y).all()):
        raise ValueError("input and output must be finite")


def check_search_settings(settings: SearchSettings) -> None:
    """Refuse words that no search knows, and a radius outside the unit circle.

    Raises
    ------
    ValueError
    """
    for name, known in (
        ("objective", OBJECTIVES),
        ("refine", REFINE),
        ("initialization", INITIALIZATIONS),
    ):
        value = getattr(settings, name)
        if value not in known:
            raise ValueError(f"{name} must be one of {known}, not {value!r}")
    if not 0.0 < settings.max_root_radius < 1.0:
        raise ValueError(
            f"max_root_radius must lie between 0 and 1, not {settings.max_root_radius}"
        )


def check_window(window: ScoringWindow, first: int, orders: Orders) -> None:
    """Refuse a window that begins before the first residual, or whose loss begins before it does.

    Raises
    ------
    ValueError
    """
    if window.residual_start < first:
        raise ValueError(f"{orders} has no residual before sample {first}")
    if window.loss_start < window.residual_start:
        raise ValueError(f"the loss starts at {window.loss_start}, before the first residual")
