"""Each decision of the preparation on a record that calls for it, and on one that does not."""

from dataclasses import replace

import numpy as np
import pytest
from records import noisy, output_error_record
from scipy.signal import chirp, lfilter

from evopem.automatic.fit import fit
from evopem.automatic.preparation import decimation, disturbance
from evopem.automatic.preparation.decimation import decide_decimation
from evopem.automatic.preparation.disturbance import decide_high_pass, decide_objective, passed
from evopem.automatic.preparation.plan import decide_preparation, prepare
from evopem.config.settings import GivenPreparation
from evopem.errors import InputError
from evopem.models.orders import Orders
from evopem.signals.recording import Recording, Segment
from evopem.signals.transforms import NO_FILTER, HighPass
from evopem.synthesis import flexible_arm


def choices(plan):
    return {each.subject: each.choice for each in plan.decisions}


def test_a_plain_record_is_left_as_it_is():
    u, y, _ = output_error_record(400)
    plan = decide_preparation(Recording(u, y, 10.0))
    assert choices(plan) == {
        "start": "0",
        "clipping": "none",
        "stuck samples": "no",
        "decimation": "1",
        "drift": "none",
        "objective": "quadratic",
    }


def test_samples_before_the_first_change_are_left_out():
    u, y, _ = output_error_record(300)
    u, y = np.concatenate([np.zeros(40), u]), np.concatenate([np.full(40, y[0]), y])
    assert decide_preparation(Recording(u, y, 10.0)).starts[0] in (28, 29, 30)


def test_a_step_from_rest_is_not_clipped():
    u = np.concatenate([np.zeros(20), np.ones(60)])
    y = lfilter([0.0, 0.1], [1.0, -0.9], u)
    plan = decide_preparation(Recording(u, y, 10.0))
    assert choices(plan)["clipping"] == "none"
    assert plan.starts[0] in (9, 10)


def test_missing_samples_are_breaks_and_are_not_filled():
    u, y, _ = output_error_record(400)
    y[100:110] = np.nan
    record = Recording(u, y, 10.0)
    prepared = prepare(record, decide_preparation(record))
    assert [each.samples for each in prepared.stretches] == [100, 290]


def test_clipped_samples_are_breaks():
    u, _, _ = output_error_record(600)
    slow = lfilter([0.1], [1.0, -0.9], u)
    y = lfilter([0.2], [1.0, -0.9], slow)
    limit = float(np.quantile(y, 0.9))
    clipped = np.minimum(y, limit)
    plan = decide_preparation(Recording(u, clipped, 10.0))
    assert plan.clipped == (-np.inf, limit)


@pytest.mark.parametrize("inputs", [0, 2])
def test_breaks_of_one_output_do_not_depend_on_the_inputs(inputs):
    u, y, e = output_error_record(600)
    slow = lfilter([0.2], [1.0, -0.9], lfilter([0.1], [1.0, -0.9], u))
    limit = float(np.quantile(slow, 0.9))
    channels = np.column_stack([u, e])[:, :inputs]
    clipped = decide_preparation(Recording(channels, np.minimum(slow, limit), 10.0))
    y[100:140] = y[100]
    stuck = decide_preparation(Recording(channels, y, 10.0))
    assert clipped.clipped == (-np.inf, limit)
    assert (clipped.stuck, stuck.stuck) == (False, True)


def test_breaks_that_would_leave_no_stretch_are_none():
    u, _, e = output_error_record(600)
    wave = np.sin(np.arange(600) * 2.0 * np.pi / 22.0) + 1e-3 * e
    plan = decide_preparation(Recording(u, np.minimum(wave, 0.7), 10.0))
    assert plan.clipped == (-np.inf, np.inf)


def test_a_stuck_sensor_makes_breaks():
    u, y, _ = output_error_record(400)
    y[100:140] = y[100]
    record = Recording(u, y, 10.0)
    prepared = prepare(record, decide_preparation(record))
    assert [each.samples for each in prepared.stretches] == [100, 260]


def test_an_output_that_mostly_stands_still_is_kept_and_said():
    u, y, _ = output_error_record(400)
    y[:250] = 0.0
    plan = decide_preparation(Recording(u, y, 10.0))
    (about,) = [each for each in plan.decisions if each.subject == "stuck samples"]
    assert not plan.stuck
    assert "stands still in 62 % of samples" in about.sentence


