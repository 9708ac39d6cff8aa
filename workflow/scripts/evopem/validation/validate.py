"""A fitted model against the data: residual tests, prediction, and pure simulation.

The one-step prediction uses every measured output before a sample, the simulation inputs alone.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from evopem.arrays import Array
from evopem.config.settings import Objective, SpectrumSettings
from evopem.models.mode_matching import OrderModel
from evopem.models.polynomial import PolynomialModel, state_space_of
from evopem.models.state_space import StateSpaceModel
from evopem.signals.prepared_data import PreparedData
from evopem.signals.recording import Recording
from evopem.validation import spectra, tables
from evopem.validation.distortion import distortion_of, floors_of
from evopem.validation.held_out_tests import (
    NO_TEST,
    SIGNIFICANCE,
    HeldOutContribution,
    HeldOutTest,
    half_waves,
    joint_contribution_test,
    left_by,
    may_follow,
)
from evopem.validation.modal_parts import free_responses
from evopem.validation.mode_evidence import ModeTable, table_of_models
from evopem.validation.model_class import ModelClass, model_class
from evopem.validation.residual_tests import (
    CROSS_CORRELATION_LAGS,
    EstimationResiduals,
    ResidualCorrelation,
    autocorrelation_of,
    correlation_with_input,
    ljung_box_lags,
    whiteness_test,
)
from evopem.validation.responses import (
    HeldOut,
    Model,
    Responses,
    held_out_stretches,
    responses_of,
    stretches_of,
    unscored_samples,
)
from evopem.validation.validation import (
    InputValidation,
    OutputValidation,
    PairCorrelation,
    StretchErrors,
    Validation,
    ValidationTables,
)

LAGS = 1200  # largest lag of the autocorrelation of residuals
# Horizons of a decade, and the longest one.
DECADE = (1, 2, 3, 5, 7)
LONGEST = 1000
# Records of a model's noise that states are fitted to, 99 for 1 %, and samples before each at most.
DRAWN, MOST_PAST = 99, 10_000


def log_spaced_horizons(samples: int) -> tuple[int, ...]:
    """Horizons about evenly spaced in their logarithm, up to a quarter of a record.

    Examples
    --------
    >>> log_spaced_horizons(200)
    (1, 2, 3, 5, 7, 10, 20, 30, 50)
    """
    last = max(1, min(LONGEST, samples // 4))
    every = (10**decade * step for decade in range(4) for step in DECADE)
    return tuple(horizon for horizon in every if horizon <= last)


def validate(
    model: Model,
    prepared: PreparedData,
    objective: Objective = "quadratic",
    models: Sequence[OrderModel] = (),
    order: int = 0,
    spectrum: SpectrumSettings | None = None,
    fit_level: bool = False,
    tests: ModelClass | None = None,
) -> tuple[Validation, ValidationTables]:
    """Validate a model on the estimation samples and on samples it was not estimated from.

    ``objective``: what the estimate minimised.  ``models``: of all orders of the same samples, this
    one of ``order`` among them, for its modes.  ``fit_level``: a level of the simulation is fitted
    to the validation samples, else it sees none of their outputs: it runs on from the estimation
    samples, or from the first tenth of a recording without a past, which is not scored.  ``tests``:
    of the class of the model, where they are known.  Of a model without input there is no
    simulation.  ValueError when too few samples are left for a test.
    """
    held_out = held_out_stretches(model, prepared, fit_level)
    responses, form = responses_of(held_out, fit_level), state_space_of(model)
    if not responses.scored.any():
        raise ValueError("no validation sample is left to score; keep more samples for validation")
    tested = EstimationResiduals.of(_estimation_stretches(form, prepared.estimation))
    recorded = tables.recorded_series(prepared.transforms, responses)
    outputs, autocorrelations, horizons = _outputs(
        form, prepared, held_out, responses, recorded, tested, objective, spectrum
    )
    crossed = _crossed(tested, prepared.validation)
    models = models or [OrderModel.of(order, math.nan, model)]
    unseen = held_out if prepared.transforms.holds_out else ()
    tests = tests or model_class(_every_stretch(tested.stretches, unseen))
    distortion = distortion_of(held_out, tested.stretches, fit_level)
    input_test = input_significance(unseen)
    validation = Validation(
        samples=int(np.sum(responses.scored)),
        unscored_samples=int(np.sum(~responses.scored)),
        prediction_error_percent=_mean([output.prediction_error_percent for output in outputs]),
        simulation_error_percent=_mean([output.simulation_error_percent for output in outputs]),
        fitted_state_error_percent=_mean([output.fitted_state_error_percent for output in outputs]),
        outputs=outputs,
        inputs=_inputs(model, prepared, unseen, input_test),
        pairs=tuple(
            PairCorrelation(*names, pair.p_value, pair.largest_ratio) for names, pair in crossed
        ),
        horizons=horizons,
        stretches=tuple(_stretch_errors(held_out, responses)),
        residual_samples=len(tested.residuals),
        lags=len(autocorrelations[0].lag) - 1,
        correlation_lags=min(CROSS_CORRELATION_LAGS, len(tested.residuals) - 1),
        input_test=input_test,
        model_class=tests,
        resolution_hz=_resolution(prepared.estimation, spectrum),
        modes=modes_of(models, order, prepared, fit_level),
        share_of_noise=_share_left(held_out) if form.inputs else math.nan,
        distortion=distortion,
        # Under feedback the inputs follow the noise, and explain a part of it.
        floors=()
        if tests.without_feedback.p_value < SIGNIFICANCE or not unseen
        else floors_of(distortion, held_out, fit_level),
    )
    names = ((name,) for name in prepared.validation.output_names)
    of_outputs = list(zip(names, autocorrelations, strict=True))
    return validation, ValidationTables(
        tables.correlation_table("autocorrelation", ("output",), of_outputs),
        tables.correlation_table("cross_correlation", ("output", "input"), crossed),
        tables.simulation_table(prepared.validation, responses, recorded),
        tables.horizon_table(validation, model.sampling_rate),
    )


def modes_of(
    models: Sequence[OrderModel], order: int, prepared: PreparedData, fit_level: bool
) -> ModeTable:
    """The modes of models of several orders, as of :func:`validate`."""
    unseen, known = prepared.transforms.holds_out, prepared.estimation
    return table_of_models(
        *(models, order, lambda m: held_out_stretches(m, prepared, fit_level) if unseen else ()),
        lambda m: stretches_of(m, known),
    )


def class_of(model: Model, prepared: PreparedData, fit_level: bool = False) -> ModelClass:
    """Tests of the class of a model alone."""
    held_out = held_out_stretches(model, prepared, fit_level)
    estimation = _estimation_stretches(state_space_of(model), prepared.estimation)
    return model_class(_every_stretch(estimation, held_out))


def validation_errors(held_out: Sequence[HeldOut], fit_level: bool = False) -> tuple[float, float]:
    """Errors one step ahead and of the simulation in percent, means over the outputs."""
    responses = responses_of(held_out, fit_level)
    measured, predicted, simulated = (
        series[responses.scored]
        for series in (responses.outputs, responses.predicted, responses.simulated)
    )
    return _mean(_errors(measured, predicted)), _mean(_errors(measured, simulated))


def _every_stretch(estimation: Sequence[HeldOut], held_out: Sequence[HeldOut]) -> Sequence[HeldOut]:
    """Of all samples: where validation samples continue the others, they are one stretch."""
    return held_out if held_out and held_out[0].before else [*estimation, *held_out]


def _estimation_stretches(model: StateSpaceModel, estimation: Recording) -> Sequence[HeldOut]:
    """The stretches with more samples than states and past take; each of several has a level."""
    taken = unscored_samples(model)
    long = [segment for segment in estimation.segments if segment.samples > taken + 1]
    if not long:
        raise ValueError(f"no stretch has more than the {taken + 1} samples that the model needs")
    own_levels = estimation.is_joined and bool(model.level.any())
    return stretches_of(model, estimation.with_segments(long), own_levels)


def _mean(errors: Sequence[float]) -> float:
    return float(np.mean(errors))


def _errors(measured: Array, computed: Array) -> list[float]:
    """Error of each output; NaN where a computed sample is not finite."""
    return [
        tables.error_percent(y, computed_one) if np.isfinite(computed_one).all() else math.nan
        for y, computed_one in zip(measured.T, computed.T, strict=True)
    ]


def _outputs(
    model: StateSpaceModel,
    prepared: PreparedData,
    held_out: Sequence[HeldOut],
    responses: Responses,
    recorded: Responses,
    tested: EstimationResiduals,
    objective: Objective,
    spectrum: SpectrumSettings | None,
) -> tuple[tuple[OutputValidation, ...], list[ResidualCorrelation], tuple[int, ...]]:
    """What is said of each output, the correlations behind it, and the horizons."""
    scored, validation = responses.scored, prepared.validation
    measured = responses.outputs[scored]
    predicted, simulated, fitted = (
        _errors(measured, series[scored])
        for series in (responses.predicted, responses.simulated, responses.fitted)
    )
    longest = max(stretch.recording.samples - stretch.unscored for stretch in held_out)
    horizons = log_spaced_horizons(min(longest, len(measured)))
    ahead = np.array([_errors(measured, _ahead(held_out, k)) for k in horizons])
    correlations = [autocorrelation_of(e, LAGS, tested.bounds) for e in tested.residuals.T]
    lags = ljung_box_lags(len(tested.residuals), 2 * model.order, len(correlations[0].lag) - 1)
    whiteness = [
        whiteness_test(e, lags, tested.bounds, effect, objective, uneven=True)
        for e, effect in zip(tested.residuals.T, tested.fit_effects(lags), strict=True)
    ]
    return (
        tuple(
            OutputValidation(
                name=validation.output_names[k],
                unit=validation.output_units[k],
                prediction_error_percent=predicted[k],
                simulation_error_percent=simulated[k],
                fitted_state_error_percent=fitted[k],
                recorded=tables.recorded_errors(prepared.transforms, recorded, k),
                horizon_errors_percent=tuple(ahead[:, k].tolist()),
                ljung_box=whiteness[k],
                autocorrelation_share_inside95=correlation.share_inside,
                outlier_percent=tables.outlier_percent(tested.residuals[:, k]),
                peaks=spectra.peak_evidence(model, prepared.estimation.longest, k, spectrum),
            )
            for k, correlation in enumerate(correlations)
        ),
        correlations,
        horizons,
    )


def _share_left(held_out: Sequence[HeldOut]) -> float:
    """Smallest share of errors by the model's own noise that fitted states of the plant leave.
    Noise that passes through slow poles of the plant moves their states before and during a record.
    Errors of the outputs count as those of a simulation, relative to each output's deviation."""
    generator = np.random.default_rng(0)
    spread = np.std(np.concatenate([stretch.recording.outputs for stretch in held_out]), axis=0)
    left, total = np.zeros((2, len(spread), DRAWN))
    with np.errstate(all="ignore"):
        for stretch in held_out:
            model, samples, count = stretch.model, stretch.recording.samples, stretch.model.outputs
            noise = replace(model, B=model.K, D=np.eye(count), input_delays=(), input_names=())
            noise = replace(noise, level=np.zeros(count))
            sizes = np.sqrt(np.diag(model.noise_covariance))
            drawn = min(max(stretch.first, samples), MOST_PAST) + samples
            e = sizes * generator.standard_normal((DRAWN, drawn, count))
            v = np.stack([noise.simulate(draws)[-samples:] for draws in e], axis=-1)
            v = v / spread[:, None]
            free = stretch.plant.free_responses(stretch.plant.A, samples) / spread[:, None]
            rest = left_by(free.reshape(-1, free.shape[2]), v.reshape(-1, DRAWN))
            total += np.sum(v**2, axis=0)
            left += np.sum(rest.reshape(v.shape) ** 2, axis=0)
        errors = [np.sum(np.sqrt(squares), axis=0) for squares in (left, total)]
        return float(np.min(errors[0] / errors[1]))


