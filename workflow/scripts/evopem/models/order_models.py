"""The models of all orders of one form, as a search over orders leaves them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

from evopem.models.modes import Mode
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
    """The model of one order.

    Attributes
    ----------
    order : int
        The order that was searched; a model with a noise model beside the plant has more states.
    bic : float
    model : StateSpaceModel
        Without its covariance, which is large and behind the standard errors of the modes.
    modes : tuple of Mode
    """

    order: int
    bic: float
    model: StateSpaceModel
    modes: tuple[Mode, ...]

    @classmethod
    def of(cls, order: int, bic: float, model: StateSpaceModel) -> OrderModel:
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
        return next(each.model for each in self.models if each.order == order)

    def with_model(self, changed: OrderModel) -> OrderModels:
        """The same with another model of one order."""
        kept = (each for each in self.models if each.order != changed.order)
        return OrderModels(tuple(sorted([*kept, changed], key=lambda each: each.order)))
