"""Recombination of polynomials by their roots."""

import numpy as np
import pytest

from evopem.estimation.search.root_sections import (
    product_of,
    random_denominators,
    recombined_polynomials,
    sections_of,
)


@pytest.mark.parametrize("order", range(8))
def test_the_product_of_the_sections_is_the_polynomial(order):
    for coefficients in random_denominators(20, order, np.random.default_rng(order)):
        found = product_of(sections_of(coefficients))
        np.testing.assert_allclose(found, coefficients, atol=1e-9)


def test_real_roots_make_sections_too():
    coefficients = np.poly([0.9, 0.5, -0.3, -0.8, 0.1])[1:]
    sections = sections_of(coefficients)
    assert sections.quadratic.shape == (2, 2)
    assert sections.single == pytest.approx([0.9])
    np.testing.assert_allclose(product_of(sections), coefficients, atol=1e-12)


def test_offspring_have_the_roots_of_their_parents():
    generator = np.random.default_rng(3)
    parents = random_denominators(6, 6, generator)
    pairs = generator.integers(6, size=(2, 30))
    offspring = recombined_polynomials(parents, pairs, generator)
    inherited = 0
    for child, (one, other) in zip(offspring, pairs.T, strict=True):
        known = np.roots(np.concatenate([[1.0], parents[one]]))
        known = np.concatenate([known, np.roots(np.concatenate([[1.0], parents[other]]))])
        for root in np.roots(np.concatenate([[1.0], child])):
            assert np.min(np.abs(known - root)) < 1e-6
        inherited += not (np.allclose(child, parents[one]) or np.allclose(child, parents[other]))
    assert inherited > 10
