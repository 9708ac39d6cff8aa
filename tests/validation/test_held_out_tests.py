"""Level and power of tests on held-out samples."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem import SearchSettings, estimate
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording
from evopem.validation.checks.inputs import responds
from evopem.validation.held_out_tests import (
    HALF_WAY,
    NO_TEST,
    HeldOutContribution,
    HeldOutTest,
    joint_contribution_test,
    may_follow,
)
from evopem.validation.modal_parts import free_responses
from evopem.validation.responses import divided
from evopem.validation.validate import input_significance

SEARCH = SearchSettings(objective="quadratic", mu=4, lambda_=4, nu=4, evaluations=1)


def contribution_test(e, x, nuisance=None):
    """The test of one output of one record."""
    others = np.ones((len(e), 0)) if nuisance is None else nuisance
    return joint_contribution_test([HeldOutContribution(e[:, None], x[:, None], [others])])


def channels(seed, samples, gain):
    """Coloured noise with poles of its own, and a response to the input of relative size gain."""
    u, e = np.random.default_rng([1, seed]).standard_normal((2, samples))
    disturbance = lfilter([1.0, 0.5], [1.0, -1.5, 0.8], e)
    response = lfilter([0.0, 1.0, 0.5], [1.0, -1.2, 0.7], u)
    return u, disturbance + gain * np.std(disturbance) / np.std(response) * response


@pytest.mark.parametrize("orders", [(6, 6, 6, 1), (6, 2, 2, 1)])
def test_unrelated_channels_pass_as_often_as_the_level_says(orders):
    p_values = []
    for seed in range(40):
        u, y = channels(seed, 800, 0.0)
        model = estimate(u[:400], y[:400], orders, settings=SEARCH).model
        p_values.append(input_significance(divided(model, Recording(u, y, 1.0), 400)).p_value)
    # Three binomial standard errors above the level.
    for level in (0.01, 0.1):
        assert np.mean(np.array(p_values) < level) <= level + 3 * np.sqrt(level / 40)


@pytest.mark.parametrize("denominator", [[1.0, -0.995], [1.0, -1.0], [1.0, -1.98, 0.9801]])
def test_unrelated_slow_channels_do_not_pass(denominator):
    """An ARX model of 2 + 2 coefficients, 700 samples to estimate and 300 held out."""
    passed = 0
    for seed in range(100):
        white, noise = np.random.default_rng([3, seed]).standard_normal((2, 2, 1500))
        u, y = (lfilter([1.0], denominator, white) + 0.05 * noise)[:, 500:]
        u, y = u - u[:700].mean(), y - y[:700].mean()
        past = np.column_stack([-y[1:699], -y[:698], u[1:699], u[:698]])
        a1, a2, *b = np.linalg.lstsq(past, y[2:700])[0]
        model = PolynomialModel([1.0, a1, a2], b, nk=1)
        passed += bool(responds(input_significance(divided(model, Recording(u, y, 1.0), 700))))
    assert passed <= 5


def test_an_input_of_several_that_explains_nothing_passes_as_often_as_the_level_says():
    """ARX models of a response to the first of two inputs, by least squares."""
    p_values = []
    for seed in range(200):
        u, y = channels(seed, 800, 1.0)
        other = np.random.default_rng([5, seed]).standard_normal(800)
        past = np.column_stack([-y[1:399], -y[:398], u[1:399], u[:398], other[1:399], other[:398]])
        a1, a2, *b = np.linalg.lstsq(past, y[2:400])[0]
        model = PolynomialModel([1.0, a1, a2], (b[:2], b[2:]), nk=(1, 1))
        both = divided(model, Recording(np.column_stack([u, other]), y, 1.0), 400)
        p_values.append([input_significance(both, [k]).p_value for k in range(2)])
    p_values = np.array(p_values)
    assert np.mean(p_values[:, 0] < 1e-4) > 0.95
    for level in (0.01, 0.1):
        assert np.mean(p_values[:, 1] < level) <= level + 3 * np.sqrt(level / 200)


def test_a_weak_response_is_found():
    passed = []
    for seed in range(20):
        u, y = channels(seed, 2000, 0.3)
        model = estimate(u[:1400], y[:1400], (4, 4, 3, 1), settings=SEARCH)
        passed.append(
            input_significance(divided(model.model, Recording(u, y, 1.0), 1400)).significant(0.01)
        )
    assert np.mean(passed) > 0.9


def test_the_level_holds_for_errors_that_are_not_white():
    p_values = []
    for seed in range(150):
        x, e = np.random.default_rng([2, seed]).standard_normal((2, 400))
        x, e = lfilter([1.0], [1.0, -0.95], x), lfilter([1.0], [1.0, -0.95], e)
        p_values.append(contribution_test(e, x).p_value)
    error = np.sqrt(0.05 * 0.95 / 150)
    assert np.mean(np.array(p_values) < 0.05) == pytest.approx(0.05, abs=4 * error)


def test_forty_samples_tell_a_response_from_none():
    p_values = []
    for seed in range(200):
        x, e = np.random.default_rng([9, seed]).standard_normal((2, 240))
        x, e = lfilter([1.0], [1.0, -1.5, 0.8], x)[200:], lfilter([1.0], [1.0, -0.9], e)[200:]
        free = free_responses(np.roots([1.0, -1.5, 0.8]), 40)
        p_values.append([contribution_test(e + gain * x, x, free).p_value for gain in (0.0, 1.0)])
    unrelated, related = np.mean(np.array(p_values) < 0.01, axis=0)
    assert unrelated < 0.04
    assert related > 0.95


def test_the_coefficient_is_that_of_the_regression():
    x, e = np.random.default_rng(3).standard_normal((2, 20_000))
    test = contribution_test(0.5 * x + e + 7.0, x)
    assert test.coefficient == pytest.approx(0.5, abs=4 / np.sqrt(20_000))
    assert test.statistic == pytest.approx(0.5 * np.sqrt(20_000), rel=0.05)
    assert contribution_test(-0.5 * x + e, x).p_value > 0.999


def test_a_transient_of_the_model_is_no_contribution():
    """Both series ring with the model's own slow pole, from unknown initial states."""
    model = PolynomialModel(np.array([1.0, -1.9, 0.998]), np.ones(1), np.ones(1), nk=1)
    free = free_responses(model.poles(), 400)
    e = np.random.default_rng(4).standard_normal(400)
    ringing = free @ [30.0, -28.0]
    x = np.random.default_rng(5).standard_normal(400) + ringing
    assert contribution_test(e + ringing, x).p_value < 0.01
    assert contribution_test(e + ringing, x, free).p_value > 0.05


