"""A model's modes and responses as tables, with their intervals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.arrays import Array, Complex
from evopem.models.conversions import covariance_of_part
from evopem.models.modes import Mode
from evopem.models.parameter_covariance import NORMAL_95, ParameterCovariance
from evopem.models.polynomial import Model, state_space_of
from evopem.models.polynomial_roots import on_circle
from evopem.models.state_space import StateSpaceModel
from evopem.models.states import delayed, powers_times

Column = list[float] | list[str] | list[int] | Array

# Frequencies, and those of each of several pairs of channels.
FREQUENCIES, FREQUENCIES_OF_PAIRS = 2049, 513
# Frequencies of a peak that is narrower than some of these steps, in half widths from its centre,
# and of each decade below the first of them.
AT_PEAK, NARROW, OF_DECADE = np.linspace(-4.0, 4.0, 17), 8.0, 20
# Samples of a time response: until it has settled to this share, within limits.
SETTLED = 1e-3
FEWEST_SAMPLES, MOST_SAMPLES = 50, 1000
UNKNOWN = np.full((1, 1, 1), np.nan)
BLOCK = 2_000_000  # derivatives of responses that are computed at a time
OF_RIVALS = 200  # frequencies at which responses of rivals are compared


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
    model: Model, frequencies: ArrayLike, noise: bool = False, rivals: Sequence[Model] = ()
) -> tuple[Array, Array, Array]:
    """95 % confidence intervals of gains, and standard errors of phases in radians, (M, l, m) each.

    The parameter covariance is propagated to ``ln G``, whose real part is ``ln |G|`` and whose
    imaginary part is the phase, to first order (Ljung 1999, section 9.4).  To it is added the mean
    square of the differences between the first of ``rivals`` and all of them, models that could
    have been chosen as well (Buckland, Burnham & Augustin 1997, with equal weights).  Of ``G`` at
    (M,) frequencies in Hz, or with ``noise`` of the diagonal of ``H``, (M, l, 1).  NaN where the
    gain is zero or depends on what the data do not determine, as between the lines of a periodic
    input.
    """
    frequencies = np.asarray(frequencies, dtype=float)
    if noise:
        response = _of_itself(model.noise_response(frequencies))
    else:
        response = model.frequency_response(frequencies)
    gain, errors = np.abs(response), np.full((2, *response.shape), np.nan)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        form = state_space_of(model)
        z = on_circle(frequencies, form.sampling_rate)
        # In blocks: of many states and channels all derivatives would not fit into memory.
        entries = form.order * (form.order + form.inputs + 2)
        size = max(1, BLOCK // (response[0, 0].size * entries or 1))
        for first in range(0, len(z) if form.covariance is not None and response.size else 0, size):
            block = slice(first, first + size)
            resolvent = form.state_response(z[block], np.eye(form.order))
            for place in range(form.outputs):
                part, covariance = _of_output(form, place)
                slopes = response_slopes(part, z[block], resolvent, noise)
                rows = (slopes / response[block, place, :, None]).reshape(-1, slopes.shape[-1])
                errors[:, block, place] = [
                    covariance.standard_errors(gradient).reshape(gain[block, place].shape)
                    for gradient in (rows.real, rows.imag)
                ]
        if rivals:
            responses = np.array([rival.frequency_response(frequencies) for rival in rivals])
            ratios = np.log(responses / responses[0])
            spread = np.mean(np.stack([ratios.real, ratios.imag], axis=1) ** 2, axis=0)
            errors = np.sqrt(errors**2 + spread)
        errors[~np.isfinite(errors)] = np.nan
        factor = np.exp(NORMAL_95 * errors[0])
        return gain / factor, gain * factor, errors[1]


def _of_output(model: StateSpaceModel, place: int) -> tuple[StateSpaceModel, ParameterCovariance]:
    """The model of one output, from the inputs and its own innovations, and its covariance."""
    output = slice(place, place + 1)

    def part(of: StateSpaceModel) -> StateSpaceModel:
        parts = of.A, of.B, of.C[output], of.D[output], of.K[:, output]
        noise = of.noise_covariance[output, output]
        return StateSpaceModel(*parts, of.sampling_rate, of.level[output], noise, of.input_delays)

    covariance = covariance_of_part(model, part)
    assert covariance is not None
    return part(model), covariance


def response_slopes(model: StateSpaceModel, z: Complex, resolvent: Complex, noise: bool) -> Complex:
    """Derivatives of ``G``, or of ``H``, of one output by all entries but the level.

    ``dG = C R dA R B + dC R B + C R dB + dD`` with the resolvent ``R = (zI - A)^-1``, turned by the
    delays; (M, m, entries), or (M, 1, entries).
    """
    n, nu = model.order, model.inputs
    left, right = (model.C @ resolvent)[:, 0], resolvent @ (model.K if noise else model.B)
    sources, of_output = right.shape[2], n * n + n * nu
    slopes = np.zeros((len(z), sources, of_output + n + nu + n), complex)
    of_source = of_output + n + nu if noise else n * n
    for j, of_pair in enumerate(slopes.transpose(1, 0, 2)):
        of_pair[:, : n * n] = (left[:, :, None] * right[:, None, :, j]).reshape(len(z), n * n)
        of_pair[:, of_source + j : of_source + n * sources : sources] = left
        of_pair[:, of_output : of_output + n] = right[:, :, j]
        if not noise:
            of_pair[:, of_output + n + j] = 1.0
    delays = np.zeros(1) if noise else np.array(model.delays)
    return slopes * (z[:, None] ** -delays)[:, :, None]


def impulse_slopes(model: StateSpaceModel, samples: int, source: int | None = None) -> Array:
    """Those of the impulse response ``h_(t+1) = C A^t b`` of one output, (samples, entries).

    From an input, or from its innovations; by A the convolutions ``sum_s C A^s dA A^(t-1-s) b``.
    """
    n, nu = model.order, model.inputs
    b = model.K if source is None else model.B[:, [source]]
    left, right = (
        powers_times(*parts, samples)[..., 0] for parts in ((model.A.T, model.C.T), (model.A, b))
    )
    of_output = n * n + n * nu
    slopes = np.zeros((samples, of_output + n + nu + n))
    spectra = np.fft.rfft(right, 2 * samples, axis=0)
    for row, spectrum in enumerate(np.fft.rfft(left, 2 * samples, axis=0).T):
        products = np.fft.irfft(spectrum[:, None] * spectra, 2 * samples, axis=0)
        slopes[2:, row * n : (row + 1) * n] = products[: samples - 2]
    slopes[1:, of_output : of_output + n] = right[:-1]
    if source is None:
        slopes[1:, of_output + n + nu :] = left[:-1]
        return slopes
    slopes[1:, n * n + source : of_output : nu] = left[:-1]
    slopes[0, of_output + n + source] = 1.0
    return delayed(slopes, [model.delays[source]] * slopes.shape[1])


def _impulse_errors(model: StateSpaceModel, samples: int, noise: bool) -> Array:
    """Standard errors of impulse and step responses, or of the noise filter's impulse responses."""
    sources = [None] if noise else range(model.inputs)
    errors = np.zeros((2 - noise, samples, model.outputs, len(sources)))
    for place in range(model.outputs):
        part, covariance = _of_output(model, place)
        for column, source in enumerate(sources):
            slopes = impulse_slopes(part, samples, source)
            for of_kind in errors[:, :, place, column]:
                of_kind[:] = covariance.standard_errors(slopes)
                slopes = np.cumsum(slopes, axis=0)
    return errors


