"""Root reflection and the Schur-Cohn test, against roots computed the long way."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from evopem.estimation.pem.kernels.polynomials import stability_barriers
from evopem.models.polynomial_roots import max_root_radius, reflect_into_disc

polynomials = st.lists(st.floats(-3, 3), min_size=1, max_size=8).map(np.array)


@given(polynomials)
def test_reflection_brings_every_root_within_the_radius(coefficients):
    (inside,) = reflect_into_disc(coefficients[None, :], 0.95)
    # Clusters of roots move by the m-th root of the rounding of their coefficients.
    assert max_root_radius(inside) < 0.95 + 1e-2


@given(st.lists(st.floats(0.2, 0.9), min_size=1, max_size=4, unique=True), st.integers(0, 3))
def test_reflection_keeps_the_shape_of_the_frequency_response(radii, outside):
    z = np.array([r * np.exp(0.7j * (k + 1)) for k, r in enumerate(radii)])
    z[:outside] = 1.0 / np.conj(z[:outside])
    coefficients = np.real(np.poly(np.concatenate([z, np.conj(z)])))[1:]
    (reflected,) = reflect_into_disc(coefficients[None, :], 0.999)
    frequencies = np.exp(-1j * np.linspace(0.1, 3.0, 40))
    before = np.abs(np.polyval(np.r_[1.0, coefficients][::-1], frequencies))
    after = np.abs(np.polyval(np.r_[1.0, reflected][::-1], frequencies))
    ratio = before / after
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-6)


@settings(max_examples=300, deadline=None)  # the first example loads compiled code
@given(
    st.lists(st.tuples(st.floats(0.0, 1.5), st.floats(0.1, 3.0)), min_size=1, max_size=5),
    st.floats(0.5, 1.0),
)
def test_step_down_agrees_with_the_roots(polar, radius):
    """Polynomials made of pairs of roots, so that the truth does not come from a root finder."""
    z = np.array([r * np.exp(1j * angle) for r, angle in polar])
    roots = np.concatenate([z, z.conj()])
    # A cluster of m roots is moved by the m-th root of its coefficients' rounding.
    apart = np.abs(roots[:, None] - roots)[np.triu_indices(len(roots), 1)]
    assume(apart.min() > 0.05)
    coefficients = np.real(np.poly(roots))[1:]
    largest = np.abs(z).max()
    assume(abs(largest - radius) > 1e-3)
    barriers, _, _ = stability_barriers(coefficients[None, :], radius)
    assert np.isfinite(barriers[0]) == (largest < radius)
