"""Last step of the order search: leading and trailing coefficients of B, and the delay.

With one coefficient of B too many, delays nk and nk + 1 both contain the true model, and the choice
between them is left to chance.  Once the orders are chosen, the models with one coefficient less
at either end and with an earlier start are compared by the same criterion.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders

# BIC removes a coefficient about where its squared t ratio is below ln N.  Up to this many times
# that value the smaller model is estimated, since the t ratio is approximate.
SCREENING = 3.0


class Fit(NamedTuple):
    """An estimated model and its BIC on the samples that all models are compared on."""

    model: PolynomialModel
    bic: float


@dataclass(frozen=True)
class DelayRefinement:
    """The model chosen in the end, and what it was compared with.

    ``fit``: the chosen model.  ``tried``: orders estimated on the way and their BIC, in this order.
    """

    fit: Fit
    tried: tuple[tuple[Orders, float], ...]


def refine_delay(
    start: Fit, samples: int, shortest_delay: int, estimate: Callable[[Orders], Fit]
) -> DelayRefinement:
    """Follow the smallest BIC from a model to its neighbours, as long as it falls.

    ``start``: the model of the last phase. ``shortest_delay``: lower end of the range of delays.  A
    longer delay with the same last lag is a special case of the model and is compared whatever the
    range.  ``estimate``: estimates a model of given orders on the same scored samples.
    """
    best = start
    tried: dict[Orders, float] = {}
    while True:
        fits = []
        for orders in delay_alternatives(best.model, samples, shortest_delay):
            if orders != start.model.orders and orders not in tried:
                fits.append(estimate(orders))
                tried[orders] = fits[-1].bic
        better = min(fits, key=lambda fit: (fit.bic, fit.model.orders), default=best)
        if not better.bic < best.bic:
            return DelayRefinement(best, tuple(tried.items()))
        best = better


def delay_alternatives(model: PolynomialModel, samples: int, shortest_delay: int) -> list[Orders]:
    """Orders to compare a model with: B without its first or its last lag, or with an earlier one.

    A lag is kept without comparison where its coefficient is clearly significant.
    """
    orders, nb, nk = model.orders, model.orders.single.nb, model.orders.single.nk
    limit = math.sqrt(SCREENING * math.log(samples))
    # A t ratio that is not known (NaN) is no reason to keep a coefficient.
    keeps_first, keeps_last = (t > limit for t in t_ratios_of_ends(model))
    alternatives = []
    if nb > 1 and not keeps_first:
        alternatives.append(replace(orders, nb=(nb - 1,), nk=(nk + 1,)))
    if nb > 1 and not keeps_last:
        alternatives.append(replace(orders, nb=(nb - 1,)))
    if nk > shortest_delay:
        alternatives.append(replace(orders, nb=(nb + 1,), nk=(nk - 1,)))
    return alternatives


def t_ratios_of_ends(model: PolynomialModel) -> tuple[float, float]:
    """Absolute t ratios of the first and the last coefficient of B.

    0 where they are not identifiable, NaN where no covariance is known.
    """
    if model.covariance is None:
        return math.nan, math.nan
    ends = np.zeros((2, model.orders.parameters))
    of_b = model.part("b")
    first, last = of_b.start, of_b.stop - 1
    ends[0, first] = ends[1, last] = 1.0
    errors = model.covariance.standard_errors(ends)
    with np.errstate(divide="ignore", invalid="ignore"):
        leading, trailing = np.abs(model.b[[0, -1]]) / errors
    return float(leading), float(trailing)