def resolving_frequencies(model: Model, count: int) -> Array:
    """Frequencies in Hz to half the rate, evenly spaced, and closer where peaks are narrow."""
    highest = model.sampling_rate / 2.0
    even = np.linspace(0.0, highest, count)
    poles = state_space_of(model).poles()
    rates = np.log(poles[poles != 0.0].astype(complex)) * model.sampling_rate
    centres, widths = np.abs(rates) / (2.0 * np.pi), np.abs(rates.real) / (2.0 * np.pi)
    narrow = (widths < NARROW * even[1]) & (centres > 0.0)
    peaks = centres[narrow, None] + widths[narrow, None] * AT_PEAK
    lowest = centres[narrow].min(initial=even[1]) / 10.0
    decades = math.log10(even[1] / lowest)
    below = 1 + math.ceil(OF_DECADE * decades) if decades > 1.0 else 0
    low = np.geomspace(lowest, even[1], below)
    added = np.concatenate([peaks.ravel(), low])
    inside = (added > 0.0) & (added < highest) & np.isfinite(added)
    return np.unique(np.concatenate([even, added[inside]]))


def frequency_response_table(
    model: Model,
    inputs: Sequence[str],
    outputs: Sequence[str],
    plant: StateSpaceModel | None = None,
    frequencies: Array | None = None,
    rivals: Sequence[Model] = (),
) -> dict[str, Column]:
    """Gains of plant and noise filter with 95 % bands, and unwrapped phases, to half the rate.

    A row for each frequency of each pair of output and input, beside the noise filter from the
    innovations of an output to itself.  Without an input one for each output, NaN for the plant.
    ``plant``: of a state-space model with a noise model beside it.  ``rivals`` of the plant's
    response could have been chosen as well.
    """
    if frequencies is None:
        count = FREQUENCIES if len(inputs) * len(outputs) <= 1 else FREQUENCIES_OF_PAIRS
        frequencies = resolving_frequencies(plant or model, count)
    shown = plant or model
    bands = response_interval(shown, frequencies, rivals=rivals)
    columns = response_columns(shown.frequency_response(frequencies), *bands)
    bands = response_interval(model, frequencies, noise=True)
    of_noise = response_columns(_of_itself(model.noise_response(frequencies)), *bands)
    columns |= {f"noise_{name}": values for name, values in of_noise.items()}
    return by_pair(outputs, inputs, "frequency_hz", frequencies, columns)