def test_quantised_samples_are_not_stuck():
    u, y, _ = output_error_record(400)
    coarse = np.round(lfilter([0.02], [1.0, -0.98], y), 1)
    assert not decide_preparation(Recording(u, coarse, 10.0)).stuck


def test_decimation_of_an_oversampled_record_is_scored():
    generator = np.random.default_rng(2)
    u = lfilter([0.02], [1.0, -0.98], generator.standard_normal(600))
    y = lfilter([0.0, 0.001], np.poly([0.985 * np.exp(0.05j), 0.985 * np.exp(-0.05j)]).real, u)
    y = noisy(y, generator.standard_normal(600), 3.0)
    decision = decide_preparation(Recording(u, y, 500.0)).decisions[3]
    assert decision.subject == "decimation"
    scores = {each.name: each.score for each in decision.alternatives}
    assert len(scores) > 1
    assert scores[decision.choice] <= 1.05 * min(scores.values())


def test_a_long_delay_alone_is_no_reason_for_a_lower_rate():
    """Models of a few coefficients reach behind it at the lower rate only."""
    u = chirp(np.arange(480), 0.0005, 480, 0.02)
    y = lfilter([0.0] * 40 + [0.1], [1.0, -0.9], u)
    y = noisy(y, np.random.default_rng(1).standard_normal(480), 2.0)
    factor, decision = decide_decimation([Segment(u - u.mean(), y - y.mean())])
    scores = {each.name: each.score for each in decision.alternatives}
    assert scores["2"] < 0.9 * scores["1"]
    assert (factor, decision.choice) == (1, "1")
    assert "the rate is kept" in decision.sentence


def test_a_stretch_shorter_than_a_delay_does_not_end_the_decision():
    generator, stretches = np.random.default_rng(1), []
    for samples in (600, 85):
        u = chirp(np.arange(samples), 0.0005, samples, 0.02)
        y = np.outer(lfilter([0.0] * 80 + [0.1], [1.0, -0.9], u), [1.0, 2.0])
        y += 0.01 * generator.standard_normal(y.shape)
        stretches.append(Segment((u - u.mean())[:, None], y - y.mean(axis=0)))
    assert not decimation._is_confirmed(stretches, 2)


def test_a_response_to_steps_behind_a_long_delay_has_no_outliers():
    generator = np.random.default_rng(3)
    u = np.repeat(generator.standard_normal(16), 50)
    y = noisy(lfilter([0.0] * 30 + [1.0, 0.5], [1.0, -0.5], u), generator.standard_normal(800), 3.0)
    assert decide_objective([Segment(u, y)])[0] == "quadratic"
    y[generator.integers(0, 800, 20)] += y.std() * generator.standard_normal(20)
    assert decide_objective([Segment(u, y)])[0] == "absolute"


def test_heavy_tails_of_noise_common_to_outputs_are_no_outliers():
    """Absolute errors of outputs are independent ones, squares may be correlated: with true orders,
    in 30 records of such noise the response errs by 8 % with squares, with absolute errors by 12.
    """
    generator = np.random.default_rng(1)
    u, common = generator.standard_normal((600, 1)), generator.standard_t(3, (600, 1))
    y = lfilter([0.0, 1.0], [1.0, -0.8], u, axis=0) + common
    y = y * [1.0, 2.0] + 0.3 * generator.standard_t(3, (600, 2))
    assert decide_objective([Segment(u, y)])[0] == "quadratic"
    assert decide_objective([Segment(u, y[:, :1])])[0] == "absolute"
    y[generator.integers(0, 600, 12), 0] += 10.0
    y[generator.integers(0, 600, 12), 1] -= 20.0
    assert decide_objective([Segment(u, y)])[0] == "absolute"


def test_samples_that_mostly_repeat_the_last_are_fitted_by_squares():
    """Their median follows no input, though the residuals are likelier to have Laplace's
    distribution; finer steps leave the decision to that.
    """
    generator = np.random.default_rng(2)
    u = np.repeat(generator.random(50), 20)
    plant = lfilter([0.0, 1.0], np.convolve([1.0, -0.96], [1.0, -0.6]), u - u.mean())
    y = np.round(plant / plant.std() / 0.2)
    stretch = Segment((u - u.mean())[:, None], (y - y.mean())[:, None])
    assert decide_objective([stretch])[0] == "absolute"
    objective, decision = decide_objective([stretch], [stretch])
    assert (objective, decision.choice) == ("quadratic", "quadratic")
    assert "squares are taken" in decision.sentence
    few = replace(stretch, outputs=stretch.outputs + 1e-3 * generator.random((1000, 1)))
    assert decide_objective([stretch], [few])[0] == "absolute"


