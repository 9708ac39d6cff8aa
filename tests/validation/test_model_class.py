"""Level and power of the tests of what every model assumes, on ARX models of simulated records."""

import warnings

import numpy as np
import pytest
from scipy.signal import chirp, lfilter

from evopem.estimation.state_space.estimate import estimates_of_orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording
from evopem.validation import model_class as module
from evopem.validation.model_class import REPEATS, feedback_test, model_class
from evopem.validation.responses import divided

SAMPLES, CUT, FREQUENCY, DECAY = 1500, 1000, 0.6, 0.03
INPUTS = ("white", "binary", "coloured", "steps", "lines", "slow")
POLE = np.exp(complex(-DECAY, FREQUENCY))
MODE = np.real(np.poly([POLE, np.conj(POLE)]))
NOISE = ([1.0], MODE, [1.0, -0.98])


def arx(u, y, nk=1, order=8):
    """Least squares with as many coefficients of A as of B."""
    first = order + nk
    past = [-y[first - k : len(y) - k] for k in range(1, order + 1)]
    past += [u[first - nk - k : len(y) - nk - k] for k in range(order)]
    found = np.linalg.lstsq(np.column_stack(past), y[first:])[0]
    return PolynomialModel(np.r_[1.0, found[:order]], found[order:], nk=nk)


