"""Modes against the chapter's table 2, and their errors against finite differences."""

import numpy as np
import pytest

from evopem.models.modes import modes_of
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.synthesis.armax import true_model


def test_table_2_of_the_chapter():
    """The chapter prints poles rounded to two digits; only the first two figures survive that."""
    z = np.array([0.94 + 0.33j, 0.43 + 0.71j, -0.67 + 0.70j])
    coefficients = np.real(np.poly(np.concatenate([z, z.conj()])))[1:]
    modes = modes_of(coefficients, 100.0)
    assert [m.frequency_hz for m in modes] == pytest.approx([5.38, 16.65, 37.15], abs=0.2)
    # The first pole lies 0.004 from the circle, less than the rounding of its digits.
    assert [100 * m.damping_ratio for m in modes] == pytest.approx([1.1, 17.5, 1.35], abs=0.5)


def test_modes_are_those_the_poles_were_made_of():
    modes = true_model().modes()
    assert [m.frequency_hz for m in modes] == pytest.approx([5.36, 16.65, 37.0], rel=1e-9)
    assert [m.damping_ratio for m in modes] == pytest.approx([0.0091, 0.175, 0.0107], rel=1e-7)
    assert all(np.isnan(m.frequency_se_hz) for m in modes)


def test_standard_errors_are_the_first_order_propagation():
    a = true_model().a[1:]
    covariance = 1e-12 * (np.eye(7) + 0.3)
    root = np.linalg.cholesky(covariance)
    for index, mode in enumerate(modes_of(a, 100.0, ParameterCovariance.from_matrix(covariance))):
        change_f, change_d = np.zeros(7), np.zeros(7)
        for k in range(7):
            plus = modes_of(a + root[:, k], 100.0)[index]
            minus = modes_of(a - root[:, k], 100.0)[index]
            change_f[k] = 0.5 * (plus.frequency_hz - minus.frequency_hz)
            change_d[k] = 0.5 * (plus.damping_ratio - minus.damping_ratio)
        assert mode.frequency_se_hz == pytest.approx(np.linalg.norm(change_f), rel=1e-4)
        assert mode.damping_se == pytest.approx(np.linalg.norm(change_d), rel=1e-4)
