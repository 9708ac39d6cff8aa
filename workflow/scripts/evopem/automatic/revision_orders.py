"""What is tried for the failed checks of a model."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from evopem.automatic.candidates import Candidate, Scorer
from evopem.automatic.cross_validation.simulation import simulated
from evopem.automatic.fit import fit, fits_in_state_space, log_loss
from evopem.config.channels import of_each
from evopem.config.structures import OF_SIMULATION
from evopem.errors import NoModelError
from evopem.models.orders import Orders, changed
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Segment, total_samples
from evopem.validation.checks.inputs import EXCITATION_ADEQUATE
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT, WHITE
from evopem.validation.checks.roots import DISTINCT, INSIDE_BOUND

# Poles and zeros that are left out where some cancel, most poles without zeros, and most roots that
# become those of D.
FEWER_ROOTS, MOST_POLES_ALONE, MOST_MOVED = (1, 2, 3, 4, 6, 8), 2, 2
# Larger orders of the same structure that are tried in state space.
LARGER_ORDERS = 2
NOISE_ORDERS = (1, 2, 3, 4, 6, 8, 10, 12)
MOST_TRIALS = 12  # revisions that are tried in all
# A revision is taken only if the error for the purpose grows by no more than this share.
TOLERATED = 0.02
DELAY = "Delay"  # the check that a model has the delays which its residuals ask for
LENGTH = "Length of B"  # the check that the last coefficients of B are significant

Revision = tuple[str, Callable[[Candidate], Candidate | None]]
"""What a revision is called, and the candidate that it gives beside the best one so far."""
Searched = Sequence[Candidate]
"""The candidates of the searches over orders, which models in state space choose from."""


def _with(
    scorer: Scorer,
    current: Candidate,
    structure: str = "",
    place: int | None = None,
    **differences: int,
) -> Callable[[Candidate], Candidate | None]:
    """A candidate of other orders, from the best model so far and the current one."""
    orders = changed(current.orders, place, **differences)

    def candidate_of(best: Candidate) -> Candidate | None:
        models = [c.polynomials for c in (best, current) if c.polynomials is not None]
        return scorer.candidate(structure or current.structure, orders, models, scored=False)

    return candidate_of


def _later(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Revision]:
    o = current.orders
    for place in scorer.checks(current).later:
        for more in range(1, min(4, o.nb[place])):
            name = f"delay of {o.nk[place] + more}"
            yield name, _with(scorer, current, place=place, nk=more, nb=-more)


def _shorter(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Revision]:
    for place in scorer.checks(current).shorter:
        for fewer in range(1, min(4, current.orders.nb[place])):
            name = f"{fewer} coefficients of B less"
            yield name, _with(scorer, current, place=place, nb=-fewer)


def _fewer_roots(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Revision]:
    o = current.orders
    # One input after the other where each has poles of its own.
    for place in range(o.inputs) if any(o.nf) else (None,):
        name = "na" if place is None else "nf"
        poles = o.na if place is None else o.nf[place]
        coefficients = min(o.nb, default=0) if place is None else o.nb[place]
        for fewer in FEWER_ROOTS:
            if min(poles, coefficients) - fewer < 1:
                continue
            less = {name: -fewer}
            if name == "na" and fewer <= MOST_MOVED:
                # What A and B have in common belongs to D: A D y = B D u + C e.
                structure = "ararmax" if o.nc else "ararx"
                common = f"{fewer} common roots of A and B moved to D"
                yield common, _with(scorer, current, structure, **less, nb=-fewer, nd=fewer)
            yield (
                f"{fewer} pole and zero less",
                _with(scorer, current, "", place, **less, nb=-fewer),
            )
            if fewer <= MOST_POLES_ALONE:
                yield f"{fewer} pole less", _with(scorer, current, "", place, **less)


def _further_noise(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Revision]:
    o = current.orders
    for n in NOISE_ORDERS:
        if not o.na and n > min(o.nc, o.nd):
            name = f"noise model of order {n}"
            yield name, _with(scorer, current, "bj", nc=n - o.nc, nd=n - o.nd)
        elif o.na and n > o.nc:
            structure = "ararmax" if o.nd else "armax" if o.inputs else "arma"
            yield f"C of order {n}", _with(scorer, current, structure, nc=n - o.nc)


def _longer_b(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Revision]:
    for more in (1, 2, 4, 8):
        yield f"{more} coefficients of B more", _with(scorer, current, nb=more)


def _earlier(scorer: Scorer, current: Candidate, _: Searched) -> Iterator[Revision]:
    def candidate_of(_: Candidate) -> Candidate | None:
        delays, given = earlier_delays(scorer, current), (scorer.stretches, current.structure)
        fits = fits_in_state_space(*given, (current.order,), delays, scorer.settings)
        for _number, fitted in fits:
            described = scorer.described(current.structure, fitted, current.order)
            return replace(scorer.scored(described), delays=delays)
        return None

    yield "earlier delays", candidate_of


def _smaller_order(scorer: Scorer, current: Candidate, searched: Searched) -> Iterator[Revision]:
    smaller = [c for c in _same_structure(current, searched) if c.order < current.order]
    yield from _of_search(scorer, "smaller order", smaller[-1:])


def _other_models(scorer: Scorer, current: Candidate, searched: Searched) -> Iterator[Revision]:
    """Larger orders, and the likeliest candidate of each other structure with a noise model."""
    larger = [c for c in _same_structure(current, searched) if c.order > current.order]
    yield from _of_search(scorer, "larger order", larger[:LARGER_ORDERS])
    likeliest: dict[str, Candidate] = {}
    for candidate in sorted(searched, key=lambda candidate: candidate.bic):
        if candidate.structure not in (current.structure, *OF_SIMULATION):
            likeliest.setdefault(candidate.structure, candidate)
    yield from _of_search(scorer, "other structure", likeliest.values())


def _same_structure(current: Candidate, searched: Searched) -> list[Candidate]:
    return [candidate for candidate in searched if candidate.structure == current.structure]


def _of_search(scorer: Scorer, name: str, candidates: Iterable[Candidate]) -> Iterator[Revision]:
    for candidate in candidates:
        yield name, partial(lambda chosen, _: scorer.with_own_scores(chosen), candidate)


# Checks, and what is tried while some of them fail, in this order: of polynomials, whose orders are
# changed one by one, and in state space, which has one order and the candidates of the search.
REVISIONS = (
    ((DISTINCT, INSIDE_BOUND), _fewer_roots, _smaller_order),
    ((DELAY,), _later, _earlier),
    ((LENGTH,), _shorter, None),
    ((WHITE,), _further_noise, None),
    ((INDEPENDENT_OF_INPUT,), _longer_b, None),
    ((WHITE, INDEPENDENT_OF_INPUT), None, _other_models),
    ((EXCITATION_ADEQUATE,), _fewer_roots, None),
)


def earlier_delays(scorer: Scorer, candidate: Candidate) -> tuple[int, ...]:
    """The delays that residuals ask for, within the limits of the configuration."""
    delays = scorer.checks(candidate).earlier_delays
    given = of_each(scorer.limits.ranges.nk, scorer.limits.names, "delay.nk") if delays else ()
    return tuple(map(max, delays, [limits[0] if limits else 0 for limits in given]))


def with_noise_models(scorer: Scorer, candidate: Candidate) -> Iterator[tuple[int, Candidate]]:
    """A plant with noise models of ascending order, fitted to its simulation errors.

    Simulations stay as they are, predictions gain.
    """
    plant = candidate.polynomials
    assert plant is not None
    errors = [
        Segment(np.empty((s.samples, 0)), s.outputs - simulated(plant, s), s.recording)
        for s in scorer.stretches
    ]
    count, objective = total_samples(errors), scorer.settings.objective
    of_plant = sum(candidate.orders.nb) + sum(candidate.orders.nf) + 1
    for n in NOISE_ORDERS:
        orders = Orders(na=n, nc=n)
        if candidate.parameters + orders.parameters > scorer.most_parameters:
            return
        try:
            fitted = fit(errors, orders, objective, level=False)
        except NoModelError:
            continue
        noise, parameters = fitted.model, of_plant + orders.parameters
        assert isinstance(noise, PolynomialModel)
        variance = noise.noise_variance
        model = replace(plant, C=noise.C, D=noise.A, noise_variance=variance, structure="bj")
        loss = log_loss(fitted.residuals_from(), objective)
        bic = float(loss + parameters * np.log(count) / count)
        if scorer.limits.allow("bj", model.orders):
            yield n, replace(candidate, structure="bj", model=model, parameters=parameters, bic=bic)
