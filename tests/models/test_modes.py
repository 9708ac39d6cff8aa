"""Modes against the chapter's table 2, and their errors against finite differences."""

from dataclasses import replace

import numpy as np
import pytest
from covariances import covariance_of_matrix

from evopem.models.modes import modes_of
from evopem.synthesis import true_model

NUMBERS = ("frequency_hz", "damping_ratio")


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
    true = true_model()
    count = true.orders.parameters
    covariance = 1e-12 * (np.eye(count) + 0.3)
    root = np.linalg.cholesky(covariance)
    known = replace(true, covariance=covariance_of_matrix(covariance))

    def moved(step):
        return true.with_parameters(true.parameters + step).modes()

    changes = [
        (
            0.5 * (plus.frequency_hz - minus.frequency_hz),
            0.5 * (plus.damping_ratio - minus.damping_ratio),
        )
        for column in root.T
        for plus, minus in zip(moved(column), moved(-column), strict=True)
    ]
    errors = np.linalg.norm(np.reshape(changes, (count, -1, 2)), axis=0)
    for mode, (of_frequency, of_damping) in zip(known.modes(), errors, strict=True):
        assert mode.frequency_se_hz == pytest.approx(of_frequency, rel=1e-4)
        assert mode.damping_se == pytest.approx(of_damping, rel=1e-4)
