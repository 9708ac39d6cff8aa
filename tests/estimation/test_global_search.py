"""The search of identification: certificates, and basin hopping."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from simulated_records import polynomial_record

from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.prediction_errors import prediction_errors, scaled_errors
from evopem.estimation.search.certificate import (
    AGREEING,
    ONE_OPTIMUM,
    POLYNOMIALS,
    STATE_SPACE,
    enough_agree,
    has_agreed,
    is_certified,
)
from evopem.estimation.search.global_search import (
    BATCH,
    BATCHES,
    _Search,
    basin_hopping,
    global_search,
)
from evopem.estimation.search.memetic import memetic_search
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import descended, pooled, same_optimum
from evopem.estimation.search.section_replacement import supports_sections
from evopem.models.orders import Orders, armax_orders, orders_of
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording
from evopem.synthesis import armax


def problem(orders, samples=600, objective="quadratic"):
    record = armax(seed=3, samples=samples)[0]
    return PolynomialProblem(
        PolynomialErrors(
            *(record.segments, armax_orders(*orders), objective, 0.9999, 0.9999, False),
            ScoringWindow(20, 40),
        )
    )


def problem_of(structure, orders, record=None, objective="quadratic"):
    record = record or armax(seed=2, samples=500)[0]
    settings = SearchSettings(objective=objective)
    of_structure = orders_of(structure, orders)
    window = ScoringWindow(of_structure.first_residual, of_structure.first_residual)
    errors = prediction_errors(record, of_structure, settings, window, False)
    return PolynomialProblem(scaled_errors(errors)[0])


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
def test_where_all_random_points_lead_to_one_optimum_the_search_is_over(objective):
    found = global_search(
        problem((7, 6, 7, 3), 4500, objective), SearchSettings(), np.random.default_rng(1)
    ).diagnostics
    assert (found.n_restarts, found.n_multistart) == (BATCHES, BATCHES * BATCH)
    assert found.generations == 0
    assert is_certified(found)


def test_a_lower_value_known_from_before_keeps_the_search_going():
    settings = SearchSettings(evaluations=8000)
    alone = global_search(problem((4, 4, 4, 3), 2000), settings, np.random.default_rng(1))
    told = global_search(
        problem((4, 4, 4, 3), 2000), settings, np.random.default_rng(1), known_minimum=0.0
    )
    assert told.diagnostics.evaluations >= settings.evaluations
    assert told.value <= alone.value


def test_a_spent_search_is_certified_where_its_few_restarts_agree_and_the_edge_is_no_lower():
    searched, steps = problem_of("bj", (4, 2, 2, 4, 3)), []
    found = global_search(searched, SearchSettings(), np.random.default_rng(1), steps.append)
    diagnostics = found.diagnostics
    assert diagnostics.n_confirming + 1 == diagnostics.n_restarts < AGREEING
    assert diagnostics.undiscovered_probability > ONE_OPTIMUM
    assert is_certified(diagnostics)
    assert steps[-1].startswith("roots of C at the edge")
    # Agreement that no replacement and no descent from the edge has contested is none.
    assert not is_certified(replace(diagnostics, withstood=False))
    assert is_certified(pooled(descended(searched, found.point), found).diagnostics)


@pytest.mark.parametrize("seed", [0, 3])
def test_few_restarts_that_agree_on_sections_that_the_record_does_not_support_are_no_certificate(
    seed,
):
    """All random points lead to one optimum, or the evaluations are spent."""
    innovations = np.random.default_rng(seed).standard_normal(600)
    output = lfilter([1.0, 0.5], [1.0, -1.5, 0.7], innovations)
    record = Recording(np.empty((600, 0)), output, 1.0)
    for orders, supported in (((2, 1), True), ((4, 2), False)):
        searched = problem_of("arma", orders, record)
        found = global_search(searched, SearchSettings(), np.random.default_rng(seed))
        assert supports_sections(searched, found.point, found.value)[0] == supported
        assert is_certified(found.diagnostics) == supported
        assert has_agreed(found.diagnostics)
        again = descended(searched, found.point)
        for both in (pooled(again, found), pooled(found, again)):
            assert has_agreed(both.diagnostics)
            assert both.diagnostics.supported == supported


@pytest.mark.parametrize("orders", [(4, 4, 4, 3), (8, 8, 8, 3)])
def test_descents_from_roots_of_c_at_the_edge_end_lower_than_those_from_random_points(orders):
    searched = problem(orders, 300, "absolute")
    descents = searched.descend(searched.random(8, np.random.default_rng(1)))
    ended = searched.polish(descents.points[[np.argmin(descents.values)]])
    point, value = ended.points[0], float(ended.values[0])
    found = searched.from_edge(point, value, np.random.default_rng(1))
    assert found.value == searched.values(found.point[None, :])[0] < 0.999 * value
    c = found.point[searched.errors.orders.part("c")]
    assert np.abs(np.roots([1.0, *c])).max() > 0.999


def test_hops_lead_lower_than_the_memetic_search_alone():
    """Orders with spare sections: nearly every choice of their places is an optimum.

    Which of them a search ends at hangs on the last digits, so several are compared.
    """
    searched, gains = problem((14, 14, 14, 3), 1000), []
    for draw in (1, 2, 3):
        generator = np.random.default_rng(draw)
        alone = memetic_search(searched, SearchSettings(), generator)
        hopping = basin_hopping(searched, alone.point, alone.value, 20000, generator)
        assert not is_certified(alone.diagnostics)
        gains.append(1.0 - hopping.value / alone.value)
    assert min(gains) >= 0.0
    assert max(gains) > 1e-4


def test_hops_never_lead_up_and_repeat_to_the_bit():
    searched = problem((6, 6, 6, 3))
    start = searched.descend(searched.random(4, np.random.default_rng(1)))
    one, two = (
        basin_hopping(searched, start.points[0], start.values[0], 20000, np.random.default_rng(5))
        for _ in range(2)
    )
    assert one.value <= start.values[0]
    assert searched.values(one.point[None, :])[0] == one.value == two.value
    np.testing.assert_array_equal(one.point, two.point)


def test_a_neighbour_keeps_all_sections_but_one():
    searched = problem((6, 6, 6, 3))
    start = searched.descend(searched.random(2, np.random.default_rng(1)))
    point = start.points[0]
    moved, _ = searched.neighbours(point, 8, np.random.default_rng(2))
    own = np.roots(np.concatenate([[1.0], point[:6]]))
    for neighbour in moved:
        roots = np.roots(np.concatenate([[1.0], neighbour[:6]]))
        kept = sum(np.min(np.abs(roots - root)) < 1e-6 for root in own)
        assert kept >= 4


@pytest.mark.parametrize(
    ("agreeing", "restarts", "undiscovered", "enough"),
    [
        (5, 5, 0.05, True),
        (5, 10, 0.05, True),
        (5, 11, 0.05, False),
        (4, 4, 0.05, False),
        (7, 7, 0.06, False),
        (7, 7, 1.0, False),
        (8, 10, 1.0, True),
        (8, 11, 1.0, False),
    ],
)
def test_enough_restarts_are_more_where_there_are_more_optima(
    agreeing, restarts, undiscovered, enough
):
    assert enough_agree(agreeing, restarts, undiscovered) is enough


@pytest.mark.parametrize(
    ("agreeing", "restarts", "undiscovered", "enough"),
    [
        (3, 3, 0.15, True),
        (3, 4, 0.1, True),
        (3, 5, 0.1, False),
        (2, 2, 0.1, False),
        (3, 3, 0.16, False),
    ],
)
def test_a_spent_search_of_polynomials_needs_random_points_and_one_restart_more(
    agreeing, restarts, undiscovered, enough
):
    given = agreeing, restarts, undiscovered
    assert enough_agree(*given, spent=True, supported=False) is enough
    assert not enough_agree(*given)


@pytest.mark.parametrize(("agreeing", "enough"), [(2, False), (3, True)])
def test_all_restarts_of_a_spent_search_agree_where_the_record_supports_sections(agreeing, enough):
    assert enough_agree(agreeing, 3, 1.0, spent=True) is enough


@pytest.mark.parametrize("of_polynomials", [True, False])
def test_two_restarts_agree_once_evaluations_are_spent_only_of_polynomials(of_polynomials):
    searched = problem((2, 2, 2, 3), 300)
    search = _Search(searched, np.random.default_rng(1), None, np.inf)
    search.problem = searched if of_polynomials else object()
    search.minima = [1.0, 1.0]
    assert search.agree(1.0, spent=True) is of_polynomials
    assert not search.agree(1.0)


def test_exchanged_poles_of_plant_and_noise_lead_from_one_optimum_to_another_and_back():
    one, d = np.ones(1), np.array([1.0, 0.9])
    truth = PolynomialModel(np.array([1.0, -1.5, 0.8]), np.array([1.0, 0.5]), one, d, one, 1)
    u, y, _ = polynomial_record(truth, 400, 5.0, np.random.default_rng(2))
    searched = problem_of("ararx", (4, 4, 4, 1), Recording(u, y, 1.0))
    descents = searched.descend(searched.random(BATCH, np.random.default_rng(2)))
    values, point = [np.min(descents.values)], descents.points[np.argmin(descents.values)]
    for _ in range(2):
        descents = searched.descend(searched.with_exchanged_poles(point)[0])
        values.append(np.min(descents.values))
        point = descents.points[np.argmin(descents.values)]
    assert values[0] == pytest.approx(values[2], rel=1e-6)
    assert values[0] < 0.999 * values[1]


def test_of_many_exchanges_of_poles_the_lowest_batch_is_descended_from(monkeypatch):
    u, e = np.random.default_rng(4).standard_normal((2, 200, 3))
    y = lfilter([0.0, 1.0], [1.0, -0.8], u.sum(axis=1)) + e[:, 0]
    orders = Orders(nb=(4, 4, 4), nc=1, nd=4, nf=(4, 4, 4), nk=(1, 1, 1))
    window = ScoringWindow(orders.first_residual, orders.first_residual)
    given = orders, SearchSettings(objective="quadratic"), window, False
    searched = PolynomialProblem(prediction_errors(Recording(u, y, 1.0), *given))
    (point,), begun = searched.random(1, np.random.default_rng(5)), []
    starts, used = searched.with_exchanged_poles(point)
    assert len(starts) == 24
    search = _Search(searched, np.random.default_rng(6), None, np.inf)
    descend = searched.descend
    monkeypatch.setattr(searched, "descend", lambda points: begun.append(points) or descend(points))
    search.descend_from("exchanged poles", starts, used)
    values = searched.values(starts)
    assert np.array_equal(begun[0], starts[values <= np.sort(values)[BATCH - 1]])
    assert search.spent > used + len(starts)


def test_descents_of_absolute_errors_to_one_optimum_end_at_one_value():
    c, d, one = np.array([1.0, 0.5]), np.array([1.0, -0.9]), np.ones(1)
    truth = PolynomialModel(np.array([1.0, -1.2, 0.7]), np.array([1.0, 0.5]), c, d, one, 1)
    u, y, _ = polynomial_record(truth, 400, 5.0, np.random.default_rng(0))
    searched = problem_of("ararmax", (2, 2, 1, 1, 1), Recording(u, y, 1.0), "absolute")
    descents = searched.descend(searched.random(BATCH, np.random.default_rng(0)))
    assert np.max(descents.values) <= (1.0 + 1e-6) * np.min(descents.values)


def test_evaluations_for_a_certificate_are_counted(monkeypatch):
    monkeypatch.setattr(
        "evopem.estimation.search.global_search.supports_sections", lambda *_: (True, 10**9)
    )
    found = global_search(problem((1, 1, 1, 3), 300), SearchSettings(), np.random.default_rng(1))
    assert is_certified(found.diagnostics)
    assert found.diagnostics.evaluations > 10**9


def test_restarts_end_where_a_refutation_of_their_optimum_did():
    searched = problem((2, 2, 2, 3), 300)
    search, point = _Search(searched, np.random.default_rng(1), None, np.inf), np.zeros(9)
    search.led += [(3.0, 2.0), (2.0, 1.0)]
    for value in (2.5, 3.0, 0.5, 3.0):
        search.add("restart", point, value, 1)
    assert search.minima == [2.5, 1.0, 0.5, 1.0]


@pytest.mark.parametrize("measured", [POLYNOMIALS, STATE_SPACE])
def test_the_error_rate_is_an_upper_limit(measured):
    assert measured.wrong / measured.certified < measured.largest_error_rate < 0.2


@pytest.mark.parametrize(
    ("structure", "orders"),
    [("oe", (4, 4, 3)), ("bj", (4, 2, 2, 4, 3)), ("arma", (4, 3)), ("ararmax", (4, 4, 2, 2, 3))],
)
def test_every_structure_has_neighbours_of_finite_value(structure, orders):
    searched = problem_of(structure, orders)
    generator = np.random.default_rng(1)
    point = searched.descend(searched.random(4, generator)).points[0]
    value = float(searched.values(point[None, :])[0])
    moved, evaluations = searched.neighbours(point, 8, generator)
    assert moved.shape == (8, searched.errors.dimension)
    assert np.isfinite(searched.values(moved)).all()
    assert evaluations > 8
    assert basin_hopping(searched, point, value, 3000, generator).value <= value


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
def test_a_search_of_a_finely_sampled_system_explains_as_much_as_the_truth(objective):
    """Modes of 60, 100 and 150 samples a period and a slow real pole: products of the derivatives
    by coefficients keep no digit of some directions."""
    generator = np.random.default_rng(3)
    u = lfilter([1.0], [1.0, -0.9], generator.standard_normal(2000))
    modes = np.outer(2.0 * np.pi / np.array([60.0, 100.0, 150.0]), [-0.1 + 1j, -0.1 - 1j])
    f = np.real(np.poly(np.exp(np.append(modes, -2.0 * np.pi / 100.0))))
    y = lfilter([0.0, 1.0], f, u)
    noise = 0.05 * np.std(y) * generator.standard_normal(len(y))
    orders, settings = orders_of("oe", (7, 7, 1)), SearchSettings(objective=objective)
    window = ScoringWindow(7, 7)
    errors = prediction_errors(Recording(u, y + noise, 1.0), orders, settings, window, False)
    found = global_search(
        PolynomialProblem(scaled_errors(errors)[0]), settings, np.random.default_rng(1)
    )
    assert found.value < errors.loss(noise[7:])


def test_descents_from_means_of_blocks_find_the_slow_poles_of_a_finely_sampled_record():
    """From estimates of the samples, whose noise at high frequencies hides them, none does."""
    generator = np.random.default_rng(6)
    u = lfilter([1.0], [1.0, -0.95], generator.standard_normal(4000))
    modes = np.outer(2.0 * np.pi / np.array([100.0, 150.0, 400.0]), [-0.1 + 1j, -0.1 - 1j])
    f = np.real(np.poly(np.exp(modes).ravel()))
    y = lfilter([0.0, 1.0], f, u)
    noise = 0.1 * np.std(y) * generator.standard_normal(len(y))
    orders, settings = orders_of("oe", (6, 6, 1)), SearchSettings(objective="quadratic")
    window = ScoringWindow(6, 6)
    errors = prediction_errors(Recording(u, y + noise, 1.0), orders, settings, window, False)
    searched = PolynomialProblem(scaled_errors(errors)[0])
    lowest = searched.descend(searched.lowest_estimates(4, slow=True)[0])
    assert lowest.values.min() < errors.loss(noise[6:])
    poles = np.roots(np.append(1.0, lowest.points[lowest.values.argmin(), orders.part("f", 0)]))
    frequencies = np.sort(np.abs(np.log(poles.astype(complex))))[::2]
    np.testing.assert_allclose(frequencies, np.sort(np.abs(modes[:, 0])), rtol=0.05)
    assert not len(problem((2, 2, 2, 1)).lowest_estimates(4, slow=True)[0])


@pytest.mark.filterwarnings("error")
def test_what_is_not_feasible_is_no_optimum_and_needs_no_warning():
    assert not same_optimum(np.float64(np.inf), np.float64(np.inf))
    assert same_optimum(np.float64(1.0 + 1e-7), np.float64(1.0))
