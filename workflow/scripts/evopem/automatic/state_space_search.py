"""Searches behind the choice of a state-space model: delays, and all orders of each form.

Each variant, a form with a weighting, is searched over all orders: on all estimation samples for
its BIC, and on the training part of each fold for its errors on held-out samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decision import Alternative, Decision, given_by_configuration
from evopem.automatic.multichannel_folds import (
    DESIGNS,
    Fold,
    designs_of,
    fewest_fitted,
    folds_of,
    is_large,
    is_long,
)
from evopem.config.input_ranges import InputRanges
from evopem.config.state_space_settings import ModelForm, OutputWeighting, variant_name
from evopem.errors import InputError
from evopem.estimation.state_space.delays import estimate_delays
from evopem.estimation.state_space.estimate import (
    StateSpaceEstimate,
    descend_from,
    estimates_of_orders,
    refitted,
)
from evopem.estimation.state_space.noise_model import RISES, WIDTH, noise_model, side_by_side
from evopem.estimation.state_space.order_models import OrderModel, OrderModels
from evopem.estimation.state_space.problem import STEPS, USUAL_ORDER
from evopem.estimation.state_space.search import FINAL_WIDTH
from evopem.estimation.state_space.settings import Objective, StateSpaceSettings
from evopem.models.state_space import Form, StateSpaceModel
from evopem.signals.multichannel import MultichannelRecording

Array = NDArray[np.float64]
Log = Callable[[str], None]
Refit = Callable[[MultichannelRecording], StateSpaceModel]
"""The model that a descent ends at on parts of a record, from the one of the whole record."""

# Estimates of each order that are descended from on large records, whose estimates are good ones,
# and steps of these descents; also of those on folds of long records, from the optimum of all.
LARGE_WIDTH, LARGE_STEPS = 2, 12
# Folds of all designs from which on the worst one of a model is left out.
TRIMMED_FOLDS = 5
# Largest orders tried of plant and noise model, and output values for each parameter of the largest
# model.
MOST_STATES, MOST_NOISE_STATES, VALUES_PER_PARAMETER = 40, 10, 5
# Above this largest order they are tried in steps of two.
SINGLE_STEPS = 10
# Weighting of the output-error models that Box-Jenkins models begin with.
OUTPUT_ERROR_WEIGHTING: OutputWeighting = "noise"
# Errors beyond this, in percent, are all the same: useless.
LARGEST_ERROR = 1e3
LARGEST_DELAY = 10


@dataclass(frozen=True)
class Variant:
    """A form, or a structure of polynomial models, with a weighting of the outputs."""

    form: ModelForm
    weighting: OutputWeighting

    @property
    def name(self) -> str:
        """Such as ``innovations_determinant``."""
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
class DelayChoice:
    """Delays of the inputs in samples, 0 for one that acts on the same sample."""

    delays: tuple[int, ...]
    decision: Decision


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


def decide_delays(
    estimation: MultichannelRecording, ranges: InputRanges | None = None
) -> DelayChoice:
    """Decide the delay of each input by the BIC of vector ARX models.

    Parameters
    ----------
    estimation : MultichannelRecording
    ranges : InputRanges, optional

    Raises
    ------
    InputError
        When the ranges are those of other inputs.
    """
    ranges = ranges or InputRanges()
    given = ranges.of_inputs(estimation.input_names, "delay.nk") if estimation.has_input else ()
    limits = [each or (0, LARGEST_DELAY) for each in given]
    if all(low == high for low, high in limits):
        delays = tuple(low for low, _ in limits)
        return DelayChoice(delays, given_by_configuration("delays", _listed(delays) or "none"))
    smallest, largest = zip(*limits, strict=True)
    delays = estimate_delays(estimation.input_records, estimation.output_records, largest, smallest)
    alternatives = tuple(
        Alternative(f"{name}: {delay}", np.nan)
        for name, delay in zip(estimation.input_names, delays, strict=True)
    )
    return DelayChoice(
        delays,
        Decision(
            *("delays", _listed(delays), alternatives, "BIC of vector ARX models"),
            "The first lags of an input are left out as long as they explain nothing.",
        ),
    )


def searched_orders(
    estimation: MultichannelRecording, limits: tuple[int, int] | None
) -> tuple[int, ...]:
    """The orders that are tried: all that the record can determine, in steps of two where many.

    Parameters
    ----------
    estimation : MultichannelRecording
    limits : (lower, upper), optional

    Raises
    ------
    InputError
        When the record is too short for any of them.
    """
    samples, ny = estimation.outputs.shape
    nu = estimation.inputs.shape[1]
    low, high = limits or (1, MOST_STATES)
    fitted = fewest_fitted(estimation)
    # Each recording has an initial state of its own.
    affordable = fitted * ny // VALUES_PER_PARAMETER // (nu + 2 * ny + len(estimation.starts))
    affordable = min(affordable, samples // 12)
    if affordable < low:
        raise InputError(
            "orders.nx",
            f"{samples} estimation samples are too few for {low} state{'s' if low > 1 else ''} with"
            f" {nu} inputs and {ny} outputs",
            "record longer, lower orders.nx, or leave channels out",
        )
    high = min(high, affordable)
    if limits is None and high > SINGLE_STEPS:
        return tuple(range(2, high + 1, 2))
    return tuple(range(low, high + 1))


def noise_orders(estimation: MultichannelRecording) -> tuple[int, ...]:
    """The orders that are tried for a noise model beside an output-error model."""
    samples = estimation.samples
    of_order = 1 + len(estimation.starts)
    affordable = min(MOST_NOISE_STATES, samples // 12, samples // VALUES_PER_PARAMETER // of_order)
    if is_long(estimation):
        return tuple(range(2, max(affordable, 2) + 1, 2))
    return tuple(range(1, max(affordable, 1) + 1))


def search_variant(
    estimation: MultichannelRecording,
    variant: Variant,
    delays: Sequence[int],
    orders: Sequence[int],
    settings: StateSpaceSettings,
    log: Log | None = None,
) -> tuple[VariantSearch, OrderModels]:
    """Estimate every order of a variant, and score it on held-out samples.

    Parameters
    ----------
    estimation : MultichannelRecording
    variant : Variant
    delays, orders : sequence of int
    settings : StateSpaceSettings
    log : callable, optional
    """
    if variant.form == "box_jenkins":
        return _search_box_jenkins(estimation, variant, delays, orders, settings, log)
    settings = settings_of(variant.form, estimation, settings)
    estimates = estimates_of_orders(
        estimation.input_records,
        estimation.output_records,
        orders,
        form=searched_form(variant.form),
        delays=tuple(delays),
        settings=settings,
        width=LARGE_WIDTH if is_large(estimation) else FINAL_WIDTH,
        steps=_steps(estimation),
        log=log,
    )
    by_order = ((each.model.order, each) for each in estimates)
    refit_of = _refits(estimation, delays, settings)
    return searched_variant(
        *(estimation, variant, by_order, _plant, refit_of, settings.objective, log)
    )


def searched_form(form: ModelForm) -> Form:
    """The form of the models that a form of the configuration is searched with."""
    return "output_error" if form.startswith("output_error") else "innovations"


def settings_of(
    form: ModelForm, estimation: MultichannelRecording, settings: StateSpaceSettings
) -> StateSpaceSettings:
    """The settings of a form: where it has a drift, its shortest period.

    Slower changes of the outputs are those that scores on held-out samples do not count either,
    which fit a level of its own to each held-out part.
    """
    if form != "output_error_drift":
        return settings
    return replace(settings, drift_period=estimation.longest.samples / DESIGNS[-1])


def _plant(estimate: StateSpaceEstimate) -> StateSpaceModel:
    return estimate.model


def _search_box_jenkins(
    estimation: MultichannelRecording,
    variant: Variant,
    delays: Sequence[int],
    orders: Sequence[int],
    settings: StateSpaceSettings,
    log: Log | None,
) -> tuple[VariantSearch, OrderModels]:
    """The same for innovations form next to output-error models, whose orders these are.

    None on large records, where a descent takes too long.
    """
    if is_large(estimation):
        return VariantSearch.without_models(variant), OrderModels(())
    plants = estimates_of_orders(
        estimation.input_records,
        estimation.output_records,
        orders,
        form="output_error",
        delays=tuple(delays),
        settings=replace(settings, weighting=OUTPUT_ERROR_WEIGHTING),
        width=WIDTH,
        log=log,
    )

    def estimates() -> Iterator[tuple[int, StateSpaceEstimate]]:
        for each in plants:
            plant = each.model
            try:
                estimate = estimate_box_jenkins(estimation, plant, delays, settings)
            except ValueError:
                continue
            if log is not None:
                log(f"{variant.name}: {plant.order} of {estimate.model.order} states")
            yield plant.order, estimate

    refit_of = _refits(estimation, delays, settings)
    return searched_variant(
        *(estimation, variant, estimates(), _plant, refit_of, settings.objective, log)
    )


def searched_variant(
    estimation: MultichannelRecording,
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
    estimation : MultichannelRecording
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


def estimate_box_jenkins(
    estimation: MultichannelRecording,
    plant: StateSpaceModel,
    delays: Sequence[int],
    settings: StateSpaceSettings,
) -> StateSpaceEstimate:
    """The optimum of innovations form next to a plant with its noise model.

    Parameters
    ----------
    estimation : MultichannelRecording
    plant : StateSpaceModel
        Of output-error form.
    delays : sequence of int
    settings : StateSpaceSettings

    Raises
    ------
    ValueError
        When the record is too short, or the descent finds no stable model.
    """
    noise = noise_model(
        plant,
        estimation.input_records,
        estimation.output_records,
        noise_orders(estimation),
        settings,
    )
    start = replace(plant, form="innovations", covariance=None)
    beside = start if noise is None else side_by_side(plant, noise)
    return descended(beside, estimation, delays, settings)


def descended(
    model: StateSpaceModel,
    estimation: MultichannelRecording,
    delays: Sequence[int],
    settings: StateSpaceSettings,
) -> StateSpaceEstimate:
    """The optimum next to a model, on the estimation samples.

    Parameters
    ----------
    model : StateSpaceModel
    estimation : MultichannelRecording
    delays : sequence of int
    settings : StateSpaceSettings

    Raises
    ------
    ValueError
        When the record is too short, or the descent finds no stable model.
    """
    return descend_from(
        model,
        estimation.input_records,
        estimation.output_records,
        estimation.sampling_rate,
        delays=tuple(delays),
        settings=settings,
        input_names=estimation.input_names,
        output_names=estimation.output_names,
    )


def _refits(
    estimation: MultichannelRecording, delays: Sequence[int], settings: StateSpaceSettings
) -> Callable[[StateSpaceEstimate], Refit]:
    """How estimates are fitted to other samples."""

    def refit_of(estimate: StateSpaceEstimate) -> Refit:
        model = replace(estimate.model, covariance=None)
        return lambda training: refitted(
            model,
            training.input_records,
            training.output_records,
            delays=tuple(delays),
            settings=settings,
            steps=LARGE_STEPS if is_long(estimation) else STEPS,
        )

    return refit_of


def _scored(
    estimation: MultichannelRecording,
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


def _steps(estimation: MultichannelRecording) -> int:
    """Steps of a descent of the search over orders."""
    return LARGE_STEPS if is_large(estimation) else STEPS


def _listed(delays: Sequence[int]) -> str:
    return ", ".join(map(str, delays))
