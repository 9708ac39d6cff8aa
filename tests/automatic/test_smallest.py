"""The smallest of the models that held-out samples and BIC do not tell apart."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.automatic import orders, structures
from evopem.automatic.candidates import Candidate, Scorer, StructureSearch
from evopem.automatic.cross_validation.folds import HeldOutScores, decide_folds
from evopem.automatic.fit import CommonSettings
from evopem.automatic.fold_errors import (
    all_as_good,
    as_good,
    coloured_bic,
    gain_of_nothing,
    may_be_chance,
    never_behind,
    not_far_behind,
    regularised_unless_worse,
    simplest,
    standard_error,
)
from evopem.automatic.revisions import _is_allowed
from evopem.automatic.structures import (
    Choice,
    _by_likelihood,
    _for_simulation,
    _likely,
    _misses_response,
    _smallest_as_good,
    _that_simulate,
    _with_valid_noise,
    compare_structures,
)
from evopem.errors import InputError, NoModelError
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Segment
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT
from evopem.validation.checks.roots import INSIDE_BOUND

SAMPLES, ONE = 500, np.ones(1)
MODEL = PolynomialModel(ONE, ONE, ONE, ONE, ONE, 1)
# Noise that all models leave, from fold to fold.
NOISE = np.log([3.0, 3.4, 2.8, 3.1, 3.2])


def candidate(parameters, effect=(0.0,) * 5, evidence=0.0):
    """With the effect of a model on the errors of each fold, and evidence of BIC against it."""
    logarithms = tuple(NOISE + np.array(effect))
    error, bic = float(np.exp(np.mean(logarithms))), evidence / SAMPLES
    scores = HeldOutScores(error, error, error, logarithms, logarithms, logarithms)
    return Candidate("oe", parameters, (1,), parameters, bic, bic, scores, MODEL)


def scorer_of(candidates, failed=None, of_all=()):
    checks = {id(each): SimpleNamespace(failed=of_all, whiteness=0.5) for each in candidates}
    if failed is not None:
        checks[id(failed)] = SimpleNamespace(failed=("Excitation adequate",), whiteness=0.5)
    return SimpleNamespace(
        independent_samples=SAMPLES,
        checks=lambda each: checks[id(each)],
        known=lambda each: each,
        with_own_scores=lambda each: each,
        stretches=[Segment(np.ones(SAMPLES), np.random.default_rng(1).standard_normal(SAMPLES))],
        absolute=False,
        penalty=lambda _: 0.0,
    )


def chosen(*candidates, failed=None, of_all=()):
    return _smallest_as_good(scorer_of(candidates, failed, of_all), candidates, "simulation")


def test_of_models_that_are_as_good_the_smallest_is_taken():
    small, large = candidate(8, evidence=4.0), candidate(12, (-0.002, 0.001, -0.003, 0.002, 0.0))
    found, sentence = chosen(large, small)
    assert found is small
    assert "smallest" in sentence


@pytest.mark.parametrize(
    "small",
    [
        candidate(8, (0.05, 0.06, 0.05, 0.07, 0.06)),  # a small loss, but in every fold
        candidate(8, evidence=40.0),
    ],
)
def test_what_folds_or_bic_tell_apart_is_not(small):
    large = candidate(12)
    assert chosen(large, small)[0] is large


@pytest.mark.parametrize(("parameters", "is_apart"), [(8, True), (10, True), (14, False)])
def test_folds_that_differ_more_are_no_reason_for_larger_models(parameters, is_apart):
    """Four folds tell a standard error to 40 %; a smaller model of lower error was told apart."""
    best, apart = candidate(12), candidate(parameters, (0.05, 0.06, 0.05, 0.07, 0.06))
    scattered = candidate(10, (0.2, -0.1, 0.2, -0.1, 0.15))
    assert as_good(scattered, best, "simulation")
    known = (best, apart, scattered)
    assert all_as_good(known, best, "simulation") == [best, *[scattered] * (not is_apart)]


def test_a_loss_too_small_to_count_is_none_though_every_fold_has_it():
    small, large = candidate(3, (0.003, 0.002, 0.003, 0.002, 0.002)), candidate(5)
    assert chosen(large, small)[0] is small


def test_a_model_beyond_the_excitation_loses_to_one_that_is_not():
    small, large = candidate(8), candidate(41)
    assert chosen(small, large, failed=large)[0] is small
    assert chosen(small, large, failed=small)[0] is large


@pytest.mark.parametrize("of_all", [(), (INDEPENDENT_OF_INPUT,)])
def test_one_step_errors_do_not_decide_where_residuals_depend_on_the_input(of_all):
    """A response that lacks a part is no likelier for its noise model."""
    likely, simulates = replace(candidate(8), simulation_bic=1.0), replace(candidate(12), bic=1.0)
    assert chosen(likely, simulates, of_all=of_all)[0] is (simulates if of_all else likely)


def test_a_pole_at_the_bound_wins_no_tie_on_held_out_samples():
    """Beyond a held-out block its slow waves grow; what they lower is the error of the fit."""
    inside, at_bound = candidate(8), replace(candidate(12), simulation_bic=-1.0)
    scorer = scorer_of((inside, at_bound), of_all=(INDEPENDENT_OF_INPUT,))
    of_all = scorer.checks(inside)
    assert _smallest_as_good(scorer, (inside, at_bound), "simulation")[0] is at_bound
    at_it = SimpleNamespace(failed=(INSIDE_BOUND,), whiteness=0.0)
    scorer.checks = lambda each: at_it if each is at_bound else of_all
    assert _smallest_as_good(scorer, (inside, at_bound), "simulation")[0] is inside


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_coloured_errors_of_simulations_count_as_fewer_independent_ones(pole):
    u, e = np.random.default_rng(3).standard_normal((2, 4000))
    stretches = [Segment(u, u + lfilter([1.0], [1.0, -pole], e))]
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings())
    gain = scorer.candidate("fir", Orders(nb=1), scored=False)
    score = coloured_bic(scorer, gain)
    share = score(replace(gain, simulation_bic=gain.simulation_bic + 1.0)) - score(gain)
    assert share == pytest.approx((1.0 - pole**2) / (1.0 + pole**2), rel=0.2)


@pytest.mark.parametrize("of_all", [(), (INDEPENDENT_OF_INPUT,)])
def test_a_larger_error_within_one_standard_error_is_left_to_a_valid_likelihood(of_all):
    """Folds that differ much say little; where no model is valid, no likelihood says more."""
    likely = candidate(8, (0.6, -0.3, 0.7, -0.3, 0.1))
    best = replace(candidate(12), bic=1.0, simulation_bic=1.0)
    assert chosen(likely, best, of_all=of_all)[0] is (best if of_all else likely)
    told_apart = candidate(8, (0.2, 0.1, 0.3, 0.1, 0.15))
    assert chosen(told_apart, best, of_all=of_all)[0] is best


@pytest.mark.parametrize("whiteness", [0.5, 1e-4])
@pytest.mark.parametrize("loss", [0.01, 0.1])
@pytest.mark.parametrize("evidence", [4.0, 40.0])
def test_a_revision_must_not_take_what_likelihoods_need(evidence, loss, whiteness):
    """Those of one-step errors where they are white, else of simulations of all samples."""
    first = candidate(12)
    smaller = candidate(8, (0.03, -0.03, 0.03, -0.02, 0.0), evidence)
    smaller = replace(smaller, simulation_bic=loss)
    scorer = scorer_of((first, smaller), failed=first)
    for each in (first, smaller):
        scorer.checks(each).whiteness = whiteness
    allowed = _is_allowed(scorer, smaller, first, Choice("simulation", first, "constant"))
    assert allowed == (evidence < 6.0 if whiteness > 0.01 else loss < 0.02)


@pytest.mark.parametrize("gain", [0.0, 0.5])
def test_a_gain_stands_for_a_response_that_cannot_be_told_from_zero(gain):
    u, e = np.random.default_rng(5).standard_normal((2, 500))
    y = gain * lfilter([0.0, 1.0, 0.5], [1.0, -0.5], u) + lfilter([1.0], [1.0, -0.8], e)
    stretches = [Segment(u, y)]
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings())
    small = scorer.candidate("fir", Orders(nb=1, nk=1))
    large = scorer.candidate("bj", Orders(nb=2, nf=2, nd=1, nk=1))
    found = gain_of_nothing(scorer, [small, large], "simulation", large)
    if gain:
        assert found is None
    else:
        assert found[0] is small
        assert "differs from zero" in found[1]


@pytest.mark.parametrize("gain", [0.0, 0.5])
def test_a_gain_stands_for_no_response_beside_noise_of_any_order(gain):
    """An ARX model takes the poles of the noise; the likeliest ARMA(2, 2) is far behind."""
    u, e = np.random.default_rng([5, 0]).standard_normal((2, 300))
    y = lfilter([1.0], np.real(np.poly([0.97, 0.7 + 0.5j, 0.7 - 0.5j])), e)
    y[1:] += gain * u[:-1]
    scorer = Scorer([Segment(u, y)], decide_folds([Segment(u, y)]), CommonSettings())
    small = scorer.candidate("fir", Orders(nb=1, nk=1))
    large = scorer.candidate("arx", Orders(na=3, nb=1, nk=1))
    # Without a model of the noise no candidate shows the small response.
    found = gain_of_nothing(scorer, [small] if gain else [small, large], "simulation", small)
    assert (found is None) == (gain > 0.0)


def test_the_standard_error_is_that_of_the_difference():
    """Folds differ by far more than two models on the same folds."""
    assert np.std(NOISE) > 0.05
    assert not as_good(candidate(8, (0.03, 0.031, 0.029, 0.03, 0.03)), candidate(9), "simulation")
    assert as_good(candidate(8, (0.03, -0.03, 0.03, -0.02, 0.0)), candidate(9), "simulation")


@pytest.mark.parametrize(("folds", "t"), [(2, 12.706), (3, 4.303), (4, 3.182), (5, 3.182)])
def test_few_folds_say_little_of_chance(folds, t):
    """Of more than four the rest is not independent; quantiles of Student's t from a table."""
    effect = np.array([0.1, -0.1, 0.05, 0.02, -0.04])[:folds]
    error = np.std(effect, ddof=1) / np.sqrt(min(folds, 4))
    best = candidate(9)
    of_folds = tuple(NOISE[:folds])
    best = replace(best, scores=replace(best.scores, simulation_folds=of_folds))
    for ratio, is_chance in ((np.exp(0.99 * t * error), True), (np.exp(1.01 * t * error), False)):
        scores = replace(
            best.scores,
            simulation=ratio * best.scores.simulation,
            simulation_folds=tuple(effect + of_folds),
        )
        rival = replace(best, scores=scores)
        assert standard_error(rival, best, "simulation") == pytest.approx(error)
        assert may_be_chance(rival, best, "simulation") == is_chance
    lost = replace(best, scores=replace(best.scores, simulation=np.inf, simulation_folds=()))
    assert not may_be_chance(lost, best, "simulation")