def input_of(kind, generator):
    white, steps = generator.standard_normal(SAMPLES), np.arange(SAMPLES)
    if kind == "binary":
        return np.sign(lfilter([1.0], [1.0, -0.5], white))
    if kind == "steps":
        return np.repeat(generator.choice([-1.0, 1.0], SAMPLES // 50), 50)
    if kind == "lines":
        phases = generator.uniform(0.0, 2.0 * np.pi, 20)
        return np.sin(2.0 * np.pi * np.outer(steps, np.arange(1, 60, 3)) / 500.0 + phases).sum(1)
    below = {"white": [1.0], "coloured": [1.0, -1.6, 0.7], "slow": [1.0, -0.995]}
    return lfilter([1.0], below[kind], white)


def resonance(u, frequency=FREQUENCY, gain=1.0):
    """Response of a mode whose frequency and gain may change from sample to sample."""
    frequency, gain = (np.broadcast_to(each, len(u)) for each in (frequency, gain))
    y = np.zeros(len(u))
    for t in range(2, len(u)):
        y[t] = 2.0 * np.exp(-DECAY) * np.cos(frequency[t]) * y[t - 1]
        y[t] += -np.exp(-2.0 * DECAY) * y[t - 2] + gain[t] * (u[t - 1] + 0.5 * u[t - 2])
    return y


def saturating(u):
    y = resonance(u)
    return np.tanh(y / np.std(y))


SYSTEMS = {
    "right": resonance,
    "frequency drifts by 10 %": lambda u: resonance(
        u, FREQUENCY * (1.0 + np.linspace(-0.05, 0.05, len(u)))
    ),
    "gain halved midway": lambda u: resonance(
        u, gain=np.where(np.arange(len(u)) < len(u) // 2, 1.0, 0.5)
    ),
    "gain comes back three times": lambda u: resonance(
        u, gain=1.0 + 0.3 * np.sin(6.0 * np.pi * np.arange(len(u)) / len(u) + 1.0)
    ),
    "quadratic": lambda u: resonance(u / np.std(u) + 0.5 * (u / np.std(u)) ** 2),
    "saturating": saturating,
}


def judged(system, kind, colour, seed):
    generator = np.random.default_rng([seed, len(kind)])
    u = input_of(kind, generator)
    x, v = SYSTEMS[system](u), lfilter([1.0], NOISE[colour], generator.standard_normal(SAMPLES))
    y = x + 0.15 * np.std(x) / np.std(v) * v
    return model_class(divided(arx(u[:CUT], y[:CUT]), Recording(u, y, 1.0), CUT))


def test_right_models_are_rejected_at_the_level_of_one_percent():
    found = [judged("right", kind, k % 3, k) for k in range(30) for kind in INPUTS]
    for name in ("constant", "linear", "without_feedback"):
        rejected = np.mean([getattr(each, name).p_value < 0.01 for each in found])
        # Three binomial standard errors above the level.
        assert rejected <= 0.01 + 3.0 * np.sqrt(0.01 / len(found))
    shares = [each.without_feedback.share for each in found]
    assert np.nanmean(shares) < 0.01, "less what unrelated signals have by chance"


@pytest.mark.parametrize(
    ("system", "test", "kinds"),
    [
        ("frequency drifts by 10 %", "constant", INPUTS),
        ("gain halved midway", "constant", INPUTS),
        # The square of a binary input is constant: only its levels say that there is one.
        ("quadratic", "linear", ("white", "coloured", "lines", "slow")),
        ("saturating", "linear", INPUTS),
    ],
)
def test_models_of_the_wrong_class_are_found(system, test, kinds):
    found = [getattr(judged(system, kind, k, k), test) for k in range(3) for kind in kinds]
    rejected = [each.p_value < 0.01 and each.share >= 0.01 for each in found]
    assert np.mean(rejected) >= 0.9


@pytest.mark.parametrize("seed", [1, 3, 7])
def test_noise_that_grows_with_the_response_is_no_wrong_class(seed):
    """Squares and cubes are large just where the noise is (White 1980)."""
    generator = np.random.default_rng([seed, 5])
    sizes = np.repeat(np.exp(generator.standard_normal(SAMPLES // 50)), 50)
    u = sizes * generator.standard_normal(SAMPLES)
    x = resonance(u)
    y = x + 0.3 * np.abs(x) * generator.standard_normal(SAMPLES)
    found = model_class(divided(arx(u[:CUT], y[:CUT]), Recording(u, y, 1.0), CUT))
    tests = found.linear, found.constant, found.without_feedback
    assert min(test.p_value for test in tests) > 1e-3


@pytest.mark.parametrize(
    ("system", "kind", "seed", "follows"),
    [
        ("gain halved midway", "slow", 0, "linear"),
        ("frequency drifts by 10 %", "slow", 0, "linear"),
        ("quadratic", "slow", 0, "constant"),
    ],
)
def test_of_change_and_nonlinearity_the_one_that_explains_less_follows(system, kind, seed, follows):
    found = judged(system, kind, 0, seed)
    assert not found.constant.passed
    assert not found.linear.passed
    assert found.follows == follows


@pytest.mark.parametrize("seed", [1, 3])
def test_a_gain_that_follows_the_level_is_no_change(seed):
    """It looks like one as the level moves; squares and cubes do not explain it."""
    g = np.random.default_rng([seed, 3])
    u = 0.5 * g.standard_normal(SAMPLES) + np.repeat(g.standard_normal(15), SAMPLES // 15)
    y = resonance(u, gain=1.0 + 0.5 * np.tanh(lfilter([0.03], [1.0, -0.97], u)))
    y += 0.15 * np.std(y) * g.standard_normal(SAMPLES)
    found = model_class(divided(arx(u[:CUT], y[:CUT]), Recording(u, y, 1.0), CUT))
    assert not found.constant.passed
    assert found.follows == "constant"


@pytest.mark.parametrize(("changes", "seed"), [(False, 19), (True, 0), (True, 2)])
def test_what_is_not_found_beside_feedback_follows_from_it(changes, seed):
    """The residuals of a response too short hold noise, which comes back through a controller."""
    r, e = np.random.default_rng([seed, 11]).standard_normal((2, SAMPLES))
    r, u, y = np.repeat(r[: SAMPLES // 20], 20), np.zeros(SAMPLES), np.zeros(SAMPLES)
    for t in range(2, SAMPLES):
        gain = 0.1 if changes and t >= SAMPLES // 2 else 0.05
        y[t] = 1.7 * y[t - 1] - 0.72 * y[t - 2] + gain * u[t - 1] + 0.1 * e[t]
        u[t] = 2.0 * r[t] - 0.8 * y[t]
    past = np.column_stack([u[10 - k : CUT - k] for k in range(1, 5)])
    response = np.linalg.lstsq(np.insert(past, 4, 1.0, axis=1), y[10:CUT])[0][:4]
    one = np.ones(1)
    model = PolynomialModel(one, response, one, one, one, nk=1)
    found = model_class(divided(model, Recording(u, y, 1.0), CUT))
    assert found.constant.passed != changes
    assert (found.follows == "feedback") != changes


def test_what_a_sweep_has_not_excited_yet_is_no_change():
    """A model of the first part of a sweep is wrong at the frequencies of the second one."""
    failed = []
    for seed in range(20):
        generator = np.random.default_rng([seed, 7])
        u = chirp(np.arange(SAMPLES), 0.001, SAMPLES, 0.35, phi=360.0 * generator.random())
        x = resonance(u)
        model = arx(u[:CUT], (x + 0.1 * generator.standard_normal(SAMPLES))[:CUT])
        y = x + 0.1 * generator.standard_normal(SAMPLES)
        found = model_class(divided(model, Recording(u, y, 1.0), CUT))
        failed.append([t.p_value < 0.01 <= t.share for t in (found.constant, found.linear)])
    assert np.sum(failed, axis=0).max() <= 2


def test_a_sudden_change_is_told_from_a_gradual_one_and_found_where_it_is():
    kinds = ("white", "coloured", "binary")
    sudden = [judged("gain halved midway", kind, 0, k) for k in range(3) for kind in kinds]
    assert max(abs(found.changed_at - SAMPLES / 2) for found in sudden) < 0.05 * SAMPLES
    gradual = [judged("frequency drifts by 10 %", kind, 0, k) for k in range(3) for kind in kinds]
    assert np.sum([found.changed_at == 0.0 for found in gradual]) >= 8


def test_a_change_that_comes_back_is_found_with_its_period():
    kinds = [kind for kind in INPUTS if kind != "lines"]
    found = [judged("gain comes back three times", kind, k, k) for k in range(3) for kind in kinds]
    failed = [each for each in found if not each.constant.passed]
    assert len(failed) >= 13
    right = [abs(each.period - SAMPLES / 3) < 0.2 * SAMPLES / 3 for each in failed]
    assert np.mean(right) >= 0.8
    drifting = [judged("frequency drifts by 10 %", kind, 0, k) for k in range(3) for kind in INPUTS]
    assert np.mean([np.isnan(each.period) for each in drifting]) >= 0.8


def test_what_comes_back_with_a_periodic_input_is_no_change():
    found = [judged("saturating", "lines", k % 3, k) for k in range(10)]
    assert [each.period for each in found] == [0.0] * len(found)
    assert sum(each.constant.passed for each in found) >= 8


def test_the_powers_that_explain_most_are_those_of_the_nonlinear_system():
    """Squares and cubes of the response, then those of the inputs."""
    for system, right in (("quadratic", {2}), ("saturating", {1})):
        found = [
            judged(system, kind, 0, k).powers for k in range(3) for kind in ("white", "coloured")
        ]
        assert np.sum([int(np.argmax(powers)) in right for powers in found]) >= 5


def test_the_input_of_a_controller_is_found():
    """Noise prevails in the loop, so that a model without delay is that of the controller."""
    found = []
    for seed in range(20):
        r, e = np.random.default_rng([seed, 4]).standard_normal((2, SAMPLES))
        u, y = np.zeros(SAMPLES), np.zeros(SAMPLES)
        v = lfilter([1.0], [1.0, -0.9], e)
        for t in range(1, SAMPLES):
            y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1] + v[t] - 0.8 * v[t - 1]
            u[t] = 0.2 * r[t] - 0.8 * y[t]
        model = arx(u[:CUT], y[:CUT], nk=0, order=4)
        tests = model_class(divided(model, Recording(u, y, 1.0), CUT))
        found.append(tests.without_feedback)
    assert np.mean([each.p_value < 0.01 and each.share >= 0.01 for each in found]) >= 0.9


@pytest.mark.parametrize("gain", [0.0, 0.25])
def test_an_input_that_follows_the_output_of_the_same_sample_is_found(gain):
    """White noise is a tenth of the variance of the input, at this sample alone."""
    found = []
    for seed in range(30):
        r, e = np.random.default_rng([seed, 5]).standard_normal((2, SAMPLES))
        u, y = np.zeros(SAMPLES), np.zeros(SAMPLES)
        for t in range(1, SAMPLES):
            y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1] + e[t] - 0.8 * e[t - 1]
            u[t] = r[t] - gain * y[t]
        one = np.ones(1)
        truth = PolynomialModel(one, np.array([0.5]), one, one, np.array([1.0, -0.8]), nk=1)
        test = model_class(divided(truth, Recording(u, y, 1.0), CUT)).without_feedback
        found.append(test.p_value < 0.01 and test.share >= 0.01)
    assert np.mean(found) >= 0.9 if gain else np.sum(found) <= 1


def test_feedback_of_an_unstable_plant_is_found_with_two_outputs():
    """No stable model is right; there is one nevertheless, and it is told what it is."""
    for seed in range(2):
        generator = np.random.default_rng(seed)
        reference = 0.05 * np.repeat(generator.choice([-1.0, 1.0], SAMPLES // 20), 20)
        u, y, x = np.zeros(SAMPLES), np.zeros((SAMPLES, 2)), np.zeros(2)
        for t in range(SAMPLES):
            y[t] = x @ [[1.0, 0.5], [0.0, 0.2]] + 2e-3 * generator.standard_normal(2)
            u[t] = reference[t] - 6.0 * x.sum() - 0.012 * generator.standard_normal()
            x = [[1.0, 0.05], [0.1, 1.0]] @ x + [0.0, 0.05 * u[t]]
            x = x + 5e-4 * generator.standard_normal(2)
        record = Recording(u, y, 1.0)
        found = next(estimates_of_orders(record.between(0, CUT), [2]))
        test = model_class(divided(found.model, record, CUT)).without_feedback
        assert test.p_value < 0.01
        assert test.share >= 0.01


def test_no_wrong_class_is_taken_for_feedback():
    """What a model lacks depends on earlier inputs; of a periodic input later ones are the same."""
    wrong = [system for system in SYSTEMS if system != "right"]
    found = {
        kind: [
            judged(system, kind, k, 100 + k).without_feedback for system in wrong for k in (0, 1)
        ]
        for kind in INPUTS
    }
    assert all(each == REPEATS for each in found.pop("lines"))
    p_values = [each.p_value for tests in found.values() for each in tests]
    assert np.isfinite(p_values).all()
    assert np.sum(np.array(p_values) < 0.01) <= 3  # of 40; more by chance in 7 of 10,000


def test_squares_that_an_input_depends_on_are_no_feedback():
    """Of an input that follows its own squares, residuals of squares are like later samples."""
    for seed in range(3):
        w, v = np.random.default_rng([seed, 8]).standard_normal((2, SAMPLES))
        u = np.zeros(SAMPLES)
        for t in range(1, SAMPLES):
            u[t] = 0.3 * min(u[t - 1] ** 2, 4.0) + w[t]
        y = resonance(u + 0.3 * (u**2 - np.mean(u**2))) + 0.3 * v
        model, record = arx(u, y), Recording(u, y, 1.0)
        assert model_class(divided(model, record, CUT)).without_feedback.passed


def test_a_stretch_without_residuals_leaves_a_test_of_feedback_as_it_is():
    """As one that is no longer than a delay; its mean is none."""
    e, u = np.random.default_rng(4).standard_normal((2, 600, 1))
    parts, direct = [(e, u), (e[:0], u[:0])], np.zeros(1, dtype=bool)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert feedback_test(parts, direct) == feedback_test(parts[:1], direct)


def test_one_periodic_input_does_not_speak_for_the_others():
    g = np.random.default_rng(6)
    lines = np.tile(g.standard_normal(SAMPLES // 20), 20)
    y = resonance(lines) + 0.1 * g.standard_normal(SAMPLES)
    model = arx(lines, y)
    two = PolynomialModel(model.A, [model.B[0], [0.0]], nk=[*model.nk, 1], sampling_rate=1.0)
    # The second one stands still, so that nothing is known of it.
    recording = Recording(np.column_stack([lines, np.zeros(SAMPLES)]), y, 1.0)
    assert model_class(divided(two, recording, CUT)).without_feedback != REPEATS
    assert model_class(divided(model, Recording(lines, y, 1.0), CUT)).without_feedback == REPEATS


def test_an_input_of_narrow_band_noise_is_not_taken_for_a_periodic_one():
    """It is like itself a period later, but not many; what it follows cannot be told."""
    pole = 0.998 * np.exp(0.3j)
    for seed in range(10):
        e, v = np.random.default_rng([seed, 5]).standard_normal((2, SAMPLES))
        u = lfilter([1.0], np.real(np.poly([pole, np.conj(pole)])), e)
        y = resonance(u) + 3.0 * v
        test = model_class(divided(arx(u, y), Recording(u, y, 1.0), CUT)).without_feedback
        assert test != REPEATS


def outputs_alone(y, order=6):
    """Test of change of an autoregression."""
    past = np.column_stack([-y[order - k : len(y) - k] for k in range(1, order + 1)])
    a = np.linalg.lstsq(past, y[order:])[0]
    model = PolynomialModel(np.r_[1.0, a], (), nk=(), noise_variance=1.0)
    record = Recording(np.zeros((len(y), 0)), y, 1.0)
    return model_class(divided(model, record, 0)).constant.p_value


def light_modes(seed):
    """Two modes under white forces, and noise, which need more than the autoregression has."""
    generator = np.random.default_rng(seed)
    y = 1.5 * generator.standard_normal(1000)
    for angle in (0.12, 0.9):
        pole = np.exp(complex(-0.005, 1.0) * angle)
        mode = np.real(np.poly([pole, np.conj(pole)]))
        part = lfilter([1.0], mode, generator.standard_normal(3000))[2000:]
        y += part / np.std(part)
    return y


def test_light_modes_that_come_and_go_are_no_change_of_a_record_without_input():
    """Two of forty are expected below 5 %, six or more have a probability of 1.4 %."""
    assert sum(outputs_alone(light_modes(seed)) < 0.05 for seed in range(40)) <= 5
    drifting = FREQUENCY * (1.0 + np.linspace(-0.1, 0.1, SAMPLES))
    forces = np.random.default_rng(1).standard_normal((5, SAMPLES))
    assert all(outputs_alone(resonance(force, drifting)) < 0.01 for force in forces)


def test_a_short_or_constant_record_is_not_judged():
    u = np.zeros(60)
    (record,) = divided(PolynomialModel([1.0], [1.0], nk=1), Recording(u, u, 1.0), 0)
    found = model_class([record])
    assert all(np.isnan(each.p_value) for each in (found.constant, found.linear))
    assert np.isnan([found.without_feedback.p_value, found.without_feedback.share]).all()
    assert found.follows == ""


def test_a_change_follows_from_no_nonlinearity_that_could_not_be_tested():
    """120 samples are enough for the test of changes, 160 for that of nonlinearity."""
    u, e = np.random.default_rng(2).standard_normal((2, 150))
    y = lfilter([0.0, 1.0, 0.5], [1.0], u) * np.repeat([1.0, 3.0], 75) + 0.01 * e
    model = PolynomialModel([1.0], [2.0, 1.0], nk=1)
    found = model_class(divided(model, Recording(u, y, 1.0), 0))
    assert not found.constant.passed
    assert np.isnan(found.linear.p_value)
    assert found.follows == ""


@pytest.mark.parametrize("system", ["gain halved midway", "saturating"])
def test_tests_in_blocks_are_those_of_all_samples_at_once(monkeypatch, system):
    whole, dense = judged(system, "white", 0, 1), []

    def at_once(stretch, output, rows):
        """The same by regressions of all rows together."""
        beside, tested = rows(slice(None))
        e, whitening = stretch.residuals[:, output], stretch.whitening[output]
        columns = np.column_stack([np.ones(len(e)), *stretch.lost, beside, tested, e])
        columns = module.filtered(columns, whitening)
        dense.append(len(columns))
        others, tested, e = np.split(columns, [-1 - tested.shape[1], -1], axis=1)
        left = [module.left_by(others, signals) for signals in (e[:, 0], tested)]
        return *left, columns

    monkeypatch.setattr(module, "ROWS", 200)
    in_blocks = judged(system, "white", 0, 1)
    monkeypatch.setattr(module, "_left", at_once)
    at_once_too = judged(system, "white", 0, 1)
    assert min(dense) > 5 * module.ROWS
    for one in ("constant", "linear", "without_feedback"):
        expected = pytest.approx(getattr(at_once_too, one).p_value, rel=1e-6)
        assert getattr(in_blocks, one).p_value == expected
        assert getattr(whole, one).p_value == expected
    np.testing.assert_equal(in_blocks.changed_at, at_once_too.changed_at)
    assert in_blocks.powers == pytest.approx(at_once_too.powers)
