"""Hops between optima: one section of the roots elsewhere, then a descent (basin hopping).

A model of more orders than a record supports has an optimum for nearly every choice of frequencies
at which its spare sections lie.  Random starts meet the best choice by luck alone.  Optima that
differ in one section are neighbours: from each optimum a search among its neighbours leads down
quickly (Leary 2000, Global optimization on funneling landscapes).
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.search.problem import Problem, converged_values, same_optimum
from evopem.estimation.search.root_recombination import Sections, product_of, sections_of

Array = NDArray[np.float64]

# Neighbours that a hop descends from: a pass over the record takes eight at the price of one.
DESCENDED = 8
# Hops without a gain after which no neighbour is expected to be lower.
PATIENCE = 6
# Places that are tried for each section at a hop.
PLACES = 12
# A neighbour of a larger value than this, relative to the optimum's, is too far away for the
# prediction of its gain by one Gauss-Newton step.
FARTHEST_NEIGHBOUR = 1.2
# Damping of that step, and of the descent: relative to the scaled diagonal of the Gauss-Newton
# matrix, which is singular where a section is common to all polynomials.
PREDICTION_DAMPING = 1e-3
# Damping of the step from a point with a section that polynomials share exactly: the matrix is
# singular in the directions of the section, where there is no slope either.
COMMON_DAMPING = 1e-6
# Distances of a section's roots from the unit circle: as far as a pole that rings for two samples,
# and as near as one that rings for hundreds.
FARTHEST, NEAREST = 0.4, 0.003


class HoppingProblem(Problem, Protocol):
    """A problem whose points have sections of roots."""

    def neighbours(
        self, point: Array, value: float, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """The most promising of random neighbours, (at most count, n), and the evaluations."""

    def descend_from_neighbours(self, points: Array) -> Descent:
        """Descend from each row, where the Gauss-Newton matrix may be singular."""


class Hops(NamedTuple):
    """Where hops from an optimum ended: point (n,), value, evaluations, values of all descents."""

    point: Array
    value: float
    evaluations: int
    optima: list[float]


def hop(
    problem: HoppingProblem,
    point: Array,
    value: float,
    max_evaluations: float,
    generator: np.random.Generator,
) -> Hops:
    """Move from optimum to lower neighbouring optimum until none is found for some time.

    ``max_evaluations``: evaluations after which no further hop starts.
    """
    evaluations = failed = 0
    optima: list[float] = []
    while failed < PATIENCE and evaluations < max_evaluations:
        starts, used = problem.neighbours(point, value, DESCENDED, generator)
        evaluations += used
        failed += 1
        if not len(starts):
            continue
        descents = problem.descend_from_neighbours(starts)
        evaluations += descents.evaluations
        optima.extend(converged_values(descents))
        lowest = int(np.argmin(descents.values))
        lower = float(descents.values[lowest])
        if lower < value:
            if not same_optimum(value, lower):
                failed = 0
            point, value = descents.points[lowest], lower
    polished = problem.polish(point[None, :])
    return Hops(
        polished.points[0],
        float(polished.values[0]),
        evaluations + polished.evaluations,
        optima,
    )


def random_sections(count: int, generator: np.random.Generator) -> Array:
    """Monic quadratic polynomials, (count, 3), spread over all frequencies and over the damping."""
    angles = np.pi * (np.arange(count) + generator.random(count)) / count
    radii = 1.0 - FARTHEST * (NEAREST / FARTHEST) ** generator.random(count)
    return np.column_stack([np.ones(count), -2.0 * radii * np.cos(angles), radii**2])


def without_nearest_section(coefficients: Array, roots: NDArray[np.complex128]) -> Array | None:
    """A monic polynomial without the section that lies nearest to some roots.

    ``coefficients`` (m,): without the leading 1.  ``roots`` (2,).  Returns (m - 1,) array or None:
    with the leading 1; None where the polynomial has no section.
    """
    found = sections_of(coefficients)
    if not len(found.quadratic):
        return None
    distances = [
        np.min(np.abs(section_roots(section)[:, None] - roots[None, :]))
        for section in found.quadratic
    ]
    rest = np.delete(found.quadratic, int(np.argmin(distances)), axis=0)
    return np.concatenate([[1.0], product_of(Sections(rest, found.single))])


def section_roots(section: Array) -> NDArray[np.complex128]:
    """The two roots of ``1 + x_1 q^-1 + x_2 q^-2``."""
    half = -0.5 * section[0]
    spread = np.sqrt(complex(half * half - section[1]))
    return np.array([half + spread, half - spread])