def test_one_fold_alone_excuses_nothing_by_chance():
    """Its spread is not known; large records of several channels and short ones have one."""

    def of_one_fold(ratio, structure):
        one = candidate(9)
        scores = replace(one.scores, simulation=ratio, simulation_folds=(float(np.log(ratio)),))
        return replace(one, structure=structure, scores=scores)

    best, worse = of_one_fold(10.0, "oe"), of_one_fold(13.0, "impulse")
    assert not may_be_chance(worse, best, "simulation")
    assert regularised_unless_worse([best, worse], "simulation", best, "")[0] is best
    near = of_one_fold(10.1, "impulse")
    assert regularised_unless_worse([best, near], "simulation", best, "")[0] is near


@pytest.mark.parametrize(
    ("effect", "is_taken"),
    [
        ((0.9, -0.1, 0.1, 0.3, 0.2), True),  # by 32 %, which so few folds may differ by
        ((0.3, 0.26, 0.29, 0.25, 0.3), False),
        ((1.9, 0.1, 0.9, 1.6, 1.8), False),  # by a factor of more than three
    ],
)
def test_a_valid_model_simulates_worse_by_no_more_than_chance(effect, is_taken):
    """One whose residuals are white, though it has more coefficients than the input excites."""
    likeliest, best = candidate(12, effect), candidate(8, evidence=40.0)
    scorer = scorer_of((likeliest, best), failed=likeliest)
    choice = _by_likelihood(scorer, (likeliest, best), "simulation", best, False)
    assert (choice is not None and choice[0] is likeliest) == is_taken


