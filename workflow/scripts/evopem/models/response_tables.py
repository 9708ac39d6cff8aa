"""A model's modes and responses as tables, with their intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.models.modes import Mode
from evopem.models.polynomial import Model, PolynomialModel
from evopem.models.polynomials import max_root_radius
from evopem.models.state_space import StateSpaceModel

NORMAL_95 = 1.959963984540054
"""97.5 % point of the standard normal distribution."""

Array = NDArray[np.float64]
Column = list[float] | list[str] | list[int] | Array

# Frequencies, and those of each of several pairs of channels.
FREQUENCIES, FREQUENCIES_OF_PAIRS = 2049, 513
# Samples of the responses of several channels.
RESPONSE_SAMPLES = 500
_RESPONSES = ("impulse", "step", "noise_impulse")
# Samples of a time response: until it has settled to this share, within limits.
SETTLED = 1e-3
FEWEST_SAMPLES, MOST_SAMPLES = 50, 1000
# Step of a central difference, in standard errors of a coefficient: small against the curvature of
# a response, large against rounding.
STEP = 1e-3


def shaped_modes_table(
    modes: Sequence[Mode], input_names: Sequence[str], output_names: Sequence[str]
) -> dict[str, Column]:
    """One row for each mode and output: what holds of the mode stands in each of its rows."""
    rows = [(mode, place) for mode in modes for place in range(len(output_names))]
    drives = {
        f"participation_{part}_{name}": [
            float(getattr(mode.input_participation[column], part)) for mode, _ in rows
        ]
        for column, name in enumerate(input_names)
        for part in ("real", "imag")
    }
    return {
        "mode": [number for number, _ in enumerate(modes, 1) for _ in output_names],
        "frequency_hz": [mode.frequency_hz for mode, _ in rows],
        "frequency_se_hz": [mode.frequency_se_hz for mode, _ in rows],
        "damping_percent": [100.0 * mode.damping_ratio for mode, _ in rows],
        "damping_se_percent": [100.0 * mode.damping_se for mode, _ in rows],
        "pole_real": [mode.pole.real for mode, _ in rows],
        "pole_imag": [mode.pole.imag for mode, _ in rows],
        "phase_collinearity": [mode.phase_collinearity for mode, _ in rows],
        "mean_phase_deg": [mode.mean_phase_deg for mode, _ in rows],
        "phase_deviation_deg": [mode.phase_deviation_deg for mode, _ in rows],
        "output": [output_names[place] for _, place in rows],
        "shape_real": [float(mode.shape[place].real) for mode, place in rows],
        "shape_imag": [float(mode.shape[place].imag) for mode, place in rows],
        "shape_se_real": [float(mode.shape_se_real[place]) for mode, place in rows],
        "shape_se_imag": [float(mode.shape_se_imag[place]) for mode, place in rows],
        "output_share": [float(mode.output_shares[place]) for mode, place in rows],
        **drives,
    }


def response_interval(
    model: Model, frequencies: ArrayLike, noise: bool = False
) -> tuple[Array, Array, Array]:
    """95 % confidence intervals of gains, and standard errors of phases in radians, (M, l, m) each.

    The parameter covariance is propagated to ``ln G``, whose real part is ``ln |G|`` and whose
    imaginary part is the phase, to first order (Ljung 1999, section 9.4), so that an interval has
    the same width in decibels above and below.  Of ``G`` at (M,) frequencies in Hz, or with
    ``noise`` of the ``H`` of polynomials, (M, 1, 1).  NaN where the gain is zero, where the
    covariance is not known, and where the response depends on a direction that the data do not
    determine, as between the lines of a periodic input.  The upper end is infinite where it leaves
    the range of numbers.

    Examples
    --------
    >>> from evopem.models.parameter_covariance import ParameterCovariance
    >>> covariance = ParameterCovariance.from_matrix(1e-4 * np.eye(2))
    >>> model = PolynomialModel([1, -0.5], [2.0], nk=1, covariance=covariance)
    >>> lower, upper, _ = response_interval(model, [0.0])  # around the gain 4
    >>> lower.round(3), upper.round(3)
    (array([[[3.842]]]), array([[[4.165]]]))
    """
    frequencies = np.asarray(frequencies, dtype=float)
    gain = np.abs((model.noise_response if noise else model.frequency_response)(frequencies))
    errors = np.full((2, *gain.shape), np.nan)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if model.covariance is None:
            pass
        elif isinstance(model, PolynomialModel):
            for place in range(gain.shape[2]):
                errors[:, :, 0, place] = _polynomial_errors(model, frequencies, noise, place)
        elif not noise:
            for place, frequency in enumerate(frequencies):
                errors[:, place] = _state_space_errors(model, float(frequency))
        errors[~np.isfinite(errors)] = np.nan
        spread = np.exp(NORMAL_95 * errors[0])
        return gain / spread, gain * spread, errors[1]


def _polynomial_errors(
    model: PolynomialModel, frequencies: Array, noise: bool, place: int
) -> tuple[Array, Array]:
    """Standard errors of ``ln |G|`` and of the phase, (M,) each.

    ``d ln G / da_i = -q^-i / A`` and ``d ln G / db_j = q^-(nk+j) / B``.
    """
    assert model.covariance is not None
    delay = np.exp(-2j * np.pi * frequencies / model.sampling_rate)[:, None]
    nk = 0 if noise else model.nk[place]
    parts = (
        (("c", model.C, 1, 1.0), ("a", model.A, 1, -1.0), ("d", model.D, 1, -1.0))
        if noise
        else (
            ("b", model.delayed_b(place), nk, 1.0),
            ("a", model.A, 1, -1.0),
            ("f", model.F[place], 1, -1.0),
        )
    )
    slopes = np.zeros((len(frequencies), model.orders.parameters), dtype=complex)
    for letter, coefficients, first, sign in parts:
        part = model.part(letter, place)
        lags = np.arange(first, first + part.stop - part.start)
        value = np.polynomial.polynomial.polyval(delay, coefficients)
        slopes[:, part] = sign * delay**lags / value
    of_gain, of_phase = (model.covariance.standard_errors(x) for x in (slopes.real, slopes.imag))
    return of_gain, of_phase


def _state_space_errors(model: StateSpaceModel, frequency: float) -> Array:
    """Standard errors of ``ln |G|`` and of the phase at one frequency, (2, l, m).

    ``dG = C R dA R B + dC R B + C R dB + dD`` with ``R = (zI - A)^-1``; delays are known.
    """
    n, ny, nu = model.order, model.outputs, model.inputs
    assert model.covariance is not None
    z = np.exp(2j * np.pi * frequency / model.sampling_rate)
    resolvent = np.linalg.inv(z * np.eye(n) - model.A)
    left, right = model.C @ resolvent, resolvent @ model.B
    ends = np.cumsum([0, n * n, n * nu, ny * n, ny * nu])
    shapes = ((n, n), (n, nu), (ny, n), (ny, nu))
    dA, dB, dC, dD = (
        model.covariance.factor[begin:end].reshape(*shape, model.covariance.factor.shape[1])
        for (begin, end), shape in zip(pairwise(ends), shapes, strict=True)
    )
    change = np.einsum("ik,klr,lj->ijr", left, dA, right, optimize=True)
    change += np.einsum("ik,kjr->ijr", left, dB, optimize=True)
    change += np.einsum("ikr,kj->ijr", dC, right, optimize=True)
    change = (change + dD) / (left @ model.B + model.D)[:, :, None]
    return np.linalg.norm([change.real, change.imag], axis=3)


def response_standard_errors(
    model: PolynomialModel, response: Callable[[PolynomialModel], Array]
) -> Array:
    """Standard errors of a real function of a model, to first order (Ljung 1999, section 9.4).

    ``model``: with a covariance, ValueError without.  ``response``: for instance ``lambda model:
    model.step_response(100)``.  Of the shape of the response; infinite where it depends on a
    direction of the coefficients that the data do not determine.
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


