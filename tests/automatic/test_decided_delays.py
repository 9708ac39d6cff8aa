"""The delay that the automatic recipe decides for one input and one output."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.automatic.candidates import OrderLimits, Scorer
from evopem.automatic.cross_validation.folds import decide_folds
from evopem.automatic.fit import CommonSettings
from evopem.automatic.orders import _paths, decide_delays, in_runs, search_structure
from evopem.automatic.structures import _at_likely_delay
from evopem.config.settings import OrderRanges
from evopem.estimation import delays as estimation_delays
from evopem.estimation.delays import delays_by_criterion, is_of_feedback, longest_delay
from evopem.models.orders import Orders
from evopem.signals.recording import Segment
from evopem.validation.model_class import feedback_test

POLES = [0.97 * np.exp(0.08j), 0.97 * np.exp(-0.08j), 0.9 * np.exp(0.2j), 0.9 * np.exp(-0.2j)]


def recorded(delay, seed, samples=2000):
    """A flexible structure under a multisine of low frequencies, with white noise at the output."""
    g = np.random.default_rng(seed)
    t = np.arange(samples)
    lines = np.arange(1, 130)
    phases = g.uniform(0, 2 * np.pi, lines.size)
    u = np.cos(2 * np.pi * np.outer(t, lines) / samples + phases).sum(axis=1)
    late = np.concatenate([np.zeros(delay), u])[:samples]
    y = lfilter([0.0, 1.0, 0.4], np.poly(POLES).real, late)
    return [Segment(u / u.std(), y / y.std() + 0.05 * g.standard_normal(samples))]


@pytest.mark.parametrize("seed", range(3))
def test_an_input_of_low_frequencies_does_not_hide_a_short_delay(seed):
    segments = recorded(0, seed)
    by_arx = delays_by_criterion(segments, [(0, longest_delay(segments))])[0].delay
    choice = decide_delays(segments, ["u"])
    assert by_arx >= 7
    assert choice.delays[0] <= 4
    assert choice.delays[0] in choice.likely[0]
    (limited,) = decide_delays(segments, ["u"], (6, 60)).delays
    assert 6 <= limited <= 60


def test_nor_does_it_with_two_outputs():
    (alone,) = recorded(0, 0)
    slower = lfilter([0.0, 0.05], [1.0, -0.95], alone.input)
    second = slower / slower.std() + 0.05 * np.random.default_rng(9).standard_normal(slower.size)
    segments = [Segment(alone.inputs, np.column_stack([alone.outputs, second]))]
    by_arx = delays_by_criterion(segments, [(0, longest_delay(segments))])[0].delay
    assert by_arx >= 4
    assert decide_delays(segments, ["u"]).delays[0] <= 2


def test_folds_of_recordings_shorter_than_the_longest_models_are_decided():
    u, y = np.random.default_rng(0).standard_normal((2, 300, 10))
    plan = decide_folds([Segment(*signals) for signals in zip(u, y, strict=True)], 1)
    assert plan.designs
    assert plan.late_response == 0


@pytest.mark.parametrize("delay", [5, 20, 40])
def test_a_prior_of_coefficients_comes_nearer_to_a_long_delay(delay):
    """That of the system, one more than the input's own, is hardly seen by such an input."""
    (decided,) = decide_delays(recorded(delay, 1), ["u"]).delays
    assert abs(decided - delay - 1) <= 4


def test_a_delay_that_the_input_shows_is_kept():
    g = np.random.default_rng(5)
    u = g.standard_normal(2000)
    late = np.concatenate([np.zeros(30), u])[:2000]
    y = lfilter([0.0, 1.0, 0.4], np.poly(POLES[2:]).real, late)
    y += 0.1 * y.std() * g.standard_normal(u.size)
    segments = [Segment(u, y)]
    by_arx = delays_by_criterion(segments, [(0, longest_delay(segments))])[0].delay
    assert decide_delays(segments, ["u"]).delays == (by_arx,)
    assert by_arx == 31