@pytest.mark.parametrize(
    ("p_value", "share", "misses", "is_taken"),
    [
        (1e-6, 0.1, True, True),
        (1e-6, 0.01, False, True),
        (1e-6, 0.01, True, False),  # what a linear model misses looks like weak feedback
        (0.01, 0.1, False, False),
    ],
)
def test_residuals_that_are_fed_back_to_the_input_may_depend_on_it(
    monkeypatch, p_value, share, misses, is_taken
):
    likeliest, best = candidate(12, (0.2,) * 5), candidate(8, evidence=40.0)
    feedback = SimpleNamespace(share=share, p_value=p_value)
    monkeypatch.setattr(structures, "feedback_test", lambda *_: feedback)
    monkeypatch.setattr(structures, "_misses_response", lambda *_: misses)
    scorer = scorer_of((likeliest, best), of_all=(INDEPENDENT_OF_INPUT,))
    fed_back = structures._is_fed_back(scorer, likeliest)
    choice = _by_likelihood(scorer, (likeliest, best), "simulation", best, fed_back)
    assert (choice is not None and choice[0] is likeliest) == is_taken
    assert choice is None or "fed back" in choice[1]


def test_a_likely_model_inside_the_stability_bound_takes_the_place_of_one_at_it():
    at_bound, inside, best = candidate(12), candidate(10, evidence=3.0), candidate(8, evidence=40.0)
    scorer = scorer_of((at_bound, inside, best))
    scorer.checks = lambda each: SimpleNamespace(
        failed=(INSIDE_BOUND,) if each is at_bound else (), whiteness=0.5
    )
    choice = _by_likelihood(scorer, (at_bound, inside, best), "simulation", best, False)
    assert choice is not None
    assert choice[0] is inside
    assert "has the lowest BIC inside the stability bound" in choice[1]