def frequency_response_table(
    model: Model,
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
        count = FREQUENCIES if len(inputs) * len(outputs) <= 1 else FREQUENCIES_OF_PAIRS
        frequencies = np.linspace(0.0, model.sampling_rate / 2.0, count)
    own = plant or model
    response, bands = own.frequency_response(frequencies), response_interval(own, frequencies)
    noise, of_noise = model.noise_response(frequencies), response_interval(model, frequencies, True)
    blocks = []
    for row in range(len(outputs)):
        beside = _columns(noise[:, row, row], *(each[:, row, row] for each in of_noise))
        of_pairs = [
            _columns(response[:, row, k], *(each[:, row, k] for each in bands))
            for k in range(len(inputs))
        ] or [dict.fromkeys(beside, np.full(len(frequencies), np.nan))]
        beside = {f"noise_{name}": column for name, column in beside.items()}
        blocks += [of_pair | beside for of_pair in of_pairs]
    count, pairs = len(frequencies), [(o, i) for o in outputs for i in inputs or ("",)]
    return {
        "output": [output for output, _ in pairs for _ in range(count)],
        "input": [source for _, source in pairs for _ in range(count)],
        "frequency_hz": np.tile(frequencies, len(pairs)),
        **{name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]},
    }


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


def time_response_table(
    model: PolynomialModel | StateSpaceModel,
    inputs: Sequence[str],
    outputs: Sequence[str],
    plant: StateSpaceModel | PolynomialModel,
) -> dict[str, Array | list[str]]:
    """Impulse and step response of the plant and impulse response of the noise filter.

    A row for each sample of each pair of output and input.  Polynomials of at most one input have
    95 % intervals, to first order in the coefficients, and the noise filter; NaN elsewhere.
    """
    if isinstance(model, PolynomialModel) and model.inputs <= 1:
        table = _responses_of_one(model)
        labels = {"output": outputs[:1], "input": inputs[:1]}
        count = len(table["time_s"])
        return {name: [*own] * count for name, own in labels.items() if own} | table
    pairs = [(row, column) for row in range(len(outputs)) for column in range(len(inputs))]
    impulse = plant.impulse_response(RESPONSE_SAMPLES) if pairs else np.empty((0, 0, 0))
    impulses = np.concatenate([np.empty(0), *(impulse[:, i, j] for i, j in pairs)])
    steps = np.concatenate([np.empty(0), *(np.cumsum(impulse[:, i, j]) for i, j in pairs)])
    times = np.arange(RESPONSE_SAMPLES) / model.sampling_rate
    unknown = np.full(len(impulses), np.nan)
    bands = {f"{name}{end}": unknown for name in _RESPONSES for end in ("", "_lower", "_upper")}
    return {
        "output": [outputs[i] for i, _ in pairs for _ in times],
        "input": [inputs[j] for _, j in pairs for _ in times],
        "time_s": np.tile(times, len(pairs)),
        **(bands | {"impulse": impulses, "step": steps}),
    }


def _responses_of_one(model: PolynomialModel) -> dict[str, Array | list[str]]:
    samples = response_length(model)
    table: dict[str, Array | list[str]] = {"time_s": np.arange(samples) / model.sampling_rate}
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
