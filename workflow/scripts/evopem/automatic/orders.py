"""Delays of the inputs, and orders within one structure."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product
from typing import Any

import numpy as np

from evopem.automatic.candidates import (
    BIC,
    GAIN,
    LARGEST_ORDER,
    SIMULATION_BIC,
    Candidate,
    Score,
    Scorer,
    StructureSearch,
)
from evopem.automatic.cross_validation.stretches import MOST_SAMPLES, first_samples
from evopem.automatic.decision import Alternative, Decision, given_by_configuration
from evopem.automatic.fit import fits_in_state_space, from_likeliest
from evopem.automatic.preparation.plan import PreparedRecord
from evopem.config.channels import of_each
from evopem.config.settings import InputRanges
from evopem.config.structures import OF_SIMULATION, REGULARISED, is_polynomial
from evopem.errors import NoModelError
from evopem.estimation.delays import SHORT_DELAY, is_of_feedback, likely_delays, longest_delay
from evopem.estimation.search.problem import Log
from evopem.estimation.state_space.estimate import RISES
from evopem.models.mode_matching import OrderModel, OrderModels
from evopem.models.orders import Orders, changed, neighbours
from evopem.models.polynomial import PolynomialModel, of_signals
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording, Segment
from evopem.validation.checks.inputs import EXCITATION_ADEQUATE
from evopem.validation.checks.roots import DISTINCT
from evopem.validation.held_out_tests import SIGNIFICANCE

# Orders tried one after the other, as long as one of the last PATIENCE has brought something; of
# structures with poles, but ARX, and one input one order less.
PATH = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, LARGEST_ORDER)
LONG_PATH = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)
# Finite responses beside a noise model, without which their noise draws poles or lags.
FINITE = "finite response"
# The paths of a structure, if not one over its poles: forms of its orders, with their sizes.
PATHS: Mapping[str, Mapping[str, Sequence[int]]] = {
    "fir": {"fir": LONG_PATH},
    "impulse": {"impulse": (16, 32, 70, 125)},
    "arx": {"arx": (*PATH, 30, 40)},
    "bj": {FINITE: LONG_PATH, "bj": PATH},
}
PATIENCE = 3
ROUNDS, BY_LIKELIHOOD = 2, 4  # over the orders of a model that is refined, and by its BIC
# The BIC of one-step or of simulation errors must fall by this much to count as a gain, or of
# models with F both by the first of these.
LEAST_GAINS = 0.002, 0.01
# Samples times parameters of all candidates of a structure, and of a refinement: the cost of a fit
# with its folds is about proportional to it.  Long records stop at lower orders.
MOST_WORK = 1_100_000
# Largest number of states, with an input and without one, and that above which they are tried in
# steps of two.
MOST_STATES, MOST_ALONE, SINGLE_STEPS = 40, 80, 10
# What errors that are a tenth larger add to the BIC.
MISSED = 2.0 * float(np.log(1.1))
# Output values of the smallest training part for each parameter of models of several channels.
VALUES_PER_PARAMETER = 5


def search_structure(
    scorer: Scorer, structure: str, smaller: Mapping[str, StructureSearch], log: Log | None = None
) -> StructureSearch:
    """Orders of one structure, from small to large as long as they bring something.

    One whose search fails by a decomposition that does not converge, or without a model, has no
    candidates: those of the others, which the same job may search, stay.
    """
    for nested in smaller.values():
        scorer.remember(nested.candidates)
    problem = ""
    try:
        if is_polynomial(structure):
            paths = _paths(scorer, structure)
            candidates = [
                c for path in paths for c in _along_path(scorer, structure, smaller, path, log)
            ]
        else:
            known = [c for search in smaller.values() for c in search.candidates]
            problem = _needless(scorer, known)
            candidates = [] if problem else _by_states(scorer, structure, known, log)
    except (NoModelError, np.linalg.LinAlgError) as error:
        candidates, problem = [], f"Its search failed: {error}."
    nothing = not candidates and not problem
    too_short = nothing and (is_polynomial(structure) or not numbers_of_states(scorer))
    decision = _decision(structure, candidates, too_short, problem)
    return StructureSearch(structure, tuple(candidates), decision, too_short)


def order_models(
    search: StructureSearch, record: PreparedRecord, estimation: Recording
) -> OrderModels:
    """The likeliest plant of each number of poles in a search, as one of a recording."""
    models: dict[int, OrderModel] = {}
    with_poles = [c for c in search.candidates if c.polynomials is None or c.orders.poles]
    for tried in sorted(with_poles, key=lambda tried: (tried.order, -tried.bic)):
        plant = record.in_its_units(tried.model)
        if isinstance(plant, PolynomialModel):
            plant = plant.plant().state_space()
        models[tried.order] = OrderModel.of(tried.order, tried.bic, of_signals(plant, estimation))
    return OrderModels(tuple(models.values()))


def without_covariances(search: StructureSearch) -> StructureSearch:
    """A search with models without their covariances, which are large."""
    plain = [replace(t, model=replace(t.model, covariance=None)) for t in search.candidates]
    return replace(search, candidates=tuple(plain))


def _along_path(
    scorer: Scorer,
    structure: str,
    smaller: Mapping[str, StructureSearch],
    path: Iterable[list[Orders]],
    log: Log | None,
) -> list[Candidate]:
    """Candidates of polynomials, as long as one criterion falls, or both of models with F."""
    candidates: list[Candidate] = []
    known = list(chain(*(search.candidates for search in smaller.values())))
    without_gain, work, lowest = 0, 0, [np.inf, np.inf]
    previous: list[PolynomialModel] = []
    for orders_of_step in scorer.limits.within(structure, path):
        tried: list[Candidate] = []
        for orders in orders_of_step:
            # The first output-error model of a step is a special case of the second.
            nested = tried if structure in OF_SIMULATION else []
            same_plant = [c for c in known if c.orders.poles == orders.poles]
            starts = [*previous, *map(_polynomials, [*same_plant, *nested])]
            candidate = scorer.candidate(structure, orders, starts, not nested, scored=False)
            if candidate is not None:
                tried.append(candidate)
                if log is not None:
                    log(f"{candidate.name}: BIC {candidate.bic:.6g}")
        if not tried:
            break
        candidates.extend(tried)
        work += scorer.samples * sum(candidate.parameters for candidate in tried)
        likeliest = min(tried, key=BIC)
        previous = [_polynomials(likeliest)]
        reached = [min(map(criterion, tried)) for criterion in (BIC, SIMULATION_BIC)]
        falls = np.array([old - new for old, new in zip(lowest, reached, strict=True)])
        # Poles of F alone that draw noise or slow drifts lower one of the two criteria.
        needed, least = (all, LEAST_GAINS[0]) if any(likeliest.orders.nf) else (any, LEAST_GAINS)
        gained = needed(falls > least)
        lowest = list(map(min, reached, lowest))
        without_gain = 0 if gained else without_gain + 1
        # Large steps say more, and take longer; ARX fits are quick, inputs need not gain alike.
        poles, inputs = likeliest.orders.poles, likeliest.orders.inputs
        slow = poles > 0 and inputs < 2 and structure != "arx"
        patience = PATIENCE - slow - (poles > SINGLE_STEPS)
        if without_gain >= patience or work >= MOST_WORK:
            break
    return candidates


def _needless(scorer: Scorer, known: Sequence[Candidate]) -> str:
    """Why no states are searched: the likeliest polynomials of one input lack nothing that the
    states of the same orders could have. Common roots say that fewer would do, which were tried."""
    polynomials = [c for c in known if c.polynomials is not None and c.orders.inputs == 1]
    if not polynomials or scorer.limits.ranges.nx is not None:
        return ""
    likeliest = min(polynomials, key=BIC)
    checks = scorer.checks(likeliest)
    is_white = checks.whiteness >= SIGNIFICANCE  # not where it is not known
    if not (is_white and {EXCITATION_ADEQUATE, DISTINCT}.issuperset(checks.failed)):
        return ""
    name = f"{likeliest.name}, the likeliest of the polynomials,"
    return f"Not searched: {name} fails no check that states would meet."


def _by_states(
    scorer: Scorer, structure: str, known: Sequence[Candidate], log: Log | None
) -> list[Candidate]:
    """Candidates in state space until their BIC rises. Of many states in output-error form also
    where that of simulations has not fallen for long: coloured errors lower the BIC with every
    state that describes them."""
    states = numbers_of_states(scorer)
    if not states:
        return []
    given = scorer.stretches, structure, states, scorer.delays, scorer.settings
    starts = {c.order: c.model for c in known if isinstance(c.model, StateSpaceModel)}
    single = [c for c in known if c.structure == "armax" and c.orders.inputs == 1]
    armax = {c.order: c.bic for c in sorted(single, key=BIC, reverse=True)}  # the lowest of each
    candidates: list[Candidate] = []
    for order, fitted in fits_in_state_space(*given, starts, log):
        candidates.append(scorer.described(structure, fitted, order))
        # The innovations form of one channel is ARMAX of as many poles, and its optimum no higher:
        # where it ends higher twice in a row, its descents fail.
        missed = (c.bic > armax.get(c.order, np.inf) + MISSED for c in candidates[-RISES:])
        if sum(missed) == RISES:
            break
        if structure in OF_SIMULATION and order > SINGLE_STEPS:
            best = min(candidates, key=SIMULATION_BIC)
            if best not in candidates[-PATIENCE:]:
                break
    return candidates


def numbers_of_states(scorer: Scorer) -> tuple[int, ...]:
    """The numbers of states that are tried: all that the record can determine.

    In steps of two where there are many; without an input those next to the likeliest estimate.
    """
    first = scorer.stretches[0]
    nu, ny, samples = first.inputs.shape[1], first.outputs.shape[1], scorer.samples
    limits = scorer.limits.ranges.nx
    low, high = limits or (1, MOST_STATES if nu else MOST_ALONE)
    # Of the smallest training part, about.  Each stretch has an initial state of its own.
    left_out = -(-samples // min(count for count, _ in scorer.plan.designs))
    values = (samples - left_out) * ny // VALUES_PER_PARAMETER
    affordable = min(values // (nu + 2 * ny + len(scorer.stretches)), samples // 12)
    high = min(high, affordable)
    if limits is None and high > SINGLE_STEPS:
        orders = tuple(range(2, high + 1, 2))
        return orders if nu else from_likeliest(scorer.stretches, orders, scorer.settings)
    return tuple(range(low, high + 1))


def _decision(
    structure: str, candidates: Sequence[Candidate], too_short: bool, problem: str
) -> Decision:
    nothing = "No model of this structure was found, or rounding spoils each of them."
    name, sentence = "none", problem or nothing
    if too_short:
        sentence = "The record is too short for this structure."
    elif candidates:
        best = min(candidates, key=BIC)
        name, at_start = best.name, ", the smallest that was tried" * (best is candidates[0])
        end = f"{at_start}; larger ones bring nothing."
        end = ", the largest that was tried." if best is candidates[-1] else end
        sentence = f"{name} has the smallest BIC of {len(candidates)} orders{end}"
    alternatives = tuple(Alternative(candidate.name, candidate.bic) for candidate in candidates)
    return Decision(f"orders of {structure}", name, alternatives, "BIC", sentence)


def _paths(scorer: Scorer, structure: str) -> Iterator[list[list[Orders]]]:
    """Orders from small to large; those of a step are alternatives of about the same size.

    One without poles is left out where limits ask for some.  Polynomials begin early too where a
    long delay is not certain, and a regularised response, which needs none, at 0 behind a long one.
    """
    late = scorer.plan.late_response * (structure in REGULARISED)
    early = scorer.early or scorer.delays
    if structure in REGULARISED and max(scorer.delays, default=0) > SHORT_DELAY:
        early = (0,) * len(scorer.delays)
    forms = PATHS.get(structure, {structure: PATH}).items()
    for delays, (form, known) in product(dict.fromkeys((scorer.delays, early)), forms):
        sizes = sorted({*known, late or known[0]})
        if structure in REGULARISED:
            # One that begins early and ends before the delay would hold nothing of the system.
            before = [delay - k for delay, k in zip(scorer.delays, delays, strict=True)]
            sizes = [n for n in sizes if n > max(before, default=0)]
        path = [orders_of_size(form, n, delays) for n in sizes]
        if not path:
            continue
        smallest = path[0][0]
        if any(smallest.nf) or not any(scorer.limits.clamped(structure, smallest).nf):
            yield path


def orders_of_size(form: str, n: int, delays: Sequence[int]) -> list[Orders]:
    """Orders of a structure, or form of it, with n poles, or coefficients of each B without."""

    def o(nb: int, less: int = 0, **others: Any) -> Orders:
        nk = [max(delay - less, 0) for delay in delays]
        return Orders(nb=(nb,) * len(delays), nk=tuple(nk), **others)

    return {
        "fir": lambda: [o(n)],
        "impulse": lambda: [o(n)],
        "arx": lambda: [o(n, na=n), o(2 * n, less=1, na=n)][: 1 + (n <= LARGEST_ORDER)],
        **dict.fromkeys(("arma", "armax"), lambda: [o(n, na=n, nc=n)]),
        "ararx": lambda: [o(n, na=n, nd=max(n // 2, 1))],
        "ararmax": lambda: [o(n, na=n, nc=max(n // 2, 1), nd=1)],
        "oe": lambda: [o(n, nf=n), o(n + 1, less=1, nf=n)],
        "bj": lambda: [o(n, nd=1, nf=n), o(n, nc=2, nd=2, nf=n)],
        FINITE: lambda: [o(n, nc=2), o(n, nc=2, nd=1)],
        "general": lambda: [o(n, na=1, nc=min(n, 4), nd=min(n, 4), nf=n)],
    }[form]()


def _polynomials(candidate: Candidate) -> PolynomialModel:
    assert candidate.polynomials is not None
    return candidate.polynomials


def refine_orders(scorer: Scorer, start: Candidate, score: Score) -> list[Candidate]:
    """Change one order after the other as long as a score falls; all that was tried.

    By their BIC only the best is scored on held-out samples, and so is its plant of own poles.
    """
    best, tried, work = start, [start], 0
    for _ in range(BY_LIKELIHOOD if score is BIC else ROUNDS):
        for orders in neighbours(best.orders):
            if work >= MOST_WORK:
                continue
            work += scorer.samples * orders.parameters
            given = best.structure, orders, [_polynomials(best)]
            candidate = scorer.candidate(*given, own_starts=False, scored=False)
            tried += [candidate] if candidate is not None else []
        tried, least = (tried, 0.0) if score is BIC else (scorer.with_scores(tried), GAIN)
        lowest = min(tried, key=score)
        if not score(lowest) < score(best) - least * score(best):
            break
        best = lowest
    plant = with_white_noise(scorer, best) if score is BIC and any(best.orders.nf) else None
    return [*tried, *filter(None, [plant]), scorer.with_own_scores(best)]


def with_white_noise(scorer: Scorer, start: Candidate) -> Candidate | None:
    """The plant of a model alone; its own search may have ended at another optimum."""
    o = changed(start.orders, nc=-start.orders.nc, nd=-start.orders.nd)
    return scorer.candidate(o.structure, o, [_polynomials(start)], own_starts=False, again=True)


RECORDED = 5  # alternatives of each input that are recorded


@dataclass(frozen=True)
class DelayChoice:
    """Delays of the inputs in samples, 0 for one that acts on the same sample."""

    delays: tuple[int, ...]
    decision: Decision
    likely: tuple[tuple[int, ...], ...] = ()  # of each input, those that together have 95 %
    shortest: int = 0  # that may be chosen
    early: tuple[int, ...] = ()  # short ones that long delays leave possible, or the same


def decide_delays(
    segments: Sequence[Segment], names: Sequence[str], ranges: InputRanges = None
) -> DelayChoice:
    """Decide the delay of each input.

    Raises InputError when the ranges are those of other inputs.
    """
    segments = first_samples(segments, MOST_SAMPLES)
    given = of_each(ranges, names, "delay.nk") if names else ()
    shortest = int(bool(names) and ranges is None and is_of_feedback(segments))
    limits = [limit or (shortest, longest_delay(segments)) for limit in given]
    if all(low == high for low, high in limits):
        delays = tuple(low for low, _ in limits)
        return DelayChoice(delays, given_by_configuration("delay", _listed(delays) or "none"))
    decided = likely_delays(segments, limits)
    delays, likely = tuple(d.delay for d in decided), tuple(d.likely for d in decided)
    before = [f"{name}: " * (len(names) > 1) for name in names]
    alternatives = tuple(
        Alternative(f"{name}{low + place}", float(of_input.scores[place]))
        for name, (low, _), of_input in zip(before, limits, decided, strict=True)
        for place in sorted(of_input.scores.argsort()[:RECORDED].tolist())
    )
    sets = "; ".join(name + in_runs(those) for name, those in zip(before, likely, strict=True))
    sentence = f"Delay in samples, with 95 % probability: {sets}."
    if any(len(of_input) > 1 for of_input in likely):
        sentence += " Taken is the shortest that is not clearly less probable than the others."
    if shortest:
        sentence += " What the same samples share is likelier of feedback than of a delay of 0."
    criterion = "−2 ln of the probability over that of the likeliest delay"
    about = Decision("delay", _listed(delays), alternatives, criterion, sentence)
    return DelayChoice(delays, about, likely, shortest, tuple(d.early for d in decided))


def _listed(delays: Sequence[int]) -> str:
    return ", ".join(map(str, delays))


def in_runs(delays: Sequence[int]) -> str:
    """Ascending numbers, neighbours together: "0, 3 to 5"; with gaps where there are many."""
    ends = [k for k in delays if k - 1 not in delays], [k for k in delays if k + 1 not in delays]
    if len(ends[0]) > RECORDED:
        return f"{len(delays)} from {delays[0]} to {delays[-1]}"
    pairs = zip(*ends, strict=True)
    return ", ".join(f"{low} to {high}" if high > low else str(low) for low, high in pairs)