def test_the_likeliest_model_is_scored_before_it_is_left_for_its_score():
    likeliest, best = candidate(12), candidate(8, evidence=40.0)
    unscored = replace(likeliest, scores=HeldOutScores())
    scorer = scorer_of((likeliest, unscored, best))
    scorer.with_own_scores = scorer.known = lambda each: likeliest if each is unscored else each
    choice = _by_likelihood(scorer, (unscored, best), "simulation", best, False)
    assert choice is not None
    assert choice[0] is likeliest


@pytest.mark.parametrize("fed_back", [True, False])
def test_a_model_that_depends_on_its_input_by_feedback_alone_has_no_failed_check(fed_back):
    """Under feedback noise passes through the input: models without it simulate far better."""
    likeliest, best = candidate(12, (0.6,) * 5), candidate(8, evidence=40.0)
    scorer = scorer_of((likeliest, best), of_all=(INDEPENDENT_OF_INPUT,))
    choice = _by_likelihood(scorer, (likeliest, best), "simulation", best, fed_back)
    assert (choice is not None and choice[0] is likeliest) == fed_back


def test_a_model_that_simulates_its_own_samples_badly_is_no_choice_for_simulation():
    """Held-out samples behind known ones do not show it.  Half as large again is too much."""
    best, drifts = candidate(8), replace(candidate(8), simulation_bic=2.0 * np.log(1.51))
    unscored = replace(best, simulation_bic=-5.0, scores=HeldOutScores())
    kept = _that_simulate(scorer_of((best, drifts, unscored)), [best, drifts, unscored])
    assert kept == [best, unscored]
    near = replace(drifts, simulation_bic=2.0 * np.log(1.49))
    assert _that_simulate(scorer_of((best, near)), [best, near]) == [best, near]
    assert _that_simulate(scorer_of((unscored,)), [unscored]) == [unscored]


