"""Remedies for failed checks of models of several channels, against known systems."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.automatic.searched_forms import SearchedForms, search_variant
from evopem.automatic.state_space_choice import ModelChoice
from evopem.automatic.state_space_remedies import act_on_checks
from evopem.automatic.variant_search import Variant
from evopem.config.constraints import Constraints
from evopem.config.settings import InputRanges, OrderRanges, SearchSettings
from evopem.signals.recording import Recording
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT, WHITE

INNOVATIONS = Variant("ss", "determinant")
ONE_MODE, TWO_MODES = (np.convolve([1.0, -1.5, 0.8], each) for each in ([1.0], [1.0, 0.2, 0.7]))


def recording(a=TWO_MODES, delay=1, samples=600, seed=2):
    """Two inputs and one output, the same delay of both, and 10 % noise that drives the poles."""
    generator = np.random.default_rng(seed)
    u, e = generator.standard_normal((samples, 2)), generator.standard_normal(samples)
    clean = lfilter(np.r_[np.zeros(delay), 1.0, 0.5], a, u[:, 0])
    clean += lfilter(np.r_[np.zeros(delay), -0.7], a, u[:, 1])
    noise = lfilter([1.0], a, e)
    y = clean + 0.1 * clean.std() / noise.std() * noise
    return Recording(u, y[:, None], 10.0, ("u1", "u2"), ("y",), ("",) * 2, ("",))


def forms(estimation, orders, delays=(1, 1), ranges=None, evaluations=20):
    settings = SearchSettings(objective="quadratic", evaluations=evaluations)
    search, models = search_variant(estimation, INNOVATIONS, delays, orders, settings)
    return SearchedForms(
        *(estimation, delays, (search,), lambda _, order: models.of_order(order)),
        *(settings, ranges or OrderRanges()),
    )


def choice(order):
    return ModelChoice("simulation", INNOVATIONS, order, "constant")


@pytest.fixture(scope="module")
def searched():
    return forms(recording(), (2, 4, 6))


def test_a_model_whose_checks_hold_is_left_alone(searched):
    found = act_on_checks(searched, choice(4))
    assert found.record.trials == found.record.failed == found.record.statements == ()
    assert found.record.choice == choice(4)
    assert found.model.model.order == 4


def test_an_order_that_is_too_small_is_raised(searched):
    found = act_on_checks(searched, choice(2))
    (trial,) = found.record.trials
    assert (trial.remedy, trial.taken, found.model.model.order) == ("larger order", True, 4)
    assert {WHITE, INDEPENDENT_OF_INPUT} == set(trial.check.split(" and "))
    poles = np.linalg.eigvals(found.model.model.A)
    assert np.allclose(np.sort_complex(poles), np.sort_complex(np.roots(TWO_MODES)), atol=0.03)
    assert "larger order was tried (1 in all), and ss, 4 states" in " ".join(
        found.record.statements
    )


def test_what_no_model_mends_stays_failed_and_is_said(searched):
    only = replace(searched.searches[0], orders=(2,), simulation=(20.0,))
    found = act_on_checks(replace(searched, searches=(only,)), choice(2))
    assert found.record.trials == ()
    assert set(found.record.failed) >= {WHITE}
    assert f"“{WHITE}” stays failed." in found.record.statements


def test_larger_errors_on_held_out_samples_are_no_remedy(searched):
    search = searched.searches[0]
    place = search.orders.index(2)
    scores = [100.0] * len(search.orders)
    scores[place] = 10.0
    worse = replace(searched, searches=(replace(search, simulation=tuple(scores)),))
    found = act_on_checks(worse, choice(2))
    assert [each.taken for each in found.record.trials] == [False]
    assert found.record.choice == choice(2)


def test_a_delay_that_is_too_long_is_found_in_the_residuals():
    late = forms(recording(ONE_MODE), (2, 3, 4), delays=(1, 3))
    found = act_on_checks(late, choice(2))
    assert found.record.trials[0].remedy == "earlier delays"
    assert found.record.trials[0].taken
    assert found.model.model.input_delays in ((), (0, 0))
    assert found.record.failed == ()


def test_delays_of_the_configuration_stay():
    ranges = OrderRanges(nk=InputRanges((3, 3)))
    late = forms(recording(ONE_MODE), (2,), delays=(3, 3), ranges=ranges)
    found = act_on_checks(late, choice(2))
    assert "earlier delays" not in [each.remedy for each in found.record.trials]


@pytest.mark.parametrize("quick", [False, True])
def test_a_chosen_model_meets_constraints(searched, quick):
    limits = Constraints(static_gain={"u1": 4.0})
    constrained = replace(searched, constraints=limits)
    found = (constrained.as_searched if quick else constrained.searched)(choice(4))
    gains = found.model.frequency_response(0.0)[0].real
    assert gains[0] == pytest.approx(4.0)
    assert found.estimate.constraints.active == ("static_gain",)
