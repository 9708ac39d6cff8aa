"""Stabilization of poles over the model order, as in experimental modal analysis.

The poles of a structure stay where they are when the order of the model is increased; poles that
fit noise do not.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import median
from typing import Literal, Protocol

from evopem.models.modes import Mode
from evopem.models.polynomial import PolynomialModel
from evopem.models.state_space import StateSpaceModel


class Estimated(Protocol):
    """An estimate of a model."""

    @property
    def model(self) -> StateSpaceModel:
        """With its covariance."""

    @property
    def bic(self) -> float:
        """BIC of white errors."""


@dataclass(frozen=True, eq=False)
class OrderModel:
    """The model of one order."""

    order: int  # that was searched: with a noise model beside the plant there are more states
    bic: float
    # Without its covariance: large, and behind the errors of the modes.
    model: PolynomialModel | StateSpaceModel
    modes: tuple[Mode, ...]

    @classmethod
    def of(cls, order: int, bic: float, model: PolynomialModel | StateSpaceModel) -> OrderModel:
        """The entry of a model with its covariance."""
        return cls(order, bic, replace(model, covariance=None), tuple(model.modes()))

    @classmethod
    def of_estimate(cls, estimate: Estimated) -> OrderModel:
        """The entry of an estimate under its own order."""
        return cls.of(estimate.model.order, estimate.bic, estimate.model)


@dataclass(frozen=True, eq=False)
class OrderModels:
    """The models of all orders that a search of one form went through, by order."""

    models: tuple[OrderModel, ...]

    def of_order(self, order: int) -> StateSpaceModel:
        """The model of an order."""
        model = next(each.model for each in self.models if each.order == order)
        assert isinstance(model, StateSpaceModel)
        return model

    def with_model(self, changed: OrderModel) -> OrderModels:
        """The same with another model of one order."""
        kept = (each for each in self.models if each.order != changed.order)
        return OrderModels(tuple(sorted([*kept, changed], key=lambda each: each.order)))


# A pole is stable from one order to the next when its natural frequency changes by less than 1 %
# and its damping ratio by less than 10 %, the usual thresholds of modal analysis (Ewins 2000).
FREQUENCY_TOLERANCE = 0.01
DAMPING_TOLERANCE = 0.10
# Stable poles whose frequencies differ by less than this share belong to one mode.
SAME_MODE = 0.02
# A mode persists when its pole appears at this many successive orders.
PERSISTENT_ORDERS = 3

Status = Literal["new", "frequency", "stable"]


@dataclass(frozen=True)
class StabilizationPole:
    """An oscillating pole at one order of a stabilization diagram.

    Its status compares it with the poles of the next lower order: none at this frequency, one at
    this frequency, or one at this frequency and damping ratio.
    """

    order: int
    frequency_hz: float
    damping_ratio: float
    status: Status


def stabilization(models: Iterable[tuple[int, PolynomialModel, float]]) -> list[StabilizationPole]:
    """Compare the poles of models, each with those of the next lower order, na.

    ``models`` are (order, model, BIC), of one order that with the smallest BIC counts.
    The poles come by order, then by frequency.
    """
    best: dict[int, tuple[float, PolynomialModel]] = {}
    for order, model, bic in models:
        if order not in best or bic < best[order][0]:
            best[order] = (bic, model)
    return stabilization_of_modes({order: model.modes() for order, (_, model) in best.items()})


class ModeOfOrder(Protocol):
    """What is compared of a mode."""

    @property
    def frequency_hz(self) -> float:
        """Natural frequency in Hz."""

    @property
    def damping_ratio(self) -> float:
        """Damping ratio."""


def stabilization_of_modes(
    modes_of: Mapping[int, Sequence[ModeOfOrder]],
) -> list[StabilizationPole]:
    """The same of modes by the order of their model."""
    poles: list[StabilizationPole] = []
    below: Sequence[ModeOfOrder] = []
    for order in sorted(modes_of):
        modes = modes_of[order]
        poles += [
            StabilizationPole(order, mode.frequency_hz, mode.damping_ratio, _status(mode, below))
            for mode in modes
        ]
        below = modes
    return poles


def persistent_frequencies(poles: Sequence[StabilizationPole]) -> list[float]:
    """Median natural frequencies in Hz of the modes that persist over the orders.

    Stable poles are grouped by frequency. A group persists when it covers
    :data:`PERSISTENT_ORDERS` orders; a pole that is stable at n - 1 orders was present at n.
    """
    stable = sorted(
        (pole for pole in poles if pole.status == "stable"), key=lambda pole: pole.frequency_hz
    )
    groups = [stable[:1]]
    for lower, upper in pairwise(stable):
        if upper.frequency_hz - lower.frequency_hz > SAME_MODE * upper.frequency_hz:
            groups.append([])
        groups[-1].append(upper)
    return [
        median(pole.frequency_hz for pole in group)
        for group in groups
        if len({pole.order for pole in group}) >= PERSISTENT_ORDERS - 1
    ]


def _status(mode: ModeOfOrder, below: Sequence[ModeOfOrder]) -> Status:
    width = FREQUENCY_TOLERANCE * mode.frequency_hz
    near = [other for other in below if abs(other.frequency_hz - mode.frequency_hz) <= width]
    if not near:
        return "new"
    tolerance = DAMPING_TOLERANCE * abs(mode.damping_ratio)
    alike = any(abs(other.damping_ratio - mode.damping_ratio) <= tolerance for other in near)
    return "stable" if alike else "frequency"
