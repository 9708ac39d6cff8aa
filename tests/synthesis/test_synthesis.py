"""Synthetic recordings against their stated truths."""

import numpy as np
import pytest
from scipy.signal import StateSpace, dlsim

from evopem import Orders, Recording, synthesis
from evopem.automatic.varying import Moves, Varying
from evopem.config.channels import SyntheticSource
from evopem.config.settings import PreparationSettings, SplitSettings, TransformSettings
from evopem.estimation.varying import Scheduled, fit_varying
from evopem.figures.moving import moving_modes
from evopem.models.varying import MovingMode
from evopem.signals.preparation import prepare
from evopem.synthesis import (
    ARM_MODES,
    SERVO,
    arm_dynamics,
    armax,
    flexible_arm,
    synthesize,
    true_model,
)


def simulated(kind, **keys):
    return synthesize(SyntheticSource(kind, **keys), TransformSettings())


@pytest.mark.parametrize("kind", ["flexible_arm", "armax"])
def test_a_seed_fixes_every_bit(kind):
    one, truth = simulated(kind, seed=5, samples=300)
    two, _ = simulated(kind, seed=5, samples=300)
    other, _ = simulated(kind, seed=6, samples=300)
    np.testing.assert_array_equal(one.output, two.output)
    assert not np.array_equal(one.output, other.output)
    assert len(one.input) == len(one.output) == 300
    assert truth.kind == kind
    assert truth.seed == 5
    assert truth.delay_samples == 3
    assert len(truth.modes) >= 3


def test_the_arm_has_the_modes_it_states():
    eigenvalues = np.linalg.eigvals(arm_dynamics()[0])
    frequencies = sorted(np.abs(eigenvalues[eigenvalues.imag > 0]) / (2 * np.pi))
    assert frequencies == pytest.approx(sorted([SERVO[0], *(m[0] for m in ARM_MODES)]))


def test_the_arms_record_is_that_of_an_exact_hold(monkeypatch):
    """Noise aside, the record is scipy's zero-order-hold simulation, two samples late."""
    for name in ("DISTURBANCE", "SENSOR_NOISE", "DRIFT_STEP"):
        monkeypatch.setattr(synthesis, name, 0.0)
    monkeypatch.setattr(synthesis, "WARM_UP_SECONDS", 0.0)
    monkeypatch.setattr(synthesis, "TRANSPORT_SAMPLES", 0)
    recording, _ = flexible_arm(seed=1, samples=400)
    a, b, c = arm_dynamics()
    held = StateSpace(a, b[:, :1], c[None, :], [[0.0]]).to_discrete(0.01)
    theirs = dlsim(held, recording.input)[1][:, 0]
    ours = arm_output(recording.output)
    np.testing.assert_allclose(ours - ours.mean(), theirs - theirs.mean(), atol=1e-6)


def arm_output(volts):
    """Undo the sensor."""
    from scipy.special import boxcox

    from evopem.synthesis import CHARACTERISTIC, SENSOR_GAIN

    return boxcox(volts, CHARACTERISTIC) / SENSOR_GAIN


def test_the_arms_record_is_non_stationary_and_its_preparation_is_not():
    recording, _ = simulated("flexible_arm", seed=2, samples=5000)
    prepared = prepare(recording, PreparationSettings())

    def spread_of_means(signal):
        return np.std([part.mean() for part in np.array_split(signal, 8)]) / np.std(signal)

    assert spread_of_means(recording.output) > 0.5
    assert spread_of_means(prepared.estimation.output) < 0.05


@pytest.mark.parametrize("transforms", [TransformSettings(1.1, 2), TransformSettings("none", 1)])
def test_the_preparation_brings_the_armax_record_back(transforms):
    plain, truth = armax(seed=2, samples=800)
    disguised, _ = synthesize(SyntheticSource("armax", seed=2, samples=800), transforms)
    settings = PreparationSettings(transforms, SplitSettings(discard=0, estimation=600))
    prepared = prepare(disguised, settings)
    first = transforms.difference
    expected = plain.output[first : first + 600]
    np.testing.assert_allclose(prepared.estimation.output, expected - expected.mean(), atol=1e-6)
    np.testing.assert_array_equal(truth.a, true_model().A)


def test_the_truth_of_an_armax_recording_is_its_model():
    """Noise of the stated ratio, and the innovations of the stated variance."""
    recording, truth = armax(seed=3, samples=20000, noise=0.3)
    clean, _ = armax(seed=3, samples=20000, noise=0.0)
    model = true_model()
    residuals = model.residuals(recording.input, recording.output)[200:]
    variance = truth.noise["innovation_variance"]
    # Relative standard deviation of a variance of 20000 samples: 1 %.
    assert np.var(residuals) == pytest.approx(variance, rel=0.04)
    assert np.sqrt(variance) / np.std(clean.output) == pytest.approx(0.3, rel=1e-9)
    assert truth.noise["ratio"] == 0.3
    assert truth.orders == model.orders


def test_an_arm_that_softens_moves_its_modes_and_not_the_servo_loop():
    steady, _ = flexible_arm(1, 300)
    same, _ = flexible_arm(1, 300, softening=0.0)
    np.testing.assert_array_equal(same.output, steady.output)
    softer, _ = flexible_arm(1, 3000, softening=0.3)
    # Two differences take the drift of the sensor away, as the chapter does.
    volts = np.diff(softer.output, 2)
    scheduled = Scheduled.of(Recording(softer.input[2:], volts / np.std(volts), 100.0))
    orders = Orders(na=9, nb=9, nk=3)
    model = fit_varying(scheduled, orders, scheduled.basis("legendre", 4)).model
    for share in (0.0, 0.5, 1.0):
        modes = model.frozen(share * scheduled.schedule[-1]).modes()
        for frequency in (ARM_MODES[2][0] * (1.0 - 0.3 * share), SERVO[0]):
            nearest = min(modes, key=lambda mode: abs(mode.frequency_hz - frequency))
            assert abs(nearest.frequency_hz - frequency) < 0.03 * frequency


def test_a_softening_arm_is_known_by_its_key_and_stands_behind_what_moves():
    recording, truth = simulated("flexible_arm", seed=1, samples=300, softening=0.3)
    np.testing.assert_array_equal(recording.output, flexible_arm(1, 300, softening=0.3)[0].output)
    assert truth.last_hz == pytest.approx((1.4, 3.752, 16.65, 25.9))
    assert simulated("flexible_arm", seed=1, samples=300)[1].last_hz == ()
    path = MovingMode((0.0, 2.99), (truth.modes[3], truth.modes[3]))
    moves = Moves("ARX(2,2,1)", 3.0, 4.0, 5.0, True, True, (path,))
    chart = moving_modes(Varying("", moves), truth)
    curves = [curve for curve in chart.panels[0].curves if curve.colour == "truth"]
    assert [curve.label for curve in curves] == ["true modes", "", "", ""]
    fourth = chart.table[chart.table["mode"] == -4]
    assert fourth["frequency_hz"].tolist() == pytest.approx([37.0, 25.9])
    assert len(chart.panels[1].curves) == 1
