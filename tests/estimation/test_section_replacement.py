"""Sections that polynomials share: order extension, gains by spectra, and replacement."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.prediction_errors import prediction_errors, scaled_errors
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.section_gains import gains, grid
from evopem.estimation.search.section_replacement import (
    SectionReplacement,
    order_extension,
    places,
    with_common_section,
    without_common_section,
)
from evopem.models.orders import armax_orders, orders_of
from evopem.signals.recording import Segment
from evopem.synthesis import armax

CASES = [
    ("armax", (6, 6, 6, 3)),
    ("oe", (6, 6, 3)),
    ("bj", (6, 4, 4, 6, 3)),
    ("arma", (6, 6)),
    ("ararmax", (6, 6, 4, 4, 3)),
]
OF_A, OF_F = (("a", 0), ("b", 0), ("c", 0)), (("f", 0), ("b", 0))


def problem(structure, orders, objective="quadratic", samples=500):
    record = armax(seed=2, samples=samples)[0]
    settings = SearchSettings(objective=objective)
    orders = orders_of(structure, orders)
    if structure == "armax":
        given = (record.segments, orders, objective, 0.9999, 0.9999, False, ScoringWindow(20, 40))
        return PolynomialProblem(PolynomialErrors(*given))
    errors = prediction_errors(record, orders, settings, ScoringWindow(20, 40), False)
    return PolynomialProblem(scaled_errors(errors)[0])


def joined(structure, orders):
    """The same problem with the record in two stretches, one of them short."""
    record = armax(seed=2, samples=500)[0]
    parts = [slice(0, 150), slice(150, None)]
    stretches = [Segment(record.input[part], record.output[part], 0) for part in parts]
    orders = orders_of(structure, orders)
    errors = PolynomialErrors(
        stretches, orders, "quadratic", 0.9999, 0.9999, False, ScoringWindow(10, 20)
    )
    return PolynomialProblem(errors)


def of_two_inputs(structure, orders):
    """The same with a second input, and the record in two stretches."""
    record, generator = armax(seed=2, samples=500)[0], np.random.default_rng(4)
    inputs = np.column_stack([record.input, generator.standard_normal(500)])
    output = record.output + np.std(record.output) * inputs[:, 1]
    parts = [slice(0, 150), slice(150, None)]
    stretches = [Segment(inputs[part], output[part], 0) for part in parts]
    one = orders_of(structure, orders)
    orders = replace(one, nb=one.nb * 2, nf=one.nf * 2, nk=one.nk * 2)
    errors = PolynomialErrors(
        stretches, orders, "quadratic", 0.9999, 0.9999, False, ScoringWindow(10, 20)
    )
    return PolynomialProblem(errors)


def optimum(searched):
    descents = searched.descend(searched.random(8, np.random.default_rng(1)))
    lowest = int(np.argmin(descents.values))
    return descents.points[lowest], float(descents.values[lowest])


@pytest.mark.parametrize(
    ("made", "structure", "orders"),
    [
        *((problem, *case) for case in CASES),
        *((made, *case) for made in (joined, of_two_inputs) for case in CASES[:3]),
    ],
)
def test_a_shared_section_changes_no_value_and_comes_off_again(made, structure, orders):
    larger = made(structure, orders)
    (*_, (below, _), (_, shared)) = order_extension(larger.errors.orders)
    smaller = larger.of_orders(below)
    point, value = optimum(smaller)
    sections = places(5, np.random.default_rng(3))[:4]  # the last has real roots
    grown = with_common_section(point, smaller.errors, larger.errors, shared, sections)
    larger.promised(grown, value)  # fits the states
    # More states fit a little more; with D, too few of them make up for all of the past.
    ratios = larger.values(grown) / value
    assert np.all(ratios > 0.97)
    assert np.median(ratios) < 1.005
    part = smaller.errors.parts[shared[0][0]]
    for own in grown:
        back = without_common_section(own, larger.errors, smaller.errors, shared)
        assert np.min(np.max(np.abs(back - point)[:, part], axis=1)) < 1e-6


@pytest.mark.parametrize(("structure", "orders"), [*CASES, ("ararx", (6, 6, 4, 3))])
def test_order_extension_leads_from_small_orders_to_the_problems_own(structure, orders):
    own = orders_of(structure, orders)
    steps = order_extension(own)
    assert steps[-1][0] == own
    assert (len(steps) > 1) is (structure != "ararx")
    for (smaller, _), (larger, shared) in pairwise(steps):
        assert larger.contains(smaller)
        assert larger.parameters - smaller.parameters == 2 * len(shared)


def test_spectra_rank_places_as_gauss_newton_steps_do():
    larger = problem("armax", (6, 6, 6, 3), samples=2000)
    smaller = larger.of_orders(armax_orders(4, 4, 4, 3))
    point, value = optimum(smaller)
    every = np.arange(0, len(grid()), 8)
    gained = gains(smaller.errors, point, OF_A, every)
    grown = with_common_section(point, smaller.errors, larger.errors, OF_A, grid()[every])
    promised = 1.0 - larger.promised(grown, value) / value
    usable = np.isfinite(promised)
    assert np.corrcoef(gained[usable], promised[usable])[0, 1] > 0.5


def test_stretches_rank_places_as_their_whole_record_does():
    whole, parted = problem("oe", (4, 4, 3)), joined("oe", (4, 4, 3))
    point, _ = optimum(whole)
    plant = whole.errors.parts["plant"].start
    apart = np.zeros(parted.errors.dimension)
    apart[:plant] = point[:plant]
    every = np.arange(0, len(grid()), 8)
    one = gains(whole.errors, point, OF_F, every)
    other = gains(parted.errors, parted.completed(apart[None, :])[0][0], OF_F, every)
    assert np.corrcoef(one, other)[0, 1] > 0.7


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
def test_exchange_never_leads_up_and_repeats_to_the_bit(objective):
    searched = problem("armax", (6, 6, 6, 3), objective)
    point, value = optimum(searched)
    one, two = (
        SectionReplacement(searched).search_from(point, value, 20000, np.random.default_rng(5))
        for _ in range(2)
    )
    assert one.value <= value
    assert searched.values(one.point[None, :])[0] == one.value == two.value
    np.testing.assert_array_equal(one.point, two.point)