def test_an_output_that_drifts_is_not_taken_for_oversampled():
    """Nearly all power of the arm's output is drift below 1 Hz; its modes reach up to 37 Hz."""
    recording, _ = flexible_arm(1, 4000)
    decision = decide_preparation(recording).decisions[3]
    assert decision.choice == "1"
    assert "coherent up to 0.4" in decision.sentence


def test_a_plan_is_applied_at_the_lower_rate():
    u, y, _ = output_error_record(400)
    record = Recording(u, y, 500.0)
    plan = replace(decide_preparation(record), factor=4)
    prepared = prepare(record, plan)
    assert prepared.sampling_rate == 125.0
    assert prepared.stretches[0].samples == 100


def test_outliers_call_for_the_absolute_objective():
    u, y, _ = output_error_record(600, percent=5.0)
    y[::60] += 30.0
    assert decide_preparation(Recording(u, y, 10.0)).objective == "absolute"


@pytest.mark.parametrize("of_input", [True, False])
def test_residuals_that_are_large_after_changes_of_the_input_are_no_outliers(of_input):
    """The same large residuals where the input changes, as under friction, and at other samples."""
    g = np.random.default_rng(3)
    u = np.repeat(g.standard_normal(60), 15)
    size = 0.02 + np.abs(np.diff(u, prepend=0.0))
    e = g.standard_normal(900) * np.r_[0.0, size[:-1]]
    y = lfilter([0.0, 1.0], [1.0, -0.8], u) + lfilter(
        [1.0], [1.0, -0.8], e if of_input else g.permutation(e)
    )
    plan = decide_preparation(Recording(u, y, 10.0), GivenPreparation(differences=0))
    assert plan.objective == ("quadratic" if of_input else "absolute")


def test_a_record_of_gaps_alone_is_refused():
    u, y, _ = output_error_record(100)
    y[::7] = np.nan
    with pytest.raises(InputError, match="without a gap"):
        decide_preparation(Recording(u, y, 10.0))


def test_an_output_that_drifts_is_filtered():
    """The arm's drift is a random walk that is summed up once more, and hides its modes."""
    recording, _ = flexible_arm(2, 1200)
    plan = decide_preparation(recording, GivenPreparation(start=0, objective="quadratic"))
    assert choices(plan)["drift"] == "second differences"
    (stretch,) = prepare(recording, plan).stretches
    assert stretch.samples == 1198
    assert abs(stretch.output.mean()) < 1e-12
    assert 0.25 < stretch.output.std() < 2.0


@pytest.mark.parametrize("pole", [0.0, 0.8, 0.97])
def test_a_walk_beside_white_noise_is_filtered_by_the_zero_of_their_sum(pole):
    """Of variances q and r the sum is ARMA(1, 1), its zero z by (1 - z)^2 / z = q / r."""
    g = np.random.default_rng(6)
    u, white, steps = g.standard_normal((3, 3000))
    white *= pole > 0.0
    steps *= (1.0 - pole) / np.sqrt(pole) if pole else 1.0
    y = 0.3 * lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.8], u) + white + np.cumsum(steps)
    stretch = Segment(u, y - y.mean())
    high_pass, about = decide_high_pass([stretch])
    assert high_pass == HighPass(1, pole)
    assert about.choice == str(high_pass)
    orders = Orders(nb=(2,), nf=(2,), nk=(1,))
    plain, filtered = (
        fit([each], orders).model.F[0] for each in (stretch, passed(stretch, high_pass))
    )
    true = np.array([1.0, -1.5, 0.8])
    assert np.abs(filtered - true).max() < (0.8 if pole > 0.9 else 0.1) * np.abs(plain - true).max()