@pytest.mark.parametrize("p_value", [1e-6, 0.5])
def test_no_simple_model_takes_the_place_of_a_valid_one_under_feedback(monkeypatch, p_value):
    """There it simulates held-out samples better than the true one, which noise moves."""
    likeliest, simple = candidate(12, (0.1,) * 5), replace(candidate(1, evidence=40.0), order=1)
    feedback = SimpleNamespace(share=0.1, p_value=p_value)
    monkeypatch.setattr(structures, "feedback_test", lambda *_: feedback)
    monkeypatch.setattr(structures, "_misses_response", lambda *_: False)
    monkeypatch.setattr(structures, "gain_of_nothing", lambda *_: None)
    given = scorer_of((likeliest, simple)), [likeliest, simple], "simulation"
    found, _ = _for_simulation(*given, *_likely(*given))
    assert found is (likeliest if p_value < 0.001 else simple)


@pytest.mark.parametrize("check", [INDEPENDENT_OF_INPUT, INSIDE_BOUND])
def test_a_likely_model_is_not_taken_for_its_likelihood_where_that_says_little(check):
    """Of a root at the bound the largest likelihood is no inner one."""
    likeliest, best = candidate(12), candidate(8, evidence=40.0)
    given = (likeliest, best), "simulation", best, False
    assert _by_likelihood(scorer_of((likeliest, best)), *given)
    assert _by_likelihood(scorer_of((likeliest, best), of_all=(check,)), *given) is None


@pytest.mark.parametrize(
    ("effect", "failures", "is_taken"),
    [
        ((-0.05, -0.06, -0.05, -0.07, -0.06), 0, True),
        ((-0.05, -0.06, -0.05, -0.07, -0.06), 1, False),  # valid residuals are worth more
        ((-0.15, -0.16, -0.15, -0.17, -0.16), 1, True),
        ((-0.01, -0.012, -0.008, -0.011, -0.009), 0, False),  # in every fold, but by 1 %
        ((-0.4, 0.3, -0.5, 0.3, 0.2), 0, False),  # by chance
    ],
)
def test_one_of_the_simplest_that_is_clearly_better_takes_the_place_of_a_choice(
    effect, failures, is_taken
):
    chosen, simple = candidate(8), replace(candidate(60, effect), structure="impulse")
    found, sentence = never_behind(
        *([chosen, simple], "simulation", chosen, "It is likely."),
        lambda each: failures * (each is simple),
    )
    assert found is (simple if is_taken else chosen)
    assert ("one of the simplest models" in sentence) == is_taken


def test_one_of_the_simplest_without_scores_takes_the_place_of_none():
    chosen, simple = candidate(8), replace(candidate(1), scores=HeldOutScores())
    given = [chosen, simple], "simulation", chosen, "It is likely.", lambda _: 0
    with np.errstate(all="raise"):
        assert never_behind(*given) == (chosen, "It is likely.")


def test_the_simplest_are_gain_small_output_error_models_arx_and_regularised_responses():
    gain, *responses = (
        replace(candidate(n), structure=name)
        for name, n in (("fir", 1), ("impulse", 16), ("impulse", 32))
    )
    arx = [replace(candidate(n), structure="arx", bic=float(n)) for n in (4, 2)]
    candidates = [gain, *responses, *arx, candidate(1), candidate(2), candidate(3)]
    assert set(simplest(candidates)) == {gain, *responses, arx[1], *candidates[5:7]}