@dataclass(frozen=True)
class Rival:
    """The model that could have been chosen as well whose response to the inputs differs most."""

    name: str
    frequency_hz: float  # where most of the difference is
    # Exponential of the root mean square of the logarithm of the ratio of both, in the power of the
    # response, octaves alike: a phase of 1 rad counts as a factor of e
    factor: float


def furthest_rival(names: Sequence[str], models: Sequence[Model], samples: int) -> Rival | None:
    """The model whose response is farthest from the first one's; None of one, or no inputs.

    From the frequency of one period in some samples on.
    """
    rate = models[0].sampling_rate
    frequencies = np.geomspace(rate / samples, rate / 2.0, OF_RIVALS)
    with np.errstate(all="ignore"):
        responses = np.array([model.frequency_response(frequencies) for model in models])
        power, ratios = np.abs(responses[0]) ** 2, np.log(responses[1:] / responses[0])
        shares = np.nan_to_num(power / power.sum(axis=0) * np.abs(ratios) ** 2, posinf=0.0)
    squares = shares.sum(axis=1)
    if not squares.any():
        return None
    place, *pair = np.unravel_index(np.argmax(squares), squares.shape)
    frequency = float(frequencies[np.argmax(shares[place][:, *pair])])
    return Rival(names[1 + int(place)], frequency, math.exp(np.sqrt(squares.max())))


