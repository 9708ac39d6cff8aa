"""What the checks of the report say of a candidate, and what its residuals say of the noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.fit import NOISE_RADIUS, PLANT_RADIUS, FitSettings, log_loss
from evopem.automatic.held_out.simulation import Model, prediction_errors
from evopem.config.structures import OF_SIMULATION
from evopem.estimation.criteria import lies_at_bound
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import covariance_of, roots_at_bound
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Segment
from evopem.validation.checks.check import SIGNIFICANCE, largest_by_chance
from evopem.validation.checks.inputs import EXCITATION_ADEQUATE
from evopem.validation.checks.residuals import (
    INDEPENDENT_OF_INPUT,
    MIN_CROSS_CORRELATION_SHARE,
    WHITE,
    are_independent,
    are_white,
)
from evopem.validation.checks.roots import (
    COINCIDENT_DISTANCE,
    DISTINCT,
    INSIDE_BOUND,
    cancelling_pairs,
)
from evopem.validation.excitation import excitation_order
from evopem.validation.residual_tests import (
    autocorrelation_of,
    correlation_with_input,
    fit_effects,
    ljung_box_lags,
    whiteness_test,
)

Array = NDArray[np.float64]

# A coefficient of so few standard errors may be 0: the BIC of a model without it then decides.
SMALL = 3.0
# Largest lag of the correlations of models of several channels.
LAGS = 100


@dataclass(frozen=True, eq=False)
class CandidateChecks:
    """What the checks say of a model on its estimation samples."""

    failed: tuple[str, ...]  # names of checks, as the report has them
    whiteness: float  # lowest p-value of the Ljung-Box tests, the fit taken into account
    correlation: float  # largest cross-correlation of residuals and input, in its 95 % bounds
    later: bool = False  # whether the first coefficient of B may be 0
    shorter: bool = False  # whether the last coefficient of B may be 0
    earlier_delays: tuple[int, ...] = ()  # where residuals depend on samples before the delay


def check_model(
    model: Model,
    structure: str,
    stretches: Sequence[Segment],
    settings: FitSettings,
    delays: tuple[int, ...] = (),
) -> CandidateChecks:
    """Judge a model that is at or near an optimum of the stretches.

    Raises ValueError when no stretch is long enough for the orders.
    """
    if isinstance(model, PolynomialModel) and model.inputs <= 1:
        return _of_one_input(model, structure, stretches, settings)
    return _of_several_channels(model, structure, stretches, settings, delays)


def _of_one_input(
    model: PolynomialModel, structure: str, stretches: Sequence[Segment], settings: FitSettings
) -> CandidateChecks:
    orders = replace(model.orders, structure=structure)
    errors = PolynomialErrors(
        *(stretches, orders, settings.objective, PLANT_RADIUS, NOISE_RADIUS, settings.level)
    )
    point = errors.completed_by_states(model)
    residuals, inputs = errors.residuals(point), errors.scored_inputs()
    covariance = covariance_of(
        *(errors, point, residuals, errors.scored_outputs()), errors.residual_counts()
    )
    failed, whiteness, correlation = [], 1.0, 0.0
    if len(residuals) > 2 and np.ptp(residuals) > 0.0:
        whiteness, white = _whiteness(errors, point, residuals, covariance)
        if not white and structure not in OF_SIMULATION:
            failed.append(WHITE)
        if np.ptp(inputs) > 0.0:
            found = correlation_with_input(residuals, inputs)
            correlation = found.largest_ratio
            if not are_independent(correlation, found.share_inside, int(found.lag[-1])):
                failed.append(INDEPENDENT_OF_INPUT)
    if covariance is None:
        distances = np.abs(np.subtract.outer(model.poles(), model.zeros()))
        cancels = bool(np.any(distances < COINCIDENT_DISTANCE))
    else:
        cancels = bool(cancelling_pairs(model, covariance))
    nb = orders.single.nb
    needed = orders.na + orders.single.nf + nb
    longest = max(stretches, key=lambda each: each.samples)
    for name, fails in (
        (DISTINCT, cancels),
        (INSIDE_BOUND, roots_at_bound(errors, model)),
        (EXCITATION_ADEQUATE, excitation_order(longest.input, needed) < needed),
    ):
        failed += [name] if fails else []
    later, shorter = (_is_insignificant(model, covariance, each) for each in (0, nb - 1))
    return CandidateChecks(tuple(failed), whiteness, correlation, later, shorter)


def _whiteness(
    errors: PolynomialErrors,
    point: Array,
    residuals: Array,
    covariance: ParameterCovariance | None,
) -> tuple[float, bool]:
    orders, correlation = errors.orders, autocorrelation_of(residuals)
    largest = int(correlation.lag[-1])
    lags = ljung_box_lags(len(residuals), orders.na + orders.nc + orders.nd, largest)
    if not 0 < lags < len(residuals):
        return math.nan, True
    rest = np.zeros(errors.dimension - orders.parameters)
    effects = np.zeros((1, 0, lags))
    if covariance is not None:
        effects = fit_effects(
            lambda step: errors.residuals(point + np.append(step, rest))[:, None], covariance, lags
        )
    test = whiteness_test(residuals, lags, effects=effects[0], objective=errors.objective)
    share = correlation.where(correlation.lag > 0).share_inside
    return test.p_value, are_white(test.p_value, share, largest) is not False


def _is_insignificant(
    model: PolynomialModel, covariance: ParameterCovariance | None, coefficient: int
) -> bool:
    """Whether a coefficient of B, but not the only one, may be 0."""
    if covariance is None or model.orders.single.nb < 2:
        return False
    gradient = np.zeros((1, covariance.factor.shape[0]))
    gradient[0, model.part("b").start + coefficient] = 1.0
    spread = float(covariance.standard_errors(gradient)[0])
    return bool(abs(model.B[0][coefficient]) < SMALL * spread)


def _of_several_channels(
    model: Model,
    structure: str,
    stretches: Sequence[Segment],
    settings: FitSettings,
    delays: tuple[int, ...],
) -> CandidateChecks:
    """Tests of each output, and of each pair of input and output, with Bonferroni's bound."""
    parts = [prediction_errors(model, each) for each in stretches]
    inputs = np.concatenate(
        [s.inputs[s.samples - len(e) :] for s, e in zip(stretches, parts, strict=True)]
    )
    residuals, bounds = np.concatenate(parts), np.cumsum([0, *map(len, parts)]).tolist()
    states = model if not isinstance(model, PolynomialModel) else model.state_space()
    radius = float(np.abs(np.concatenate([states.poles(), states.noise_zeros()])).max())
    failed, whiteness, correlation, earlier = [], 1.0, 0.0, delays
    if lies_at_bound(radius, settings.max_root_radius):
        failed.append(INSIDE_BOUND)
    if len(residuals) > 2 and np.isfinite(residuals).all():
        tests = [_ljung_box(e, bounds, states.order) for e in residuals.T]
        whiteness = min(tests)
        if structure not in OF_SIMULATION and whiteness < SIGNIFICANCE / len(tests):
            failed.append(WHITE)
        pairs = [
            correlation_with_input(e, u, LAGS, bounds)
            for u in inputs.T
            for e in residuals.T
            if np.ptp(u) > 0.0 and np.ptp(e) > 0.0
        ]
        allowed = largest_by_chance(sum(len(each.lag) for each in pairs))
        correlation = max((each.largest_ratio for each in pairs), default=0.0)
        least_share = min((each.share_inside for each in pairs), default=1.0)
        if correlation > allowed or least_share < MIN_CROSS_CORRELATION_SHARE:
            failed.append(INDEPENDENT_OF_INPUT)
        earlier = _earlier_delays(residuals, inputs, bounds, delays)
    return CandidateChecks(tuple(failed), whiteness, correlation, earlier_delays=earlier)