@pytest.mark.parametrize(
    ("effect", "is_taken"),
    [
        ((0.01,) * 5, True),  # behind by 1 %
        ((0.2, -0.1, 0.2, -0.1, 0.0), True),  # behind by chance
        ((0.06, 0.05, 0.07, 0.06, 0.05), False),
    ],
)
def test_a_regularised_response_stands_for_a_system_that_has_no_orders(effect, is_taken):
    chosen, response = candidate(8), replace(candidate(60, effect), structure="impulse")
    short = replace(candidate(16, (0.5,) * 5), structure="impulse")
    found, sentence = regularised_unless_worse(
        [chosen, response, short], "simulation", chosen, "It is likely."
    )
    assert found is (response if is_taken else chosen)
    assert ("points to a nonlinear system" in sentence) == is_taken
    assert sentence.endswith(f"not clearly worse than {chosen.name}.") == is_taken


@pytest.mark.parametrize("structure", ["impulse", "oe", "arx", "fir"])
def test_simple_models_but_a_gain_may_be_too_far_behind_for_scores(structure):
    for ratio, is_behind in ((2.1, True), (1.9, False)):
        loss = 2.0 * float(np.log(ratio))
        simple = replace(candidate(60), structure=structure, simulation_bic=loss)
        kept = [] if is_behind and structure != "fir" else [simple]
        assert not_far_behind(scorer_of([]), [simple], [candidate(8)]) == kept
    assert not_far_behind(scorer_of([]), [simple], []) == [simple]


def test_sizes_of_residuals_that_follow_the_input_are_what_a_linear_model_misses():
    u, e = np.random.default_rng(4).standard_normal((2, SAMPLES))
    for y, misses in ((u + e, False), (u + e * np.abs(np.diff(u, prepend=0.0)), True)):
        late = np.concatenate([np.zeros(1), y[:-1]])
        scorer = SimpleNamespace(stretches=[Segment(u, late)])
        assert _misses_response(scorer, candidate(1)) is misses


@pytest.mark.parametrize(
    ("gain", "follows", "is_response"),
    [
        (0.0, False, False),
        (0.0, True, True),
        (0.1, True, True),
        (0.1, False, False),
        (0.6, True, False),
    ],
    ids=["noise", "missed", "missed under weak feedback", "weak feedback", "strong feedback"],
)
def test_what_a_linear_model_misses_calls_for_a_regularised_response(gain, follows, is_response):
    r, noise = np.random.default_rng(4).standard_normal((2, 3000))
    u, e = np.zeros((2, 3000))
    for t in range(2, 3000):
        e[t] = noise[t] * (abs(u[t - 1] - u[t - 2]) if follows else 1.0)
        u[t] = r[t] + gain * e[t - 1]
    chosen, response = candidate(8), replace(candidate(60), structure="impulse", bic=1.0)
    scorer = scorer_of((chosen, response))
    scorer.settings = SimpleNamespace(objective="quadratic")
    scorer.stretches = [Segment(u, np.concatenate([[0.0], u[:-1]]) + e)]
    given = scorer, [chosen, response], "simulation"
    found, _ = _for_simulation(*given, *_likely(*given))
    assert found is (response if is_response else chosen)


def test_a_model_without_errors_of_simulation_is_compared_without_a_ratio():
    exact = replace(candidate(1), scores=HeldOutScores(0.0, 0.0, 0.0))
    noisy = replace(candidate(8), scores=HeldOutScores(0.0, 0.0, 1.0))
    assert _with_valid_noise([exact, candidate(4)]) == ([exact, candidate(4)], [])
    kept, (left_out,) = _with_valid_noise([exact, noisy])
    assert kept == [exact]
    assert [each.score for each in left_out.alternatives] == [np.inf]


