"""Origin of modes on truths with one mode of the input and one of the noise."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import chirp, lfilter, residuez

from evopem import SearchSettings, estimate
from evopem.models.mode_matching import OrderModel
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording
from evopem.validation.modal_parts import ModalParts, held_out_mode_tests
from evopem.validation.mode_evidence import doubts as reasons
from evopem.validation.mode_evidence import table_of_models
from evopem.validation.responses import divided, stretches_of

RATE = 100.0
SEARCH = SearchSettings(objective="quadratic", mu=4, lambda_=8, nu=4, evaluations=2000)


def pole(frequency, damping):
    w = 2 * np.pi * frequency / RATE
    return np.exp(w * complex(-damping, np.sqrt(1 - damping**2)))


OF_INPUT, OF_NOISE = pole(10.0, 0.02), pole(25.0, 0.02)


def factor(root):
    return np.real(np.poly([root, np.conj(root)]))


def record(seed, samples=3000, noise=0.5):
    u, e = np.random.default_rng([1, seed]).standard_normal((2, samples + 500))
    x = lfilter([0.0, 1.0, 0.5], factor(OF_INPUT), u)
    v = lfilter([1.0, 0.3], factor(OF_NOISE), e)
    y = x + noise * np.std(x) / np.std(v) * v
    return u[500:], y[500:]


def evidence(seed, order):
    u, y = record(seed)
    cut = 2000
    model = estimate(u[:cut], y[:cut], (order,) * 3 + (1,), RATE, settings=SEARCH).model
    recording = Recording(u, y, RATE)
    table = table_of_models(
        [OrderModel.of(order, 0.0, model)], order, lambda each: divided(each, recording, cut)
    )
    return table.modes


def test_each_mode_has_its_origin_at_the_true_order():
    for seed in range(5):
        of_input, of_noise = evidence(seed, 4)
        assert of_input.origin == "input"
        assert of_input.reached is True
        assert of_noise.origin == "noise"
        assert of_noise.reached is False


def test_superfluous_modes_have_no_origin():
    origins = []
    for seed in range(4):
        for found in evidence(seed, 10):
            frequency = found.mode.frequency_hz
            if abs(frequency - 10.0) < 0.3 and found.mode.damping_ratio < 0.1:
                assert found.reached is True
            elif abs(frequency - 25.0) > 1.0:
                origins.append(found.origin)
    assert len(origins) >= 8
    # Two tests at 1 % each: three of some dozen are very unlikely.
    assert sum(origin != "neither" for origin in origins) <= 2


def example(nk=2):
    a = np.convolve(factor(OF_INPUT), factor(pole(30.0, 0.1)))
    return PolynomialModel(a, np.array([1.0, -0.4, 0.2]), np.ones(1), nk=nk, sampling_rate=RATE)


def test_residues_are_those_of_scipy():
    model = example()
    residues, poles, _ = residuez(model.B[0], model.A)
    for mode in model.modes():
        expected = residues[np.argmin(np.abs(poles - mode.pole))]
        assert mode.input_participation[0] == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("nk", [0, 1, 3])
def test_modal_responses_add_up_to_the_simulation(nk):
    model = example(nk)
    u = np.random.default_rng(2).standard_normal(200)
    (record,) = divided(model, Recording(u, model.simulate(u), RATE), 0)
    parts = ModalParts.of(model.modes(), record)
    # Without a delay the response to the sample itself is no part of the modes.
    rest = (parts.simulated - sum(parts.by_input))[:, 0]
    np.testing.assert_allclose(rest, 0.0 if nk else model.B[0][0] * u, atol=1e-10)


def test_a_mode_is_reached_without_covariance_or_other_orders():
    model = example()
    u = np.random.default_rng(4).standard_normal(300)
    recording = Recording(u, model.simulate(u) + 0.01 * np.roll(u, 50), RATE)
    table = table_of_models(
        [OrderModel.of(4, 0.0, model)], 4, lambda each: divided(each, recording, 100)
    )
    assert table.modes[0].stable is None
    assert table.modes[0].reached is True


def test_recurrence_is_the_share_of_models_that_have_the_mode():
    def model(order, frequency, damping, real):
        a = np.convolve(factor(pole(frequency, damping)), [1.0, -real])
        found = PolynomialModel(a, np.ones(1), np.ones(1), nk=1, sampling_rate=RATE)
        return OrderModel.of(order, 0.0, found)

    others = [
        model(4, 10.1, 0.02, 0.2),
        model(5, 10.1, 0.05, 0.2),
        model(6, 12.0, 0.02, 0.2),
        model(7, 9.95, 0.018, 0.2),
    ]
    first_order = PolynomialModel(
        np.array([1.0, 0.5]), np.ones(1), np.ones(1), nk=1, sampling_rate=RATE
    )
    chosen = model(3, 10.0, 0.02, 0.3)
    table = table_of_models([OrderModel.of(1, 0.0, first_order), chosen, *others], 3)
    (found,) = (each for each in table.modes if each.order == 3)
    assert (found.recurrence, found.orders) == (0.5, (3, 4, 7))
    alone = table_of_models([OrderModel.of(1, 0.0, first_order), chosen], 3)
    assert np.isnan(alone.modes[0].recurrence)


def test_lower_orders_that_have_a_mode_speak_for_it():
    """Only order 7 has poles to spare, and lacks the mode of orders 2 to 6."""
    models = []
    for order in range(2, 8):
        a = np.convolve(factor(pole(10.0 if order < 7 else 13.0, 0.02)), factor(pole(30.0, 0.05)))
        a = np.convolve(a, [1.0, -0.3]) if order == 7 else a
        found = PolynomialModel(a, np.ones(1), np.ones(1), nk=1, sampling_rate=RATE)
        models.append(OrderModel.of(order, 0.0, found))
    judged = next(each for each in table_of_models(models, 6).modes if each.mode.frequency_hz < 11)
    assert judged.orders == (2, 3, 4, 5, 6)
    assert judged.recurrence == 0.8
    assert not any("of the orders compared" in doubt for doubt in judged.doubts)


def test_two_orders_that_both_have_a_mode_are_enough_at_the_end_of_a_range():
    def model(order, *modes):
        a = np.convolve(factor(modes[0]), factor(modes[1]))
        found = PolynomialModel(a, np.ones(1), np.ones(1), nk=1, sampling_rate=RATE)
        return OrderModel.of(order, 0.0, found)

    slow, fast, other = pole(10.0, 0.02), pole(30.0, 0.05), pole(20.0, 0.02)
    first, second = table_of_models([model(6, slow, fast), model(7, slow, other)], 7).modes[:2]
    assert (first.confirmed, second.confirmed) == (True, False)


def test_delays_are_no_poles_to_spare():
    """A model with one mode for two has them, in state space, where B is longer than A."""

    def model(order, *modes):
        a = np.array([1.0])
        for each in modes:
            a = np.convolve(a, factor(each))
        b = 0.3 ** np.arange(3 * order)
        found = PolynomialModel(a, b, np.ones(1), nk=1, sampling_rate=RATE)
        return OrderModel.of(order, 0.0, found.state_space())

    slow, fast = pole(10.0, 0.02), pole(30.0, 0.05)
    models = [model(2, slow), model(4, slow, fast), model(6, slow, fast, pole(20.0, 0.3))]
    judged = table_of_models(models, 4).modes
    assert [each.recurrence for each in judged if each.order == 4] == [1.0, 1.0]


def test_a_mode_forty_decibels_below_the_output_or_slower_than_the_record_is_not_trusted():
    """Without noise each is significant, however little of it there is."""
    weak, strong, slow = pole(30.0, 0.02), pole(10.0, 0.02), pole(0.2, 0.002)
    f = [factor(each) for each in (weak, strong, slow)]
    b = [3e-3 * np.ones(1), np.ones(1), np.array([1e-3])]
    above = sum(np.polymul(b[k], np.polymul(f[k - 1], f[k - 2])) for k in range(3))
    below = np.polymul(np.polymul(f[0], f[1]), f[2])
    model = PolynomialModel(np.ones(1), above, F=below, nk=1, sampling_rate=RATE)
    u, e = np.random.default_rng(5).standard_normal((2, 1500))
    recording = Recording(u, model.simulate(u) + 1e-4 * e, RATE)
    table = table_of_models(
        [OrderModel.of(6, 0.0, model)], 6, lambda each: divided(each, recording, 700)
    )
    doubts = {round(each.mode.frequency_hz, 1): " ".join(each.doubts) for each in table.modes}
    assert all(each.reached for each in table.modes)
    assert [key for key, doubt in doubts.items() if "0.01 % of the power" in doubt] == [30.0]
    assert not any("hardly decays" in doubt for doubt in doubts.values())
    # The input drives it clearly, which no tone in the errors would be, or its damping is known.
    outlasting = next(each for each in table.modes if each.mode.frequency_hz < 1.0)

    def is_doubted(standard_error, statistic, reached=True):
        mode = replace(outlasting.mode, damping_se=standard_error)
        test = replace(outlasting.input_test, statistic=statistic)
        judged = replace(outlasting, mode=mode, input_test=test, reached=reached)
        return "hardly decays within the record" in reasons(judged, RATE, 800)

    known = [is_doubted(0.0006, 5.0), is_doubted(0.0008, 5.0), is_doubted(0.0006, 12.0, False)]
    assert known == [False, True, True]
    assert not is_doubted(0.0008, 12.0)


@pytest.mark.parametrize(
    ("statistic", "recurrence", "confirmed", "doubted", "coefficient"),
    [
        *((9.9, 0.5, True, 1, 1.0), (10.0, 0.5, True, 0, 1.0), (np.nan, 0.5, True, 1, np.nan)),
        *((9.9, 1.0, False, 1, 1.0), (10.0, 1.0, False, 0, 1.0), (10.0, 0.5, False, 2, 1.0)),
        (10.0, np.nan, False, 0, 1.0),  # nothing where no other order has enough poles to share it
        # Its response to the input is not of the size that the model gives it.
        *((14.5, 1.0, False, 1, 0.11), (14.5, 0.5, True, 1, 2.0), (14.5, 1.0, False, 0, 1.26)),
    ],
)
def test_a_mode_that_the_input_drives_clearly_needs_few_other_orders(
    statistic, recurrence, confirmed, doubted, coefficient
):
    (judged,) = table_of_models(
        [OrderModel.of(2, 0.0, PolynomialModel(np.ones(1), np.ones(1), F=factor(OF_INPUT)))], 2
    ).modes
    test = replace(judged.input_test, statistic=statistic, coefficient=coefficient)
    alone = replace(judged, input_test=test, recurrence=recurrence, compared=4, confirmed=confirmed)

    def said_of(evidence):
        said = " ".join(reasons(evidence, RATE))
        return ("other orders" in said) + ("there is no larger one" in said)

    assert said_of(alone) == doubted


@pytest.mark.parametrize(("noise", "confirmed"), [(0.01, True), (40.0, False)])
def test_the_largest_order_needs_no_smaller_ones_that_have_too_few_poles(noise, confirmed):
    one, both = factor(OF_INPUT), np.polymul(factor(OF_INPUT), factor(pole(30.0, 0.02)))
    models = [PolynomialModel(np.ones(1), np.ones(1), F=f, sampling_rate=RATE) for f in (one, both)]
    u, e = np.random.default_rng(5).standard_normal((2, 1500))
    recording = Recording(u, models[1].simulate(u) + noise * e, RATE)
    by_order = [OrderModel.of(n, 0.0, models[n > 3]) for n in (2, 3, 4, 5)]
    table = table_of_models(by_order, 5, lambda each: divided(each, recording, 700))
    assert [mode.confirmed for mode in table.modes] == [True, confirmed]
    assert table.modes[1].orders == (4, 5)


def test_a_mode_that_decays_within_the_estimation_samples_outlasts_no_record():
    """However few the validation samples of another recording are."""
    model = PolynomialModel(np.ones(1), np.ones(1), F=factor(pole(10.0, 0.02)), sampling_rate=RATE)
    u, e = np.random.default_rng(5).standard_normal((2, 800))
    recording = Recording(u, model.simulate(u) + 10.0 * e, RATE)

    def found(estimation_samples):
        estimation = recording.between(0, estimation_samples)
        (mode,) = table_of_models(
            [OrderModel.of(2, 0.0, model)],
            2,
            lambda each: stretches_of(each, recording.between(740, 800)),
            lambda each: stretches_of(each, estimation),
        ).modes
        return "hardly decays within the record" in mode.doubts

    assert [found(60), found(700)] == [True, False]


@pytest.mark.parametrize("inputs", [0, 1])
def test_a_strongly_damped_mode_without_input_may_be_the_colour_of_the_force(inputs):
    b, a = [np.ones(1)] * inputs, factor(pole(10.0, 0.385))
    model = PolynomialModel(a, b, np.array([1.0, 0.2]), nk=(1,) * inputs, sampling_rate=RATE)
    (judged,) = table_of_models([OrderModel.of(2, 0.0, model)], 2).modes
    assert any("colour of the force" in doubt for doubt in judged.doubts) == (not inputs)


def test_modes_that_make_up_a_finite_response_are_not_trusted():
    """The zeros of 1 - (0.75 / z) ** 12 are modes; a slower one lasts longer."""
    ring = np.zeros(13)
    ring[[0, 12]] = 1.0, -(0.75**12)
    u, e = np.random.default_rng(6).standard_normal((2, 1500))

    def doubted(a, b):
        model = PolynomialModel(a, b, np.ones(1), nk=1, sampling_rate=RATE)
        recording = Recording(u, model.simulate(u) + 0.01 * e, RATE)
        table = table_of_models(
            [OrderModel.of(len(a) - 1, 0.0, model)],
            len(a) - 1,
            lambda m: divided(m, recording, 700),
        )
        return ["finite" in " ".join(each.doubts) for each in table.modes]

    b = np.random.default_rng(7).standard_normal(12)
    assert doubted(ring, b) == [True] * 5
    assert not any(doubted(np.convolve(ring, factor(OF_INPUT)), np.convolve(b, [1.0, -0.5])))


@pytest.mark.parametrize(("gain", "trusted"), [(0.003, False), (0.3, True)])
def test_a_slow_mode_vouches_for_those_of_a_finite_response_where_it_is_trusted(gain, trusted):
    """It outlasts one in both cases; the weaker one has less than 0.01 % of the power."""
    ring = np.zeros(13)
    ring[[0, 12]] = 1.0, -(0.75**12)
    u, e = np.random.default_rng(6).standard_normal((2, 1500))
    b = np.r_[np.random.default_rng(7).standard_normal(12), 0.0]
    b = np.convolve(b, factor(OF_INPUT))[:14] + gain * np.r_[ring, 0.0]
    model = PolynomialModel(
        np.convolve(ring, factor(OF_INPUT)), b, np.ones(1), nk=1, sampling_rate=RATE
    )
    recording = Recording(u, model.simulate(u) + 0.01 * e, RATE)
    modes = tuple(replace(mode, frequency_se_hz=0.01, damping_se=1e-3) for mode in model.modes())
    of_order = OrderModel.of(14, 0.0, model, modes)
    table = table_of_models([of_order], 14, lambda each: divided(each, recording, 700))
    assert [mode.trusted for mode in table.modes] == [trusted] * 6


def test_poles_of_an_autoregression_that_describe_finite_errors_are_no_modes():
    """Those of 1 - (0.9 / z) ** 12 over a real factor: errors of one coefficient, cut off."""
    u, e = np.random.default_rng(11).standard_normal((2, 3000))
    ring = 0.9 ** np.arange(12)
    a = np.convolve(ring, factor(OF_INPUT))
    b = np.convolve(ring, [1.0, 0.5])
    model = PolynomialModel(a, b, np.ones(1), nk=1, sampling_rate=RATE)
    x = lfilter([0.0, 1.0, 0.5], factor(OF_INPUT), u)
    v = lfilter([1.0, -0.9], factor(OF_INPUT), e)
    recording = Recording(u, x + 0.5 * v, RATE)
    modes = tuple(replace(mode, frequency_se_hz=0.01, damping_se=1e-3) for mode in model.modes())
    of_order = OrderModel.of(13, 0.0, model, modes)
    table = table_of_models([of_order], 13, lambda each: divided(each, recording, 1500))
    trusted = {round(mode.mode.frequency_hz): mode.trusted for mode in table.modes}
    assert trusted.pop(10)
    assert len(trusted) == 5
    assert not any(trusted.values())


@pytest.mark.parametrize(
    ("lines", "finite", "doubted"),
    [(700, True, True), (700, False, False), (12, False, True)],
)
def test_a_response_that_outlasts_no_finite_one_has_no_modes(lines, finite, doubted):
    """A slow pole beside those of the ring; an input of few lines does not tell what it is."""
    ring = np.zeros(13)
    ring[[0, 12]] = 1.0, -(0.75**12)
    a, taps = np.convolve(ring, factor(OF_NOISE)), np.random.default_rng(7).standard_normal(12)
    b = np.convolve(taps, a)[:14] if finite else np.convolve(taps, [1.0, -0.5])
    model = PolynomialModel(np.ones(1), b, F=a, nk=1, sampling_rate=RATE)
    phases = np.random.default_rng(8).uniform(0.0, 2.0 * np.pi, (lines, 1))
    places = np.linspace(1, 749, lines).astype(int)[:, None]
    u = np.cos(2.0 * np.pi * places * np.arange(1500) / 1500 + phases).sum(axis=0)
    y = lfilter(np.r_[0.0, taps], 1.0, u) if finite else model.simulate(u)
    noise = 0.05 * np.std(y) * np.random.default_rng(9).standard_normal(1500)
    recording = Recording(u, y + noise, RATE)
    table = table_of_models(
        *([OrderModel.of(14, 0.0, model)], 14, lambda each: divided(each, recording, 900)),
        lambda each: stretches_of(each, recording.between(0, 900)),
    )
    said = ["finite" in " ".join(each.doubts) for each in table.modes]
    assert said == [doubted] * len(said)
    assert len(said) == 6


@pytest.mark.parametrize(
    ("finite", "sweep", "damping_se", "doubted"),
    [
        (False, (0.5, 2.0), 0.001, False),
        (False, (0.5, 2.0), 0.5, True),  # it may decay within the samples of a finite response
        (True, (20.0, 3.0), None, True),
    ],
)
def test_a_sweep_tells_a_slow_mode_from_a_finite_response(finite, sweep, damping_se, doubted):
    """It is almost one frequency at a time, which a few coefficients answer as a mode does."""
    times = np.arange(500) / RATE
    u, e = chirp(times, sweep[0], times[-1], sweep[1]), np.random.default_rng(1).normal(size=500)
    b, a = ([1.0, -0.3, 0.5, 0.4], 1.0) if finite else ([1.0, 0.5], factor(pole(3.3, 0.02)))
    y = lfilter([0.0, *b], a, u)
    recording = Recording(u, y + 0.05 * np.std(y) * e, RATE)
    known = recording.between(0, 400)
    model = estimate(known, orders=(2, 2, 1), structure="oe", settings=SEARCH).model
    own = model.modes()
    modes = tuple(replace(mode, damping_se=damping_se or mode.damping_se) for mode in own)
    (judged,) = table_of_models(
        *([OrderModel.of(2, 0.0, model, modes)], 2, lambda each: divided(each, recording, 400)),
        lambda each: stretches_of(each, known),
    ).modes
    assert ("finite" in " ".join(judged.doubts)) == doubted


def test_errors_of_the_first_samples_are_not_those_of_the_noise():
    """They hold responses to inputs before the record, and ring where a mode is left out."""
    a, b = factor(pole(10.0, 0.003)), np.array([1.0, 0.5])
    u, e = np.random.default_rng(12).standard_normal((2, 3000))
    y = lfilter(np.r_[np.zeros(9), b], a, u) + lfilter([1e-4], a, e)
    model = PolynomialModel(a, b, np.ones(1), nk=9, sampling_rate=RATE)
    (stretch,) = divided(model, Recording(u, y, RATE).between(500, 3000), 2000)
    assert np.abs(stretch.outputs - stretch.predicted_from_start()).max() > 1.0
    assert np.abs(ModalParts.of(model.modes(), stretch).innovations).max() < 1e-3
    # They ring for as long as these samples last, a hundred times larger than the errors.
    (judged,) = table_of_models([OrderModel.of(2, 0.0, model)], 2, lambda _: (stretch,)).modes
    assert judged.needed_by_noise


@pytest.mark.parametrize(("highest", "reached"), [(14.0, None), (30.0, True)])
def test_a_mode_without_input_near_it_is_not_reached(highest, reached):
    """What it adds at other frequencies says as much for it as for any other pole."""
    a = np.convolve(factor(OF_INPUT), factor(pole(28.0, 0.02)))
    model = PolynomialModel(a, np.ones(2), np.ones(1), nk=1, sampling_rate=RATE)
    lines = np.arange(1, round(highest / RATE * 1500))
    phases = np.random.default_rng(8).uniform(0.0, 2.0 * np.pi, len(lines))
    u = np.cos(2.0 * np.pi * np.outer(np.arange(1500), lines) / 1500 + phases).sum(axis=1)
    noise = np.random.default_rng(9).standard_normal(1500)
    recording = Recording(u, model.simulate(u) + 0.01 * noise, RATE)
    table = table_of_models(
        [OrderModel.of(4, 0.0, model)], 4, lambda each: divided(each, recording, 900)
    )
    assert [each.reached for each in table.modes] == [True, reached]


@pytest.mark.parametrize("there", [True, False])
def test_a_mode_that_only_the_estimation_part_excites_is_tested_there(there):
    """As that of a sweep whose last part is far above it."""
    slow, fast = factor(OF_INPUT), factor(pole(28.0, 0.02))

    def model(weight):
        b = weight * fast + slow
        return PolynomialModel(np.ones(1), b, F=np.convolve(slow, fast), nk=1, sampling_rate=RATE)

    found, time = model(0.1), np.arange(2000) / RATE
    u = np.sin(2.0 * np.pi * (2.0 * time + 0.75 * time**2))
    noise = np.random.default_rng(10).standard_normal(2000)
    recording = Recording(u, model(0.1 * there).simulate(u) + noise, RATE)
    table = table_of_models(
        *([OrderModel.of(4, 0.0, found)], 4, lambda each: divided(each, recording, 1600)),
        lambda each: stretches_of(each, recording.between(0, 1600)),
    )
    assert [each.reached for each in table.modes] == [there, True]
    alone = table_of_models(
        [OrderModel.of(4, 0.0, found)], 4, lambda each: divided(each, recording, 1600)
    )
    assert alone.modes[0].reached is not True


def test_a_stretch_no_longer_than_a_delay_tells_nothing_of_modes():
    """An identification of a recording with gaps had ended there."""
    u, e = np.random.default_rng(5).standard_normal((2, 600))
    model = example(nk=30)
    y = model.simulate(u) + 0.1 * e
    long, short = (stretches_of(model, Recording(u[:n], y[:n], 1.0)) for n in (600, 20))
    alone = held_out_mode_tests(model.modes(), long, long)
    assert held_out_mode_tests(model.modes(), [*long, *short], [*short, *long]) == alone
    assert all(math.isnan(test.p_value) for test, *_ in held_out_mode_tests(model.modes(), short))