def test_without_a_contribution_or_samples_nothing_is_judged():
    e = np.random.default_rng(6).standard_normal(100)
    for test in (
        contribution_test(e, np.zeros(100)),
        contribution_test(e, np.ones(100)),
        contribution_test(e[:30], e[:30]),
        contribution_test(e, np.where(np.arange(100) == 5, np.nan, e)),
    ):
        assert np.isnan(test.p_value)
        assert test.significant(0.01) is None


def test_errors_with_a_part_that_explains_more_than_half_of_the_difference_are_smaller():
    e, x = np.random.default_rng(7).standard_normal((2, 1000, 1))

    def smaller(without, errors):
        contribution = HeldOutContribution(without, without - errors, [np.empty((1000, 0))])
        return joint_contribution_test([contribution], HALF_WAY)

    assert smaller(e + 0.5 * x, e).p_value < 1e-4
    assert smaller(e, e + 0.5 * x).p_value > 0.999
    assert smaller(e + 0.5 * x, e).coefficient == pytest.approx(1.0, abs=0.1)
    # Of two parts of white noise the mean squares are alike.
    assert 0.01 < smaller(e + x, e - x).p_value < 0.99
    assert np.isnan(smaller(e, e).p_value)


def _of_three_outputs(seed, effect):
    """Coloured errors that outputs share, and a contribution that is weak at each of them."""
    generator = np.random.default_rng([8, seed])
    mixing = np.array([[1.0, 0.0, 0.0], [0.7, 1.0, 0.0], [0.5, 0.3, 1.0]])
    e = lfilter([1.0], [1.0, -0.8], generator.standard_normal((300, 3)) @ mixing.T, axis=0)
    x = generator.standard_normal((300, 1)) * np.array([0.5, -1.0, 0.8])
    return HeldOutContribution(e + effect * x, x, [np.ones((300, 1))] * 3)


