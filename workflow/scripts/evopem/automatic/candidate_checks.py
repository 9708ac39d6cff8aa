"""What the checks of the report say of a candidate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from evopem.arrays import Array
from evopem.automatic.cross_validation.simulation import Model, prediction_errors
from evopem.automatic.fit import NOISE_RADIUS, PLANT_RADIUS, CommonSettings
from evopem.config.structures import OF_SIMULATION, REGULARISED
from evopem.estimation.criteria import lies_at_bound
from evopem.estimation.impulse_response import posterior
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import covariance_of, roots_at_bound
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Segment
from evopem.validation.checks.check import largest_by_chance
from evopem.validation.checks.inputs import EXCITATION_ADEQUATE
from evopem.validation.checks.residuals import (
    INDEPENDENT_OF_INPUT,
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
from evopem.validation.residual_tests import (
    Residuals,
    autocorrelation_of,
    correlation_with_input,
    fit_effects,
    ljung_box_lags,
    whiteness_test,
)
from evopem.validation.spectra import excitation_order, needed_excitation

# A coefficient of so few standard errors may be 0: the BIC of a model without it then decides.
SMALL = 3.0
# Probability of feedback, or of residuals as coloured as these, by chance, from which a choice
# depends on it: far rarer than that of a failed check.
BY_CHANCE = 1e-3
LAGS = 1200  # largest lag of the autocorrelations of residuals


@dataclass(frozen=True, eq=False)
class CandidateChecks:
    """What the checks say of a model on its estimation samples."""

    failed: tuple[str, ...]  # names of checks, as the report has them
    whiteness: float  # lowest p-value of the Ljung-Box tests, the fit taken into account
    correlation: float  # largest cross-correlation of residuals and input, in its 95 % bounds
    later: tuple[int, ...] = ()  # inputs of which the first coefficient of B may be 0
    shorter: tuple[int, ...] = ()  # inputs of which the last coefficient of B may be 0
    earlier_delays: tuple[int, ...] = ()  # in state space, where residuals depend on what is before


def check_model(
    model: Model,
    structure: str,
    stretches: Sequence[Segment],
    settings: CommonSettings,
    delays: tuple[int, ...] = (),
) -> CandidateChecks:
    """Judge a model that is at or near an optimum of the stretches.

    Raises ValueError when no stretch is long enough for the orders.
    """
    if isinstance(model, PolynomialModel):
        return _of_polynomials(model, structure, stretches, settings)
    parts = [prediction_errors(model, stretch) for stretch in stretches]
    tested = _Residuals.of(stretches, parts)
    lags = tested.whiteness_lags(model.order)
    p_values = [
        whiteness_test(e, lags, tested.bounds, model.order).p_value for e in tested.residuals.T
    ]
    checks = tested.checks(structure, p_values)
    radius = float(np.abs(np.concatenate([model.poles(), model.noise_zeros()])).max())
    at_bound = (INSIDE_BOUND,) if lies_at_bound(radius, settings.max_root_radius) else ()
    earlier = _earlier_delays(tested, delays)
    return replace(checks, failed=checks.failed + at_bound, earlier_delays=earlier)


def _of_polynomials(
    model: PolynomialModel, structure: str, stretches: Sequence[Segment], settings: CommonSettings
) -> CandidateChecks:
    orders = replace(model.orders, structure=structure)
    errors = PolynomialErrors(
        *(stretches, orders, settings.objective, PLANT_RADIUS, NOISE_RADIUS, True)
    )
    if structure in REGULARISED:
        response = posterior(errors)
        point = response.point
        covariance: ParameterCovariance | None = response.covariance(errors)
    else:
        point = errors.completed_by_states(model.parameters)
        covariance = covariance_of(errors, point, errors.residuals(point))
    tested = _Residuals.of(
        errors.stretches, [residuals[:, None] for residuals in errors.residuals_of_stretches(point)]
    )
    lags = tested.whiteness_lags(orders.na + orders.nc + orders.nd)
    effects = np.zeros((1, 0, lags))
    if covariance is not None and lags > 0:
        jacobian = errors.jacobian(point)[:, : orders.parameters]
        effects = fit_effects(
            tested.residuals,
            lambda step: (jacobian @ step)[:, None],
            *(covariance, lags, tested.bounds),
        )
    e = tested.residuals[:, 0]
    test = whiteness_test(e, lags, tested.bounds, effects[0], errors.objective)
    checks = tested.checks(structure, [test.p_value])
    if covariance is None:
        cancels = any(
            np.any(np.abs(np.subtract.outer(model.poles(), model.zeros(i))) < COINCIDENT_DISTANCE)
            for i in range(orders.inputs)
        )
    else:
        cancels = bool(cancelling_pairs(model, covariance))
    needed = needed_excitation(orders)
    inputs = max(stretches, key=lambda stretch: stretch.samples).inputs
    excited = [excitation_order(u, n) >= n for u, n in zip(inputs.T, needed, strict=True)]
    further = {
        DISTINCT: cancels,
        INSIDE_BOUND: roots_at_bound(errors, model),
        EXCITATION_ADEQUATE: not all(excited),
    }
    doubted = () if structure in REGULARISED else range(orders.inputs)
    later, shorter = (
        tuple(i for i in doubted if _is_insignificant(model, covariance, i, end)) for end in (0, -1)
    )
    failed = *checks.failed, *(name for name, fails in further.items() if fails)
    return replace(checks, failed=failed, later=later, shorter=shorter)


def _is_insignificant(
    model: PolynomialModel, covariance: ParameterCovariance | None, place: int, end: int
) -> bool:
    """Whether the first or last of several coefficients of the B of an input may be 0."""
    if covariance is None or model.orders.nb[place] < 2:
        return False
    part = model.orders.part("b", place)
    gradient = np.zeros((1, covariance.factor.shape[0]))
    gradient[0, range(part.start, part.stop)[end]] = 1.0
    spread = float(covariance.standard_errors(gradient)[0])
    return bool(abs(model.B[place][end]) < SMALL * spread)


class _Residuals(Residuals):
    """The residuals of a candidate, of all stretches."""

    @classmethod
    def of(cls, stretches: Sequence[Segment], parts: Sequence[Array]) -> Self:
        return cls.at_ends([stretch.inputs for stretch in stretches], parts)

    def whiteness_lags(self, fitted: int) -> int:
        return ljung_box_lags(len(self.residuals), fitted, min(LAGS, len(self.residuals) - 1))

    def checks(self, structure: str, p_values: Sequence[float]) -> CandidateChecks:
        """Whiteness of each output, and independence of each pair, by Bonferroni's bound."""
        if not (np.ptp(self.residuals) > 0.0 and np.isfinite(self.residuals).all()):
            return CandidateChecks((), 1.0, 0.0)
        correlations = [autocorrelation_of(e, LAGS, self.bounds) for e in self.residuals.T]
        white = [
            are_white(p_value, c.share_inside, len(correlations[0].lag) - 1, len(correlations))
            is not False
            for p_value, c in zip(p_values, correlations, strict=True)
        ]
        failed = [] if all(white) or structure in OF_SIMULATION else [WHITE]
        pairs = [
            correlation_with_input(e, u, bounds=self.bounds)
            for u in self.inputs.T
            for e in self.residuals.T
            if np.ptp(u) > 0.0 and np.ptp(e) > 0.0
        ]
        independent = [
            are_independent(pair.largest_ratio, pair.p_value, int(pair.lag[-1]), len(pairs))
            for pair in pairs
        ]
        failed += [] if all(independent) else [INDEPENDENT_OF_INPUT]
        largest = max((pair.largest_ratio for pair in pairs), default=0.0)
        return CandidateChecks(tuple(failed), min(p_values), largest)


def _earlier_delays(tested: _Residuals, delays: tuple[int, ...]) -> tuple[int, ...]:
    """The delays, earlier where residuals depend on samples of an input before its delay. A
    dependence on later samples is one of the response, and no fault of the delay."""
    residuals, inputs, bounds = tested.residuals, tested.inputs, tested.bounds
    allowed, earlier = largest_by_chance(residuals.shape[1] * sum(delays)), list(delays)
    for column, delay in enumerate(delays):
        for e in residuals.T if delay else ():
            correlation = correlation_with_input(e, inputs[:, column], max(delay, 1), bounds)
            large = np.abs(correlation.values) > allowed * correlation.bound95
            before = correlation.lag[large & (correlation.lag >= 0) & (correlation.lag < delay)]
            earlier[column] = min([earlier[column], *before.tolist()])
    return tuple(earlier)