@pytest.mark.parametrize("seed", range(2))
def test_white_noise_behind_the_plant_does_not_make_a_delay_longer(seed):
    """Of few lines: ARX models of white output noise need many lags, and leave out the first."""
    g = np.random.default_rng(seed)
    t, lines = np.arange(240), np.arange(1, 30)
    phases = g.uniform(0, 2 * np.pi, lines.size)
    u = np.cos(2 * np.pi * np.outer(t, lines) / 240 + phases).sum(axis=1)
    y = lfilter([0.0, 1.0], np.poly([0.95, *POLES[2:]]).real, u)
    segments = [Segment(u / u.std(), y / y.std() + 0.03 * g.standard_normal(240))]
    by_arx = delays_by_criterion(segments, [(0, longest_delay(segments))])[0].delay
    choice = decide_delays(segments, ["u"])
    assert abs(choice.delays[0] - 1) <= 2 < by_arx - 1
    assert 1 in choice.likely[0]
    assert len(choice.likely[0]) <= 6


def test_feedback_is_not_taken_for_a_delay_of_0():
    """The controller acts on the same sample: the noise of the output is in the input."""
    g = np.random.default_rng(0)
    u, y, v = np.zeros(1500), np.zeros(1500), lfilter([1.0], [1.0, -0.9], g.standard_normal(1500))
    r = g.standard_normal(1500)
    for k in range(1, 1500):
        y[k] = 0.5 * u[k - 1] + v[k]
        u[k] = r[k] - 0.8 * y[k]
    choice = decide_delays([Segment(u, y)], ["u"])
    assert choice.delays == (1,)
    assert choice.shortest == 1
    assert "feedback" in choice.decision.sentence
    assert decide_delays([Segment(u, y)], ["u"], (0, 5)).delays == (0,)  # given, and believed
    free = lfilter([1.0, 0.5], [1.0, -0.5], r) + v
    assert decide_delays([Segment(r, free)], ["u"]).delays == (0,)


def test_feedback_of_white_noise_is_told_from_a_direct_response():
    """No past residual is in the input, whose own past tells it: the simpler loop does."""
    g = np.random.default_rng(4)
    r, e = g.standard_normal((2, 2000))
    u, x, y = np.zeros((3, 2000))
    for k in range(2, 2000):
        x[k] = 1.5 * x[k - 1] - 0.7 * x[k - 2] + u[k - 1] + 0.5 * u[k - 2]
        y[k] = x[k] + e[k]
        u[k] = r[k] - 0.2 * y[k]
    for other in ([], [g.standard_normal(2000)]):
        inputs = np.column_stack([*other, u])
        choice = decide_delays([Segment(inputs, y[:, None])], list("uv")[: inputs.shape[1]])
        assert choice.shortest == 1
        assert choice.delays[-1] == 1


@pytest.mark.parametrize(("gain", "direct", "called"), [(0.0, 0.3, {0}), (0.6, 0.0, {10, 11, 12})])
def test_feedback_of_all_channels_is_told_from_their_direct_responses(gain, direct, called):
    """Of 16 pairs one alone would call a direct response feedback."""
    count = 0
    for seed in range(12):
        g = np.random.default_rng(seed)
        b, loop = g.standard_normal((2, 4, 4))
        r, e = g.standard_normal((2, 600, 4))
        x, u, y = np.zeros((3, 600, 4))
        for k in range(1, 600):
            x[k] = 0.8 * x[k - 1] + u[k - 1] @ b / 4 + 0.3 * e[k - 1]
            y[k] = x[k] + 0.5 * e[k]
            u[k] = r[k] - gain * y[k] @ loop / 4
            y[k] += direct * r[k] @ b / 4
        count += is_of_feedback([Segment(u, y)])
    assert count in called


def test_a_direct_response_without_noise_is_not_called_feedback():
    """Nothing but rounding is left, which has no likelihood."""
    t, phases = np.arange(1000), np.random.default_rng(0).uniform(0, 2 * np.pi, 8)
    u = np.cos(2 * np.pi * np.outer(t, np.arange(1, 9)) * 5 / 1000 + phases).sum(axis=1)
    y = lfilter([1.0, 0.5], [1.0, -0.8], u)
    choice = decide_delays([Segment(u, y)], ["u"])
    assert choice.delays == (0,)
    assert choice.shortest == 0


