"""A model's modes and responses as tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import max_root_radius
from evopem.models.state_space import StateSpaceModel
from evopem.models.state_space_tables import NORMAL_95, gain_intervals

Filter = Literal["plant", "noise"]


def gain_band(
    model: PolynomialModel, frequencies: ArrayLike, which: Filter = "plant"
) -> tuple[Array, Array]:
    """Lower and upper end of the 95 % confidence interval of a gain at frequencies in Hz.

    As :func:`response_interval` has them.

    Examples
    --------
    >>> from evopem.models.polynomial import PolynomialModel
    >>> from evopem.models.parameter_covariance import ParameterCovariance
    >>> covariance = ParameterCovariance.from_matrix(1e-4 * np.eye(2))
    >>> model = PolynomialModel(
    ...     np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1, covariance=covariance
    ... )
    >>> lower, upper = gain_band(model, [0.0])  # around the gain 4
    >>> lower.round(3), upper.round(3)
    (array([3.842]), array([4.165]))
    """
    return response_interval(model, frequencies, which)[:2]


def response_interval(
    model: PolynomialModel, frequencies: ArrayLike, which: Filter = "plant", place: int = 0
) -> tuple[Array, Array, Array]:
    """95 % confidence interval of a gain, and standard error of a phase, at frequencies in Hz.

    The parameter covariance is propagated to ``ln G``, whose real part is ``ln |G|`` and whose
    imaginary part is the phase, to first order (Ljung 1999, section 9.4), so the interval has the
    same width in decibels above and below, and is never negative.

    All are NaN where the gain is zero, where the covariance is not known, and where the response
    depends on a direction of the parameters that the data do not determine, as between the lines
    of a periodic input. The upper end is infinite where it leaves the range of numbers.

    ``frequencies`` (M,): Hz.  ``which`` {"plant", "noise"}: ``G = B / (A F)`` from the input at a
    ``place``, or ``H = C / (A D)``.  Returns both ends and the error in radians, (M,) each.
    """
    frequencies = np.asarray(frequencies, dtype=float)
    if model.covariance is None:
        unknown = np.full(frequencies.shape, np.nan)
        return unknown, unknown, unknown
    delay = np.exp(-2j * np.pi * frequencies / model.sampling_rate)[:, None]
    above, below = ("b", "af") if which == "plant" else ("c", "ad")
    slopes = np.zeros((len(frequencies), model.orders.parameters), dtype=complex)
    response = model.frequency_response if which == "plant" else model.noise_response
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # d ln G / da_i = -q^-i / A and d ln G / db_j = q^-(nk+j) / B.
        for letter in (above, *below):
            coefficients, first = _polynomial(model, letter, place)
            part = model.part(letter, place)
            lags = np.arange(first, first + part.stop - part.start)
            sign = 1.0 if letter == above else -1.0
            value = np.polynomial.polynomial.polyval(delay, coefficients)
            slopes[:, part] = sign * delay**lags / value
        errors, phase_errors = (
            model.covariance.standard_errors(part) for part in (slopes.real, slopes.imag)
        )
        errors[~np.isfinite(errors)] = np.nan
        phase_errors[~np.isfinite(phase_errors)] = np.nan
        spread = np.exp(NORMAL_95 * errors)
        gain = np.abs(response(frequencies)[..., 0, place if which == "plant" else 0])
        return gain / spread, gain * spread, phase_errors


def _polynomial(model: PolynomialModel, letter: str, place: int) -> tuple[Array, int]:
    """Coefficients of a polynomial by lag from 0, and the lag of its first parameter."""
    if letter == "b":
        nk = model.nk[place]
        return np.concatenate([np.zeros(nk), model.B[place]]), nk
    return (model.F[place] if letter == "f" else getattr(model, letter)), 1


# Step of a central difference, in standard errors of a coefficient: small against the curvature of
# a response, large against rounding.
STEP = 1e-3


def response_standard_errors(
    model: PolynomialModel, response: Callable[[PolynomialModel], Array]
) -> Array:
    """Standard errors of a real function of a model, to first order (Ljung 1999, section 9.4).

    ``model``: with a covariance.  ``response``: for instance ``lambda model:
    model.step_response(100)``, or ``lambda model: 20 *
    np.log10(np.abs(model.frequency_response(frequencies)))``.  Returns of the shape of the
    response; infinite where it depends on a direction of the coefficients that the data do not
    determine.  Raises ValueError when the model has no covariance.
    """
    if model.covariance is None:
        raise ValueError("the model has no covariance of its coefficients")
    point = model.parameters
    slopes = []
    deviations = model.covariance.standard_errors(np.eye(len(point)))
    for index, deviation in enumerate(deviations):
        step = np.zeros(len(point))
        # Of a coefficient without a finite standard error, a step of its own size.
        size = deviation if 0.0 < deviation < np.inf else max(abs(point[index]), 1.0)
        step[index] = STEP * size
        up, down = (response(model.with_parameters(point + sign * step)) for sign in (1, -1))
        slopes.append((up - down) / (2.0 * step[index]))
    jacobian = np.array(slopes)
    errors = model.covariance.standard_errors(jacobian.reshape(len(point), -1).T)
    return errors.reshape(jacobian.shape[1:])


Array = NDArray[np.float64]

FREQUENCIES = 2049
# Samples of a time response: until it has settled to this share, within limits.
SETTLED = 1e-3
FEWEST_SAMPLES, MOST_SAMPLES = 50, 1000


def frequency_response_table(
    model: PolynomialModel | StateSpaceModel,
    inputs: Sequence[str],
    outputs: Sequence[str],
    plant: StateSpaceModel | None = None,
    frequencies: Array | None = None,
) -> dict[str, Array | list[str]]:
    """Gains of plant and noise filter with 95 % bands, and unwrapped phases, to half the rate.

    A row for each frequency of each pair of output and input, beside the noise filter from the
    innovations of an output to itself.  Without an input one for each output, NaN for the plant.
    ``plant``: of a state-space model with a noise model beside it.
    """
    if frequencies is None:
        frequencies = np.linspace(0.0, model.sampling_rate / 2.0, FREQUENCIES)
    filters = _Filters.of(model, plant, frequencies)
    blocks = []
    for row in range(len(outputs)):
        noise = {f"noise_{name}": column for name, column in filters.noise(row).items()}
        blocks += [filters.plant(row, k) | noise for k in range(len(inputs))] or [
            dict.fromkeys(filters.noise(row), np.full(len(frequencies), np.nan)) | noise
        ]
    count, pairs = len(frequencies), [(o, i) for o in outputs for i in inputs or ("",)]
    return {
        "output": [output for output, _ in pairs for _ in range(count)],
        "input": [source for _, source in pairs for _ in range(count)],
        "frequency_hz": np.tile(frequencies, len(pairs)),
        **{name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]},
    }


@dataclass(frozen=True, eq=False)
class _Filters:
    """Responses of plant, (M, l, m), and noise filter, (M, l, l), with intervals of their gains."""

    model: PolynomialModel | StateSpaceModel
    frequencies: Array
    response: NDArray[np.complex128]
    noise_response: NDArray[np.complex128]
    bands: tuple[Array, Array] | None  # of the plant of a state-space model

    @classmethod
    def of(
        cls,
        model: PolynomialModel | StateSpaceModel,
        plant: StateSpaceModel | None,
        frequencies: Array,
    ) -> _Filters:
        bands, own = None, plant or model
        if isinstance(own, StateSpaceModel):
            bands = gain_intervals(own, frequencies)
        return cls(
            *(model, frequencies, own.frequency_response(frequencies)),
            *(model.noise_response(frequencies), bands),
        )

    def plant(self, row: int, column: int) -> dict[str, Array]:
        """Columns of one pair."""
        response = self.response[:, row, column]
        if self.bands is not None:
            lower, upper = (each[:, row, column] for each in self.bands)
            return _columns(response, lower, upper, np.full(len(response), np.nan))
        assert isinstance(self.model, PolynomialModel)
        return _columns(response, *response_interval(self.model, self.frequencies, place=column))

    def noise(self, row: int) -> dict[str, Array]:
        """Columns of the noise filter of one output."""
        response = self.noise_response[:, row, row]
        if isinstance(self.model, PolynomialModel):
            return _columns(response, *response_interval(self.model, self.frequencies, "noise"))
        return _columns(response, *(np.full(len(response), np.nan),) * 3)


def _columns(
    response: NDArray[np.complex128], lower: Array, upper: Array, phase_error: Array
) -> dict[str, Array]:
    return {
        "gain": np.abs(response),
        "gain_lower": lower,
        "gain_upper": upper,
        "phase_deg": np.degrees(_unwrapped(np.angle(response))),
        "phase_se_deg": np.degrees(phase_error),
    }


def _unwrapped(angles: Array) -> Array:
    """Continuous angles, NaN where there is none, as at the frequency of an integrator."""
    known, unwrapped = np.isfinite(angles), np.full(len(angles), np.nan)
    unwrapped[known] = np.unwrap(angles[known])
    return unwrapped


def time_response_table(model: PolynomialModel) -> dict[str, Array]:
    """Impulse and step response of the plant and impulse response of the noise filter.

    Each with its 95 % interval, to first order in the coefficients; NaN where there is none.
    """
    samples = response_length(model)
    table = {"time_s": np.arange(samples) / model.sampling_rate}
    responses = {
        "impulse": (model.has_input, lambda m: m.impulse_response(samples)),
        "step": (model.has_input, lambda m: m.step_response(samples)),
        "noise_impulse": (True, lambda m: m.noise_impulse_response(samples)),
    }
    for name, (exists, response) in responses.items():
        values = response(model) if exists else np.full(samples, np.nan)
        errors = np.full(samples, np.nan)
        if exists and model.covariance is not None:
            errors = response_standard_errors(model, response)
            errors[~np.isfinite(errors)] = np.nan
        table |= {
            name: values,
            f"{name}_lower": values - NORMAL_95 * errors,
            f"{name}_upper": values + NORMAL_95 * errors,
        }
    return table


def response_length(model: PolynomialModel) -> int:
    """Number of samples in which the responses of a model settle, within limits."""
    radius = max(max_root_radius(getattr(model, letter)[1:]) for letter in "adf")
    settling = MOST_SAMPLES
    if radius < 1.0:
        settling = math.ceil(math.log(SETTLED) / math.log(radius)) if radius > 0.0 else 0
    memory = len(model.delayed_b()) + len(model.c)
    return min(max(settling + memory, FEWEST_SAMPLES), MOST_SAMPLES)
