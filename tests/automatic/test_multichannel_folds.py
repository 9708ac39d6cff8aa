"""Held-out parts of recordings of several channels: whole recordings where there are several."""

from dataclasses import replace

import numpy as np
import pytest

from evopem.automatic.multichannel_folds import designs_of, fewest_fitted, folds_of
from evopem.estimation.state_space.held_out import errors_simulated_on, simulation_errors
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording, concatenated

NOISE = 0.1
TRUTH = StateSpaceModel(
    A=np.array([[0.9, 0.3], [-0.3, 0.9]]),
    B=np.array([[1.0], [0.5]]),
    C=np.eye(2),
    D=np.zeros((2, 1)),
    K=np.zeros((2, 2)),
    sampling_rate=1.0,
    level=np.zeros(2),
    noise_covariance=NOISE**2 * np.eye(2),
    structure="ss_oe",
)


def recording(samples, seed):
    generator = np.random.default_rng(seed)
    u = generator.standard_normal((samples, 1))
    y = TRUTH.simulate(u, generator.standard_normal(2))
    y += NOISE * generator.standard_normal(y.shape)
    return Recording(u, y, 1.0, ("u",), ("a", "b"), ("",), ("", ""))


def joined(*lengths):
    parts = [recording(samples, seed) for seed, samples in enumerate(lengths)]
    return concatenated(parts), parts


def test_recordings_are_dealt_out_in_turn():
    whole, parts = joined(100, 110, 120, 130)
    folds = folds_of(whole, 2)
    assert [each.held_out.segment_starts for each in folds] == [(0, 100), (0, 110)]
    np.testing.assert_array_equal(folds[0].training.separated[1].outputs, parts[3].outputs)
    assert designs_of(whole) == (2, 4)
    assert designs_of(joined(100, 100)[0]) == (2,)
    assert fewest_fitted(whole) == 220


def test_a_recording_without_which_too_little_is_left_is_not_held_out():
    whole, _ = joined(1000, 100, 120)
    folds = [each for count in designs_of(whole) for each in folds_of(whole, count)]
    assert [each.held_out.samples for each in folds] == [100, 100, 120]
    assert fewest_fitted(whole) == 1100


def test_one_recording_is_divided_into_parts_behind_its_first():
    (whole, _) = joined(600)
    assert designs_of(whole) == (2, 5)
    folds = folds_of(whole, 5)
    assert [(each.first, each.stop) for each in folds] == [
        *((120, 240), (240, 360), (360, 480), (480, 600))
    ]
    assert folds[0].training.segment_starts == (0, 120)
    assert [each.training.samples for each in folds] == [480] * 4


@pytest.mark.parametrize("count", [2, 3])
def test_the_truth_leaves_the_noise_whatever_the_recordings_are(count):
    whole, parts = joined(400, 300, 350)
    for fold in folds_of(whole, count):
        spread = np.sqrt(
            sum(
                np.sum((each.outputs - each.outputs.mean(axis=0)) ** 2, axis=0)
                for each in fold.held_out.separated
            )
        )
        expected = 100.0 * NOISE * np.sqrt(fold.held_out.samples) / spread
        np.testing.assert_allclose(
            fold.errors(TRUTH, "quadratic"), np.tile(expected, (3, 1)), rtol=0.1
        )
    # What the other recordings of a fold are makes no difference to one that is held out.
    one, other = folds_of(whole, 3)[0], folds_of(concatenated([parts[0], parts[2]]), 2)[0]
    np.testing.assert_array_equal(one.errors(TRUTH, "quadratic"), other.errors(TRUTH, "quadratic"))


def test_an_unstable_model_simulates_nothing():
    whole, _ = joined(100, 100)
    errors = folds_of(whole, 2)[0].errors(replace(TRUTH, A=1.2 * TRUTH.A), "quadratic")
    assert np.isinf(errors[:2]).all()


def test_absolute_errors_are_pooled_as_sums_of_them():
    whole, _ = joined(400, 300)
    fold = folds_of(whole, 2)[0]
    (held,) = fold.held_out.separated
    spread = np.abs(held.outputs - np.median(held.outputs, axis=0)).mean(axis=0)
    expected = 100.0 * NOISE * np.sqrt(2.0 / np.pi) / spread
    np.testing.assert_allclose(fold.errors(TRUTH, "absolute"), np.tile(expected, (3, 1)), rtol=0.1)


def test_surplus_modes_gain_nothing_by_the_states_they_begin_with():
    """Noise of the measured force rings in a light mode, and modes beside it resemble that."""

    def with_modes(*angles):
        n = 2 * len(angles)
        A = np.zeros((n, n))
        for k, angle in enumerate(angles):
            turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = 0.999 * turn
        B = np.tile(TRUTH.B / len(angles), (len(angles), 1))
        C = np.tile(np.eye(2), len(angles))
        return replace(TRUTH, A=A, B=B, C=C, K=np.zeros((n, 2)))

    truth, surplus = with_modes(0.3), with_modes(0.2995, 0.3, 0.3005)
    absorbed, scored = [], []
    for seed in range(5):
        generator = np.random.default_rng(seed)
        force = np.zeros((600, 1))
        force[100] = 1.0
        outputs = truth.simulate(force)
        measured = force + 0.02 * generator.standard_normal(force.shape)
        absorbed.append([simulation_errors(m, measured, outputs).mean() for m in (truth, surplus)])
        scored.append(
            [
                np.sqrt(np.mean(errors_simulated_on(m, measured, outputs, 60) ** 2))
                for m in (truth, surplus)
            ]
        )
    of_truth, of_surplus = np.mean(absorbed, axis=0)
    assert of_surplus < 0.9 * of_truth
    of_truth, of_surplus = np.mean(scored, axis=0)
    assert of_surplus > 0.99 * of_truth


@pytest.mark.parametrize("at", [120, 800])
def test_the_response_to_one_blow_is_divided_by_its_energy(at):
    """Every training part has the blow, and errors of the true model are those of the noise."""
    samples = 1200
    u = np.zeros((samples, 1))
    u[at : at + 2] = 10.0
    ringing = replace(TRUTH, A=1.03 * TRUTH.A)
    clean = ringing.simulate(u, np.zeros(2))
    y = clean + NOISE * np.random.default_rng(1).standard_normal(clean.shape)
    whole = Recording(u, y, 1.0, ("u",), ("a", "b"), ("",), ("", ""))
    folds = [each for count in designs_of(whole) for each in folds_of(whole, count)]
    assert len(folds) >= 3
    response = np.flatnonzero(np.abs(clean).max(axis=1) > 3.0 * NOISE)
    for fold in folds:
        assert np.ptp(fold.training.inputs) == 10.0
        assert at < fold.first < fold.stop <= response[-1] + 48
        simulated, _, predicted = fold.errors(ringing, "quadratic")
        least = 100.0 * NOISE / y[fold.first : fold.stop].std(axis=0)
        np.testing.assert_allclose(simulated, least, rtol=0.35)
        np.testing.assert_allclose(predicted, least, rtol=0.35)
        assert least.max() < 60.0


def test_ordinary_records_are_divided_into_equal_lengths():
    whole = recording(1000, 3)
    assert [(each.first, each.stop) for each in folds_of(whole, 5)] == [
        (200, 400),
        (400, 600),
        (600, 800),
        (800, 1000),
    ]