def compared(monkeypatch, *models):
    """The comparison of models with scores and without, none of which are refined."""

    def with_own_scores(each):
        return each if each.is_scored else replace(each, scores=models[0].scores)

    scorer = scorer_of(models)
    scorer.known = scorer.on_all_samples = lambda each: each
    scorer.has_input, scorer.remember, scorer.with_scores = True, list, lambda each, _: list(each)
    scorer.likely = ()
    scorer.settings, scorer.with_own_scores = CommonSettings(), with_own_scores
    monkeypatch.setattr(structures, "refine_orders", lambda *_: [])
    monkeypatch.setattr(structures, "_with_noise", lambda *_: [])
    monkeypatch.setattr(structures, "gain_of_nothing", lambda *_: None)
    decision = structures.Decision("orders", "", (), "", "")
    searches = [StructureSearch(each.structure, (each,), decision) for each in models]
    return compare_structures(scorer, searches)


def test_the_model_for_modes_has_the_scores_that_revisions_compare(monkeypatch):
    of_modes = replace(candidate(9, evidence=-2.0), scores=HeldOutScores())
    choice = compared(monkeypatch, candidate(8), of_modes).choice("modes")
    assert (choice.candidate.parameters, choice.candidate.is_scored) == (9, True)


@pytest.mark.parametrize(("prediction", "is_left"), [(1.4, False), (1.6, True)])
def test_a_noise_model_that_makes_held_out_errors_half_as_large_again_is_refuted(
    monkeypatch, prediction, is_left
):
    """It has the lowest simulation errors and BIC; its errors one step ahead are larger."""
    sound, found = candidate(9), candidate(8, (-0.3,) * 5, evidence=-100.0)
    scores = replace(found.scores, prediction=prediction * found.scores.simulation)
    found = replace(found, structure="bj", scores=scores)
    comparison = compared(monkeypatch, sound, found)
    for purpose in ("simulation", "modes"):
        assert comparison.choice(purpose).candidate is (sound if is_left else found)
    said = [d for d in comparison.decisions if d.subject == "refuted noise models"]
    assert [[(a.name, a.score) for a in d.alternatives] for d in said] == (
        [[(found.name, pytest.approx(prediction))]] if is_left else []
    )


def test_the_best_plant_without_a_noise_model_is_tried_with_some():
    u, e = np.random.default_rng(3).standard_normal((2, 1000))
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.8], u) + lfilter([2.0], [1.0, -0.9], e)
    segments = (Segment(u, y),)
    scorer = Scorer(segments, decide_folds(segments), CommonSettings(), delays=(1,))
    plants = [scorer.candidate("oe", Orders(nb=(n,), nf=(n,), nk=(1,))) for n in (1, 2)]
    tried = structures._with_noise(scorer, plants)
    assert [each.orders.nc for each in tried] == [1, 2, 3, 4]
    assert {(each.structure, each.orders.nb, each.orders.nf) for each in tried} == {
        ("bj", (2,), (2,))
    }
    assert all(each.bic < plants[1].bic - 0.5 for each in tried)
    assert structures._with_noise(scorer, []) == []


def test_a_structure_whose_search_fails_leaves_those_of_its_job(monkeypatch):
    u, e = np.random.default_rng(0).standard_normal((2, 200))
    segments = (Segment(u, np.concatenate([[0.0], u[:-1]]) + 0.1 * e),)
    scorer = Scorer(segments, decide_folds(segments), CommonSettings(), delays=(1,))
    found = orders.search_structure(scorer, "fir", {})

    def fails(problem):
        def search(*_):
            raise problem

        monkeypatch.setattr(orders, "_by_states", search)
        return orders.search_structure(scorer, "ss", {})

    for problem in (np.linalg.LinAlgError("it did not converge"), NoModelError("no finite errors")):
        failed = fails(problem)
        assert failed.candidates == ()
        assert not failed.too_short
        assert str(problem) in failed.decision.sentence
        chosen = compare_structures(scorer, [found, failed]).choice("simulation")
        assert chosen.candidate.structure == "fir"
    with pytest.raises(InputError, match="mend it"):
        fails(InputError("orders.nx", "wrong", "mend it"))
    with pytest.raises(ValueError, match="shapes"):
        fails(ValueError("the shapes differ"))
