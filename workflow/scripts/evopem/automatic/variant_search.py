"""The evidence for the orders of a form: BIC on all samples, and errors on held-out ones.

The BIC is that of models of all estimation samples.  Up to the order of the lowest one, models are
fitted to the training part of each fold, and scored on its held-out part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.multichannel_folds import Fold, designs_of, folds_of
from evopem.config.settings import ModelForm, Objective, OutputWeighting
from evopem.config.structures import variant_name
from evopem.estimation.state_space.noise_model import RISES
from evopem.estimation.state_space.starting_models import USUAL_ORDER
from evopem.models.stabilization import OrderModel, OrderModels
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording

Array = NDArray[np.float64]
Log = Callable[[str], None]

Refit = Callable[[Recording], StateSpaceModel]
"""The model that a descent ends at on parts of a record, from the one of the whole record."""

# Folds of all designs from which on the worst one of a model is left out.
TRIMMED_FOLDS = 5
# Errors beyond this, in percent, are all the same: useless.
LARGEST_ERROR = 1e3


@dataclass(frozen=True)
class Variant:
    """A form, or a structure of polynomial models, with a weighting of the outputs."""

    form: ModelForm
    weighting: OutputWeighting

    @property
    def name(self) -> str:
        """Such as ``ss_determinant``."""
        return variant_name(self.form, self.weighting)


class ScoredEstimate(Protocol):
    """What an order is scored by on all samples."""

    @property
    def bic(self) -> float:
        """BIC of white errors."""

    @property
    def coloured_bic(self) -> float:
        """BIC of the innovations of an autoregression of the errors."""


Estimate = TypeVar("Estimate", bound=ScoredEstimate)


@dataclass(frozen=True)
class FoldErrors:
    """Errors in percent of the models of all orders on one fold, mean over the outputs."""

    simulation: tuple[float, ...]
    free_level: tuple[float, ...]
    prediction: tuple[float, ...]


@dataclass(frozen=True)
class VariantSearch:
    """The orders of one variant, with their evidence.

    Attributes
    ----------
    variant : Variant
    orders : tuple of int
        Up to that of the lowest BIC.
    tried : tuple of int
        All orders whose BIC was computed.
    bic : tuple of float
        Of models of all estimation samples, of all orders tried.
    coloured_bic : tuple of float
        Of these models with a vector autoregression of their errors, of all orders: comparable
        between forms with and without a noise model.
    simulation, free_level, prediction : tuple of float
        Errors on held-out samples in percent, one step ahead for prediction: root mean square over
        the folds of all designs, without the worst one of each model where there are enough.
        Simulations run on from the samples before; with a free level each held-out part has one
        of its own.
    folds : tuple of FoldErrors
        Errors of the models of all orders on each fold of the design with most folds.
    """

    variant: Variant
    orders: tuple[int, ...]
    tried: tuple[int, ...]
    bic: tuple[float, ...]
    coloured_bic: tuple[float, ...]
    simulation: tuple[float, ...]
    free_level: tuple[float, ...]
    prediction: tuple[float, ...]
    folds: tuple[FoldErrors, ...]

    @classmethod
    def without_models(cls, variant: Variant) -> VariantSearch:
        """The search of a variant that no model could be estimated of."""
        return cls(variant, *((),) * 8)


def searched_variant(
    estimation: Recording,
    variant: Variant,
    estimates: Iterable[tuple[int, Estimate]],
    plant_of: Callable[[Estimate], StateSpaceModel],
    refit_of: Callable[[Estimate], Refit],
    objective: Objective,
    log: Log | None,
) -> tuple[VariantSearch, OrderModels]:
    """The search of a variant of any form, and the plants of its orders.

    Parameters
    ----------
    estimation : Recording
    variant : Variant
    estimates : iterable of (int, ScoredEstimate)
        Of all samples, by ascending order; ends as soon as their BIC rises.
    plant_of : callable
        The plant of an estimate in state space.
    refit_of : callable
        How an estimate is fitted to other samples.
    objective : {"quadratic", "absolute"}
        Of the errors on held-out samples.
    log : callable, optional
    """
    found = until_bic_rises(estimates)
    models = tuple(
        OrderModel.of(
            order,
            each.bic,
            replace(
                plant_of(each),
                sampling_rate=estimation.sampling_rate,
                input_names=estimation.input_names,
                output_names=estimation.output_names,
            ),
        )
        for order, each in found.items()
    )
    search = _scored(estimation, variant, found, refit_of, objective, log)
    return search, OrderModels(models)


def until_bic_rises(estimates: Iterable[tuple[int, Estimate]]) -> dict[int, Estimate]:
    """The estimates by order, up to where the BIC has risen so often that the search ends.

    From the usual largest order on it ends with the first rise, also of the BIC with the colour of
    the errors: states that only describe coloured errors would be added without end.

    Parameters
    ----------
    estimates : iterable of (int, ScoredEstimate)
        By ascending order; no more of them is taken than needed.
    """
    found: dict[int, Estimate] = {}
    lowest = lowest_coloured = np.inf
    rises = 0
    for order, estimate in estimates:
        found[order] = estimate
        rises = 0 if estimate.bic < lowest else rises + 1
        falls = rises == 0 and estimate.coloured_bic < lowest_coloured
        if rises >= RISES or (order >= USUAL_ORDER and not falls):
            break
        lowest = min(lowest, estimate.bic)
        lowest_coloured = min(lowest_coloured, estimate.coloured_bic)
    return found


def _scored(
    estimation: Recording,
    variant: Variant,
    estimates: Mapping[int, Estimate],
    refit_of: Callable[[Estimate], Refit],
    objective: Objective,
    log: Log | None,
) -> VariantSearch:
    """The search of a variant, with errors on held-out samples up to the lowest BIC."""
    if not estimates:
        return VariantSearch.without_models(variant)
    bic = {order: each.bic for order, each in estimates.items()}
    orders = _up_to_lowest(bic)
    refits = [refit_of(estimates[order]) for order in orders]
    of_designs = []
    for count in designs_of(estimation):
        folds = _told(folds_of(estimation, count), variant, log)
        of_designs.append(_errors_of_folds(folds, refits, objective))
    scores = _without_worst_fold(np.concatenate(of_designs))
    simulation, free_level, prediction = (tuple(map(float, row)) for row in scores)
    return VariantSearch(
        variant,
        orders,
        tuple(bic),
        tuple(map(float, bic.values())),
        tuple(float(estimates[order].coloured_bic) for order in orders),
        simulation,
        free_level,
        prediction,
        tuple(FoldErrors(*(tuple(map(float, row)) for row in fold)) for fold in of_designs[-1]),
    )


def _up_to_lowest(bic: Mapping[int, float]) -> tuple[int, ...]:
    """The orders up to that of the lowest BIC.

    Errors that are not white raise the order of BIC, but never lower it.
    """
    lowest = min(bic, key=lambda order: bic[order])
    return tuple(order for order in bic if order <= lowest)


def _told(folds: Sequence[Fold], variant: Variant, log: Log | None) -> Iterator[Fold]:
    """The folds of a design, each one after a line that says so."""
    for number, fold in enumerate(folds, start=1):
        if log is not None:
            log(f"{variant.name}: fold {number} of {len(folds)}")
        yield fold


def _errors_of_folds(folds: Iterable[Fold], refits: Sequence[Refit], objective: Objective) -> Array:
    """Errors of each model on each fold of a design, (folds, 3, models), mean over the outputs.

    Simulation with the level of the training part and with a free one, and prediction.  The
    training part of a fold is fitted by a descent from the model of all samples: so it is the
    same optimum that is scored.
    """
    relative = []
    for fold in folds:
        of_fold = np.full((3, len(refits)), np.inf)
        for place, refit in enumerate(refits):
            try:
                fitted = refit(fold.training)
            except ValueError:
                continue
            errors = np.minimum(fold.errors(fitted, objective), LARGEST_ERROR)
            of_fold[:, place] = errors.mean(axis=-1)
        relative.append(of_fold)
    return np.array(relative).reshape(-1, 3, len(refits))


def _without_worst_fold(errors: Array) -> Array:
    """Root mean square over all folds of (folds, 3, models) errors but the worst of each model.

    A slow pole of a model of high order makes a simulation drift on one fold, or not, by the last
    digits of the descent that fits its training part.  That alone shall not decide.
    """
    kept = np.sort(errors, axis=0)
    if len(kept) >= TRIMMED_FOLDS:
        kept = kept[:-1]
    return np.sqrt(np.mean(kept**2, axis=0))
