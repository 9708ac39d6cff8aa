"""Polynomials as products of sections, each given by reflection coefficients of its own."""

from __future__ import annotations

import numpy as np

from evopem.estimation.pem.kernels.cache import cached_njit, njit


@cached_njit
def products_of_sections(reflections, radius):
    """Coefficients of products of sections, and their derivatives.

    A section is ``1 + radius k_1 (1 + k_2) q^-1 + radius^2 k_2 q^-2``: its roots lie within
    ``radius`` where both reflection coefficients lie between -1 and 1.  The last of an odd number
    is a single root, ``1 + radius k q^-1``.

    ``reflections`` (models, m), C-contiguous: ``k_1`` and ``k_2`` of each section in turn.
    Returns coefficients (models, m), without the leading 1, and their derivatives by the
    reflections (models, m, m).
    """
    count, m = reflections.shape
    coefficients, derivatives = np.empty((count, m)), np.zeros((count, m, m))
    factors, product = np.empty(((m + 1) // 2, 2)), np.empty(m + 1)
    for model in range(count):
        for section in range(m // 2):
            one, two = reflections[model, 2 * section], reflections[model, 2 * section + 1]
            factors[section, 0] = radius * one * (1.0 + two)
            factors[section, 1] = radius * radius * two
        if m % 2:
            factors[m // 2, 0], factors[m // 2, 1] = radius * reflections[model, m - 1], 0.0
        _product(factors, -1, product)
        for i in range(m):
            coefficients[model, i] = product[i + 1]
        for section in range((m + 1) // 2):
            _product(factors, section, product)
            first = 2 * section
            last = first + 1 == m
            one = 0.0 if last else reflections[model, first]
            two = 0.0 if last else reflections[model, first + 1]
            for i in range(m):
                derivatives[model, i, first] = radius * (1.0 + two) * product[i]
                if not last:
                    before = product[i - 1] if i else 0.0
                    derivatives[model, i, first + 1] = radius * (one * product[i] + radius * before)
    return coefficients, derivatives


@njit
def _product(factors, left_out, product):
    """Product of all sections but one, with the leading 1, into ``product``."""
    product[:] = 0.0
    product[0] = 1.0
    for k in range(factors.shape[0]):
        if k == left_out:
            continue
        for i in range(product.size - 1, 0, -1):
            product[i] += factors[k, 0] * product[i - 1]
            if i > 1:
                product[i] += factors[k, 1] * product[i - 2]
