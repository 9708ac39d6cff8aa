"""Remedies of failed checks tried in turn, on models of one channel and of several."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from evopem.automatic.record import Trial

Model = TypeVar("Model")
Remedy = TypeVar("Remedy")

# A remedy is taken only if the error for the purpose grows by no more than this share.
TOLERATED = 0.02
DELAY = "Delay"
"""The check that a model has the delays which its residuals ask for."""


@dataclass(frozen=True, eq=False)
class Attempt(Generic[Model]):
    """The model that a remedy gave, and what came of it."""

    model: Model
    trial: Trial


class Budget:
    """Remedies that may be tried in all.

    Parameters
    ----------
    remedies : int
    """

    def __init__(self, remedies: int) -> None:
        self._left = remedies

    def of(self, remedies: Iterable[Remedy]) -> Iterator[Remedy]:
        """As many of some remedies as are left; each one is spent as it is given."""
        for remedy in remedies:
            if self._left == 0:
                return
            self._left -= 1
            yield remedy


def tried_in_turn(
    remedies: Iterable[Remedy],
    model: Model,
    attempt: Callable[[Remedy, Model], Attempt[Model] | None],
    suffices: Callable[[Model], bool],
) -> tuple[Model, list[Attempt[Model]]]:
    """The model after some remedies, and all attempts.

    Parameters
    ----------
    remedies : iterable
    model : Model
        Before the remedies.
    attempt : callable
        What a remedy gives where a model is the best so far; None where no model can be estimated.
    suffices : callable
        Whether no further remedy is needed for a model that was taken.
    """
    attempts = []
    for remedy in remedies:
        found = attempt(remedy, model)
        if found is None:
            continue
        attempts.append(found)
        if found.trial.taken:
            model = found.model
            if suffices(model):
                break
    return model, attempts
