"""Choice of a state-space model: delays, form, weighting of the outputs, and order.

Each variant, a form with a weighting, is searched over all orders: on all estimation samples for
its BIC, and on the training part of each fold for its errors on held-out samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decision import Alternative, Decision, given_by_configuration
from evopem.config.state_space_settings import (
    OutputWeighting,
    StateSpaceChoices,
    StateSpaceForm,
)
from evopem.errors import InputError
from evopem.estimation.state_space.delays import estimate_delays
from evopem.estimation.state_space.estimate import (
    StateSpaceEstimate,
    StateSpaceSettings,
    descend_from,
    errors_on,
    estimates_of_orders,
    models_of_orders,
)
from evopem.estimation.state_space.noise_model import RISES, noise_model, side_by_side
from evopem.models.state_space import Form, StateSpaceModel
from evopem.signals.multichannel import MultichannelRecording

Array = NDArray[np.float64]
Log = Callable[[str], None]
ModelsOf = Callable[[Sequence[MultichannelRecording], int], Iterator[tuple[int, StateSpaceModel]]]

# Designs of folds, each a number of folds of consecutive samples: few long ones show errors of the
# gain and of slow poles, many leave more samples to fit.  Large records have the first alone.
DESIGNS = (2, 5)
LARGE = 100_000
SHORTEST_FOLD = 40
# Largest orders tried of plant and noise model, and output values for each parameter of the largest
# model.
MOST_STATES, MOST_NOISE_STATES, VALUES_PER_PARAMETER = 20, 10, 5
# Above this largest order they are tried in steps of two.
SINGLE_STEPS = 10
# Weighting of the output-error models that Box-Jenkins models begin with.
OUTPUT_ERROR_WEIGHTING: OutputWeighting = "noise"
# Errors beyond this, in percent, are all the same: useless.
LARGEST_ERROR = 1e3
# A smaller order is taken whose score is within this share of the lowest.
MARGIN = 0.01
LARGEST_DELAY = 10


@dataclass(frozen=True)
class Variant:
    """A form with a weighting of the outputs."""

    form: StateSpaceForm
    weighting: OutputWeighting

    @property
    def name(self) -> str:
        """Such as ``innovations_determinant``."""
        return f"{self.form}_{self.weighting}"


@dataclass(frozen=True)
class DelayChoice:
    """Delays of the inputs in samples, 0 for one that acts on the same sample."""

    delays: tuple[int, ...]
    decision: Decision


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
    simulation, prediction : tuple of float
        Errors on held-out samples in percent, one step ahead for prediction: the geometric mean
        over the designs of the folds.
    """

    variant: Variant
    orders: tuple[int, ...]
    tried: tuple[int, ...]
    bic: tuple[float, ...]
    simulation: tuple[float, ...]
    prediction: tuple[float, ...]


@dataclass(frozen=True)
class StateSpaceChoice:
    """The variant and order of the model, and the decisions that led to them."""

    variant: Variant
    order: int
    purpose: str
    decisions: tuple[Decision, ...]