def test_a_fold_whose_models_are_near_instability_decides_nothing_of_a_filter(monkeypatch):
    u, walk = np.random.default_rng(6).standard_normal((2, 1000))
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.8], u) + np.cumsum(walk)
    stretch, errors, filtered = Segment(u, y - y.mean()), disturbance._probe_errors, []

    def probed(fold, training):
        filtered.extend([fold] * (training is not fold.training))
        of_first = training is not fold.training and len(filtered) == 1
        return (1e3 if of_first else 1.0) * errors(fold, training)

    high_pass, _ = decide_high_pass([stretch])
    assert high_pass != NO_FILTER
    monkeypatch.setattr(disturbance, "_probe_errors", probed)
    assert decide_high_pass([stretch])[0] == high_pass
    assert len(filtered) == 4


def test_what_a_filter_costs_in_all_folds_of_an_output_counts_beside_the_others(monkeypatch):
    u, *walks = np.random.default_rng(6).standard_normal((4, 1000))
    response = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.8], u)
    y = response[:, None] + 0.1 * np.cumsum(walks, axis=1).T
    stretch, errors, filtered = Segment(u, y - y.mean(axis=0)), disturbance._probe_errors, []

    def probed(fold, training):
        is_filtered = training is not fold.training
        filtered.extend([fold] * is_filtered)
        return (1e3 if is_filtered and len(filtered) > 8 else 1.0) * errors(fold, training)

    assert decide_high_pass([stretch])[0] != NO_FILTER
    monkeypatch.setattr(disturbance, "_probe_errors", probed)
    assert decide_high_pass([stretch])[0] == NO_FILTER
    assert len(filtered) == 12


def test_a_record_that_is_too_short_to_simulate_held_out_samples_is_not_filtered():
    u, walk = np.random.default_rng(1).standard_normal((2, 75))
    y = lfilter([1.0, 1.0], [1.0], u) + 0.3 * np.cumsum(walk)
    high_pass, about = decide_high_pass([Segment(u, y - y.mean())])
    assert high_pass == NO_FILTER
    assert "too short to simulate held-out samples" in about.sentence


def test_a_stationary_response_to_a_multisine_of_low_frequencies_is_not_differenced():
    """The smooth output of three modes is predicted best from its differences."""
    t, y = np.arange(2600), 0.0
    phases = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, 42)
    u = np.cos(2.0 * np.pi * np.outer(t, np.arange(1, 43)) / 600 + phases).sum(axis=1)
    for frequency in (0.06, 0.15, 0.25):
        pole = np.exp((-0.01 + 1j) * 2.0 * np.pi * frequency)
        part = lfilter([0.0, 1.0, 0.4], [1.0, -2.0 * pole.real, abs(pole) ** 2], u)
        y = y + part / part.std()
    high_pass, about = decide_high_pass([Segment(u[2000:], y[2000:] - y[2000:].mean())])
    assert high_pass == NO_FILTER
    assert min(about.alternatives, key=lambda each: each.score).name != "none"


def test_an_integrating_plant_is_not_differenced():
    u, e = np.random.default_rng(6).standard_normal((2, 800))
    y = np.cumsum(u) + e
    assert decide_high_pass([Segment(u, y - y.mean())])[0] == NO_FILTER


@pytest.mark.parametrize("seed", [1, 4, 7])
def test_a_response_behind_a_long_delay_is_not_taken_for_a_random_walk(seed):
    """An ARX model of 24 lags does not reach 50 samples back, and sees a slow drift instead."""
    g = np.random.default_rng(seed)
    u = lfilter([1.0], [1.0, -0.5], g.standard_normal(600))
    y = lfilter([1.0], [1.0, -0.985], np.r_[np.zeros(50), u[:-50]])
    y = y + 0.1 * y.std() * g.standard_normal(600)
    assert decide_high_pass([Segment(u - u.mean(), y - y.mean())])[0] == NO_FILTER


@pytest.mark.parametrize("seed", [0, 3, 5])
def test_a_plant_behind_a_delay_of_many_lags_is_not_taken_for_a_drift(seed):
    """A delay of 15 samples leaves too few of 16 lags for the plant, which differences replace."""
    u, e = np.random.default_rng(seed).standard_normal((2, 440))
    pairs = np.exp([-0.062 + 0.139j, -0.0009 + 0.092j])
    a = np.poly(np.concatenate([pairs, pairs.conj(), [0.945]])).real
    b = [0.12, -0.48, 0.73, -0.5, 0.13]
    y = lfilter(b, a, np.r_[np.zeros(15), u[:-15]]) + lfilter([0.01], a, e)
    assert decide_high_pass([Segment(u, y - y.mean())])[0] == NO_FILTER


