"""Levenberg-Marquardt descent on the projected errors of a state-space model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.damped_descent import Optimum, damped_step
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.sections import inside, moved, normalised

Array = NDArray[np.float64]

# Damping relative to the diagonal of the Hessian: at the start, and where a descent gives up.
FIRST_DAMPING, LARGEST_DAMPING = 1e-3, 1e12
# A pole moved to the radius stops just inside it.
EDGE = 1e-9


def descend(
    errors: StateSpaceErrors, start: Array, max_iterations: int, tolerance: float
) -> Optimum:
    """Minimise the criterion from a point.

    Parameters
    ----------
    errors : StateSpaceErrors
    start : (n,) array
    max_iterations : int
        Accepted steps.
    tolerance : float
        The descent has converged when a Gauss-Newton step promises less than this decrease of the
        criterion, or twice in a row gains less.
    """
    layout = errors.layout
    limit = errors.radius * (1.0 - EDGE)
    point = normalised(layout, inside(layout, start, limit))
    if not np.isfinite(point).all():
        return Optimum(point, np.inf, False, 0)
    found = errors.projection(point)
    criterion, stable = errors.criterion(found.covariance), errors.stable(found)
    evaluations = 1
    if not np.isfinite(criterion):
        return Optimum(point, np.inf, False, evaluations)

    def ended(converged: bool) -> Optimum:
        return Optimum(point, criterion if stable else np.inf, converged, evaluations)

    damping, growth, small_gains = FIRST_DAMPING, 2.0, 0
    for _ in range(max_iterations):
        equations = errors.normal_equations(found)
        evaluations += 1
        scale = np.sqrt(np.maximum(np.diag(equations.hessian), 0.0))
        scale = np.where(scale > 1e-12 * scale.max(initial=1e-300), scale, 1.0)
        gradient = equations.gradient / scale
        hessian = equations.hessian / np.outer(scale, scale)
        while True:
            step = damped_step(hessian, gradient, damping)
            if step is None:
                damping, growth = damping * growth, growth * 2.0
                if damping > LARGEST_DAMPING:
                    return ended(True)
                continue
            promised = -(gradient @ step) - 0.5 * step @ hessian @ step
            if promised < 0.1 * tolerance and damping <= FIRST_DAMPING:
                return ended(True)
            trial = inside(layout, moved(layout, point, step / scale), limit)
            new_found = errors.projection(trial) if np.isfinite(trial).all() else None
            evaluations += 1
            new, new_stable = np.inf, False
            if new_found is not None:
                new_stable = errors.stable(new_found)
                # A descent may begin with an unstable A, but never goes back to one.
                if new_stable or not stable:
                    new = errors.criterion(new_found.covariance)
            if new < criterion and new_found is not None:
                break
            damping, growth = damping * growth, growth * 2.0
            if damping > LARGEST_DAMPING:
                return ended(True)
        gain = criterion - new
        ratio = gain / promised if promised > 0.0 else 0.0
        damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3), 1e-15)
        growth = 2.0
        point, found, criterion, stable = trial, new_found, new, new_stable
        small_gains = small_gains + 1 if gain < tolerance else 0
        if small_gains >= 2:
            return ended(True)
    return ended(False)
