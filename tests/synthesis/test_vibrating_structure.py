"""Records of vibrating structures against continuous-time theory."""

import numpy as np
from scipy.linalg import solve_continuous_lyapunov
from scipy.signal import lsim
from vibrating_structure import VibratingStructure, random_structure


def test_velocities_have_the_covariance_and_spectral_peaks_of_the_continuous_structure():
    shapes = np.array([[1.0, 0.4], [0.5, -1.0]])
    structure = VibratingStructure(np.array([3.0, 11.0]), np.array([0.05, 0.03]), shapes)
    y = structure.ambient_record(200_000, 50.0, 0.0, np.random.default_rng(1))
    w, z = 2.0 * np.pi * structure.frequencies_hz, structure.damping_ratios
    dynamics = np.block([[np.zeros((2, 2)), np.eye(2)], [np.diag(-(w**2)), np.diag(-2.0 * z * w)]])
    forces = np.vstack([np.zeros((2, 2)), shapes.T])
    states = solve_continuous_lyapunov(dynamics, -forces @ forces.T)
    expected = shapes @ states[2:, 2:] @ shapes.T
    np.testing.assert_allclose(np.cov(y.T), expected, rtol=0.05)
    spectrum = np.abs(np.fft.rfft(y[:, 1].reshape(100, -1), axis=1)) ** 2
    frequencies = np.fft.rfftfreq(2000, 1.0 / 50.0)
    power = spectrum.mean(axis=0)
    for low, high, peak in ((1.0, 6.0, 3.0), (6.0, 20.0, 11.0)):
        inside = (frequencies > low) & (frequencies < high)
        assert abs(frequencies[inside][np.argmax(power[inside])] - peak) < 0.2


def test_random_structures_have_their_close_pairs_and_no_others():
    for seed in range(20):
        f = random_structure(np.random.default_rng(seed)).frequencies_hz
        close = np.diff(f) < 0.055 * f[1:]
        assert close.sum() >= 2


def test_driven_velocities_are_those_of_the_continuous_structure_under_held_forces():
    shapes = np.array([[1.0, 0.4], [0.5, -1.0], [0.2, 0.3]])
    structure = VibratingStructure(np.array([3.0, 11.0]), np.array([0.05, 0.03]), shapes)
    u, y = structure.driven_record(1000, 50.0, 2, 0.0, np.random.default_rng(1))
    w, z = 2.0 * np.pi * structure.frequencies_hz, structure.damping_ratios
    dynamics = np.block([[np.zeros((2, 2)), np.eye(2)], [np.diag(-(w**2)), np.diag(-2.0 * z * w)]])
    forces = np.vstack([np.zeros((2, 2)), shapes[:2].T])
    velocities = np.hstack([np.zeros((3, 2)), shapes])
    system = (dynamics, forces, velocities, np.zeros((3, 2)))
    _, expected, _ = lsim(system, u, np.arange(1000) / 50.0, interp=False)
    # The record begins with the response to earlier forces, which decays.
    np.testing.assert_allclose(y[700:], expected[700:], atol=1e-4 * y.std())