def response_to_two_inputs(outputs, samples=800):
    """Two white inputs, and as many outputs that respond to both with white noise."""
    generator = np.random.default_rng(7)
    u, gains = generator.standard_normal((samples, 2)), generator.standard_normal((2, outputs))
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.8], u @ gains, axis=0)
    return u, y + 0.1 * generator.standard_normal(y.shape)


@pytest.mark.parametrize("outputs", [1, 2])
def test_outputs_of_two_inputs_are_differenced_where_all_of_them_drift(outputs):
    u, y = response_to_two_inputs(outputs)
    walks = np.cumsum(np.random.default_rng(3).standard_normal(y.shape), axis=0)
    walks *= 3.0 * y.std(axis=0) / walks.std(axis=0)
    drifting = decide_preparation(Recording(u, y + walks, 10.0))
    assert choices(drifting)["drift"] != "none"
    assert choices(decide_preparation(Recording(u, y, 10.0)))["drift"] == "none"
    y[:, 0] += walks[:, 0]
    one_drifts = decide_preparation(Recording(u, y, 10.0))
    assert (choices(one_drifts)["drift"] != "none") == (outputs == 1)


@pytest.mark.parametrize("outputs", [1, 2])
def test_outliers_of_outputs_of_two_inputs_call_for_the_absolute_objective(outputs):
    u, y = response_to_two_inputs(outputs)
    assert decide_preparation(Recording(u, y, 10.0)).objective == "quadratic"
    y[::60] += 30.0
    assert decide_preparation(Recording(u, y, 10.0)).objective == "absolute"


def test_of_outputs_alone_the_objective_is_decided_and_no_difference():
    e = np.random.default_rng(4).standard_normal((800, 2))
    plan = decide_preparation(Recording(np.empty((800, 0)), np.cumsum(e, axis=0), 10.0))
    assert choices(plan) == {"start": "0", "decimation": "1", "objective": "quadratic"}
    tails = lfilter([1.0], [1.0, -0.9], np.sign(e) * e**4, axis=0)
    plan = decide_preparation(Recording(np.empty((800, 0)), tails, 10.0))
    assert plan.objective == "absolute"


def test_given_differences_are_not_decided():
    u, y, _ = output_error_record(300)
    plan = decide_preparation(Recording(u, y, 10.0), GivenPreparation(differences=0))
    decision = next(each for each in plan.decisions if each.subject == "drift")
    assert decision.criterion == "none"


def channels(samples=1200, rest=0, seed=1):
    """White signals of two inputs and three outputs."""
    generator = np.random.default_rng(seed)
    u = generator.standard_normal((samples, 2))
    y = generator.standard_normal((samples, 3)) + 5.0
    u[:rest], y[:rest] = 0.0, 5.0
    return Recording(u, y, 100.0)


def test_of_several_channels_a_rest_is_left_out_and_white_signals_keep_their_rate():
    plan = decide_preparation(channels(rest=60))
    assert choices(plan) == {
        "start": "50",
        "decimation": "1",
        "drift": "none",
        "objective": "quadratic",
    }
    assert plan.decisions[1].sentence.endswith("the record is not oversampled.")
    given = decide_preparation(channels(rest=60), GivenPreparation(start=0, factor=1))
    assert given.starts == (0,)


def test_several_slow_channels_are_scored_at_lower_rates():
    generator = np.random.default_rng(2)
    u = lfilter([0.02], [1.0, -0.98], generator.standard_normal((600, 2)), axis=0)
    b, a = [0.0, 0.001], np.poly([0.985 * np.exp(0.05j), 0.985 * np.exp(-0.05j)]).real
    y = lfilter(b, a, u @ np.array([[1.0, 0.5], [0.2, -1.0]]), axis=0)
    y += 0.03 * y.std(axis=0) * generator.standard_normal(y.shape)
    plan = decide_preparation(Recording(u, y, 500.0))
    scores = {each.name: each.score for each in plan.decisions[1].alternatives}
    assert len(scores) > 1
    assert scores[str(plan.factor)] <= 1.05 * min(scores.values())
    stretch = prepare(Recording(u, y, 500.0), plan).stretches[0]
    assert stretch.outputs.shape == (-(-600 // plan.factor), 2)
    np.testing.assert_allclose(stretch.outputs.mean(axis=0), 0.0, atol=0.2)