def test_delays_of_many_inputs_in_short_pieces_are_decided():
    """The pieces have fewer rows than the models of all channels have coefficients."""
    g = np.random.default_rng(0)
    u = g.standard_normal((1564, 4))
    y = lfilter([0.0, 1.0], [1.0, -0.5], u, axis=0).sum(axis=1, keepdims=True)
    y += 0.1 * g.standard_normal(y.shape)
    cuts = [0, 64, *range(79, 1564, 15)]
    segments = [Segment(u[a:b], y[a:b]) for a, b in pairwise(cuts)]
    assert decide_delays(segments, list("abcd")).shortest == 0


def test_feedback_of_an_output_is_found_in_any_units():
    generator = np.random.default_rng(3)
    y, r = generator.standard_normal((1500, 2)), generator.standard_normal(1500)
    u = r + 0.5 * np.concatenate([[0.0], y[:-1, 0]])
    direct = np.zeros(1, dtype=bool)
    tests = [feedback_test([(y * [unit, 1.0], u[:, None])], direct) for unit in (1.0, 1e-9)]
    assert tests[0].p_value < 1e-20
    assert tests[1].p_value == pytest.approx(tests[0].p_value, rel=1e-3)


def test_errors_that_are_large_where_the_input_is_are_no_feedback():
    """Bursts that input and errors share make their products large, of any lag, by chance."""
    g = np.random.default_rng(3)
    bursts = np.repeat(np.exp(1.2 * g.standard_normal(75)), 20)
    w, v = bursts * g.standard_normal((2, 1500))
    y = lfilter([1.0, 0.5], [1.0, -0.8], w) + 0.3 * lfilter([1.0], [1.0, -0.8], v)
    choice = decide_delays([Segment(w, y)], ["u"])
    assert (choice.delays, choice.shortest) == ((0,), 0)


def test_a_delay_of_0_is_taken_only_where_it_is_the_likeliest():
    """A first coefficient that chance makes large enough not to speak against the same sample."""
    decided = []
    for seed in range(12):
        u, e = np.random.default_rng(seed).standard_normal((2, 200))
        y = lfilter([0.0, 1.0, 0.5], [1.0, -0.8], u)
        choice = decide_delays([Segment(u, y + 0.5 * y.std() * e)], ["u"])
        decided.append((choice.delays[0], 0 in choice.likely[0]))
    assert sum(delay == 1 for delay, _ in decided) >= 11
    assert sum(likely for _, likely in decided) >= 2


def test_delays_are_listed_in_runs():
    assert in_runs((0, 3, 4, 5)) == "0, 3 to 5"
    assert in_runs(tuple(range(1, 20, 2))) == "10 from 1 to 19"


def test_folds_of_a_short_record_are_longer_than_its_delay():
    """Parts of the interleaved design have fewer samples than the delay: no model were scored."""
    g = np.random.default_rng(5)
    u = g.standard_normal(320)
    y = lfilter([0.0] * 53 + [1.0], [1.0, -0.8], u)
    segments = (Segment(u, y + 0.3 * y.std() * g.standard_normal(320)),)
    assert (2, 3) in decide_folds(segments).designs
    plan = decide_folds(segments, 53)
    assert plan.designs
    assert (2, 3) not in plan.designs
    scorer = Scorer(segments, plan, CommonSettings(), delays=(53,))
    candidate = scorer.candidate("oe", Orders(nb=1, nf=1, nk=53))
    assert candidate is not None
    assert candidate.scores.simulation < 60.0


def test_a_response_that_comes_back_late_is_inside_folds_and_regularised_lengths():
    """It begins again after 70 samples, for which short responses and six blocks have no room."""
    g = np.random.default_rng(7)
    u, e = g.standard_normal((2, 700))
    first = lfilter([0.0, 1.0], [1.0, -0.6], u)
    for share, expected in ((0.6, 87), (0.0, 0)):
        y = first + share * np.r_[np.zeros(70), first[:-70]] + 0.1 * e
        plan = decide_folds((Segment(u, y),), 1)
        assert abs(plan.late_response - expected) <= 2
        assert ((2, 3) in plan.designs) == (not expected)
        scorer = Scorer((Segment(u, y),), plan, CommonSettings(), delays=(1,))
        search = search_structure(scorer, "impulse", {})
        assert (plan.late_response in search.orders) == (expected > 0)


