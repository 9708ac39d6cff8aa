"""Output-error models of measured frequency responses: orders, entries, and their covariance.

The model is ``G(p) = C (pI - A)^-1 B + D`` with a section of two poles for each mode; p is s, or in
discrete time ``(z - 1)/(z + 1)``, which leaves degrees as they are. After the search for the poles
all entries descend together, with residues of rank one.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from evopem.arrays import Array, Complex, Integers, one_blas_thread
from evopem.errors import InputError
from evopem.estimation.search.frequency_problem import (
    Equations,
    FrequencyProblem,
    descended_squares,
    lowest_poles,
    response_axis,
    sections_dynamics,
    stacked,
)
from evopem.estimation.search.problem import Log, SearchResult
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate
from evopem.models.continuous import phi_functions
from evopem.models.modes import Mode, frequency_and_damping
from evopem.models.parameter_covariance import ParameterCovariance, jacobian_of
from evopem.models.state_space import StateSpaceModel
from evopem.signals.readers.frequency_responses import FrequencyResponses

# Modes that are tried, and orders without a lower criterion that end the search.
MOST_MODES, PATIENCE = 15, 3
# Rate of the equivalent of a continuous-time model in discrete time, in highest frequencies.
HELD_RATE = 10.0


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """The model of frequency responses, and how it was found."""

    responses: FrequencyResponses
    point: Array  # (2 modes,) log ω and log ζ of the sections, where p is in units of ``scale``
    B: Array  # (n, m)
    C: Array  # (l, n)
    D: Array  # (l, m)
    scale: float  # rad/s
    weights: Array  # (F, l, m) reciprocal standard deviations of real and imaginary part
    variance_factor: float  # of the stated variances; 1 where they are absolute
    criteria: dict[int, float]  # BIC of each number of modes
    diagram: dict[int, list[Mode]]  # of the models by their number of states
    search: SearchResult  # of the poles

    @property
    def sections(self) -> int:
        """Number of sections, each of two poles."""
        return len(self.point) // 2

    @property
    def estimate(self) -> StateSpaceEstimate:
        """The same in the form of estimates from samples; it leaves no residuals in time."""
        n, outputs = self.model.order, self.model.outputs
        both = self.responses.values, self.misfit
        sizes, misfits = (np.linalg.norm(values, axis=(0, 2)) for values in both)
        return StateSpaceEstimate(
            model=self.model,
            order=n,
            objective=self.error_percent**2 / 100.0,
            fit_percent=100.0 - 100.0 * misfits / np.maximum(sizes, 1e-300),
            bic=self.criteria[self.sections],
            coloured_bic=np.nan,
            parameters=self.parameters,
            residuals=(),
            initial_states=np.zeros((1, n)),
            segment_levels=np.zeros((1, outputs)),
            at_stability_bound=False,
            search=self.search,
        )

    @property
    def rate(self) -> float:
        """Sampling rate (Hz) of the model, or of its equivalent in discrete time."""
        return self.responses.sampling_rate or HELD_RATE * float(self.responses.frequencies[-1])

    @property
    def parameters(self) -> int:
        """Number of parameters that the data can determine."""
        outputs, inputs = self.D.shape
        return len(self.point) * (outputs + inputs) + outputs * inputs

    @property
    def flat(self) -> Array:
        """Point, B, C and D one after the other."""
        return np.concatenate([self.point, self.B.ravel(), self.C.ravel(), self.D.ravel()])

    def split(self, parameters: Any) -> dict[str, Any]:
        """Parameters as of :attr:`flat` by their names."""
        parts = {"point": self.point, "B": self.B, "C": self.C, "D": self.D}
        ends = np.cumsum([part.size for part in parts.values()])[:-1]
        split = zip(parts.items(), np.split(parameters, ends), strict=True)
        return {name: values.reshape(part.shape) for (name, part), values in split}

    def _resolvent(self, frequencies: Array) -> Complex:
        p = response_axis(frequencies, self.responses.sampling_rate, self.scale)
        A = sections_dynamics(self.point)
        return np.asarray(np.linalg.inv(p[:, None, None] * np.eye(len(A)) - A), dtype=complex)

    def response(self, frequencies: Array) -> Complex:
        """G at frequencies in Hz, (F, l, m)."""
        return np.asarray(self.C @ self._resolvent(frequencies) @ self.B + self.D)

    @cached_property
    def misfit(self) -> Complex:
        """Measured less modelled responses, (F, l, m)."""
        return np.asarray(self.responses.values - self.response(self.responses.frequencies))

    @property
    def errors(self) -> Complex:
        """The misfit in standard deviations of its real or imaginary part, (F, l, m)."""
        return np.asarray(self.misfit * self.weights / np.sqrt(self.variance_factor))

    @property
    def error_percent(self) -> float:
        """Misfit in percent of the measured responses."""
        return 100.0 * float(np.linalg.norm(self.misfit) / np.linalg.norm(self.responses.values))

    def _slopes(self, frequencies: Array) -> Iterator[tuple[Integers, Complex, Complex]]:
        """Of each output its parameters, the responses (F, m), and slopes (F, parameters, m)."""
        (outputs, inputs), n, first = self.D.shape, len(self.B), len(self.B) + self.B.size
        resolvent, A = self._resolvent(frequencies), sections_dynamics(self.point)
        right, left = resolvent @ self.B, self.C @ resolvent  # (F, n, m), (F, l, n)
        up, down = np.arange(0, n, 2), np.arange(1, n, 2)
        ones = np.broadcast_to(np.eye(inputs), (len(left), inputs, inputs))
        for row in range(outputs):
            x, y = left[:, row, :, None], right  # dG = x_i dA_ij y_j
            of_damping = x[:, down] * A[down, down][:, None] * y[:, down]
            turning = A[up, down][:, None] * (x[:, up] * y[:, down] - x[:, down] * y[:, up])
            of_B = (x[:, :, :, None] * np.eye(inputs)).reshape(len(left), -1, inputs)
            slopes = np.concatenate([turning + of_damping, of_damping, of_B, right, ones], axis=1)
            last = first + self.C.size + row * inputs
            rows = np.r_[:first, first + row * n : first + (row + 1) * n, last : last + inputs]
            yield rows, left[:, row] @ self.B + self.D[row], slopes

    def equations(self) -> Equations:
        """Of all parameters, row by row of the outputs."""
        total, gradient = 0.0, np.zeros(self.flat.size)
        matrix = np.zeros((len(gradient),) * 2)
        for row, (rows, values, slopes) in enumerate(self._slopes(self.responses.frequencies)):
            columns = stacked(slopes * self.weights[:, row, None, :]).transpose(0, 2, 1)
            columns = columns.reshape(-1, len(rows))
            misfit = self.responses.values[:, row] - values
            errors = stacked(misfit * self.weights[:, row]).ravel()
            total += float(errors @ errors)
            gradient[rows] -= columns.T @ errors
            matrix[np.ix_(rows, rows)] += columns.T @ columns
        return total, gradient, matrix

    def polished(self, repair: Callable[[Array], Array]) -> "ResponseFit":
        """The fit after a descent of all entries together; ``repair`` keeps the poles inside."""

        def equations(parameters: Array) -> Equations:
            return replace(self, **self.split(parameters)).equations()

        def inside(parameters: Array) -> Array:
            poles = self.point.size
            return np.concatenate([repair(parameters[:poles]), parameters[poles:]])

        return replace(self, **self.split(descended_squares(equations, self.flat, inside)[0]))

    @cached_property
    def covariance(self) -> ParameterCovariance:
        """Of the parameters as of :attr:`flat`."""
        matrix = self.equations()[2]
        sizes = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        values, vectors = np.linalg.eigh(matrix / np.outer(sizes, sizes))
        free = slice(len(values) - self.parameters, None)  # the others change the states alone
        shown = values[free] > 1e-14 * values[-1]
        directions = vectors[:, free] / sizes[:, None]
        factor = directions[:, shown] / np.sqrt(values[free][shown] / self.variance_factor)
        return ParameterCovariance(factor, directions[:, ~shown])

    def relative_errors(self, frequencies: Array) -> Array:
        """Standard errors of logarithms of gains and of phases (rad), (2, F, l, m), to first order.

        Infinite where a response depends on what the data do not determine.
        """
        errors = np.empty((2, len(frequencies), *self.D.shape))
        for row, (rows, values, slopes) in enumerate(self._slopes(frequencies)):
            relative = np.zeros((*values.shape, self.flat.size), dtype=complex)
            relative[..., rows] = (slopes / values[:, None]).transpose(0, 2, 1)
            for part, gradients in zip(errors, (relative.real, relative.imag), strict=True):
                flat = self.covariance.standard_errors(gradients.reshape(-1, self.flat.size))
                part[:, row] = flat.reshape(values.shape)
        return errors

    @cached_property
    def model(self) -> StateSpaceModel:
        """In discrete time with covariance: the model, or its equivalent with inputs held."""
        responses, outputs = self.responses, len(self.C)
        held = None if responses.sampling_rate else self.scale / self.rate

        def entries(parameters: Any) -> list[Any]:
            return _discrete(**self.split(parameters), held=held)

        A, B, C, D = entries(self.flat)
        silent = np.zeros((outputs * len(A) + outputs, self.flat.size))  # K and level
        slopes = np.vstack([jacobian_of(entries, self.flat), silent])
        noise = np.mean(np.abs(self.misfit) ** 2, axis=0)
        return StateSpaceModel(
            A=A,
            B=B,
            C=C,
            D=D,
            K=np.zeros((len(A), outputs)),
            sampling_rate=self.rate,
            level=np.zeros(outputs),
            noise_covariance=np.diag(noise.sum(axis=1)),
            covariance=self.covariance.through(slopes),
            structure="ss_oe",
            input_names=responses.input_names,
            output_names=responses.output_names,
        )


def _discrete(point: Any, B: Any, C: Any, D: Any, held: float | None) -> list[Any]:
    """``[A, B, C, D]`` in z, of bilinear p, or of s with inputs held for so many radians."""
    A = sections_dynamics(point)
    n = len(A)
    if held is None:
        inverse, root = np.linalg.inv(np.eye(n) - A), np.sqrt(2.0)
        A = inverse @ (np.eye(n) + A)
        return [A, root * inverse @ B, root * C @ inverse, D + C @ inverse @ B]
    power, phi_1, _ = phi_functions(held * A)
    return [power, held * phi_1 @ B, C, D]


def _factored(point: Array, coefficients: Array) -> tuple[Array, Array]:
    """B (n, m) and C (l, n) with residues of rank one nearest to those of (l, m, n) numerators."""
    drives, shapes = [], []
    for k in range(len(point) // 2):
        A = sections_dynamics(point[[k, k + len(point) // 2]])
        poles, vectors = np.linalg.eig(A)
        numerators = A[0, 1] * coefficients[:, :, 2 * k] + np.multiply.outer(
            poles, coefficients[:, :, 2 * k + 1]
        )
        u, s, v = np.linalg.svd(numerators / (poles - poles[::-1])[:, None, None])
        turns = np.sqrt(s[:, 0])[:, None]
        shape, drive = turns * u[:, :, 0], turns * v[:, 0]
        if poles[0].imag:  # the second of a pair is the conjugate of the first
            shape[1], drive[1] = shape[0].conj(), drive[0].conj()
        shapes.append((shape.T @ np.linalg.inv(vectors)).real)
        drives.append((vectors @ drive).real)
    return np.vstack(drives), np.hstack(shapes)


def fit_responses(
    responses: FrequencyResponses,
    modes: tuple[int, int] = (1, MOST_MODES),
    seed: int = 1,
    log: Log | None = None,
) -> ResponseFit:
    """The output-error model with the smallest BIC, as :func:`evopem.fit_responses`."""
    most = min(modes[1], (len(responses.frequencies) - 1) // 3)
    if most < modes[0]:
        problem = f"{len(responses.frequencies)} frequencies are too few for {modes[0]} modes"
        raise InputError(responses.source, problem, f"give {3 * modes[0] + 1} or more")
    modes = modes[0], most
    with one_blas_thread():
        if responses.variances is not None:
            return _searched(responses, np.sqrt(2.0 / responses.variances), modes, seed, log)
        sizes = _deviations(responses.values)
        sizes[sizes == 0.0] = 1.0
        ones = np.ones(responses.values.shape)
        first = _searched(responses, ones / sizes, modes, seed, None)
        left = np.maximum(_deviations(first.misfit), 1e-12 * sizes)
        return _searched(responses, ones / left, modes, seed, log)


def _deviations(values: Complex) -> Array:
    """Of real and imaginary parts over the frequencies, (l, m)."""
    return np.asarray(np.sqrt(0.5 * np.mean(np.abs(values) ** 2, axis=0)))


def _searched(
    responses: FrequencyResponses,
    weights: Array,
    modes: tuple[int, int],
    seed: int,
    log: Log | None,
) -> ResponseFit:
    """The fit of the smallest BIC, each number of modes searched from that before as well."""
    scale, shape = 2.0 * np.pi * float(responses.frequencies[-1]), responses.values.shape
    p = response_axis(responses.frequencies, responses.sampling_rate, scale)
    flat = responses.values.reshape(len(p), -1), weights.reshape(len(p), -1)
    best: ResponseFit | None = None
    criteria: dict[int, float] = {}
    diagram: dict[int, list[Mode]] = {}
    point, reals = None, 2 * weights.size
    for number in range(modes[0], modes[1] + 1):
        generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
        problem = FrequencyProblem(p, *flat, number)
        search = lowest_poles(problem, point, generator)
        point = search.point
        coefficients = problem.solved(point)[1].reshape(*shape[1:], -1)
        matrices = *_factored(point, coefficients), coefficients[:, :, -1]
        rest: Any = scale, weights, 1.0, criteria, diagram, search
        fit = ResponseFit(responses, point, *matrices, *rest).polished(problem.repair)
        squares = max(float(np.sum(np.abs(fit.errors) ** 2)), 1e-24 * problem.power)
        freedom = reals - fit.parameters
        if not responses.are_absolute:
            fit = replace(fit, variance_factor=squares / max(freedom, 1))
        misfit = squares if responses.are_absolute else reals * np.log(squares / reals)
        criteria[number] = misfit + fit.parameters * np.log(reals)
        diagram[2 * number] = natural(fit)
        if log:
            log(f"{number} modes: error {fit.error_percent:.3g} %, BIC {criteria[number]:.6g}")
        if best is None or criteria[number] < criteria[best.sections]:
            best = fit
        if number - best.sections >= PATIENCE or freedom < reals // 10:
            break
    assert best is not None
    return best


def natural(fit: ResponseFit) -> list[Mode]:
    """The sections that oscillate, without their shapes."""
    omega, zeta = np.exp(fit.point.reshape(2, -1))
    p = (omega * (-zeta + np.sqrt(zeta.astype(complex) ** 2 - 1.0)))[zeta < 1.0]
    poles = np.exp(p * fit.scale / fit.rate)
    if fit.responses.sampling_rate:
        poles = (1.0 + p) / (1.0 - p)
    return [Mode(*frequency_and_damping(pole, fit.rate), pole) for pole in poles.tolist()]
