"""The automatic recipe as a whole, against known truths."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from records import error_percent, output_error_record
from scipy.signal import lfilter

import evopem
from evopem.automatic import candidates, structures
from evopem.automatic.candidates import Candidate, OrderLimits, Scorer, StructureSearch
from evopem.automatic.cross_validation.folds import (
    FoldPlan,
    HeldOutScores,
    decide_folds,
    decide_repetition,
)
from evopem.automatic.cross_validation.simulation import simulated
from evopem.automatic.decision import Decision
from evopem.automatic.fit import CommonSettings
from evopem.automatic.orders import refine_orders, search_structure
from evopem.automatic.structures import compare_structures
from evopem.config.settings import OrderRanges
from evopem.errors import NoModelError
from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load
from evopem.models.orders import Orders
from evopem.models.polynomial import model_of
from evopem.notebook.estimate import estimate
from evopem.pipeline import complete_model
from evopem.signals.recording import Segment

SAMPLES = 120
ABOUT = Decision("folds", "given", (), "none", "They are given.")


def test_the_model_simulates_unseen_samples_as_well_as_the_true_structure_does():
    """In the geometric mean of five records: which models come close to the truth is chance."""
    ratios = []
    for seed in range(3, 8):
        u, y, truth = output_error_record(300, seed=seed)
        given, held_out = slice(SAMPLES), slice(SAMPLES, None)
        before = u.copy(), y.copy()
        parts = [(u[each] + 4.0, y[each] + 9.0) for each in (given, held_out)]
        found = evopem.identify(*parts[0], 10.0, validation=parts[1], show_progress=False)
        assert np.array_equal((u, y), before)
        orders = {"nb": 2, "nf": 2, "nk": 1}
        oracle = estimate(u[given], y[given], orders, structure="oe", sampling_rate=10.0)
        errors = [
            np.std((truth - np.ravel(m.simulate(u)))[held_out]) for m in (found.model, oracle.model)
        ]
        ratios.append(errors[0] / errors[1])
    assert np.exp(np.mean(np.log(ratios))) < 1.2
    assert len({each.subject for each in found.decisions}) == len(found.decisions)
    assert all(each.sentence.endswith(".") for each in found.decisions)


def test_a_model_of_another_purpose_that_is_not_found_ends_no_identification(monkeypatch):
    estimate_choice, purposes = complete_model.estimate_choice, []

    def unstable(choice, *given):
        purposes.append(choice.purpose)
        if choice.purpose == "prediction":
            raise NoModelError("the descent found no stable model")
        return estimate_choice(choice, *given)

    monkeypatch.setattr(complete_model, "estimate_choice", unstable)
    u, y, _ = output_error_record(200, seed=12)
    found = evopem.identify(u, y, 10.0, structure="oe", show_progress=False)
    other = load(ModelRecord, found.files.other_model("prediction"))
    assert purposes == ["simulation", "prediction", "modes"]
    assert other.text == found.results.model.text


def test_a_chirp_gets_interleaved_folds():
    t = np.arange(1000.0)
    u = np.sin(0.02 * t + 0.0007 * t**2)
    plan = decide_folds([Segment(u, lfilter([0.0, 1.0], [1.0, -0.5], u))])
    assert all(blocks > 1 for _, blocks in plan.designs)


def test_feedback_does_not_lead_to_an_output_error_model():
    generator = np.random.default_rng(8)
    n = 600
    reference, e = np.repeat(generator.choice([-1.0, 1.0], n // 8), 8), generator.standard_normal(n)
    noise = lfilter([1.0, 0.4], [1.0, -1.7, 0.8], 0.3 * e)
    u, x = np.zeros(n), np.zeros(n)
    for t in range(2, n):
        x[t] = 1.7 * x[t - 1] - 0.8 * x[t - 2] + 0.3 * u[t - 1] + 0.2 * u[t - 2]
        u[t] = reference[t] - 0.3 * (x[t] + noise[t])
    stretches = [Segment(u, x + noise)]
    plan = FoldPlan(((2, 1),), ABOUT, decide_repetition(stretches))
    scorer = Scorer(stretches, plan, CommonSettings())
    searches = [
        StructureSearch(structure, tuple(scorer.candidate(structure, o) for o in orders), ABOUT)
        for structure, orders in (
            ("armax", [Orders(na=n, nb=n, nc=n, nk=1) for n in (1, 2, 3)]),
            ("oe", [Orders(nb=n, nf=n, nk=1) for n in (1, 2, 3, 6)]),
        )
    ]
    chosen = compare_structures(scorer, searches).choice("simulation").candidate
    assert chosen.structure == "armax"
    assert error_percent(x, simulated(chosen.model, Segment(u, x), fitted_level=True)[:, 0]) < 25.0


def test_a_regularised_response_takes_the_place_of_a_worse_choice():
    """A response of forty random decaying coefficients, which no small model has."""
    generator = np.random.default_rng(1)
    b = generator.standard_normal(40) * np.exp(-np.arange(40) / 8.0)
    u, e = generator.standard_normal((2, 300))
    y = lfilter(np.r_[0.0, b], [1.0], u)
    stretches = [Segment(u, y + 0.5 * y.std() * e)]
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings(), delays=(1,))
    searches = [search_structure(scorer, each, {}) for each in ("fir", "impulse", "arx", "oe")]
    compared = compare_structures(scorer, searches)
    chosen = compared.choice("simulation").candidate
    assert chosen.structure == "impulse"
    (decision,) = (d for d in compared.decisions if d.subject == "structure for simulation")
    assert "one of the simplest models" in decision.sentence
    others = compare_structures(scorer, [searches[0], *searches[2:]]).choice("simulation")
    errors = [
        np.linalg.norm(each.model.impulse_response(60)[1:41, 0, 0] - b)
        for each in (chosen, others.candidate)
    ]
    assert errors[0] < 0.9 * errors[1]


def test_coloured_noise_of_a_finite_response_needs_no_poles_of_the_plant():
    """Four coefficients, which ARX models lose in many; orders that are given have poles."""
    u, e = np.random.default_rng(0).standard_normal((2, 600))
    y = lfilter([0.0, 1.0, 0.5, -0.3, 0.2], [1.0], u) + 0.3 * lfilter([1.0, 0.6], [1.0], e)
    stretches = [Segment(u, y)]
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings(), delays=(1,))
    searches = [search_structure(scorer, each, {}) for each in ("fir", "arx", "armax", "bj")]
    chosen = compare_structures(scorer, searches).choice("simulation").candidate
    assert (chosen.orders.nb, chosen.orders.nf, chosen.orders.na) == ((4,), (0,), 0)
    given = OrderLimits(ranges=OrderRanges(plant=(1, 3)))
    limited = Scorer(stretches, decide_folds(stretches), CommonSettings(), given, (1,))
    assert all(c.orders.nf > (0,) for c in search_structure(limited, "bj", {}).candidates)


def test_results_of_a_regularised_response_claim_no_order_noise_model_or_search(tmp_path):
    u, y, _ = output_error_record(400, percent=10.0)
    found = evopem.identify(u, y + 3.0, 10.0, structure="impulse", show_progress=False)
    assert found.model.structure == "impulse"
    assert found.verdict.startswith("Good for simulation from the input")
    assert "not for modes" in found.verdict
    judged = {each.name: each for each in found.checks}
    assert not {"Search repeatable", "Orders inside their search ranges"} & set(judged)
    assert "claim nothing of the noise" in judged["White residuals"].statement
    assert "Excitation adequate" not in judged
    loaded = evopem.load(found.save(tmp_path / "saved") / "model.json")
    assert np.array_equal(loaded.covariance.factor, found.model.covariance.factor)
    assert np.array_equal(loaded.simulate(u), found.model.simulate(u))


def test_candidates_far_behind_are_not_scored_on_held_out_samples():
    u, y, _ = output_error_record(400)
    stretches = [Segment(u, y)]
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings(), delays=(1,))
    searches = [search_structure(scorer, each, {}) for each in ("fir", "arx", "oe")]
    assert not any(each.is_scored for search in searches for each in search.candidates)
    tried = [each for search in searches for each in search.candidates]
    known = scorer.with_scores(tried)
    scored = [each for each in known if each.is_scored]
    assert len(scored) < len(known) / 2
    everything = map(scorer.scored, tried)
    lowest = min(each.scores.simulation for each in everything)
    assert min(each.scores.simulation for each in scored) < 1.02 * lowest


@pytest.mark.parametrize(
    ("structure", "lowest", "lowest_simulation", "last"),
    [
        ("oe", 40, 3, 5),  # undamped poles draw drifts
        ("oe", 3, 40, 5),
        ("oe", 4, 4, 6),
        ("armax", 20, 3, 20),
        ("armax", 8, 8, 12),  # whose steps are large from ten poles on
        ("armax", 5, 5, 8),
    ],
)
def test_a_path_ends_where_no_order_brings_something(structure, lowest, lowest_simulation, last):
    calls = []

    def of_orders(structure, orders, starts, own_starts, scored):
        calls.append((orders, starts, own_starts))
        n = orders.poles
        scores = [abs(n - best) - 0.01 * n for best in (lowest, lowest_simulation)]
        model = model_of(orders, np.zeros(orders.parameters))
        return Candidate(structure, n, (1,), n, *scores, HeldOutScores(), model)

    scorer = SimpleNamespace(
        candidate=of_orders, limits=OrderLimits(), delays=(1,), early=(), samples=1
    )
    scorer.plan = SimpleNamespace(late_response=0)
    found = search_structure(scorer, structure, {})
    assert found.orders[-1] == last
    scorer.delays, scorer.limits = (1, 1), OrderLimits(names=("u", "v"))
    assert search_structure(scorer, structure, {}).orders[-1] > last or last > 10
    del calls[len(found.candidates) :]
    # The first output-error model of a step is all that the second, of which it is a case, needs.
    for orders, starts, own_starts in calls:
        nested = [s for s in starts if s.orders.poles == orders.poles]
        assert own_starts == (not nested) == (orders.nk == (1,))


def test_a_candidate_that_is_scored_late_stands_once_among_the_others(monkeypatch):
    monkeypatch.setattr(candidates, "SCORED_IN_VAIN", 1)
    u, y, _ = output_error_record(300)
    stretches = [Segment(u, y)]
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings(), delays=(1,))
    tried = [Orders(nb=n, nf=n, nk=1) for n in (1, 2, 3, 4, 5)]
    found = tuple(scorer.candidate("oe", orders, scored=False) for orders in tried)
    refined = Mock(side_effect=lambda *_: list(map(scorer.with_own_scores, found)))
    monkeypatch.setattr(structures, "refine_orders", refined)
    compared = compare_structures(scorer, [StructureSearch("oe", found, ABOUT)]).candidates
    names = [each.name for each in compared]
    assert len(set(names)) == len(names)
    assert set(names) >= {each.name for each in found}


@pytest.mark.parametrize(("likelier", "tried"), [(0.0, 4), (1.0, 2)])
def test_states_end_where_polynomials_of_the_same_systems_are_far_likelier(likelier, tried):
    u, y, _ = output_error_record(300)
    stretches, limits = [Segment(u, y)], OrderLimits(ranges=OrderRanges(nx=(1, 4)))
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings(), limits, delays=(1,))
    of_orders = [Orders(na=n, nb=n, nc=n, nk=1) for n in (1, 2, 3, 4)]
    known = (scorer.candidate("armax", orders, scored=False) for orders in of_orders)
    armax = StructureSearch("armax", tuple(replace(c, bic=c.bic - likelier) for c in known), ABOUT)
    assert len(search_structure(scorer, "ss", {"armax": armax}).orders) == tried


@pytest.mark.parametrize("seed", range(2))
def test_orders_of_the_noise_are_refined_by_likelihood(seed):
    """Simulation errors, which are those of the noise, do not tell them."""
    u, e = np.random.default_rng(seed).standard_normal((2, 500))
    y = lfilter([0.0, 1.0], [1.0, -0.8], u) + 0.3 * lfilter([1.0, 0.5], [1.0, -0.9], e)
    stretches = [Segment(u, y)]
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings(), delays=(1,))
    searches = [search_structure(scorer, each, {}) for each in ("oe", "bj")]
    chosen = compare_structures(scorer, searches).choice("simulation").candidate
    assert chosen.orders == Orders(nb=1, nc=1, nd=1, nf=1, nk=1)


def test_the_length_of_a_finite_response_beside_a_noise_model_is_refined():
    u, e = np.random.default_rng(1).standard_normal((2, 400))
    y = lfilter([0.0, 1.0, -0.7, 0.5], [1.0], u) + 0.3 * lfilter([1.0, 0.8], [1.0], e)
    stretches = [Segment(u, y)]
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings(), delays=(1,))
    start = scorer.candidate("bj", Orders(nb=4, nc=2, nk=1), scored=False)
    refined = min(refine_orders(scorer, start, candidates.BIC), key=candidates.BIC)
    assert refined.structure == "bj"
    assert refined.orders == Orders(nb=3, nc=1, nk=1)


def test_a_plant_is_estimated_again_from_a_likelier_model_with_noise():
    """Its own search may have ended at another optimum."""
    u, y, _ = output_error_record(300)
    stretches, orders = [Segment(u, y)], Orders(nb=2, nf=2, nk=1)
    known, scorer = (
        Scorer(stretches, decide_folds(stretches), CommonSettings(), delays=(1,)) for _ in range(2)
    )
    plant = known.candidate("oe", orders, scored=False)
    scorer.remember([replace(plant, bic=plant.bic + 1.0)])
    with_noise = scorer.candidate("bj", Orders(nb=2, nd=1, nf=2, nk=1), scored=False)
    refine_orders(scorer, with_noise, candidates.BIC)
    assert scorer.candidate("oe", orders).bic == pytest.approx(plant.bic, abs=1e-6)


def test_folds_that_a_model_does_not_lead_to_are_estimated_anew(monkeypatch):
    u, y, _ = output_error_record(300)
    stretches = [Segment(u, y)]
    limits = OrderLimits(ranges=OrderRanges(nx=(2, 2)))
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings(), limits, (1,))
    (found,) = search_structure(scorer, "ss", {}).candidates
    expected = scorer.scored(found).scores.simulation
    monkeypatch.setattr(candidates, "refit", Mock(side_effect=NoModelError("it is unstable")))
    assert scorer.scored(found).scores.simulation == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(
    ("noise", "given", "is_searched"), [(0.0, None, False), (0.9, None, True), (0.0, (1, 2), True)]
)
def test_states_are_searched_where_polynomials_leave_something(noise, given, is_searched):
    """Residuals that are coloured, of polynomials without a noise model; or what is asked for."""
    u, e = np.random.default_rng(0).standard_normal((2, 400))
    y = lfilter([0.0, 1.0], [1.0, -0.8], u) + 0.1 * lfilter([1.0], [1.0, -noise], e)
    limits = OrderLimits(ranges=OrderRanges(nx=given))
    scorer = Scorer([Segment(u, y)], decide_folds([Segment(u, y)]), CommonSettings(), limits, (1,))
    search = search_structure(scorer, "ss", {"oe": search_structure(scorer, "oe", {})})
    assert bool(search.candidates) == is_searched
    assert is_searched == ("fails no check" not in search.decision.sentence)
    assert not search.too_short


def test_state_space_competes_with_polynomials_by_the_same_scores():
    u, y, _ = output_error_record(800)
    stretches = [Segment(u, y)]
    limits = OrderLimits(ranges=OrderRanges(nx=(1, 3), plant=(1, 3)))
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings(), limits, (1,))
    searches = [search_structure(scorer, each, {}) for each in ("armax", "ss")]
    # Two states of innovations form are an ARMAX model with as many roots of A, B and C.
    armax, ss = (next(c for c in search.candidates if c.order == 2) for search in searches)
    assert ss.parameters == armax.parameters
    assert ss.bic == pytest.approx(armax.bic, abs=0.01)
    # Both leave the noise, 20 % of the noise-free output, on samples that neither has seen.
    for each in scorer.with_scores([armax, ss]):
        assert each.scores.simulation == pytest.approx(20.0, rel=0.1)
        assert each.scores.prediction == pytest.approx(20.0, rel=0.1)
    comparison = compare_structures(scorer, searches)
    assert comparison.choice("modes").candidate.structure in ("armax", "ss")
    (about,) = (each for each in comparison.decisions if each.subject == "structure for modes")
    assert {each.name.split()[0].strip(",") for each in about.alternatives} == {"armax", "ss"}


def test_a_finite_response_has_no_modes_of_likelier_models():
    """A few poles are fewer coefficients than ten taps, which the BIC rewards."""
    generator = np.random.default_rng(26)
    u = lfilter([1.0], [1.0, -0.5], generator.standard_normal(445))
    taps = generator.standard_normal(10) * np.exp(-0.2 * np.arange(10))
    response = lfilter([0.0, *taps], [1.0], u)
    y = response + response.std() * generator.standard_normal(445)
    found = evopem.identify(u, y, 100.0, show_progress=False)
    assert found.summary.orders.structure == "fir"
    assert found.modes.empty
