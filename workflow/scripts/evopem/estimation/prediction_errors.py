"""The prediction-error problem of a recording, orders and settings, checked and scaled."""

from dataclasses import dataclass, replace

import numpy as np

from evopem.arrays import Array
from evopem.config.settings import OBJECTIVES, ScoringWindow, SearchSettings
from evopem.config.structures import REGULARISED
from evopem.errors import NoModelError
from evopem.estimation.criteria import power_of_two_scale
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.memetic import REFINE
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording
from evopem.signals.recording_checks import LARGEST


def default_window(orders: Orders, settings: SearchSettings) -> ScoringWindow:
    """The window of an estimate that is not compared with models of other orders. From the first
    residual that has all its measured past; for ARMAX models ``n_initial_discard`` later."""
    if orders.structure != "armax":
        return ScoringWindow(orders.first_residual, orders.first_residual)
    first = max(orders.first_residual, orders.nc)
    return ScoringWindow(first, first + max(settings.n_initial_discard, orders.nc))


def prediction_errors(
    data: Recording, orders: Orders, settings: SearchSettings, window: ScoringWindow, level: bool
) -> PolynomialErrors:
    """The problem of a recording and orders; ValueError when no segment is long enough."""
    radius = settings.max_root_radius
    return PolynomialErrors(
        data.segments, orders, settings.objective, radius, radius, level, window
    )


def checked_errors(
    data: Recording,
    orders: Orders,
    settings: SearchSettings,
    window: ScoringWindow | None,
    level: bool,
) -> PolynomialErrors:
    """The same of a recording as a user gives it; ValueError when it or a setting is of no use."""
    check_search_settings(settings)
    if orders.inputs and data.inputs.shape[1] != orders.inputs:
        raise ValueError(
            f"structure {orders.structure!r} with nb = {orders.nb[0]} needs an input"
            if not data.has_input
            else f"{orders} is of {orders.inputs} inputs; the recording has {data.inputs.shape[1]}"
        )
    # The ARMAX problem of the chapter.
    alone = orders.structure == "armax" and orders.inputs == 1 and not (level or data.is_joined)
    first = orders.first_residual
    if window is None:
        window = default_window(orders, settings) if alone else ScoringWindow(first, first)
    first = max(first, orders.nc if alone else 0)
    if window.residual_start < first:
        raise ValueError(f"{orders} has no residual before sample {first}")
    if window.loss_start < window.residual_start:
        raise ValueError(f"the loss starts at {window.loss_start}, before the first residual")
    _check_signals(data)
    _check_length(data, orders, window, 0 if alone else sum(orders.nf) + orders.noise_states)
    return prediction_errors(data, orders, settings, window, level)


def _check_signals(data: Recording) -> None:
    for name, signal in {"input": data.inputs, "output": data.outputs}.items():
        largest = float(np.max(np.abs(signal), initial=0.0))
        if largest and not 1.0 / LARGEST < largest < LARGEST:
            problem = f"the largest magnitude of the {name} is {largest:g}"
            raise ValueError(f"{problem}; scale it between {1.0 / LARGEST:g} and {LARGEST:g}")


def _check_length(data: Recording, orders: Orders, window: ScoringWindow, states: int) -> None:
    """Refuse a recording that no model of the orders can be estimated from."""
    first = window.loss_start
    kept = [s for s in data.segments if s.samples > first + states or not data.is_joined]
    counted = sum(segment.samples - first for segment in kept)
    # A prior stands in for residuals of coefficients, not of levels.
    regularised = orders.structure in REGULARISED
    estimated = len(kept) if regularised else orders.parameters + states * len(kept)
    if counted <= estimated and kept:
        raise NoModelError(
            f"{orders} needs more than {estimated} residuals for its coefficients and initial "
            f"states; {data.samples} samples less the first {first} leave {counted}"
        )
    if not any(np.any(segment.output[first:]) for segment in kept) and kept:
        raise NoModelError("the output is zero throughout")


def check_search_settings(settings: SearchSettings) -> None:
    """Refuse words that no search knows, numbers too small, and a radius outside the circle."""
    for name, known in (("objective", OBJECTIVES), ("refine", REFINE)):
        value = getattr(settings, name)
        if value not in known:
            raise ValueError(f"{name} must be one of {known}, not {value!r}")
    for name, least in {"mu": 1, "lambda_": 1, "nu": 1, "seed": 0, "n_initial_discard": 0}.items():
        if (given := getattr(settings, name)) < least:
            raise ValueError(f"{name} must be at least {least}, not {given}")
    if not 0.0 < (radius := settings.max_root_radius) < 1.0:
        raise ValueError(f"max_root_radius must lie between 0 and 1, not {radius}")


@dataclass(frozen=True, eq=False)
class Units:
    """Units of the points of a scaled problem, and the input means that it leaves out. A large mean
    would ask for states and a level so large that their weak priors count, and that hide the rest:
    in ``F x = -B u + g`` and ``v = A y + x - level`` it adds a constant to x."""

    errors: PolynomialErrors  # scaled
    scales: Array  # (n,)
    means: Array  # (m,), of the scaled inputs

    def restored(self, point: Array) -> Array:
        """A point in the units of the signals."""
        return self._moved(point, 1.0) * self.scales

    def taken(self, point: Array) -> Array:
        """The scaled point of a point in the units of the signals."""
        return self._moved(point / self.scales, -1.0)

    def _moved(self, point: Array, sign: float) -> Array:
        moved, parts, o = point.copy(), self.errors.parts, self.errors.orders
        states = moved[parts["plant"]].reshape(len(self.errors.stretches), -1)
        for i, mean in enumerate(self.means):
            f = point[o.part("f", i)]
            constant = sign * mean * point[o.part("b", i)].sum() / (1.0 + f.sum())
            moved[parts["level"]] -= constant
            before = sum(o.nf[:i])
            states[:, before : before + o.nf[i]] += constant * np.cumsum(f[::-1])[::-1]
        return moved


def scaled_errors(errors: PolynomialErrors) -> tuple[PolynomialErrors, Units]:
    """The problem with signals scaled by powers of two, beside levels without input means."""
    inputs = np.concatenate([stretch_errors.inputs for stretch_errors, _ in errors.places])
    outputs = np.concatenate([stretch.output for stretch in errors.stretches])
    output_scale = power_of_two_scale(outputs)
    means = inputs.mean(axis=0) if errors.level else np.zeros(inputs.shape[1])
    input_scales = np.array([power_of_two_scale(signal) for signal in (inputs - means).T])
    scales, parts = np.ones(errors.dimension), errors.parts
    scales[parts["b"]] = output_scale / np.repeat(input_scales, errors.orders.nb)
    for name in ("level", "plant", "noise"):
        scales[parts[name]] = output_scale
    scaled = errors.scaled(means, input_scales, output_scale)
    return scaled, Units(scaled, scales, means / input_scales)


def in_scaled_units(model: PolynomialModel, units: Units) -> PolynomialModel:
    """A model in the units of a scaled problem, whose numerators are divided by their scales."""
    part = units.errors.orders.part
    of_inputs = tuple(b / units.scales[part("b", i)][0] for i, b in enumerate(model.B))
    return replace(model, B=of_inputs, covariance=None)
