"""Sums of products of signals from equations of their sections, against sums over samples."""

from dataclasses import replace

import numpy as np
import pytest

from evopem.estimation.state_space import errors as module
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.scaled_recording import scaled_recording
from evopem.estimation.state_space.section_grams import section_gram
from evopem.estimation.state_space.starting_points import from_poles
from evopem.signals.recording import Recording, concatenated


def problem(structure: str, order: int, delays: int, lengths: list[int]) -> StateSpaceErrors:
    """Of noise in segments, with two inputs and three outputs."""
    generator = np.random.default_rng(order)
    segments = [Recording(*(generator.normal(size=(n, k)) for k in (2, 3)), 1.0) for n in lengths]
    drift = 100.0 if structure == "ss_oe" else None
    return StateSpaceErrors(
        scaled_recording(concatenated(segments), delays, drift_period=drift), order, structure
    )


@pytest.mark.parametrize("structure", ["ss", "ss_oe"])
@pytest.mark.parametrize("order", [1, 2, 7, 12])
@pytest.mark.parametrize(("delays", "lengths"), [(1, [400]), (0, [150, 90, 200])])
def test_sums_are_those_over_samples(monkeypatch, structure, order, delays, lengths):
    errors = problem(structure, order, delays, lengths)
    generator = np.random.default_rng(7)
    angles = 1j * generator.uniform(0.0, np.pi, order // 2)
    pairs = generator.uniform(0.3, 0.99, order // 2) * np.exp(angles)
    poles = np.concatenate([pairs, pairs.conj(), [0.9] * (order % 2)])
    projection = errors.projection(from_poles(errors, poles))
    sections, states = projection.sections, projection.states
    signals = errors.signals.derivatives(sections, states)
    driven = signals.T @ errors.signals.of_drives
    gram, with_states = section_gram(errors.signals, sections, signals, states, driven)
    sizes, of_states = np.linalg.norm(signals, axis=0), np.linalg.norm(states, axis=0)
    scale = np.outer(sizes, sizes) + (sizes.max() * 1e-9) ** 2
    np.testing.assert_allclose(gram / scale, signals.T @ signals / scale, atol=1e-9)
    scale = np.outer(of_states, sizes) + (sizes.max() * 1e-9) ** 2
    np.testing.assert_allclose(with_states / scale, states.T @ signals / scale, atol=1e-9)
    assert projection.factor is not None
    over_samples = errors.normal_equations(projection)
    monkeypatch.setattr(module, "MANY_PRODUCTS", 0.0)
    for found, expected in zip(errors.normal_equations(projection), over_samples, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def test_poles_next_to_the_circle_are_summed_over_samples(monkeypatch):
    """The equations multiply rounding there: at a radius of 1 - 1e-9 Hessians had been negative."""
    errors = replace(problem("ss", 1, 1, [400]), radius=1.0 - 1e-7)
    projection = errors.projection(from_poles(errors, np.array([1.0 - 1e-6 + 0j])))
    _, over_samples = errors.normal_equations(projection)
    monkeypatch.setattr(module, "MANY_PRODUCTS", 0.0)
    np.testing.assert_array_equal(errors.normal_equations(projection)[1], over_samples)
