"""Orders within one structure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from evopem.automatic.candidate_checks import CandidateChecks, check_model
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import Fit, FitSettings, fit, log_loss
from evopem.automatic.folds import FoldPlan, HeldOutScores, held_out_scores
from evopem.automatic.limits import OrderLimits
from evopem.automatic.simulation import simulated
from evopem.automatic.stretches import MOST_SAMPLES, first_samples
from evopem.config.structures import AUTOMATIC_STRUCTURES, ORDER_NAMES
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.recording import Segment, total_samples

# Orders tried one after the other, as long as one of the last PATIENCE has brought something.
PATH = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20)
LONG_PATH = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)
PATIENCE = 3
# A criterion must fall by this share (simulation) or by this much (BIC) to count as a gain.
GAIN, BIC_GAIN = 0.005, 0.002
# Samples for each parameter.
SAMPLES_PER_PARAMETER = 8
# Samples times parameters of all candidates of a structure, and of a refinement: the cost of a fit
# with its folds is about proportional to it.  Long records stop at lower orders.
MOST_WORK = 1_100_000
# Candidates whose errors, one step ahead and of simulations, are both this much above the lowest of
# all (a factor of 3 in the criterion's logarithm of squares) are not scored on folds.
REACH = 2.0 * np.log(3.0)
# Structures whose optima serve as starts of others.
NESTED: Mapping[str, tuple[str, ...]] = AUTOMATIC_STRUCTURES


@dataclass(frozen=True)
class Candidate:
    """A model of some orders with what it reaches.

    Attributes
    ----------
    structure : str
    orders : Orders
    parameters : int
        Coefficients and levels.
    bic : float
        On the one-step residuals from a common sample on.
    simulation_bic : float
        The same formula with the errors of a simulation of the estimation part, whose initial
        states and levels are fitted.
    scores : HeldOutScores
    model : PolynomialModel
        Fitted to the whole estimation part.
    """

    structure: str
    orders: Orders
    parameters: int
    bic: float
    simulation_bic: float
    scores: HeldOutScores
    model: PolynomialModel

    @property
    def name(self) -> str:
        """Structure and orders in a few letters."""
        named = [
            f"{n}={getattr(self.orders.single, n)}" for n in ("na", "nb", "nc", "nd", "nf", "nk")
        ]
        shown = [text for text in named if not text.endswith("=0") or text.startswith("nk")]
        return f"{self.structure} {' '.join(shown)}"


@dataclass(frozen=True)
class StructureSearch:
    """All candidates of one structure."""

    structure: str
    candidates: tuple[Candidate, ...]
    decision: Decision


class Scorer:
    """Fits and scores models of one record, each orders once.

    Structures and orders of a long record are compared on its first ``MOST_SAMPLES`` samples;
    :meth:`on_all_samples` fits what was chosen to all.

    Parameters
    ----------
    stretches : sequence of Segment
    plan : FoldPlan
    settings : FitSettings
    limits : OrderLimits
        Other orders have no candidates.
    """

    def __init__(
        self,
        stretches: Sequence[Segment],
        plan: FoldPlan,
        settings: FitSettings,
        limits: OrderLimits = OrderLimits(),  # noqa: B008 - frozen
    ) -> None:
        self.whole, self.plan, self.settings = tuple(stretches), plan, settings
        self.limits = limits
        self.stretches = first_samples(stretches, MOST_SAMPLES)
        self.samples = total_samples(self.stretches)
        self.window = min(4 * max(PATH), min(each.samples for each in self.stretches) // 4)
        self._known: dict[tuple[str, Orders], Candidate] = {}
        self._checked: dict[Candidate, CandidateChecks] = {}

    @property
    def most_parameters(self) -> int:
        """Most parameters that the record carries."""
        return max(4, round(self.independent_samples) // SAMPLES_PER_PARAMETER)

    @property
    def independent_samples(self) -> float:
        """Samples that tell something new, where residuals repeat with the input."""
        return self.samples * self.plan.repetition.independent

    def penalty(self, parameters: int) -> float:
        """What the BIC of a sample adds for parameters."""
        count = self.samples - self.window * len(self.stretches)
        independent = count * self.plan.repetition.independent
        return float(parameters * np.log(independent) / independent)

    def candidate(
        self,
        structure: str,
        orders: Orders,
        models: Sequence[PolynomialModel] = (),
        own_starts: bool = True,
    ) -> Candidate | None:
        """The candidate of these orders; None where the record does not carry them.

        Parameters
        ----------
        structure : str
        orders : Orders
        models : sequence of PolynomialModel
            Descents start from them, and with ``own_starts`` from estimates by linear algebra.
        own_starts : bool
        """
        key = (structure, orders)
        if key not in self._known:
            if not self.limits.allow(structure, orders):
                return None
            if orders.parameters + orders.single.nf + orders.noise_states > self.most_parameters:
                return None
            try:
                found = fit(self.stretches, orders, self.settings, models, own_starts, structure)
            except (ValueError, np.linalg.LinAlgError):
                return None
            described = self._described(structure, found)
            if self._within_reach(described):
                scores = held_out_scores(self.stretches, self.plan, found.model, self.settings)
                described = replace(described, scores=scores)
            self._known[key] = described
        return self._known[key]

    def _within_reach(self, candidate: Candidate) -> bool:
        """Whether one of the criteria is near enough to the best of all to be worth folds."""
        known = [*self._known.values(), candidate]
        return (
            candidate.bic <= min(each.bic for each in known) + REACH
            or candidate.simulation_bic <= min(each.simulation_bic for each in known) + REACH
        )

    def checks(self, candidate: Candidate) -> CandidateChecks:
        """What the checks of the report say of a candidate, on the compared samples.

        Parameters
        ----------
        candidate : Candidate
        """
        if candidate not in self._checked:
            self._checked[candidate] = check_model(
                candidate.model, candidate.structure, self.stretches, self.settings
            )
        return self._checked[candidate]

    def on_all_samples(self, candidate: Candidate) -> Candidate:
        """The same orders, fitted to the whole record where the scores come from a part of it."""
        if self.samples == total_samples(self.whole):
            return candidate
        models = [candidate.model]
        try:
            found = fit(
                *(self.whole, candidate.orders, self.settings, models),
                *(False, candidate.structure),
            )
        except (ValueError, np.linalg.LinAlgError):
            return candidate
        return replace(candidate, model=found.model)

    def remember(self, candidates: Sequence[Candidate]) -> None:
        """Take candidates as known that were scored before, with the same settings."""
        for each in candidates:
            self._known.setdefault((each.structure, each.orders), each)

    def _described(self, structure: str, found: Fit) -> Candidate:
        penalty = self.penalty(found.parameters)
        objective = self.settings.objective
        robust = objective == "absolute"
        simulation_errors = np.concatenate(
            [simulated(found.model, s, True, robust) - s.output for s in self.stretches]
        )
        return Candidate(
            structure,
            found.orders,
            found.parameters,
            log_loss(found.residuals_from(self.window), objective) + penalty,
            log_loss(simulation_errors, objective) + penalty,
            HeldOutScores.none(),
            found.model,
        )


def search_structure(
    scorer: Scorer, structure: str, delay: int, smaller: Mapping[str, StructureSearch]
) -> StructureSearch:
    """Orders of one structure, growing from 1 as long as they bring something.

    Parameters
    ----------
    scorer : Scorer
    structure : str
        A key of :data:`NESTED`.
    delay : int
        Samples.
    smaller : mapping of str to StructureSearch
        The searches of ``NESTED[structure]``, whose models are starts.
    """
    candidates: list[Candidate] = []
    without_gain, work, best, best_bic = 0, 0, np.inf, np.inf
    previous: list[PolynomialModel] = []
    for orders_of_step in scorer.limits.within(structure, _path(structure, delay)):
        found: list[Candidate] = []
        for orders in orders_of_step:
            starts = [*previous, *_same_plant(orders, structure, smaller)]
            candidate = scorer.candidate(structure, orders, starts)
            if candidate is not None:
                found.append(candidate)
        if not found:
            break
        candidates.extend(found)
        work += scorer.samples * sum(each.parameters for each in found)
        previous = [min(found, key=lambda each: each.bic).model]
        score = min(min(each.scores.simulation, each.scores.free_level) for each in found)
        bic = min(each.bic for each in found)
        gained = score < (1.0 - GAIN) * best or bic < best_bic - BIC_GAIN
        best, best_bic = min(best, score), min(best_bic, bic)
        without_gain = 0 if gained else without_gain + 1
        if without_gain >= PATIENCE or work >= MOST_WORK:
            break
    return StructureSearch(structure, tuple(candidates), _decision(structure, candidates))


def _decision(structure: str, candidates: Sequence[Candidate]) -> Decision:
    alternatives = tuple(Alternative(each.name, each.bic) for each in candidates)
    if not candidates:
        sentence = "The record is too short for this structure."
        return Decision(f"orders of {structure}", "none", (), "BIC", sentence)
    best = min(candidates, key=lambda each: each.bic)
    at_edge = best is candidates[-1]
    sentence = f"{best.name} has the smallest BIC of {len(candidates)} orders" + (
        ", the largest that was tried." if at_edge else "; larger ones bring nothing."
    )
    return Decision(f"orders of {structure}", best.name, alternatives, "BIC", sentence)


def _path(structure: str, delay: int) -> Iterator[list[Orders]]:
    """Orders from small to large; those of a step are alternatives of about the same size."""
    o = Orders
    build: Callable[[int], list[Orders]] = {
        "fir": lambda n: [o(nb=n, nk=delay)],
        "arx": lambda n: [o(na=n, nb=n, nk=delay), o(na=n, nb=2 * n, nk=max(delay - 1, 0))],
        "armax": lambda n: [o(na=n, nb=n, nc=n, nk=delay)],
        "ararx": lambda n: [o(na=n, nb=n, nd=max(n // 2, 1), nk=delay)],
        "ararmax": lambda n: [o(na=n, nb=n, nc=max(n // 2, 1), nd=1, nk=delay)],
        "oe": lambda n: [o(nb=n, nf=n, nk=delay), o(nb=n + 1, nf=n, nk=max(delay - 1, 0))],
        "bj": lambda n: [
            o(nb=n, nd=1, nf=n, nk=delay),
            o(nb=n, nc=2, nd=2, nf=n, nk=delay),
        ],
    }[structure]
    for n in LONG_PATH if structure == "fir" else PATH:
        yield build(n)
    if structure == "arx":
        for n in (30, 40):
            yield [o(na=n, nb=n, nk=delay)]


def _same_plant(
    orders: Orders, structure: str, smaller: Mapping[str, StructureSearch]
) -> list[PolynomialModel]:
    """Models of nested structures with as many poles."""
    poles = max(orders.na, orders.single.nf)
    return [
        candidate.model
        for name in NESTED[structure]
        if name in smaller
        for candidate in smaller[name].candidates
        if max(candidate.orders.na, candidate.orders.single.nf) == poles
    ]


def refine_orders(
    scorer: Scorer, start: Candidate, score: Callable[[Candidate], float], rounds: int = 2
) -> list[Candidate]:
    """Change one order after the other as long as a score falls; all that was tried, best last.

    Parameters
    ----------
    scorer : Scorer
    start : Candidate
    score : callable
        Smaller is better.
    rounds : int
    """
    best, tried, work = start, [start], 0
    for _ in range(rounds):
        found: list[Candidate] = []
        for orders in _neighbours(best.orders):
            if orders.structure != best.orders.structure or work >= MOST_WORK:
                continue
            work += scorer.samples * orders.parameters
            candidate = scorer.candidate(best.structure, orders, [best.model], own_starts=False)
            if candidate is not None:
                found.append(candidate)
        tried.extend(found)
        if not found:
            break
        lowest = min(found, key=score)
        if not score(lowest) < (1.0 - GAIN) * score(best):
            break
        best = lowest
    return [*tried, best]


def _neighbours(o: Orders) -> list[Orders]:
    changes: list[dict[str, int]] = [
        {"nb": o.single.nb + 1},
        {"nb": o.single.nb + 3},
        {"nk": o.single.nk + 1},
    ]
    if o.single.nb > 1:
        changes += [{"nb": o.single.nb - 1}, {"nk": o.single.nk + 1, "nb": o.single.nb - 1}]
    if o.single.nk > 0:
        changes += [{"nk": o.single.nk - 1, "nb": o.single.nb + 1}, {"nk": o.single.nk - 1}]
    for name in ("na", "nc", "nd", "nf"):
        order = getattr(o.single, name)
        if order:
            changes.append({name: order + 1})
            if order > 1:
                changes.append({name: order - 1})
    given = {name: getattr(o.single, name) for name in ORDER_NAMES}
    return [Orders(**(given | change)) for change in changes]
