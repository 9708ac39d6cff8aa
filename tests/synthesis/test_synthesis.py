"""Synthetic recordings against their stated truths."""

import numpy as np
import pytest
from scipy.signal import StateSpace, dlsim

from evopem.signals.preparation import prepare
from evopem.synthesis import synthesize
from evopem.synthesis.armax import armax, true_model
from evopem.synthesis.flexible_arm import ARM_MODES, SERVO, arm_dynamics


@pytest.mark.parametrize("kind", ["flexible_arm", "armax"])
def test_a_seed_fixes_every_bit(kind):
    one, truth = synthesize(kind, seed=5, samples=300)
    two, _ = synthesize(kind, seed=5, samples=300)
    other, _ = synthesize(kind, seed=6, samples=300)
    np.testing.assert_array_equal(one.output, two.output)
    assert not np.array_equal(one.output, other.output)
    assert len(one.input) == len(one.output) == 300
    assert truth["delay_samples"] == 3
    assert len(truth["modes"]) >= 3


def test_the_arm_has_the_modes_it_states():
    eigenvalues = np.linalg.eigvals(arm_dynamics()[0])
    frequencies = sorted(np.abs(eigenvalues[eigenvalues.imag > 0]) / (2 * np.pi))
    assert frequencies == pytest.approx(sorted([SERVO[0], *(m[0] for m in ARM_MODES)]))


def test_the_arms_record_is_that_of_an_exact_hold(monkeypatch):
    """Noise aside, the record is scipy's zero-order-hold simulation, two samples late."""
    from evopem.synthesis import flexible_arm as arm

    for name in ("DISTURBANCE", "SENSOR_NOISE", "DRIFT_STEP"):
        monkeypatch.setattr(arm, name, 0.0)
    monkeypatch.setattr(arm, "WARM_UP_SECONDS", 0.0)
    monkeypatch.setattr(arm, "TRANSPORT_SAMPLES", 0)
    recording, _ = arm.flexible_arm(seed=1, samples=400)
    a, b, c = arm_dynamics()
    held = StateSpace(a, b[:, :1], c[None, :], [[0.0]]).to_discrete(0.01)
    theirs = dlsim(held, recording.input)[1][:, 0]
    ours = arm_output(recording.output)
    np.testing.assert_allclose(ours - ours.mean(), theirs - theirs.mean(), atol=1e-6)


def arm_output(volts):
    """Undo the sensor."""
    from scipy.special import boxcox

    from evopem.synthesis.flexible_arm import CHARACTERISTIC, SENSOR_GAIN

    return boxcox(volts, CHARACTERISTIC) / SENSOR_GAIN


def test_the_arms_record_is_non_stationary_and_its_preparation_is_not():
    recording, _ = synthesize("flexible_arm", seed=2, samples=5000)
    prepared = prepare(
        recording,
        {"box_cox": 1.1, "difference": 2, "difference_input": 0},
        {"discard": 500, "estimation": 0.8},
    )

    def spread_of_means(signal):
        return np.std([part.mean() for part in np.array_split(signal, 8)]) / np.std(signal)

    assert spread_of_means(recording.output) > 0.5
    assert spread_of_means(prepared.estimation.output) < 0.05


def test_the_preparation_brings_the_armax_record_back():
    plain, truth = armax(seed=2, samples=800)
    disguised, _ = armax(seed=2, samples=800, box_cox=1.1, difference=2)
    prepared = prepare(
        disguised,
        {"box_cox": 1.1, "difference": 2, "difference_input": 0},
        {"discard": 0, "estimation": 600},
    )
    expected = plain.output[2:602]
    np.testing.assert_allclose(prepared.estimation.output, expected - expected.mean(), atol=1e-6)
    np.testing.assert_array_equal(truth["a"], true_model().a)


def test_an_unknown_kind_is_refused():
    with pytest.raises(ValueError, match="flexible_arm"):
        synthesize("pendulum", seed=1, samples=10)
