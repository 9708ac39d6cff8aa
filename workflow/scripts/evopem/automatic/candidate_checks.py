"""The checks of the report that a candidate can be judged by before it is chosen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from evopem.automatic.fit import NOISE_RADIUS, PLANT_RADIUS, FitSettings
from evopem.estimation.pem.stretch_errors import StretchErrors
from evopem.estimation.polynomial_estimate import covariance_of, roots_at_bound
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Segment
from evopem.validation.checks.excitation import EXCITATION_ADEQUATE
from evopem.validation.checks.residuals import (
    INDEPENDENT_OF_INPUT,
    WHITE,
    WITHOUT_NOISE_MODEL,
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
    ljung_box_lags,
    whiteness_test,
)

# A coefficient of so few standard errors may be 0: the BIC of a model without it then decides.
SMALL = 3.0


@dataclass(frozen=True, eq=False)
class CandidateChecks:
    """What the checks say of a model on its estimation samples.

    Attributes
    ----------
    failed : tuple of str
        Names of checks, as the report has them.
    whiteness : float
        p-value of the Ljung-Box test, the fit taken into account.
    correlation : float
        Largest cross-correlation of residuals and input, in its 95 % bounds.
    later, shorter : bool
        Whether the first, or the last, coefficient of B may be 0.
    """

    failed: tuple[str, ...]
    whiteness: float
    correlation: float
    later: bool
    shorter: bool


def check_model(
    model: PolynomialModel, structure: str, stretches: Sequence[Segment], settings: FitSettings
) -> CandidateChecks:
    """Judge a model that is at or near an optimum of the stretches.

    Parameters
    ----------
    model : PolynomialModel
    structure : str
        What the model is called: some structures claim nothing of the noise.
    stretches : sequence of Segment
    settings : FitSettings

    Raises
    ------
    ValueError
        When no stretch is long enough for the orders.
    """
    orders = replace(model.orders, structure=structure)
    errors = StretchErrors(
        *(stretches, orders, settings.objective, PLANT_RADIUS, NOISE_RADIUS, settings.level)
    )
    point = errors.completed_by_states(model)
    residuals, inputs = errors.residuals(point), errors.scored_inputs()
    failed, whiteness, correlation = [], 1.0, 0.0
    if len(residuals) > 2 and np.ptp(residuals) > 0.0:
        whiteness, white = _whiteness(errors, point)
        if not white and structure not in WITHOUT_NOISE_MODEL:
            failed.append(WHITE)
        if np.ptp(inputs) > 0.0:
            found = correlation_with_input(residuals, inputs)
            correlation = found.largest_ratio
            if not are_independent(correlation, found.share_inside, int(found.lag[-1])):
                failed.append(INDEPENDENT_OF_INPUT)
    covariance = _covariance(errors, point)
    if _cancels(model, covariance):
        failed.append(DISTINCT)
    if roots_at_bound(errors, model):
        failed.append(INSIDE_BOUND)
    needed = orders.na + orders.single.nf + orders.single.nb
    longest = max(stretches, key=lambda each: each.samples)
    if excitation_order(longest.input, needed) < needed:
        failed.append(EXCITATION_ADEQUATE)
    later, shorter = (
        _is_insignificant(model, covariance, coefficient)
        for coefficient in (0, model.orders.single.nb - 1)
    )
    return CandidateChecks(tuple(failed), whiteness, correlation, later, shorter)


def _whiteness(errors: StretchErrors, point: np.ndarray) -> tuple[float, bool]:
    residuals, orders = errors.residuals(point), errors.orders
    correlation = autocorrelation_of(residuals)
    largest = int(correlation.lag[-1])
    lags = ljung_box_lags(len(residuals), orders.na + orders.nc + orders.nd, largest)
    if not 0 < lags < len(residuals):
        return math.nan, True
    test = whiteness_test(residuals, [errors.jacobian(point)], lags, errors.objective)
    share = correlation.where(correlation.lag > 0).share_inside
    return test.p_value, are_white(test.p_value, share, largest) is not False


def _covariance(errors: StretchErrors, point: np.ndarray) -> ParameterCovariance | None:
    try:
        return covariance_of(
            *(errors, point, errors.residuals(point), errors.scored_outputs()),
            errors.residual_counts(),
        )
    except (ValueError, np.linalg.LinAlgError):
        return None


def _cancels(model: PolynomialModel, covariance: ParameterCovariance | None) -> bool:
    if covariance is not None:
        return bool(cancelling_pairs(model, covariance))
    distances = np.abs(np.subtract.outer(model.poles(), model.zeros()))
    return bool(np.any(distances < COINCIDENT_DISTANCE))


def _is_insignificant(
    model: PolynomialModel, covariance: ParameterCovariance | None, coefficient: int
) -> bool:
    """Whether a coefficient of B, but not the only one, may be 0."""
    if covariance is None or model.orders.single.nb < 2:
        return False
    gradient = np.zeros((1, covariance.factor.shape[0]))
    gradient[0, model.part("b").start + coefficient] = 1.0
    spread = float(covariance.standard_errors(gradient)[0])
    return bool(abs(model.b[coefficient]) < SMALL * spread)