@pytest.mark.parametrize("records", [1, 3])
def test_the_joint_level_holds_for_outputs_with_common_noise(records):
    p_values = []
    for seed in range(300):
        of_records = [_of_three_outputs(1000 * record + seed, 0.0) for record in range(records)]
        p_values.append(joint_contribution_test(of_records).p_value)
    error = np.sqrt(0.05 * 0.95 / 300)
    assert np.mean(np.array(p_values) < 0.05) == pytest.approx(0.05, abs=4 * error)


def test_what_is_weak_in_each_record_is_found_in_all_together():
    joint, longest = [], []
    for seed in range(40):
        records = [_of_three_outputs(1000 * record + seed, 0.07) for record in range(3)]
        joint.append(joint_contribution_test(records).p_value < 0.01)
        longest.append(joint_contribution_test(records[:1]).p_value < 0.01)
    assert np.mean(joint) > np.mean(longest) + 0.2


def test_what_is_weak_at_each_output_is_found_at_all_together():
    joint, single = [], []
    for seed in range(40):
        record = _of_three_outputs(seed, 0.1)
        e, x = record.errors_without, record.contributions
        joint.append(joint_contribution_test([record]).p_value < 0.01)
        single.append(min(contribution_test(e[:, k], x[:, k]).p_value for k in range(3)) < 0.01 / 3)
    assert np.mean(joint) > np.mean(single) + 0.2


def test_the_largest_of_all_frequencies_is_as_rare_as_its_level_says():
    """The largest line of white noise, by Fisher's test."""
    noise = np.random.default_rng(4).standard_normal((400, 300))
    lines = np.abs(np.fft.rfft(noise, axis=1))[:, 1:-1] ** 2 / 150.0
    tests = [HeldOutTest(1.0, float(np.sqrt(line)), 0.0, 300) for line in lines.max(axis=1)]
    # At 5 % of 400 between 7 and 35 but for one case in a thousand.
    assert 7 <= sum(test.of_largest(2).p_value < 0.05 for test in tests) <= 35


def test_a_test_shows_a_part_whose_coefficient_it_knows_well():
    known, vague = HeldOutTest(-0.1, -0.5, 0.7, 100), HeldOutTest(1.5, 3.0, 0.002, 100)
    assert [test.would_show(0.01) for test in (known, vague, NO_TEST)] == [True, False, False]


def test_samples_of_a_fit_show_only_what_is_larger_than_the_largest_by_chance():
    """One of twelve coefficients is 6.7 by chance at 1 %; a right part has 2.3 more in 99 %."""
    tests = [HeldOutTest(0.7, 0.7 * t, 0.0, 1500) for t in (4.0, 5.9, 8.8, 9.2)]
    assert [test.would_show(0.01) for test in tests] == [False, True, True, True]
    in_sample = [test.of_largest(12).would_show(0.01) for test in tests]
    assert in_sample == [False, False, False, True]


def looped(white, noise):
    """An input under proportional feedback of a first-order plant."""
    u, y = np.zeros((2, len(white)))
    for t in range(len(white)):
        y[t] = 0.8 * y[t - 1] + u[t - 1] + noise[t] if t else 0.0
        u[t] = white[t] - 0.5 * y[t]
    return u


def test_an_input_of_a_loop_may_follow_noise_and_others_may_not():
    white, noise = np.random.default_rng(5).standard_normal((2, 2000))
    time = np.arange(2000)
    assert may_follow(looped(white, noise))
    assert may_follow(lfilter([1.0], [1.0, -0.7], white))  # who knows
    assert not may_follow(white)
    assert not may_follow(np.sin(1e-4 * time**2))
    assert not may_follow(np.repeat(white[:200], 10))
    assert not may_follow(np.zeros(2000))
