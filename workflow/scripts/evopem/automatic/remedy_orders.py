"""What is tried for the failed checks of a model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from evopem.automatic.candidates import Candidate, Scorer
from evopem.automatic.fit import FitSettings, fit, log_loss
from evopem.automatic.held_out.simulation import simulated
from evopem.automatic.orders import refine_orders
from evopem.automatic.state_space import fits_in_state_space, fits_of_several_inputs
from evopem.automatic.structures import score_of
from evopem.config.channels import of_each
from evopem.config.structures import OF_SIMULATION, ORDER_NAMES
from evopem.errors import NoModelError
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.recording import Segment, total_samples
from evopem.validation.checks.inputs import EXCITATION_ADEQUATE
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT, WHITE
from evopem.validation.checks.roots import DISTINCT, INSIDE_BOUND

# Poles and zeros that are left out where some cancel, most poles without zeros, and most roots that
# become those of D.
FEWER_ROOTS, MOST_POLES_ALONE, MOST_MOVED = (1, 2, 3, 4, 6, 8), 2, 2
# Larger orders of the same structure that are tried for several channels.
LARGER_ORDERS = 2
NOISE_ORDERS = (1, 2, 3, 4, 6, 8, 10, 12)
# Remedies that are tried in all, of one channel and of several.
MOST_TRIALS, MOST_OF_SEVERAL = 12, 6
# A remedy is taken only if the error for the purpose grows by no more than this share.
TOLERATED = 0.02
DELAY = "Delay"
"""The check that a model has the delays which its residuals ask for."""
LENGTH = "Length of B"
"""The check that the last coefficients of B are significant."""

Remedy = tuple[str, Callable[[Candidate], Candidate | None]]
"""What a remedy is called, and the candidate that it gives beside the best one so far."""
Searched = Sequence[Candidate]
"""The candidates of the searches over orders, which several channels choose from."""


def _with(scorer: Scorer, current: Candidate, structure: str = "", **changes: int) -> Any:
    """A candidate of other orders, from the best model so far and the current one."""
    orders = _changed(current.orders, **changes)

    def found(best: Candidate) -> Candidate | None:
        models = [each.polynomials for each in (best, current) if each.polynomials is not None]
        return scorer.candidate(structure or current.structure, orders, models)

    return found


def _changed(orders: Orders, **changes: int) -> Orders:
    """Other orders, of the smallest structure that has them."""
    given = {name: getattr(orders.single, name) for name in ORDER_NAMES}
    return Orders(**(given | changes))


def _later(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Remedy]:
    nk, nb = current.orders.single.nk, current.orders.single.nb
    for more in range(1, min(4, nb)):
        yield f"delay of {nk + more}", _with(scorer, current, nk=nk + more, nb=nb - more)


def _shorter(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Remedy]:
    nb = current.orders.single.nb
    for fewer in range(1, min(4, nb)):
        yield f"{fewer} coefficients of B less", _with(scorer, current, nb=nb - fewer)


def _fewer_roots(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Remedy]:
    o = current.orders
    name = "nf" if o.single.nf else "na"
    for fewer in FEWER_ROOTS:
        poles, nb = getattr(o.single, name) - fewer, o.single.nb - fewer
        if min(poles, nb) < 1:
            continue
        if name == "na" and fewer <= MOST_MOVED:
            # What A and B have in common belongs to D: A D y = B D u + C e.
            moved = {"na": poles, "nb": nb, "nd": o.nd + fewer}
            structure = "ararmax" if o.nc else "ararx"
            common = f"{fewer} common roots of A and B moved to D"
            yield common, _with(scorer, current, structure, **moved)
        yield f"{fewer} pole and zero less", _with(scorer, current, nb=nb, **{name: poles})
        if fewer <= MOST_POLES_ALONE:
            yield f"{fewer} pole less", _with(scorer, current, **{name: poles})


def _further_noise(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Remedy]:
    o = current.orders
    for n in NOISE_ORDERS:
        if o.single.nf and n > min(o.nc, o.nd):
            yield f"noise model of order {n}", _with(scorer, current, "bj", nc=n, nd=n)
        elif o.na and n > o.nc:
            structure = "ararmax" if o.nd else "armax"
            yield f"C of order {n}", _with(scorer, current, structure, nc=n)
        elif not o.na and not o.single.nf:
            yield f"A and C of order {n}", _with(scorer, current, "armax", na=n, nc=n)


def _longer_b(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Remedy]:
    nb = current.orders.single.nb
    for more in (1, 2, 4, 8):
        yield f"{more} coefficients of B more", _with(scorer, current, nb=nb + more)


def _earlier(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Remedy]:
    def found(_: Candidate) -> Candidate | None:
        delays, given = earlier_delays(scorer, current), (scorer.stretches, current.structure)
        if current.polynomials is None:
            fits = fits_in_state_space(*given, (current.order,), delays, scorer.settings)
        else:
            orders = {current.order: replace(current.orders, nk=delays)}
            fits = fits_of_several_inputs(scorer.stretches, orders, scorer.settings)
        for _number, each in fits:
            described = scorer.described(current.structure, each, current.order)
            return replace(scorer.scored(described), delays=delays)
        return None

    yield "earlier delays", found


def _smaller_order(scorer: Scorer, current: Candidate, searched: Searched) -> Iterator[Remedy]:
    smaller = [each for each in _same_structure(current, searched) if each.order < current.order]
    for each in smaller[-1:]:
        yield "smaller order", partial(_refined, scorer, each)


def _other_models(scorer: Scorer, current: Candidate, searched: Searched) -> Iterator[Remedy]:
    """Larger orders, and the likeliest candidate of each other structure with a noise model."""
    larger = [each for each in _same_structure(current, searched) if each.order > current.order]
    for each in larger[:LARGER_ORDERS]:
        yield "larger order", partial(_refined, scorer, each)
    likeliest: dict[str, Candidate] = {}
    for each in sorted(searched, key=lambda each: each.bic):
        if each.structure not in (current.structure, *OF_SIMULATION):
            likeliest.setdefault(each.structure, each)
    for each in likeliest.values():
        yield "other structure", partial(_refined, scorer, each)


def _same_structure(current: Candidate, searched: Searched) -> list[Candidate]:
    return [each for each in searched if each.structure == current.structure]


def _refined(scorer: Scorer, candidate: Candidate, _: Candidate) -> Candidate:
    scored = candidate if candidate.is_scored else scorer.scored(candidate)
    return refine_orders(scorer, scored, score_of("prediction"))[-1]


# Checks, and what is tried while some of them fail, in this order.
OF_ONE_CHANNEL = (
    ((DISTINCT, INSIDE_BOUND, EXCITATION_ADEQUATE), _fewer_roots),
    ((DELAY,), _later),
    ((LENGTH,), _shorter),
    ((WHITE,), _further_noise),
    ((INDEPENDENT_OF_INPUT,), _longer_b),
)
OF_SEVERAL = (
    ((DELAY,), _earlier),
    ((INSIDE_BOUND,), _smaller_order),
    ((WHITE, INDEPENDENT_OF_INPUT), _other_models),
)


def earlier_delays(scorer: Scorer, candidate: Candidate) -> tuple[int, ...]:
    """The delays that residuals ask for, within the limits of the configuration."""
    delays = scorer.checks(candidate).earlier_delays
    given = of_each(scorer.limits.ranges.nk, scorer.limits.names, "delay.nk") if delays else ()
    least = [each[0] if each else 0 for each in given]
    return tuple(map(max, delays, least))


def with_noise_models(scorer: Scorer, candidate: Candidate) -> Iterator[tuple[int, Candidate]]:
    """A plant of one input with noise models of ascending order, fitted to its simulation errors.

    Simulations stay as they are, predictions gain.
    """
    plant = candidate.polynomials
    assert plant is not None
    errors = [
        Segment(np.empty((each.samples, 0)), each.outputs - simulated(plant, each), each.recording)
        for each in scorer.stretches
    ]
    count, objective = total_samples(errors), scorer.settings.objective
    own = candidate.orders.single.nb + candidate.orders.single.nf + 1
    for n in NOISE_ORDERS:
        orders = Orders(na=n, nc=n)
        if candidate.parameters + orders.parameters > scorer.most_parameters:
            return
        try:
            found = fit(errors, orders, FitSettings(objective, level=False))
        except NoModelError:
            continue
        noise, parameters = found.model, own + orders.parameters
        assert isinstance(noise, PolynomialModel)
        variance = noise.noise_variance
        model = replace(plant, C=noise.C, D=noise.A, noise_variance=variance, structure="bj")
        loss = log_loss(found.residuals_from(), objective)
        bic = float(loss + parameters * np.log(count) / count)
        if scorer.limits.allow("bj", model.orders):
            given = replace(candidate, structure="bj", model=model)
            yield n, replace(given, parameters=parameters, bic=bic)