def _ljung_box(residuals: Array, bounds: Sequence[int], fitted: int) -> float:
    """p-value with as many degrees of freedom as lags, less what was fitted."""
    samples = len(residuals)
    lags = ljung_box_lags(samples, fitted, min(LAGS, samples // 3))
    if lags < 1 or not np.ptp(residuals) > 0.0:
        return 1.0
    return whiteness_test(residuals, lags, bounds, fitted).p_value


def _earlier_delays(
    residuals: Array, inputs: Array, bounds: Sequence[int], delays: tuple[int, ...]
) -> tuple[int, ...]:
    """The delays, earlier where residuals depend on samples of an input before its delay.

    A dependence on later samples is one of the response, and no fault of the delay.
    """
    allowed, earlier = largest_by_chance(residuals.shape[1] * sum(delays)), list(delays)
    for column, delay in enumerate(delays):
        for e in residuals.T if delay else ():
            found = correlation_with_input(e, inputs[:, column], max(delay, 1), bounds)
            large = np.abs(found.values) > allowed * found.bound95
            before = found.lag[large & (found.lag >= 0) & (found.lag < delay)]
            earlier[column] = min([earlier[column], *before.tolist()])
    return tuple(earlier)


def heaviness(model: Model, stretches: Sequence[Segment]) -> float:
    """How much likelier a residual is under Laplace's distribution than under a normal one.

    The mean logarithm of the ratio, each distribution at its likeliest scale.
    """
    e = np.concatenate([prediction_errors(model, each) for each in stretches])
    return 0.5 * (log_loss(e, "quadratic") - log_loss(e, "absolute"))


def feedback_probability(model: Model, stretches: Sequence[Segment]) -> float:
    """Probability that an input depends so much on past residuals by chance.

    Each input is regressed on its own past without and with past residuals (an F test; Granger
    1969), in the longest stretch; of several inputs the lowest one counts, times their number.
    """
    stretch = max(stretches, key=lambda each: each.samples)
    e = prediction_errors(model, stretch)
    inputs = stretch.inputs[stretch.samples - len(e) :]
    lowest = min(_of_input(u, e) for u in inputs.T)
    return min(1.0, lowest * inputs.shape[1])


def _of_input(u: Array, e: Array) -> float:
    from scipy.stats import f

    n, lags = len(e), min(10, len(e) // (15 * e.shape[1]))
    if lags < 1:
        return 1.0
    past_inputs = [np.ones(n - lags), *(u[lags - k : n - k] for k in range(1, lags + 1))]
    past_errors = [each[lags - k : n - k] for each in e.T for k in range(1, lags + 1)]
    target = u[lags:]
    without = _sum_of_squares(np.column_stack(past_inputs), target)
    with_residuals = _sum_of_squares(np.column_stack([*past_inputs, *past_errors]), target)
    added = len(past_errors)
    freedom = len(target) - lags - added - 1
    if not with_residuals > 0.0 or freedom < 1:
        return 1.0
    statistic = (without - with_residuals) / added / (with_residuals / freedom)
    return float(f.sf(statistic, added, freedom))


def _sum_of_squares(regressors: Array, target: Array) -> float:
    e = target - regressors @ np.linalg.lstsq(regressors, target, rcond=None)[0]
    return float(e @ e)
