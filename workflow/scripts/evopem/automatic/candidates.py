"""Limits of orders, and candidates: models with the scores that they are compared by."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter

import numpy as np

from evopem.automatic.candidate_checks import CandidateChecks, check_model
from evopem.automatic.cross_validation.folds import (
    KINDS,
    LONGEST_PAST,
    LONGEST_RESPONSE,
    FoldPlan,
    HeldOutScores,
    held_out_scores,
)
from evopem.automatic.cross_validation.simulation import Model, errors_simulated_on
from evopem.automatic.cross_validation.stretches import MOST_SAMPLES, first_samples
from evopem.automatic.decision import Decision
from evopem.automatic.fit import (
    CommonSettings,
    Fit,
    fit,
    fits_in_state_space,
    fits_of_parts,
    log_loss,
    refit,
)
from evopem.config.channels import of_each
from evopem.config.settings import OrderRanges, Range
from evopem.config.structures import REGULARISED, STRUCTURES, varied_order
from evopem.errors import NoModelError
from evopem.models.orders import PER_INPUT, Orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Segment, total_samples

# Largest order of the paths of polynomial structures: criteria count the samples behind its past.
LARGEST_ORDER = 20
SAMPLES_PER_PARAMETER = 8
# An error must fall by this share to count as a gain; candidates are scored on folds until so many
# in a row bring none: about a quarter of them, with the lowest errors of all.
GAIN, SCORED_IN_VAIN = 0.005, 6


@dataclass(frozen=True)
class OrderLimits:
    """Lowest and highest orders of a search; a structure without an order has no limit of it."""

    structure: str | None = None  # the only structure that may be chosen
    ranges: OrderRanges = field(default_factory=OrderRanges)
    names: tuple[str, ...] = ("input",)  # of the inputs

    def allow(self, structure: str, orders: Orders | None) -> bool:
        """Whether a structure, with orders if it is a polynomial one, may be chosen."""
        if self.structure not in (None, structure):
            return False
        return orders is None or self.clamped(structure, orders) == orders

    def within(self, structure: str, path: Iterable[list[Orders]]) -> Iterator[list[Orders]]:
        """A path of orders moved inside the limits, without repetitions."""
        known: set[Orders] = set()
        for step in path:
            moved = dict.fromkeys(self.clamped(structure, orders) for orders in step)
            new = [orders for orders in moved if orders not in known]
            known.update(new)
            if new:
                yield new

    def at_upper_ends(self, orders: Orders) -> tuple[str, ...]:
        """The orders that lie at the upper end of a range of several, such as "nb of hot"."""
        return tuple(
            f"{name} of {self.names[place]}" if name in PER_INPUT else name
            for name in STRUCTURES[orders.structure]
            if name != "nk"
            for place, (order, limits) in enumerate(self._each(name, orders))
            if limits is not None and limits[0] < limits[1] == order
        )

    def clamped(self, structure: str, orders: Orders) -> Orders:
        """The nearest orders that are allowed, of those that the structure has."""
        given = {name: getattr(orders, name) for name in STRUCTURES["general"]}
        for name in STRUCTURES[structure]:
            # The degree of A or F follows that of the plant.
            plant = self.ranges.plant if name == varied_order("plant", structure) else None
            near = tuple(_nearest(order, ends or plant) for order, ends in self._each(name, orders))
            given[name] = near if name in PER_INPUT else near[0]
        return Orders(**given)

    def _each(self, name: str, orders: Orders) -> list[tuple[int, Range | None]]:
        """An order, or that of each input, with its limits; InputError for those of others."""
        value, ranges = getattr(orders, name), getattr(self.ranges, name)
        if name not in PER_INPUT:
            return [(value, ranges)]
        key = f"{'delay' if name == 'nk' else 'orders'}.{name}"
        return list(zip(value, of_each(ranges, self.names, key), strict=True))


def _nearest(order: int, limits: Range | None) -> int:
    return order if limits is None else min(max(order, limits[0]), limits[1])


@dataclass(frozen=True)
class Candidate:
    """A model of some structure and orders with what it reaches.

    ``bic`` is that of the one-step residuals from a common sample on; ``simulation_bic`` the same
    formula with the errors of a simulation of the estimation part, whose initial states the first
    tenth of each stretch determines and which is scored after it, infinite without an input.  The
    model is fitted to the whole estimation part.
    """

    structure: str
    order: int  # states, or the largest degree of A and F, or coefficients of B without poles
    delays: tuple[int, ...]  # of the inputs
    parameters: int  # coefficients and levels
    bic: float
    simulation_bic: float
    scores: HeldOutScores
    model: Model  # in the form of its structure

    @property
    def polynomials(self) -> PolynomialModel | None:
        """The model of a polynomial structure; None in state space."""
        return self.model if isinstance(self.model, PolynomialModel) else None

    @property
    def orders(self) -> Orders:
        """Orders of the polynomials."""
        assert self.polynomials is not None
        return self.polynomials.orders

    @property
    def is_scored(self) -> bool:
        """Whether there are scores on held-out samples."""
        return bool(np.isfinite(self.scores.prediction))

    @property
    def has_poles(self) -> bool:
        """Whether the plant may oscillate."""
        if self.polynomials is None:
            return self.order >= 2
        return self.orders.na + max(self.orders.nf, default=0) >= 2

    @cached_property
    def name(self) -> str:
        """Structure and orders in a few letters."""
        if self.polynomials is None:
            return f"{self.structure}, {self.order} state{'s' * (self.order > 1)}"
        orders = self.orders
        if orders.inputs > 1:
            return str(replace(orders, structure=self.structure))
        shown = {n: getattr(orders.single, n) for n in ("na", "nb", "nc", "nd", "nf", "nk")}
        words = [f"{n}={order}" for n, order in shown.items() if order or n == "nk"]
        return f"{self.structure} {' '.join(words)}"


Score = Callable[[Candidate], float]

BIC: Score = attrgetter("bic")
SIMULATION_BIC: Score = attrgetter("simulation_bic")


@dataclass(frozen=True)
class StructureSearch:
    """All candidates of one structure, by ascending orders."""

    structure: str
    candidates: tuple[Candidate, ...]
    decision: Decision
    too_short: bool = False  # the record, for any candidate

    @property
    def orders(self) -> tuple[int, ...]:
        """The orders that were tried."""
        return tuple(dict.fromkeys(candidate.order for candidate in self.candidates))


class Scorer:
    """Fits and scores models of one record, each orders once.

    Structures and orders of a long record of one output are compared on its first ``MOST_SAMPLES``
    samples; :meth:`on_all_samples` fits what was chosen to all.

    ``limits``: of the orders of candidates.  ``delays``: of the inputs, of models whose orders have
    none.  ``likely``: delays of each input that are likely.  ``early``: short ones to try as well.
    """

    def __init__(
        self,
        stretches: Sequence[Segment],
        plan: FoldPlan,
        settings: CommonSettings,
        limits: OrderLimits = OrderLimits(),
        delays: tuple[int, ...] = (),
        likely: tuple[tuple[int, ...], ...] = (),
        early: tuple[int, ...] = (),
    ) -> None:
        self.whole, self.plan, self.settings = tuple(stretches), plan, settings
        self.limits, self.delays, self.likely, self.early = limits, delays, likely, early
        inputs, outputs = stretches[0].inputs.shape[1], stretches[0].outputs.shape[1]
        self.has_input = inputs > 0
        self.stretches = first_samples(stretches, MOST_SAMPLES) if outputs == 1 else self.whole
        self.samples = total_samples(self.stretches)
        self.window = min(
            4 * LARGEST_ORDER, min(stretch.samples for stretch in self.stretches) // 4
        )
        self._known: dict[tuple[str, Orders | int], Candidate] = {}
        self._checked: dict[Candidate, CandidateChecks] = {}

    @property
    def most_parameters(self) -> int:
        """Most parameters of an output that the record carries."""
        return max(4, round(self.independent_samples) // SAMPLES_PER_PARAMETER)

    @property
    def independent_samples(self) -> float:
        """Samples that tell something new, where residuals repeat with the input."""
        return self.samples * self.plan.repetition.independent

    @property
    def absolute(self) -> bool:
        """Whether errors are absolute instead of squared."""
        return self.settings.objective == "absolute"

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
        scored: bool = True,
        again: bool = False,
    ) -> Candidate | None:
        """The candidate of these orders; None where the record does not carry them.

        Descents start from the models, and with ``own_starts`` from estimates by linear algebra;
        ``scored`` on held-out samples; ``again`` where it is known, which stays if it is likelier.
        """
        key = (structure, orders)
        if again or key not in self._known:
            if not self.limits.allow(structure, orders):
                return None
            if not self._carries(structure, orders):
                return None
            try:
                fitted = fit(
                    self.stretches, orders, self.settings.objective, models, own_starts, structure
                )
            except NoModelError:
                return None
            candidate = self.described(structure, fitted)
            self._known[key] = min(self._known.get(key, candidate), candidate, key=BIC)
        return self.with_own_scores(self._known[key]) if scored else self._known[key]

    def _carries(self, structure: str, orders: Orders) -> bool:
        """Whether the record, and the training part of each fold, has samples for these orders."""
        if structure in REGULARISED:
            # Its prior stands in for samples; the first ones of each stretch have no known past.
            blocks = max(folds * blocks for folds, blocks in self.plan.designs)
            parts = max(len(self.stretches), blocks)
            past = orders.first_residual <= LONGEST_PAST * self.samples / parts
            return past and orders.parameters <= LONGEST_RESPONSE
        return orders.parameters + sum(orders.nf) + orders.noise_states <= self.most_parameters

    def with_scores(
        self, candidates: Sequence[Candidate], criteria: Sequence[Score] = (BIC, SIMULATION_BIC)
    ) -> list[Candidate]:
        """Candidates, of which those that may win have scores on held-out samples: by ascending
        criteria, until so many in a row lower no error."""
        scored: dict[Candidate, Candidate] = {}
        for criterion in criteria:
            lowest, without_gain = dict.fromkeys(KINDS, np.inf), 0
            for candidate in sorted(candidates, key=criterion):
                scored[candidate] = self.with_own_scores(candidate)
                errors = {kind: getattr(scored[candidate].scores, kind) for kind in KINDS}
                gained = any(errors[kind] < (1.0 - GAIN) * lowest[kind] for kind in KINDS)
                lowest = {kind: min(errors[kind], lowest[kind]) for kind in KINDS}
                without_gain = 0 if gained else without_gain + 1
                if without_gain >= SCORED_IN_VAIN:
                    break
        return [scored.get(candidate, candidate) for candidate in candidates]

    def with_own_scores(self, candidate: Candidate) -> Candidate:
        """A candidate with scores, which are computed once for each structure and orders."""
        known = candidate if candidate.is_scored else self.known(candidate)
        if not known.is_scored:
            known = self._known[_key(candidate)] = self.scored(candidate)
        return known

    def known(self, candidate: Candidate) -> Candidate:
        """The candidate of the same structure and orders, with scores if it has been scored."""
        return self._known.get(_key(candidate), candidate)

    def described(self, structure: str, fitted: Fit, order: int = 0) -> Candidate:
        """The candidate of a fit, without scores on held-out samples."""
        penalty, objective = self.penalty(fitted.parameters), self.settings.objective
        simulation_loss = np.inf
        if self.has_input:
            errors = [
                errors_simulated_on(fitted.model, None, s, True, self.absolute)
                for s in self.stretches
            ]
            simulation_loss = log_loss(np.concatenate(errors), objective)
        polynomials = fitted.model if isinstance(fitted.model, PolynomialModel) else None
        return Candidate(
            structure,
            order or (polynomials.orders.plant if polynomials is not None else 0),
            self.delays if polynomials is None else polynomials.orders.nk,
            fitted.parameters,
            log_loss(fitted.residuals_from(self.window), objective) + penalty,
            simulation_loss + penalty,
            HeldOutScores(),
            fitted.model,
        )

    def scored(self, candidate: Candidate) -> Candidate:
        """A candidate with its scores on held-out samples."""
        model = candidate.model

        def refitted(parts: Sequence[Sequence[Segment]]) -> Sequence[Model]:
            if isinstance(model, PolynomialModel):
                return fits_of_parts(parts, model, candidate.structure, self.settings.objective)
            return [self._refitted(candidate, stretches) for stretches in parts]

        scores = held_out_scores(self.stretches, self.plan, refitted, self.absolute)
        return replace(candidate, scores=scores)

    def _refitted(self, candidate: Candidate, stretches: Sequence[Segment]) -> Model:
        """The optimum of other stretches that a descent from a candidate's model ends at."""
        model, structure = candidate.model, candidate.structure
        if isinstance(model, PolynomialModel):
            objective = self.settings.objective
            return fit(stretches, model.orders, objective, [model], False, structure).model
        given = candidate.delays, self.settings
        try:
            return refit(model, structure, stretches, *given, self.stretches)
        except NoModelError:
            # A pole next to the unit circle may leave it on other samples.
            fits = fits_in_state_space(stretches, structure, (candidate.order,), *given)
            for _, fitted in fits:
                return fitted.model
            raise

    def checks(self, candidate: Candidate) -> CandidateChecks:
        """What the checks of the report say of a candidate, on the compared samples."""
        if candidate not in self._checked:
            given = candidate.model, candidate.structure, self.stretches, self.settings
            self._checked[candidate] = check_model(*given, candidate.delays)
        return self._checked[candidate]

    def on_all_samples(self, candidate: Candidate) -> Candidate:
        """The same orders, fitted to the whole record where the scores come from a part of it."""
        if self.samples == total_samples(self.whole):
            return candidate
        try:
            model = self._refitted(candidate, self.whole)
        except NoModelError:
            return candidate
        return replace(candidate, model=model)

    def remember(self, candidates: Sequence[Candidate]) -> None:
        """Take candidates as known that were scored before, with the same settings."""
        for candidate in candidates:
            self._known.setdefault(_key(candidate), candidate)


def _key(candidate: Candidate) -> tuple[str, Orders | int]:
    """What tells a candidate from the others of a record."""
    states = candidate.polynomials is None
    return candidate.structure, candidate.order if states else candidate.orders