def _ahead(held_out: Sequence[HeldOut], horizon: int) -> Array:
    """Predictions of the scored samples."""
    with np.errstate(all="ignore"):
        return np.concatenate([part.predicted(horizon)[part.unscored :] for part in held_out])


def _crossed(
    tested: EstimationResiduals, recording: Recording
) -> list[tuple[tuple[str, str], ResidualCorrelation]]:
    """Cross-correlations of the residuals of all outputs with all inputs, by their names."""
    return [
        ((output, source), correlation_with_input(e, u, CROSS_CORRELATION_LAGS, tested.bounds))
        for output, e in zip(recording.output_names, tested.residuals.T, strict=True)
        for source, u in zip(recording.input_names, tested.inputs.T, strict=True)
    ]


def _inputs(
    model: Model, prepared: PreparedData, held_out: Sequence[HeldOut], of_all: HeldOutTest
) -> tuple[InputValidation, ...]:
    estimation, validation = prepared.estimation, prepared.validation
    inputs, hidden = [], spectra.hidden_bands(estimation.inputs, estimation.sampling_rate)
    for k in range(model.inputs):
        needed = (
            spectra.needed_excitation(model.orders)[k] if isinstance(model, PolynomialModel) else 0
        )
        u = estimation.inputs[:, k]
        inputs.append(
            InputValidation(
                estimation.input_names[k],
                spectra.excitation_order(u, needed),
                needed,
                spectra.split_spectra(u, validation.inputs[:, k], estimation.sampling_rate),
                hidden[k],
                input_significance(held_out, [k]) if model.inputs > 1 else of_all,
                may_follow(u),
            )
        )
    return tuple(inputs)


