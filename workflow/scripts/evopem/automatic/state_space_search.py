"""The search of state-space models of a form over its orders.

Estimates of each order are descended from; Box-Jenkins models begin with an output-error model and
a noise model beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from evopem.automatic.multichannel_folds import DESIGNS, is_large, is_long
from evopem.automatic.searched_orders import noise_orders
from evopem.automatic.variant_search import Refit, Variant, VariantSearch, searched_variant
from evopem.config.state_space_settings import ModelForm, OutputWeighting
from evopem.estimation.state_space.estimate import StateSpaceEstimate, descend_from, refitted
from evopem.estimation.state_space.noise_model import WIDTH, noise_model, side_by_side
from evopem.estimation.state_space.order_models import OrderModels
from evopem.estimation.state_space.order_sweep import estimates_of_orders
from evopem.estimation.state_space.problem import STEPS
from evopem.estimation.state_space.search import FINAL_WIDTH
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.models.state_space import Form, StateSpaceModel
from evopem.signals.multichannel import MultichannelRecording

Log = Callable[[str], None]

# Estimates of each order that are descended from on large records, whose estimates are good ones,
# and steps of these descents; also of those on folds of long records, from the optimum of all.
LARGE_WIDTH, LARGE_STEPS = 2, 12
# Weighting of the output-error models that Box-Jenkins models begin with.
OUTPUT_ERROR_WEIGHTING: OutputWeighting = "noise"


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
    noise = noise_beside(plant, estimation, settings)
    start = replace(plant, form="innovations", covariance=None)
    beside = start if noise is None else side_by_side(plant, noise)
    return descended(beside, estimation, delays, settings)


def noise_beside(
    plant: StateSpaceModel, estimation: MultichannelRecording, settings: StateSpaceSettings
) -> StateSpaceModel | None:
    """The model of what a plant leaves of the estimation samples; None where that is white.

    Parameters
    ----------
    plant : StateSpaceModel
        Of output-error form.
    estimation : MultichannelRecording
    settings : StateSpaceSettings
    """
    return noise_model(
        plant,
        estimation.input_records,
        estimation.output_records,
        noise_orders(estimation),
        settings,
    )


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


def _steps(estimation: MultichannelRecording) -> int:
    """Steps of a descent of the search over orders."""
    return LARGE_STEPS if is_large(estimation) else STEPS