def test_an_input_that_rests_after_one_early_blow_has_no_late_response():
    u = (np.arange(600) == 3).astype(float)
    y = lfilter([0.0, 1.0], [1.0, -1.6, 0.9], u)
    y += 0.01 * np.random.default_rng(3).standard_normal(600)
    assert decide_folds((Segment(u, y),), 1).late_response == 0


def test_weak_feedback_does_not_hide_a_response_to_the_same_sample():
    """Past residuals explain 3 % of the input, the same sample nearly all that is new."""
    g = np.random.default_rng(2)
    r, e = g.standard_normal((2, 1500))
    u = r + 0.17 * np.concatenate([[0.0], e[:-1]])
    y = lfilter([1.0, -0.5], [1.0, -0.9], u) + 0.05 * lfilter([1.0], [1.0, -0.9], e)
    choice = decide_delays([Segment(u, y)], ["u"])
    assert (choice.delays, choice.shortest) == ((0,), 0)


@pytest.mark.parametrize(("against", "early"), [(12.0, 3), (30.0, 40)])
def test_structures_are_searched_behind_a_short_delay_too_where_a_long_one_is_doubtful(
    against, early, monkeypatch
):
    def scores(segments, delays, place, tried):
        return np.array([0.0 if k == 40 else against + abs(k - 3) for k in tried])

    monkeypatch.setattr(estimation_delays, "delay_scores", scores)
    segments = recorded(0, 0)
    choice = decide_delays(segments, ["u"])
    assert (choice.delays, choice.early) == ((40,), (early,))
    plan = decide_folds(segments)
    scorer = Scorer(segments, plan, CommonSettings(), delays=choice.delays, early=choice.early)
    begins = {path[0][0].nk for path in _paths(scorer, "oe")}
    assert begins == {(40,), (early,)}


def test_regularised_responses_begin_early_too_where_the_delay_is_long():
    """A long delay may be wrong, and these responses need none."""
    u, e = np.random.default_rng(4).standard_normal((2, 600))
    segments = (Segment(u, lfilter([1.0], [1.0, -0.8], u) + 0.1 * e),)
    plan = decide_folds(segments)
    limits = OrderLimits(ranges=OrderRanges(nk=(1, 600)))
    for delay, begins in ((40, {40, 1}), (3, {3})):
        scorer = Scorer(segments, plan, CommonSettings(), limits, (delay,))
        found = search_structure(scorer, "impulse", {}).candidates
        assert {candidate.orders.single.nk for candidate in found} == begins
        # One that begins early and ends before the delay holds nothing of the system.
        assert min(o.nk[0] + o.nb[0] for o in (each.orders for each in found)) > delay
    scorer = Scorer(segments, plan, CommonSettings(), limits, (130,))
    assert {path[0][0].nk for path in _paths(scorer, "impulse")} == {(130,)}


def test_other_likely_delays_are_tried_with_the_orders_of_a_candidate(monkeypatch):
    """Small models have decided for too early a delay, or for one that is as likely as another."""
    u, e = np.random.default_rng(6).standard_normal((2, 800))
    y = lfilter([0.0] * 9 + [1.0], [1.0, -0.8], u) + 2.0 * e
    segments = (Segment(u, y),)
    scorer = Scorer(segments, decide_folds(segments), CommonSettings(), likely=((6, 7, 8, 9),))
    early = scorer.candidate("oe", Orders(nb=1, nf=1, nk=8), scored=False)
    found = _at_likely_delay(scorer, early)
    assert found.delays == (9,)
    near = replace(early, bic=found.bic + 1.0 / 800)
    assert _at_likely_delay(scorer, near) is near
    monkeypatch.setattr(scorer, "checks", lambda _: SimpleNamespace(whiteness=1e-6))
    assert _at_likely_delay(scorer, early) is early