def input_significance(held_out: Sequence[HeldOut], tested: Sequence[int] = ()) -> HeldOutTest:
    """Test that the response to some inputs is in the outputs of the validation samples.

    The measured outputs are regressed on the simulated ones, on the response to the other inputs
    and on the free responses of the plant.  Half waves as long as a sixth of the samples or longer
    are taken for drift: two slow signals always have some alike.  The noise model is not used:
    where A and C have nearly common factors, the errors without the input have a narrow peak just
    where ``(B/C) u`` has one.  ``tested``: numbers of the inputs, all by default.
    Without held-out samples there is no test: a model responds to the samples it was fitted to.
    """
    if not held_out or not held_out[0].model.inputs:
        return NO_TEST
    model = held_out[0].plant
    samples = sum(stretch.recording.samples for stretch in held_out)
    driven = np.isin(np.arange(model.inputs), tested or range(model.inputs))
    if not any(np.ptp(stretch.recording.inputs[:, driven], axis=0).any() for stretch in held_out):
        # What is simulated is then a free response alone.
        return HeldOutTest(math.nan, math.nan, math.nan, samples)
    records = []
    with np.errstate(all="ignore"):
        for stretch in held_out:
            y, count = stretch.recording.outputs, stretch.recording.samples
            simulated = stretch.simulated_from_rest(driven)[stretch.first :]
            beside = [np.hstack([free_responses(model.poles(), count), half_waves(count)])]
            beside *= y.shape[1]
            if not driven.all():
                of_others = stretch.simulated_from_rest(~driven)[stretch.first :]
                beside = [np.column_stack(both) for both in zip(beside, of_others.T, strict=True)]
            records.append(HeldOutContribution(y, simulated, beside))
        return joint_contribution_test(records)


def _stretch_errors(held_out: Sequence[HeldOut], responses: Responses) -> list[StretchErrors]:
    ends = np.cumsum([0, *(stretch.recording.samples for stretch in held_out)])
    of_stretches = []
    for begin, end, stretch in zip(ends[:-1], ends[1:], held_out, strict=True):
        part = slice(begin + stretch.unscored, end)
        measured = responses.outputs[part]
        errors = [
            _mean(_errors(measured, computed[part])) if len(measured) else math.nan
            for computed in (responses.predicted, responses.simulated)
        ]
        of_stretches.append(StretchErrors(len(measured), *errors))
    return of_stretches


def _resolution(estimation: Recording, spectrum: SpectrumSettings | None) -> float:
    """Resolution 2 W of the multitaper spectra of the longest stretch, Hz."""
    settings = spectrum or SpectrumSettings()
    samples = estimation.longest.samples
    segment = samples // -(-samples // settings.nfft)
    return 2.0 * settings.time_halfbandwidth * estimation.sampling_rate / segment
