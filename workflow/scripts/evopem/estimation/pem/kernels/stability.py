"""Roots inside a circle: the step-down (Schur-Cohn) test, and a barrier at its edge."""

from __future__ import annotations

import numpy as np

from evopem.estimation.pem.kernels.cache import cached_njit, njit


@njit
def step_down(coefficients, radius, work):
    """Whether all roots of ``1 + x_1 q^-1 + ... + x_m q^-m`` lie within ``radius``.

    Step-down recursion on the polynomial whose roots are divided by ``radius``.  Row k of
    ``work``, (m + 1 or more, m or more), receives the coefficients of the polynomial of degree k;
    the last of them is the k-th reflection coefficient.
    """
    m = coefficients.size
    scale = 1.0
    for i in range(m):
        scale *= radius
        work[m, i] = coefficients[i] / scale
    for order in range(m, 0, -1):
        x, k = work[order], work[order, order - 1]
        if not abs(k) < 1.0:
            return False
        d = 1.0 / (1.0 - k * k)
        for i in range(order - 1):
            work[order - 1, i] = (x[i] - k * x[order - 2 - i]) * d
    return True


@njit
def barrier(coefficients, radius, work, slope):
    """Barrier of one polynomial, see :func:`stability_barriers`; its gradient goes to ``slope``.

    The gradient follows by the adjoint of each step of the recursion.  ``slope`` must be zero.
    """
    m = coefficients.size
    if not step_down(coefficients, radius, work):
        return np.inf
    value = 0.0
    for order in range(m, 0, -1):
        k = work[order, order - 1]
        value -= np.log1p(-k * k)
    for order in range(1, m + 1):
        x, k, below = work[order], work[order, order - 1], work[order - 1]
        d = 1.0 / (1.0 - k * k)
        of_k = 2.0 * k * d
        for i in range(order - 1):
            of_k += slope[i] * (2.0 * k * below[i] - x[order - 2 - i]) * d
        for i in range(order // 2):
            j = order - 2 - i
            head, tail = slope[i], slope[j]
            slope[i] = (head - k * tail) * d
            slope[j] = (tail - k * head) * d
        slope[order - 1] = of_k
    scale = 1.0
    for i in range(m):
        scale *= radius
        slope[i] /= scale
    return value


@njit
def barrier_curvature(coefficients, radius, work, slopes, next_slopes, curvature):
    """Gauss-Newton part of the second derivatives of one polynomial's :func:`barrier`.

    Written to the leading (m, m) entries of ``curvature``; zero where a root lies outside.
    ``slopes`` and ``next_slopes``, (m or more, m or more), are buffers for ``d x_i / d x_j``.
    """
    m = coefficients.size
    for i in range(m):
        for j in range(m):
            curvature[i, j] = 0.0
    if not step_down(coefficients, radius, work):
        return
    scale = 1.0
    for i in range(m):
        scale *= radius
        for j in range(m):
            slopes[i, j] = 0.0
        slopes[i, i] = 1.0 / scale
    for order in range(m, 0, -1):
        x, k, below = work[order], work[order, order - 1], work[order - 1]
        d = 1.0 / (1.0 - k * k)
        own = slopes[order - 1]
        weight = 2.0 * (1.0 + k * k) * d * d
        for i in range(m):
            for j in range(m):
                curvature[i, j] += weight * own[i] * own[j]
        for i in range(order - 1):
            mirror = order - 2 - i
            for j in range(m):
                change = slopes[i, j] - k * slopes[mirror, j]
                change += (2.0 * k * below[i] - x[mirror]) * own[j]
                next_slopes[i, j] = change * d
        for i in range(order - 1):
            for j in range(m):
                slopes[i, j] = next_slopes[i, j]


@cached_njit
def schur_stable(coefficients, radius):
    """Whether all roots of ``1 + x_1 q^-1 + ... + x_m q^-m`` lie within ``radius``, row by row.

    ``coefficients`` (models, m), C-contiguous, without the leading 1.  Returns (models,) bool.
    """
    count, m = coefficients.shape
    stable = np.empty(count, dtype=np.bool_)
    work = np.empty((m + 1, m))
    for model in range(count):
        stable[model] = step_down(coefficients[model], radius, work)
    return stable


@cached_njit
def stability_barriers(coefficients, radius):
    """``-sum log(1 - k_i**2)`` over the reflection coefficients of each row's polynomial.

    It grows without bound as a root approaches ``radius``, and is the logarithm of the variance
    of white noise filtered through the polynomial's inverse, roots divided by ``radius``.

    ``coefficients`` (models, m), C-contiguous, without the leading 1.  Returns values (models,),
    infinite where a root lies outside; gradients (models, m), and Gauss-Newton parts of the second
    derivatives (models, m, m), zero where a root lies outside.
    """
    count, m = coefficients.shape
    values = np.empty(count)
    gradients, curvatures = np.zeros((count, m)), np.empty((count, m, m))
    work, slopes, next_slopes = np.empty((m + 1, m)), np.empty((m, m)), np.empty((m, m))
    for model in range(count):
        x = coefficients[model]
        values[model] = barrier(x, radius, work, gradients[model])
        barrier_curvature(x, radius, work, slopes, next_slopes, curvatures[model])
    return values, gradients, curvatures
