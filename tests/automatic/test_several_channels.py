"""Search, choice and revisions for several channels, against known systems."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from vibrating_structure import VibratingStructure

from evopem.automatic.candidates import Candidate, OrderLimits, Scorer
from evopem.automatic.chosen_model import estimate_candidate
from evopem.automatic.cross_validation.folds import HeldOutScores, decide_folds, held_out_scores
from evopem.automatic.fit import (
    LARGE_WIDTH,
    CommonSettings,
    fits_in_state_space,
    recording_of,
    task_of,
    until_bic_rises,
)
from evopem.automatic.fold_errors import as_good
from evopem.automatic.orders import (
    SINGLE_STEPS,
    decide_delays,
    numbers_of_states,
    search_structure,
)
from evopem.automatic.revisions import act_on_checks
from evopem.automatic.structures import Choice, compare_structures
from evopem.config.constraints import Constraints
from evopem.config.settings import FitSettings, OrderRanges, SearchSettings
from evopem.errors import NoModelError
from evopem.estimation.criteria import lost_model
from evopem.estimation.state_space import local_estimates
from evopem.estimation.state_space.search import FINAL_WIDTH, is_heavy
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording, Segment
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT, WHITE

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
ONE_MODE, TWO_MODES = (np.convolve([1.0, -1.5, 0.8], each) for each in ([1.0], [1.0, 0.2, 0.7]))


def simulated(samples, seed, number=0):
    generator = np.random.default_rng(seed)
    u = generator.standard_normal((samples, 1))
    y = TRUTH.simulate(u, generator.standard_normal(2))
    return Segment(u, y + NOISE * generator.standard_normal(y.shape), number)


def scorer_of(segments, delays=None, **ranges):
    nu = segments[0].inputs.shape[1]
    limits = OrderLimits(None, OrderRanges(**ranges), tuple(f"u{k + 1}" for k in range(nu)))
    delays = (1,) * nu if delays is None else delays
    return Scorer(segments, decide_folds(segments), CommonSettings(), limits, delays)


# Held-out samples.


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
def test_the_truth_leaves_the_noise(objective):
    segments = [simulated(400, 1), simulated(300, 2, 1)]
    absolute = objective == "absolute"
    plan = decide_folds(segments)
    scores = held_out_scores(segments, plan, lambda parts: [TRUTH] * len(parts), absolute)
    y = np.concatenate([each.outputs for each in segments])
    size = np.abs(y - y.mean(axis=0)).mean(axis=0) if absolute else y.std(axis=0)
    noise = NOISE * np.sqrt(2.0 / np.pi) if absolute else NOISE
    expected = 100.0 * np.mean(noise / size)
    for score in (scores.simulation, scores.fitted_level, scores.prediction):
        assert score == pytest.approx(expected, rel=0.1)


def test_an_unstable_model_simulates_nothing():
    segments = [simulated(300, 1)]
    unstable = replace(TRUTH, A=1.2 * TRUTH.A)
    scores = held_out_scores(
        segments, decide_folds(segments), lambda parts: [unstable] * len(parts), False
    )
    assert scores.simulation > 1e4


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
        fitted = [m.simulate_from_fitted_state(measured, outputs) for m in (truth, surplus)]
        absorbed.append([np.linalg.norm(outputs - each, axis=0).mean() for each in fitted])
        segments = [Segment(measured, outputs)]
        plan = replace(decide_folds(segments), designs=((5, 1),), by_energy=False)
        scores = [
            held_out_scores(segments, plan, lambda parts, m=m: [m] * len(parts), False)
            for m in (truth, surplus)
        ]
        scored.append([each.simulation for each in scores])
    of_truth, of_surplus = np.mean(absorbed, axis=0)
    assert of_surplus < 0.9 * of_truth
    of_truth, of_surplus = np.mean(scored, axis=0)
    assert of_surplus > 0.99 * of_truth


# Orders.


@pytest.mark.parametrize(
    ("orders", "bic", "coloured", "last", "driven"),
    [
        # Two rises end a search; a single one does not.
        (range(2, 21, 2), (9, 8, 8.5, 7, 7.5, 7.2, 3, 2, 1, 0), (0,) * 10, 12, True),
        # Beyond 20 states the first one does, of either criterion.
        (range(16, 31, 2), (9, 8, 7, 6, 5, 5.5, 4, 3), (9, 8, 7, 6, 5, 4, 3, 2), 26, True),
        (range(16, 31, 2), (9, 8, 7, 6, 5, 4, 3, 2), (9, 8, 7, 6, 6.5, 6, 5, 4), 24, True),
        # Errors that stay coloured alike do not add states without end.
        (range(16, 31, 2), (9, 8, 7, 6, 5, 4, 3, 2), (5, 6, 7, 8, 9, 9, 9, 9), 20, True),
        ((30,), (1,), (1,), 30, True),
        # Without an input states describe nothing but colour: BIC alone decides.
        (range(16, 31, 2), (9, 8, 7, 6, 5, 5.5, 6, 3), (5, 6, 7, 8, 9, 9, 9, 9), 28, False),
    ],
)
def test_a_search_over_orders_ends_where_bic_rises(orders, bic, coloured, last, driven):
    scores = zip(orders, bic, coloured, strict=True)
    estimates = (SimpleNamespace(order=n, bic=b, coloured_bic=c) for n, b, c in scores)
    assert [each.order for each in until_bic_rises(estimates, driven)][-1] == last


@pytest.mark.parametrize(
    ("structure", "lowest", "last"),
    [("ss_oe", 12, 18), ("ss_oe", 6, 12), ("ss_oe_drift", 26, 30), ("ss", 6, 30)],
)
def test_coloured_errors_add_no_states_that_simulate_worse(structure, lowest, last, monkeypatch):
    """Three orders in vain of many states end a search in output-error form, whatever its BIC."""
    scorer = scorer_of(noise(900))
    fits = ((order, order) for order in range(2, 31, 2))
    monkeypatch.setattr("evopem.automatic.orders.fits_in_state_space", lambda *_: fits)
    monkeypatch.setattr(
        scorer,
        "described",
        lambda _, order, __: replace(scored(1.0), order=order, simulation_bic=abs(order - lowest)),
    )
    assert search_structure(scorer, structure, {}).candidates[-1].order == last


def noise(samples, nu=2, ny=3):
    generator = np.random.default_rng(2)
    return [Segment(*(generator.standard_normal((samples, n)) for n in (nu, ny)))]


def test_orders_follow_the_length_of_the_record():
    assert numbers_of_states(scorer_of(noise(5000))) == tuple(range(2, 41, 2))
    assert numbers_of_states(scorer_of(noise(100))) == (1, 2, 3)
    assert numbers_of_states(scorer_of(noise(5000), nx=(3, 5))) == (3, 4, 5)
    short = scorer_of(noise(30), nx=(4, 4))
    assert numbers_of_states(short) == ()
    with pytest.raises(NoModelError, match="too short for a model of any structure"):
        compare_structures(short, [search_structure(short, "ss", {})])


def test_models_that_rounding_spoils_are_not_said_to_lack_samples(monkeypatch):
    def lost(*_):
        raise lost_model("model", "the search had")

    monkeypatch.setattr(local_estimates, "described", lost)
    scorer = scorer_of(noise(300), nx=(1, 1))
    search = search_structure(scorer, "ss", {})
    assert "rounding spoils" in search.decision.sentence
    with pytest.raises(NoModelError, match="or rounding spoils each of them"):
        compare_structures(scorer, [search])


@pytest.mark.parametrize(("channels", "widths"), [(4, [FINAL_WIDTH] * 2), (8, [LARGE_WIDTH])])
def test_many_channels_shorten_a_search_as_many_samples_do(monkeypatch, channels, widths):
    """Normal equations take time in proportion to the square of the channels."""
    seen, signals = [], np.random.default_rng(1).standard_normal((4000, channels))
    name = "evopem.automatic.fit.estimates_of_orders"
    monkeypatch.setattr(name, lambda *_, width, **__: seen.append(width) or iter(()))
    stretches = [Segment(signals[:, : channels // 2], signals[:, channels // 2 :])]
    for structure in ("ss", "ss_bj"):
        given = stretches, structure, (2,), (1,) * (channels // 2), CommonSettings()
        assert not list(fits_in_state_space(*given))
    assert seen == widths


def test_orders_of_outputs_alone_begin_below_the_states_of_their_modes():
    modes = np.arange(1.0, 12.0)
    shapes = np.random.default_rng(6).standard_normal((6, 11))
    mast = VibratingStructure(1.3 * modes, 0.008 / np.sqrt(modes), shapes)
    y = mast.ambient_record(1200, 32.0, 0.05, np.random.default_rng(7))
    alone = [Segment(y[:, :0], y)]
    orders = numbers_of_states(scorer_of(alone))
    assert SINGLE_STEPS < orders[0] <= 22 <= orders[-1] - 40
    # They are descended from estimates alone.
    errors = task_of(recording_of(alone), "ss", (), CommonSettings()).errors
    assert is_heavy(errors(recording_of(alone), 22))
    assert not is_heavy(errors(recording_of(alone), 20))
    # So are orders of many outputs, whose search would take longest.
    of_many = recording_of([Segment(y[:, :0], np.tile(y, 5))])
    assert is_heavy(task_of(of_many, "ss", (), CommonSettings()).errors(of_many, 10))
    few = [Segment(y[:, :0], noise(1200, ny=6)[0].outputs)]
    assert numbers_of_states(scorer_of(few))[0] == 2


def test_delays_stay_within_their_limits():
    (given,) = noise(300)
    y = given.outputs.copy()
    y[3:, 0] += 5.0 * given.inputs[:-3, 0]
    y[1:, 1] += 5.0 * given.inputs[:-1, 1]
    decided = partial(decide_delays, [Segment(given.inputs, y)], ("u1", "u2"))
    assert decided().delays == (3, 1)
    assert decided((0, 2)).delays == (2, 1)
    assert decided((1, 1)).delays == (1, 1)


# The choice.


def scored(error, folds=(), bic=0.0):
    logarithms = tuple(np.log(np.asarray(folds) * error)) if folds else ()
    scores = HeldOutScores(error, error, error, logarithms, logarithms, logarithms)
    return Candidate("ss", 2, (1,), 9, bic, bic, scores, TRUTH)


def test_models_within_a_standard_error_are_as_good():
    best = scored(10.0, (0.9, 1.1, 0.95, 1.05))
    assert as_good(scored(10.05, (1.0, 1.0, 0.97, 1.03)), best, "simulation")
    assert not as_good(scored(12.0, (0.5, 1.5, 0.5, 1.5)), best, "simulation")  # 10 % at most
    assert not as_good(scored(10.5, (0.9, 1.1, 0.95, 1.05)), best, "simulation")
    assert not as_good(scored(np.inf, (0.9, 1.1, 0.95, 1.05)), best, "simulation")


@pytest.fixture(scope="module")
def two_outputs():
    scorer = scorer_of([simulated(500, 3)], nx=(1, 5))
    searches = [search_structure(scorer, each, {}) for each in ("ss", "ss_oe")]
    return scorer, compare_structures(scorer, searches)


def test_the_smallest_model_that_does_as_well_is_chosen(two_outputs):
    scorer, comparison = two_outputs
    chosen = comparison.choice("auto").candidate
    assert (chosen.structure, chosen.order) == ("ss_oe", 2)
    assert scorer.checks(chosen).failed == ()
    assert comparison.choice("prediction").candidate.order == 2
    poles = np.sort_complex(np.linalg.eigvals(chosen.model.A))
    np.testing.assert_allclose(poles, np.sort_complex(np.linalg.eigvals(TRUTH.A)), atol=0.01)


def test_without_an_input_there_is_no_simulation():
    e = np.random.default_rng(5).standard_normal((600, 2))
    y = np.column_stack([lfilter([1.0], ONE_MODE, e[:, 0]), lfilter([1.0, 0.3], ONE_MODE, e[:, 0])])
    segments = [Segment(np.zeros((600, 0)), y + 0.1 * e)]
    scorer = scorer_of(segments, nx=(1, 4))
    comparison = compare_structures(scorer, [search_structure(scorer, "ss", {})])
    assert [each.purpose for each in comparison.choices] == ["prediction", "modes"]
    chosen = comparison.choice("auto").candidate
    assert chosen.order >= 2
    assert np.isinf(chosen.scores.simulation)


# Revisions.


def recording(a=TWO_MODES, delay=1, samples=600, seed=2):
    """Two inputs and one output, the same delay of both, and 10 % noise that drives the poles."""
    generator = np.random.default_rng(seed)
    u, e = generator.standard_normal((samples, 2)), generator.standard_normal(samples)
    clean = lfilter(np.r_[np.zeros(delay), 1.0, 0.5], a, u[:, 0])
    clean += lfilter(np.r_[np.zeros(delay), -0.7], a, u[:, 1])
    shaped = lfilter([1.0], a, e)
    y = clean + 0.1 * clean.std() / shaped.std() * shaped
    return Recording(u, y[:, None], 10.0, ("u1", "u2"), ("y",))


def searched(estimation, orders, delays=(1, 1), **ranges):
    scorer = scorer_of(estimation.segments, delays, nx=orders, **ranges)
    found = search_structure(scorer, "ss", {}).candidates
    return scorer, list(map(scorer.with_own_scores, found))


def choice_of(candidates, order):
    return Choice("simulation", next(c for c in candidates if c.order == order), "constant")


@pytest.fixture(scope="module")
def innovations():
    return searched(recording(), (2, 4))


def test_a_model_whose_checks_hold_is_left_alone(innovations):
    scorer, candidates = innovations
    found = act_on_checks(scorer, choice_of(candidates, 4), candidates)
    assert found.trials == found.failed == found.statements == ()
    assert found.choice.candidate.order == 4


def test_an_order_that_is_too_small_is_raised(innovations):
    scorer, candidates = innovations
    kept = [each for each in candidates if each.order != 3]
    found = act_on_checks(scorer, choice_of(candidates, 2), kept)
    (trial,) = found.trials
    assert (trial.revision, trial.taken, found.choice.candidate.order) == ("larger order", True, 4)
    assert {WHITE, INDEPENDENT_OF_INPUT} == set(trial.check.split(" and "))
    poles = np.linalg.eigvals(found.choice.candidate.model.A)
    assert np.allclose(np.sort_complex(poles), np.sort_complex(np.roots(TWO_MODES)), atol=0.03)


def test_what_no_model_mends_stays_failed_and_is_said(innovations):
    scorer, candidates = innovations
    found = act_on_checks(scorer, choice_of(candidates, 2), ())
    assert found.trials == ()
    assert WHITE in found.failed
    assert f"“{WHITE}” failed, and no revision was tried for it." in found.statements


def test_larger_errors_on_held_out_samples_are_no_revision(innovations):
    scorer, candidates = innovations
    small, large = choice_of(candidates, 2), choice_of(candidates, 4).candidate
    worse = replace(large, scores=HeldOutScores(1e3, 1e3, 1e3))
    found = act_on_checks(scorer, small, (worse,))
    assert [each.taken for each in found.trials] == [False]
    assert found.choice.candidate is small.candidate


def test_a_delay_that_is_too_long_is_found_in_the_residuals():
    scorer, candidates = searched(recording(ONE_MODE), (2, 2), (1, 3))
    found = act_on_checks(scorer, choice_of(candidates, 2), candidates)
    assert (found.trials[0].revision, found.trials[0].taken) == ("earlier delays", True)
    assert found.choice.candidate.delays == (1, 1)
    assert found.failed == ()


def test_delays_of_the_configuration_stay():
    given = (3, 3)
    scorer, candidates = searched(recording(ONE_MODE), (2, 2), (3, 3), nk=given)
    found = act_on_checks(scorer, choice_of(candidates, 2), candidates)
    assert "earlier delays" not in [each.revision for each in found.trials]


@pytest.mark.parametrize("evaluations", [0, 20])
def test_a_chosen_model_meets_constraints(innovations, evaluations):
    scorer, candidates = innovations
    fit = FitSettings(constraints=Constraints(static_gain={"u1": 4.0}))
    found = estimate_candidate(
        *(choice_of(candidates, 4).candidate, recording(), scorer),
        *(SearchSettings(evaluations=evaluations), fit),
    )
    gains = found.model.frequency_response(0.0)[0].real
    assert gains[0] == pytest.approx(4.0)
    assert found.estimate.constraints.active == ("static_gain",)