def by_pair(
    outputs: Sequence[str],
    inputs: Sequence[str],
    name: str,
    axis: Array,
    columns: Mapping[str, Array],
) -> dict[str, Column]:
    """Rows along an axis for each pair of output and input, of columns (N, l, m).

    Columns may be alike for all outputs or inputs, (N, 1, m) or (N, l, 1).  Without an input there
    is a row for each output, NaN in columns of none.
    """
    pairs, shape = list(product(outputs, inputs or ("",))), (len(outputs), len(inputs) or 1)
    filled = {name: of_pairs if of_pairs.size else UNKNOWN for name, of_pairs in columns.items()}
    return {
        "output": [output for output, _ in pairs for _ in axis],
        "input": [source for _, source in pairs for _ in axis],
        name: np.tile(axis, len(pairs)),
        **{
            name: np.broadcast_to(of_pairs, (len(axis), *shape)).transpose(1, 2, 0).ravel()
            for name, of_pairs in filled.items()
        },
    }


def response_columns(
    response: Complex, lower: Array, upper: Array, phase_error: Array
) -> dict[str, Array]:
    """Gains with intervals, and continuous phases with standard errors (rad), (F, l, m) each."""
    return {
        "gain": np.abs(response),
        "gain_lower": lower,
        "gain_upper": upper,
        "phase_deg": np.degrees(_unwrapped(np.angle(response))),
        "phase_se_deg": np.degrees(phase_error),
    }


def _of_itself(values: NDArray) -> NDArray:
    """Of each output from its own innovations, (N, l, 1)."""
    return np.einsum("tii->ti", values)[..., None]


def _unwrapped(angles: Array) -> Array:
    """Continuous angles, NaN where there is none, as at the frequency of an integrator."""
    unwrapped = np.full(angles.shape, np.nan)
    for at in np.ndindex(angles.shape[1:]):
        known = np.isfinite(angles[:, *at])
        unwrapped[known, *at] = np.unwrap(angles[known, *at])
    return unwrapped


def time_response_table(
    model: Model,
    inputs: Sequence[str],
    outputs: Sequence[str],
    plant: Model,
    rivals: Sequence[Model] = (),
) -> dict[str, Column]:
    """Impulse and step response of the plant and impulse response of the noise filter.

    A row for each sample of each pair of output and input, beside the noise filter from the
    innovations of an output to itself, with 95 % intervals to first order in the coefficients, and
    with the spread of ``rivals`` of the plant, as :func:`response_interval` has it; without an
    input one for each output, NaN for the plant.
    """
    samples = response_length(model)

    def of_plant(plant: Any) -> Array:
        impulse = plant.impulse_response(samples)
        return np.stack([impulse, np.cumsum(impulse, axis=0)])

    def of_noise(model: Any) -> Array:
        return _of_itself(model.noise_impulse_response(samples))[None]

    columns: dict[str, Array] = {}
    for names, of_part, response in (
        (("impulse", "step"), plant, of_plant),
        (("noise_impulse",), model, of_noise),
    ):
        values = response(of_part)
        errors = np.full(values.shape, np.nan)
        form = state_space_of(of_part)
        if form.covariance is not None and values.size:
            errors = _impulse_errors(form, samples, response is of_noise)
            if rivals and response is of_plant:
                responses = np.array([response(rival) for rival in rivals])
                errors = np.sqrt(errors**2 + np.mean((responses - responses[0]) ** 2, axis=0))
            errors[~np.isfinite(errors)] = np.nan
        for end, sign in (("", 0.0), ("_lower", -1.0), ("_upper", 1.0)):
            ends = values + sign * NORMAL_95 * errors if sign else values
            columns |= {name + end: of_end for name, of_end in zip(names, ends, strict=True)}
    return by_pair(outputs, inputs, "time_s", np.arange(samples) / model.sampling_rate, columns)


def response_length(model: Model) -> int:
    """Number of samples in which the responses of a model settle, within limits."""
    form = state_space_of(model)
    radius = float(np.abs(form.poles()).max(initial=0.0))
    settling = MOST_SAMPLES
    if radius < 1.0:
        settling = math.ceil(math.log(SETTLED) / math.log(radius)) if radius > 0.0 else 0
    memory = form.order + max(form.input_delays, default=0)
    return min(max(settling + memory, FEWEST_SAMPLES), MOST_SAMPLES)
