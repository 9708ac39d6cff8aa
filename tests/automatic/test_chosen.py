"""The global search of the chosen model, and what held-out samples say of it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from records import output_error_record
from scipy.signal import lfilter

from evopem.automatic import chosen_model
from evopem.automatic.candidates import Scorer, StructureSearch
from evopem.automatic.cross_validation.folds import decide_folds
from evopem.automatic.cross_validation.simulation import prediction_errors, simulated
from evopem.automatic.decision import Decision
from evopem.automatic.fit import CommonSettings, Fit, fits_in_state_space
from evopem.automatic.orders import order_models
from evopem.automatic.preparation.plan import PreparationPlan, PreparedRecord
from evopem.automatic.structures import Choice
from evopem.config.settings import SearchSettings
from evopem.errors import LostModelError, NoModelError
from evopem.files.json_form import from_json, to_json
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording, Segment


@pytest.fixture(scope="module")
def candidate():
    u, y, _ = output_error_record(400)
    recording = Recording(u, 5.0 * y, 10.0)
    record = PreparedRecord.of(recording, PreparationPlan((0,)))
    scorer = Scorer(record.stretches, decide_folds(record.stretches), CommonSettings())
    found = scorer.candidate("oe", Orders(nb=2, nf=2, nk=1))
    return recording, record, scorer, Choice("simulation", found, "constant")


def test_finite_responses_have_no_models_whose_modes_are_compared_by_order(candidate):
    recording, record, scorer, choice = candidate
    fir = scorer.candidate("fir", Orders(nb=40, nk=1), scored=False)
    found = StructureSearch("any", (fir, choice.candidate), Decision("any", "", (), "", ""))
    (model,) = order_models(found, record, recording).models
    assert model.order == 2


# Held-out errors over those of the compared model, and the deviation of the folds.
@pytest.mark.parametrize(
    ("worse", "spread", "at_bound", "taken"),
    [
        (1.0, 0.0, False, True),
        (1.3, 0.0, False, False),
        (1.08, 0.1, False, True),
        (1.3, 0.3, False, False),
        (0.9, 0.0, True, False),
    ],
    ids=["as good", "worse", "worse by chance", "worse, of folds that differ much", "at the bound"],
)
def test_a_searched_model_that_simulates_worse_is_left(
    candidate, monkeypatch, worse, spread, at_bound, taken
):
    recording, record, scorer, choice = candidate
    compared = chosen_model.estimate_candidate(
        replace(choice.candidate, model=record.in_its_units(choice.candidate.model)),
        *(recording, scorer, SearchSettings(evaluations=0)),
    )
    estimate = compared.estimate
    found_lower = replace(estimate.search, value=0.9 * estimate.search.value)
    lower = replace(estimate, search=found_lower, at_stability_bound=at_bound)
    searched = replace(compared, estimate=lower)
    monkeypatch.setattr(
        *(chosen_model, "estimate_candidate"),
        lambda *given, **_: compared if given[3].evaluations == 0 else searched,
    )

    def scored(self, candidate):
        known = choice.candidate.scores
        folds = tuple(
            each + np.log(worse) + spread * (-1) ** k
            for k, each in enumerate(known.simulation_folds)
        )
        scores = replace(known, simulation=worse * known.simulation, simulation_folds=folds)
        return replace(candidate, scores=scores)

    monkeypatch.setattr(Scorer, "scored", scored)
    found, about = chosen_model.estimate_choice(
        *(choice, scorer, record, recording, SearchSettings(evaluations=100))
    )
    assert (found is searched) == taken
    assert about.choice == (chosen_model.SEARCHED if taken else chosen_model.COMPARED)
    assert about.sentence.endswith("the compared model is kept.") != taken


def test_modes_of_outputs_alone_may_lie_at_the_bound(candidate):
    """They are not simulated, whose error was said to be infinite."""
    *_, choice = candidate
    alone = replace(choice.candidate, scores=replace(choice.candidate.scores, simulation=np.inf))
    compared = SimpleNamespace(
        estimate=SimpleNamespace(at_stability_bound=False, search=SimpleNamespace(value=2.0))
    )
    searched = SimpleNamespace(
        estimate=SimpleNamespace(at_stability_bound=True, search=SimpleNamespace(value=1.0))
    )
    modes = Choice("modes", alone, "constant")
    about = chosen_model._about_search(modes, searched, compared, alone)
    assert about.choice == chosen_model.SEARCHED
    assert "predicted one step ahead with" in about.sentence
    assert "inf" not in about.sentence


def test_the_searched_model_is_taken_where_no_descent_leads_from_the_compared_one(
    candidate, monkeypatch
):
    recording, record, scorer, choice = candidate
    estimate_candidate = chosen_model.estimate_candidate

    def of_searches_alone(*given, **options):
        if given[3].evaluations == 0:
            raise NoModelError("the descent found no stable model")
        return estimate_candidate(*given, **options)

    monkeypatch.setattr(chosen_model, "estimate_candidate", of_searches_alone)
    found, about = chosen_model.estimate_choice(
        *(choice, scorer, record, recording, SearchSettings(evaluations=2000))
    )
    assert about.choice == chosen_model.SEARCHED
    assert found.model.poles() == pytest.approx(np.roots([1.0, -1.5, 0.8]), abs=0.05)


def test_an_estimate_that_is_compared_has_its_minimum_alone(candidate):
    recording, record, scorer, _ = candidate
    settings = CommonSettings()
    ((_, fitted),) = fits_in_state_space(record.stretches, "ss_oe", (2,), (1,), settings)
    assert fitted.model.covariance is None
    described = replace(scorer.described("ss_oe", fitted, 2), delays=(1,))
    of_recording = replace(described, model=record.in_its_units(described.model))
    given = of_recording, recording, scorer, SearchSettings(evaluations=0)
    whole = chosen_model.estimate_candidate(*given)
    bare = chosen_model.estimate_candidate(*given, bare=True)
    assert bare.estimate.search.value == whole.estimate.search.value
    assert bare.model.covariance is None is not whole.model.covariance


def test_the_search_begins_with_the_candidate_in_the_units_of_the_recording(candidate):
    recording, record, scorer, choice = candidate
    found, about = chosen_model.estimate_choice(
        *(choice, scorer, record, recording, SearchSettings(evaluations=200))
    )
    assert about.choice == chosen_model.SEARCHED
    assert found.model.F[0] == pytest.approx([1.0, -1.5, 0.8], abs=0.05)
    assert found.model.B[0] == pytest.approx([5.0, 2.5], rel=0.2)


def test_an_optimum_that_rounding_spoils_is_left_for_the_compared_model(candidate, monkeypatch):
    recording, record, scorer, choice = candidate
    describe, given = chosen_model.describe, []

    def spoiled(errors, result, *rate, **shortest):
        given.append(result)
        if len(given) == 1:
            raise LostModelError("search", "its errors are lost in rounding", "lower the orders")
        return describe(errors, result, *rate, **shortest)

    monkeypatch.setattr(chosen_model, "describe", spoiled)
    search = SearchSettings(evaluations=0)
    found, _ = chosen_model.estimate_choice(choice, scorer, record, recording, search)
    compared = record.in_its_units(choice.candidate.model)
    np.testing.assert_allclose(found.model.F[0], compared.F[0], rtol=1e-12)
    np.testing.assert_allclose(found.model.B[0], compared.B[0], rtol=1e-2)


def test_plant_and_noise_are_searched_together_where_rounding_spoils_the_plant_alone(
    candidate, monkeypatch
):
    recording, record, scorer, choice = candidate
    plant = choice.candidate.model
    model = replace(plant, C=np.array([1.0, 0.1]), D=np.array([1.0, -0.1]), structure="bj")
    with_noise = replace(choice, candidate=replace(choice.candidate, structure="bj", model=model))
    estimate_candidate = chosen_model.estimate_candidate

    def of_both_alone(asked, *given, **options):
        if asked.structure == "oe":
            raise LostModelError("search", "its errors are lost in rounding", "lower the orders")
        return estimate_candidate(asked, *given, **options)

    monkeypatch.setattr(chosen_model, "estimate_candidate", of_both_alone)
    found, _ = chosen_model.estimate_choice(
        *(with_noise, scorer, record, recording, SearchSettings(evaluations=200)), plant_kept=True
    )
    assert found.model.orders == model.orders
    assert found.model.F[0] == pytest.approx([1.0, -1.5, 0.8], abs=0.05)


@pytest.mark.parametrize(("spoiled", "given"), [(2, 1e-7), (9, 0.01)])
def test_a_pole_that_rounding_puts_beyond_the_bound_moves_the_bound_in(
    candidate, monkeypatch, spoiled, given
):
    """It stays above 0.5: with it a model is returned, and checks say that it is unstable."""
    recording, _, scorer, choice = candidate
    refit, bounds = chosen_model.refitted_estimate, []

    def rounded(model, data, settings):
        bounds.append(settings.max_root_radius)
        estimate = refit(model, data, settings)
        outside = replace(estimate.model, F=(np.poly([1.0 + 1e-8, 0.5]),))
        return replace(estimate, model=outside) if len(bounds) <= spoiled else estimate

    monkeypatch.setattr(chosen_model, "refitted_estimate", rounded)
    search = SearchSettings(evaluations=0, max_root_radius=1.0 - given)
    found = chosen_model.estimate_candidate(choice.candidate, recording, scorer, search)
    expected = [1e-7, 1e-6, 1e-5] if spoiled == 2 else [0.01, 0.1]
    np.testing.assert_allclose(1.0 - np.array(bounds), expected, rtol=1e-6)
    assert found.largest_radius == bounds[-1]  # what a check compares the roots with
    assert (np.abs(found.model.poles()).max() < 1.0) == (spoiled == 2)


def test_a_bound_that_no_descent_begins_inside_is_not_stated(candidate, monkeypatch):
    recording, _, scorer, choice = candidate
    refit, search = chosen_model.refitted_estimate, SearchSettings(max_root_radius=0.99)

    def rounded(model, data, settings):
        if settings.max_root_radius < search.max_root_radius:
            raise NoModelError("no start is inside")
        estimate = refit(model, data, settings)
        return replace(estimate, model=replace(estimate.model, F=(np.poly([1.0 + 1e-8, 0.5]),)))

    monkeypatch.setattr(chosen_model, "refitted_estimate", rounded)
    search = replace(search, evaluations=0)
    found = chosen_model.estimate_candidate(choice.candidate, recording, scorer, search)
    assert found.largest_radius == 0.99


def test_a_model_from_which_no_descent_begins_further_inside_is_kept(candidate, monkeypatch):
    recording, _, scorer, choice = candidate
    refit, bounds = chosen_model.refitted_estimate, []

    def rounded(model, data, settings):
        bounds.append(settings.max_root_radius)
        if len(bounds) == 2:
            raise NoModelError("no start has finite errors")
        estimate = refit(model, data, settings)
        outside = replace(estimate.model, F=(np.poly([1.0 + 1e-8, 0.5]),))
        return replace(estimate, model=outside)

    monkeypatch.setattr(chosen_model, "refitted_estimate", rounded)
    search = SearchSettings(evaluations=0, max_root_radius=1.0 - 1e-7)
    found = chosen_model.estimate_candidate(choice.candidate, recording, scorer, search)
    assert len(bounds) == 2
    assert np.abs(found.model.poles()).max() > 1.0


def test_an_undamped_pole_gains_nothing_by_the_state_it_begins_with():
    """A pole that a zero cancels, and whose state draws the slow wave of a drift."""
    generator = np.random.default_rng(1)
    u, e = generator.standard_normal((2, 600))
    one = np.ones(1)
    truth = PolynomialModel(one, np.array([1.0, 0.5]), one, one, np.array([1.0, -1.5, 0.8]), 1)
    y = truth.simulate(u) + 2.0 * np.sin(2.0 * np.pi * np.arange(600) / 500.0 + 0.5) + 0.1 * e
    wave = np.array([1.0, -2.0 * np.cos(2.0 * np.pi / 500.0), 1.0])
    larger = replace(truth, B=(np.convolve(truth.B[0], wave),), F=(np.convolve(truth.F[0], wave),))
    stretches = [Segment(u, y)]
    errors = [np.std(y - simulated(m, stretches[0], True)[:, 0]) for m in (truth, larger)]
    assert errors[1] < 0.2 * errors[0]
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings())
    bics = [
        scorer.described("oe", Fit(m, 5, (lfilter([1.0], [1.0], e)[:, None],), 0)).simulation_bic
        for m in (truth, larger)
    ]
    assert bics[1] > bics[0] - 0.1


def test_a_slow_state_of_the_predictor_gains_nothing_by_what_it_is_fitted_to():
    """C with a root at 0.9999: fitted to all samples its state draws a level through the noise."""
    generator = np.random.default_rng(2)
    u, e = generator.standard_normal((2, 400))
    one = np.ones(1)
    truth = PolynomialModel(np.array([1.0, -0.8]), one, one, one, one, 1)
    y = lfilter([0.0, 1.0], truth.A, u) + lfilter([1.0], truth.A, e)
    slow = replace(truth, A=np.convolve(truth.A, [1.0, -0.99]), C=np.array([1.0, -0.9999]))
    slow = replace(slow, B=(np.convolve(truth.B[0], [1.0, -0.99]),))
    before, held_out = Segment(u[:200], y[:200]), Segment(u[200:], y[200:] + 3.0)

    def size(past):
        return np.sqrt(np.mean(prediction_errors(slow, held_out, past) ** 2))

    assert size(before) > 1.3 * size(None)
    assert len(prediction_errors(truth, held_out, before)) == 200
    assert len(prediction_errors(truth, held_out, held_out.between(0, 0))) == 180


def test_prediction_errors_do_not_contain_what_inputs_before_the_record_do():
    generator = np.random.default_rng(3)
    u, e = generator.standard_normal(600), 0.01 * generator.standard_normal(600)
    one = np.ones(1)
    truth = PolynomialModel(np.array([1.0, -1.5, 0.9]), one, one, one, one, 20)
    y = lfilter([1.0], truth.A, np.concatenate([np.zeros(20), u[:-20]]) + e)
    assert np.abs(prediction_errors(truth, Segment(u[200:], y[200:]))).max() < 0.05


def test_a_choice_has_a_json_form(candidate):
    choice = candidate[3]
    again = from_json(Choice, to_json(choice))
    assert again.candidate.orders == choice.candidate.orders
    assert np.array_equal(again.candidate.model.parameters, choice.candidate.model.parameters)


def test_models_go_to_the_units_of_a_recording_and_back(candidate):
    _, record, _, choice = candidate
    back = replace(record, scales=tuple(1.0 / each for each in record.scales))
    once = record.in_its_units(choice.candidate.model)
    assert not np.allclose(once.B[0], choice.candidate.model.B[0])
    np.testing.assert_array_equal(back.in_its_units(once).B[0], choice.candidate.model.B[0])