def decide_delays(estimation: MultichannelRecording, limits: tuple[int, int] | None) -> DelayChoice:
    """Decide the delay of each input by the BIC of vector ARX models.

    Parameters
    ----------
    estimation : MultichannelRecording
    limits : (lower, upper), optional
    """
    nu = estimation.inputs.shape[1]
    low, high = limits or (0, LARGEST_DELAY)
    if nu == 0 or low == high:
        delays = (low,) * nu
        return DelayChoice(delays, given_by_configuration("delays", _listed(delays) or "none"))
    delays = estimate_delays(estimation.inputs, estimation.outputs, high, low)
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
    estimation: MultichannelRecording, limits: tuple[int, int] | None, place: str
) -> tuple[int, ...]:
    """The orders that are tried: all that the record can determine, in steps of two where many.

    Parameters
    ----------
    estimation : MultichannelRecording
    limits : (lower, upper), optional
    place : str
        Configuration key of the data set, for an error to name.

    Raises
    ------
    InputError
        When the record is too short for any of them.
    """
    samples, ny = estimation.outputs.shape
    nu = estimation.inputs.shape[1]
    low, high = limits or (1, MOST_STATES)
    # A fold of two leaves half of the samples.
    affordable = samples * ny // 2 // VALUES_PER_PARAMETER // (nu + 2 * ny + 1)
    affordable = min(affordable, samples // 12)
    if affordable < low:
        raise InputError(
            f"{place}.orders.nx",
            f"{samples} estimation samples are too few for {low} states with {nu} inputs and {ny}"
            " outputs",
            "record longer, or lower orders.nx",
        )
    high = min(high, affordable)
    if limits is None and high > SINGLE_STEPS:
        return tuple(range(2, high + 1, 2))
    return tuple(range(low, high + 1))


def noise_orders(estimation: MultichannelRecording) -> tuple[int, ...]:
    """The orders that are tried for a noise model beside an output-error model."""
    samples = estimation.samples
    affordable = min(MOST_NOISE_STATES, samples // 12, samples // VALUES_PER_PARAMETER // 2)
    if _is_large(estimation):
        return tuple(range(2, max(affordable, 2) + 1, 2))
    return tuple(range(1, max(affordable, 1) + 1))


def search_variant(
    estimation: MultichannelRecording,
    variant: Variant,
    delays: Sequence[int],
    orders: Sequence[int],
    settings: StateSpaceSettings,
    log: Log | None = None,
) -> VariantSearch:
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
    form: Form = "output_error" if variant.form == "output_error" else "innovations"
    found: dict[int, float] = {}
    for estimate in estimates_of_orders(
        estimation.inputs if estimation.has_input else None,
        estimation.outputs,
        orders,
        form=form,
        delays=tuple(delays),
        settings=settings,
        log=log,
    ):
        found[estimate.model.order] = estimate.bic
        if list(found.values()).index(min(found.values())) < len(found) - RISES:
            break
    orders = _up_to_lowest(found)

    def models(
        parts: Sequence[MultichannelRecording], fold: int
    ) -> Iterator[tuple[int, StateSpaceModel]]:
        for model in models_of_orders(
            [part.inputs for part in parts] if estimation.has_input else None,
            [part.outputs for part in parts],
            orders,
            form=form,
            delays=tuple(delays),
            settings=settings,
            fold=fold,
        ):
            yield model.order, model

    return _scored(estimation, variant, orders, found, models, log)


def _search_box_jenkins(
    estimation: MultichannelRecording,
    variant: Variant,
    delays: Sequence[int],
    orders: Sequence[int],
    settings: StateSpaceSettings,
    log: Log | None,
) -> VariantSearch:
    """The same for innovations form next to output-error models, whose orders these are.

    None on large records, where a descent takes too long.
    """
    if _is_large(estimation):
        return VariantSearch(variant, (), (), (), (), ())
    found: dict[int, float] = {}
    noise: dict[int, int] = {}
    plants = models_of_orders(
        estimation.inputs,
        estimation.outputs,
        orders,
        form="output_error",
        delays=tuple(delays),
        settings=replace(settings, weighting=OUTPUT_ERROR_WEIGHTING),
    )
    for plant in plants:
        try:
            estimate = estimate_box_jenkins(estimation, plant, delays, settings, polish=False)
        except ValueError:
            continue
        noise[plant.order] = estimate.model.order - plant.order
        found[plant.order] = estimate.bic
        if log is not None:
            log(f"{variant.name}: {plant.order} and {noise[plant.order]} states")
        if list(found.values()).index(min(found.values())) < len(found) - RISES:
            break
    if not found:
        return VariantSearch(variant, (), (), (), (), ())
    orders = _up_to_lowest(found)

    def models(
        parts: Sequence[MultichannelRecording], fold: int
    ) -> Iterator[tuple[int, StateSpaceModel]]:
        inputs, outputs = [part.inputs for part in parts], [part.outputs for part in parts]
        for plant in models_of_orders(
            inputs,
            outputs,
            range(orders[0], orders[-1] + 1, orders[1] - orders[0] if len(orders) > 1 else 1),
            form="output_error",
            delays=tuple(delays),
            settings=replace(settings, weighting=OUTPUT_ERROR_WEIGHTING),
            fold=fold,
        ):
            if plant.order not in noise:
                continue
            same = (noise[plant.order],) if noise[plant.order] else ()
            try:
                found = _box_jenkins(inputs, outputs, plant, delays, same, settings, polish=False)
            except ValueError:
                continue
            yield plant.order, found.model

    return _scored(estimation, variant, orders, found, models, log)


def estimate_box_jenkins(
    estimation: MultichannelRecording,
    plant: StateSpaceModel,
    delays: Sequence[int],
    settings: StateSpaceSettings,
    polish: bool = True,
) -> StateSpaceEstimate:
    """The optimum of innovations form next to a plant with its noise model.

    Parameters
    ----------
    estimation : MultichannelRecording
    plant : StateSpaceModel
        Of output-error form.
    delays : sequence of int
    settings : StateSpaceSettings
    polish : bool
        Whether the descent goes on to the last digits.

    Raises
    ------
    ValueError
        When the record is too short, or the descent finds no stable model.
    """
    tried = noise_orders(estimation)
    found = _box_jenkins(
        [estimation.inputs], [estimation.outputs], plant, delays, tried, settings, polish
    )
    model = replace(
        found.model,
        sampling_rate=estimation.sampling_rate,
        input_names=estimation.input_names,
        output_names=estimation.output_names,
    )
    return replace(found, model=model)


def _box_jenkins(
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    plant: StateSpaceModel,
    delays: Sequence[int],
    orders: Sequence[int],
    settings: StateSpaceSettings,
    polish: bool,
) -> StateSpaceEstimate:
    noise = noise_model(plant, inputs, outputs, orders, settings) if orders else None
    start = plant if noise is None else side_by_side(plant, noise)
    return descend_from(
        start, list(inputs), list(outputs), delays=tuple(delays), settings=settings, polish=polish
    )


def _scored(
    estimation: MultichannelRecording,
    variant: Variant,
    orders: tuple[int, ...],
    bic: Mapping[int, float],
    models: ModelsOf,
    log: Log | None,
) -> VariantSearch:
    """The search of a variant with the errors of its models on held-out samples."""
    scores = []
    for count in _designs(estimation):
        scores.append(_design_scores(estimation, count, orders, models))
        if log is not None:
            log(f"{variant.name}: {count} folds")
    with np.errstate(divide="ignore"):
        mean = np.exp(np.mean(np.log(np.array(scores)), axis=0))
    return VariantSearch(
        variant,
        orders,
        tuple(bic),
        tuple(map(float, bic.values())),
        tuple(map(float, mean[0])),
        tuple(map(float, mean[1])),
    )


def choose(searches: Sequence[VariantSearch], choices: StateSpaceChoices) -> StateSpaceChoice:
    """Choose the variant and the order with the lowest error on held-out samples.

    Parameters
    ----------
    searches : sequence of VariantSearch
        Simpler ones first.
    choices : StateSpaceChoices
    """
    has_input = any(each.variant.form == "output_error" for each in searches) or any(
        np.isfinite(each.simulation).any() for each in searches
    )
    purpose = choices.purpose
    if purpose in ("auto", "modes"):
        purpose = "simulation" if has_input else "prediction"
    scored = [
        (getattr(each, purpose)[position], order, rank, each.variant)
        for rank, each in enumerate(searches)
        for position, order in enumerate(each.orders)
    ]
    finite = [entry for entry in scored if np.isfinite(entry[0])] or scored
    lowest_score = min(entry[0] for entry in finite)
    near = [e for e in finite if e[3] == min(finite)[3] and e[0] <= (1.0 + MARGIN) * lowest_score]
    _, order, _, variant = min(near or finite, key=lambda entry: (entry[1], entry[2]))
    unit = (
        "simulation error on held-out samples, %"
        if purpose == "simulation"
        else "one-step error on held-out samples, %"
    )
    best = tuple(
        Alternative(each.variant.name, float(np.nanmin(getattr(each, purpose))))
        for each in searches
        if each.orders
    )
    own = next(each for each in searches if each.variant == variant)
    orders = tuple(
        Alternative(str(n), float(score))
        for n, score in zip(own.orders, getattr(own, purpose), strict=True)
    )
    decisions = (
        Decision(
            *("form and weighting", variant.name, best, unit),
            f"Models of parts of the estimation samples are scored on the others; the lowest score"
            f" is for {purpose}.",
        ),
        Decision(
            *("order", str(order), orders, unit),
            f"The smallest order within {100 * MARGIN:g} % of the lowest score, up to the order of"
            f" the lowest BIC, {own.orders[-1]}.",
        ),
    )
    return StateSpaceChoice(variant, order, purpose, decisions)


def _up_to_lowest(bic: Mapping[int, float]) -> tuple[int, ...]:
    """The orders up to that of the lowest BIC.

    Errors that are not white raise the order of BIC, but never lower it.
    """
    lowest = min(bic, key=lambda order: bic[order])
    return tuple(order for order in bic if order <= lowest)


def _designs(estimation: MultichannelRecording) -> tuple[int, ...]:
    if _is_large(estimation):
        return DESIGNS[:1]
    return tuple(n for n in DESIGNS if estimation.samples >= n * SHORTEST_FOLD) or DESIGNS[:1]


def _design_scores(
    estimation: MultichannelRecording, count: int, orders: Sequence[int], models: ModelsOf
) -> Array:
    """Errors of simulation and prediction by order, over all folds of one design, (2, orders)."""
    edges = np.linspace(0, estimation.samples, count + 1).round().astype(int)
    ny = estimation.outputs.shape[1]
    squares = np.zeros((2, len(orders), ny))
    reference = np.zeros(ny)
    place = {order: position for position, order in enumerate(orders)}
    for fold, (first, stop) in enumerate(pairwise(edges)):
        held = estimation.between(first, stop)
        ends = (estimation.between(0, first), estimation.between(stop, estimation.samples))
        parts = [part for part in ends if part.samples >= SHORTEST_FOLD // 2]
        power = np.sum((held.outputs - held.outputs.mean(axis=0)) ** 2, axis=0)
        reference += power
        seen = set()
        for order, model in models(parts, 100 * count + fold):
            at = place[order]
            seen.add(at)
            for row, relative in enumerate(errors_on(model, held.inputs, held.outputs)):
                squares[row, at] += (np.minimum(relative, LARGEST_ERROR) / 100.0) ** 2 * power
        for at in set(place.values()) - seen:
            squares[:, at] = np.inf
    errors: Array = 100.0 * np.sqrt(squares / reference).mean(axis=2)
    if not estimation.has_input:
        errors[0] = np.nan
    return errors


def _is_large(estimation: MultichannelRecording) -> bool:
    channels = estimation.inputs.shape[1] + estimation.outputs.shape[1]
    return estimation.samples * channels > LARGE


def _listed(delays: Sequence[int]) -> str:
    return ", ".join(map(str, delays))
