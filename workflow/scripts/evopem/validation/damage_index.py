"""How far frequencies lie from those of a reference, with conditions regressed out.

The frequencies of each reference recording are a polynomial of the conditions, scatter that is
shared by the modes, and errors of known variance.  The squared distance of a further recording
(Mahalanobis) is Hotelling's, since the covariance is estimated from the reference: F-distributed
where nothing changed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Self

import numpy as np
from scipy.special import fdtrc, fdtri

from evopem.arrays import Array, Flags, Indices
from evopem.validation.level_changes import fits

# Largest degree of the polynomial of a condition, and reference recordings for each coefficient.
HIGHEST_DEGREE, FOR_EACH = 3, 5
# Reference recordings beyond the modes and coefficients; as many as modes where these are more.
FEWEST_FREE = 5
# Share of unchanged recordings that lack a mode, below which one without it is an event.
RARE = 0.05

Reason = Literal["", "no mode", "reference", "condition"]
"""Why a recording is not judged: its modes, a reference that is too small, or its conditions."""


@dataclass(frozen=True)
class Distance:
    """How far one recording lies from the reference."""

    # Distance in units of the limit, above 1 where it is above; NaN where it cannot be judged
    index: float
    p_value: float  # that an unchanged recording lies as far
    modes: tuple[int, ...]  # that are judged together
    # Of each of these, what is left of its frequency in Hz, with its standard deviation
    left: tuple[float, ...]
    standard_errors: tuple[float, ...]
    reason: Reason = ""


@dataclass(frozen=True)
class Frequencies:
    """Frequencies of the modes of one structure in its recordings.

    ``values``, ``errors``: (n, k) in Hz, with standard errors, NaN where a mode is missing.
    ``conditions``: (n, c).  ``is_reference``: (n,) recordings in which nothing has changed.
    """

    values: Array
    errors: Array
    conditions: Array
    is_reference: Flags

    @cached_property
    def terms(self) -> tuple[Array, int]:
        """(n, p) A constant and powers of the conditions, and how many were tried."""
        return regressors(self.conditions, self.is_reference, self.values, self.errors)

    @cached_property
    def _known(self) -> dict[tuple[bytes, bytes], _Fit]:
        return {}

    def distance(self, number: int, false_alarms: float) -> Distance:
        """That of a recording; of one of the reference, from all others of it.

        ``false_alarms``: probability that a recording in which nothing changed is above its limit.
        """
        terms, tried = self.terms
        rows, modes, reason = self._judged(number, tried)
        if reason:
            return Distance(math.nan, math.nan, (), (), (), reason)
        key = rows.tobytes(), modes.tobytes()
        if key not in self._known:
            of = np.ix_(rows, modes)
            self._known[key] = _Fit.of(self.values[of], self.errors[of], terms[rows], tried)
        fit, measured = self._known[key], (self.values[number, modes], self.errors[number, modes])
        left, errors = fit.left(*measured, terms[number])
        index, p_value = fit.judged(left / errors, false_alarms)
        judged, beside, expected = (tuple(part.tolist()) for part in (modes, left, errors))
        return Distance(index, p_value, judged, beside, expected)

    def missing(self, number: int) -> list[int]:
        """Modes missing in a recording, as an unchanged one does with a probability below RARE."""
        without, others = ~np.isfinite(self.values), self.is_reference.copy()
        others[number] = False
        lacking = (without[others].sum(axis=0) + 1) / (others.sum() + 1)
        return np.flatnonzero(without[number] & (lacking < RARE)).tolist()

    def _judged(self, number: int, tried: int) -> tuple[Indices, Indices, Reason]:
        """Reference recordings and modes: all of the latter that enough of the former have."""
        has, others = np.isfinite(self.values), self.is_reference.copy()
        others[number] = False
        modes, nothing = np.flatnonzero(has[number]), np.arange(0)
        at, known = self.conditions[number], self.conditions[self.is_reference]
        if others.any() and not np.all((at >= known.min(axis=0)) & (at <= known.max(axis=0))):
            return nothing, nothing, "condition"
        # Those go first that few have, of these the least certain.
        relative = self.errors[number, modes] / self.values[number, modes]
        order = np.lexsort((-relative, has[others][:, modes].sum(axis=0)))
        for first in range(len(modes)):
            kept = np.sort(modes[order[first:]])
            rows = np.flatnonzero(others & has[:, kept].all(axis=1))
            free = len(rows) - tried - len(kept) + 1
            if free >= max(FEWEST_FREE, len(kept)):
                return rows, kept, ""
        return nothing, nothing, "reference" if len(modes) else "no mode"


@dataclass(frozen=True)
class _Fit:
    """What the reference says of some modes: coefficients of the terms, scatter, correlation."""

    coefficients: Array  # (k, p)
    covariances: Array  # (k, p, p)
    scatter: Array  # (k,) variances beyond the errors
    correlation: Array  # (k, k) of what is left, in units of its expected deviation
    free: int  # recordings beyond the coefficients

    @classmethod
    def of(cls, values: Array, errors: Array, design: Array, tried: int) -> Self:
        """From recordings, (n, k), that have all of the modes; design (n, p).

        Coefficients that were tried count as estimated: a choice among them fits better than none.
        """
        designs = np.repeat(design[None], values.shape[1], axis=0)
        coefficients, covariances, _, scatter = fits(values.T, errors.T, designs, 1)
        rest = (values - design @ coefficients.T) / np.sqrt(errors**2 + scatter)
        free = len(design) - tried
        return cls(coefficients, covariances, scatter, rest.T @ rest / free, free)

    def left(self, values: Array, errors: Array, terms: Array) -> tuple[Array, Array]:
        """What is left of the values of a further recording, (k,), and its standard errors."""
        of_mean = np.einsum("p,kpq,q->k", terms, self.covariances, terms)
        left = values - self.coefficients @ terms
        return left, np.sqrt(errors**2 + self.scatter + of_mean)

    def judged(self, standardised: Array, false_alarms: float) -> tuple[float, float]:
        """Distance over its limit, and p-value of no change."""
        k = len(standardised)
        beyond = self.free - k + 1
        distance = float(standardised @ np.linalg.solve(self.correlation, standardised))
        statistic = distance * beyond / (self.free * k)
        limit = float(fdtri(k, beyond, 1.0 - false_alarms))
        return math.sqrt(statistic / limit), float(fdtrc(k, beyond, statistic))


def regressors(conditions: Array, rows: Flags, values: Array, errors: Array) -> tuple[Array, int]:
    """(n, p) A constant, and powers of conditions up to the degree that BIC takes, centred.

    ``conditions`` (n, c); ``values``, ``errors`` (n, k), NaN where missing.  The degree is the same
    of all conditions, and chosen from some rows and all columns of values together.  The number
    behind it is that of the coefficients that were tried.
    """
    within, counts = conditions[rows], np.isfinite(values[rows]).sum(axis=0)
    if not within.size or not len(counts):
        return np.ones((len(conditions), 1)), 1
    low, high = within.min(axis=0), within.max(axis=0)
    varying = high > low
    scaled = ((2.0 * conditions - low - high)[:, varying]) / (high - low)[varying]
    designs = [np.ones((len(scaled), 1))]
    for degree in range(1, HIGHEST_DEGREE + 1):
        larger = np.hstack([designs[-1], scaled**degree])
        used = larger[rows]
        if FOR_EACH * used.shape[1] > counts.max() or np.linalg.matrix_rank(used) < used.shape[1]:
            break
        designs.append(larger)
    totals = np.zeros(len(designs))
    for of_mode, of_errors in zip(values.T, errors.T, strict=True):
        has = rows & np.isfinite(of_mode)
        if has.sum() >= FOR_EACH * designs[-1].shape[1]:
            totals += _criteria(of_mode[has], of_errors[has], [design[has] for design in designs])
    return designs[int(np.argmin(totals))], designs[-1].shape[1]


def _criteria(values: Array, errors: Array, designs: Sequence[Array]) -> Array:
    """Bayesian information criterion of designs, all with the weights that the largest one has.
    With its penalty twice: modes share scatter, and their evidence is counted as independent."""
    scatter = fits(values, errors, designs[-1][None], 1)[3][0]
    roots, count = 1.0 / np.sqrt(errors**2 + scatter), len(values)
    criteria = []
    for design in designs:
        basis = np.linalg.qr(design * roots[:, None])[0]
        weighted = values * roots
        left = float(np.sum((weighted - basis @ (basis.T @ weighted)) ** 2))
        criteria.append(count * math.log(max(left, 1e-300)) + 2 * design.shape[1] * math.log(count))
    return np.array(criteria)
