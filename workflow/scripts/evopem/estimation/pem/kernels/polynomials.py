"""Single polynomials: roots inside a circle, a barrier at its edge, products, filters."""

from functools import partial

import numpy as np

from evopem.compilation import cached_njit, njit


@njit
def step_down(coefficients, radius, work):
    """Whether all roots of ``1 + x_1 q^-1 + ... + x_m q^-m`` lie within ``radius``.  Row k of
    ``work``, (m + 1 or more, m or more), receives the polynomial of degree k of the step-down
    recursion, whose last coefficient is the k-th reflection coefficient."""
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
    The gradient follows by the adjoint of each step of the recursion.  ``slope`` must be zero."""
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
    """Gauss-Newton part of the second derivatives of one polynomial's :func:`barrier`.  Written to
    the leading (m, m) entries of ``curvature``; zero where a root lies outside.  ``slopes`` and
    ``next_slopes``, (m or more, m or more), are buffers for ``d x_i / d x_j``."""
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
        slope = slopes[order - 1]
        weight = 2.0 * (1.0 + k * k) * d * d
        for i in range(m):
            for j in range(m):
                curvature[i, j] += weight * slope[i] * slope[j]
        for i in range(order - 1):
            mirror = order - 2 - i
            for j in range(m):
                change = slopes[i, j] - k * slopes[mirror, j]
                change += (2.0 * k * below[i] - x[mirror]) * slope[j]
                next_slopes[i, j] = change * d
        for i in range(order - 1):
            for j in range(m):
                slopes[i, j] = next_slopes[i, j]


@cached_njit
def stability_barriers(coefficients, radius):
    """``-sum log(1 - k_i**2)`` over the reflection coefficients of each row's polynomial, which
    grows without bound as a root approaches ``radius``: values (M,), inf outside, gradients (M, m)
    and Gauss-Newton parts of the second derivatives (M, m, m), zero outside."""
    count, m = coefficients.shape
    values = np.empty(count)
    gradients, curvatures = np.zeros((count, m)), np.empty((count, m, m))
    work, slopes, next_slopes = np.empty((m + 1, m)), np.empty((m, m)), np.empty((m, m))
    for model in range(count):
        x = coefficients[model]
        values[model] = barrier(x, radius, work, gradients[model])
        barrier_curvature(x, radius, work, slopes, next_slopes, curvatures[model])
    return values, gradients, curvatures


@partial(cached_njit, is_quick=True)
def products_of_sections(reflections, radius):
    """Products of sections ``1 + radius k_1 (1 + k_2) q^-1 + radius^2 k_2 q^-2``, whose roots lie
    within ``radius`` where k_1 and k_2 lie within 1, and of a last ``1 + radius k q^-1`` where
    their number is odd: coefficients (M, m), derivatives by the reflections (M, m, m)."""
    count, m = reflections.shape
    coefficients, derivatives = np.empty((count, m)), np.zeros((count, m, m))
    factors, product = np.empty(((m + 1) // 2, 2)), np.empty(m + 1)
    for model in range(count):
        for section in range(m // 2):
            k1, k2 = reflections[model, 2 * section], reflections[model, 2 * section + 1]
            factors[section, 0] = radius * k1 * (1.0 + k2)
            factors[section, 1] = radius * radius * k2
        if m % 2:
            factors[m // 2, 0], factors[m // 2, 1] = radius * reflections[model, m - 1], 0.0
        _product(factors, -1, product)
        for i in range(m):
            coefficients[model, i] = product[i + 1]
        for section in range((m + 1) // 2):
            _product(factors, section, product)
            first = 2 * section
            last = first + 1 == m
            k1 = 0.0 if last else reflections[model, first]
            k2 = 0.0 if last else reflections[model, first + 1]
            for i in range(m):
                derivatives[model, i, first] = radius * (1.0 + k2) * product[i]
                if not last:
                    before = product[i - 1] if i else 0.0
                    derivatives[model, i, first + 1] = radius * (k1 * product[i] + radius * before)
    return coefficients, derivatives


@njit
def _product(factors, left_out, product):
    """Product of all sections but one, with the leading 1, into ``product``."""
    for i in range(product.size):
        product[i] = 0.0 if i else 1.0
    for k in range(factors.shape[0]):
        if k == left_out:
            continue
        for i in range(product.size - 1, 0, -1):
            product[i] += factors[k, 0] * product[i - 1]
            if i > 1:
                product[i] += factors[k, 1] * product[i - 2]


@cached_njit
def filter_rows(signals, denominator, states):
    """Filter each row of ``signals`` (rows, samples) through ``1/denominator`` in place, and update
    its state (rows, m): operation by operation :func:`scipy.signal.lfilter`, whose import takes
    longer than a small estimate."""
    m = states.shape[1]
    z = np.zeros(m + 1)
    for row in range(signals.shape[0]):
        for i in range(m):
            z[i] = states[row, i]
        for t in range(signals.shape[1]):
            filtered = z[0] + signals[row, t]
            for i in range(m):
                z[i] = z[i + 1] - filtered * denominator[i + 1]
            signals[row, t] = filtered
        for i in range(m):
            states[row, i] = z[i]
