"""The model of a point in the units of the recording, and the covariance of its entries."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import oaconvolve

from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.sections import state_matrix
from evopem.estimation.vector_autoregression import coloured_autocovariances
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]


# Condition of the states' responses at the outputs, scaled to one, above which another basis of the
# states is taken, and doublings of the number of samples that they are seen over.
ILL_CONDITIONED, DOUBLINGS = 1e4, 20


def model_of(errors: StateSpaceErrors, projection: Projection) -> StateSpaceModel:
    """The model of a point in the units of the recording, without covariance."""
    return PointModel(errors, projection).model()


def degrees_of_freedom(errors: StateSpaceErrors) -> float:
    """Samples less the estimates for each output."""
    outputs = errors.data.outputs.shape[1]
    estimated = (errors.parameters + errors.order * errors.data.segments) / outputs
    return float(max(errors.data.samples - estimated, 1.0))


class PointModel:
    """Matrices of the model of a point for scaled signals.

    The states are those of the sections times ``basis``.

    Parameters
    ----------
    errors : StateSpaceErrors
    projection : Projection
        Of the point.
    """

    def __init__(self, errors: StateSpaceErrors, projection: Projection) -> None:
        self._errors, self._projection = errors, projection
        data, n = errors.data, errors.order
        m, outputs = data.inputs.shape[1], data.outputs.shape[1]
        direct = int(data.feedthrough.sum())
        linear = projection.linear
        sections, C = state_matrix(projection.sections, errors.layout), linear[:n].T
        self._basis = _basis_of(sections, C)
        self._inverse = np.linalg.inv(self._basis)
        self._drives = self._basis @ errors.drive_matrix(projection)
        self._predictor = self._basis @ sections @ self._inverse
        self._K, self._C = self._basis @ errors.gain(projection), C @ self._inverse
        self._D = np.zeros((outputs, m))
        self._D[:, data.feedthrough] = linear[n : n + direct].T
        self._constants = linear[n + direct : n + direct + data.levels]
        self._resolvent = np.linalg.inv(np.eye(n) - self._predictor)
        self._closed = np.eye(outputs) - self._C @ self._resolvent @ self._K
        self._level = self._level_of(data.level_shares @ self._constants)

    def model(self) -> StateSpaceModel:
        """The model in the units of the recording, without covariance."""
        data = self._errors.data
        u, y = data.input_scales, data.output_scales
        degrees = degrees_of_freedom(self._errors)
        noise = self._projection.covariance * np.outer(y, y) * data.samples / degrees
        inputs = self._drives[:, : data.inputs.shape[1]]
        return StateSpaceModel(
            A=self._predictor + self._K @ self._C,
            B=(inputs + self._K @ self._D) / u,
            C=self._C * y[:, None],
            D=self._D * y[:, None] / u,
            K=self._K / y,
            level=data.output_offsets + y * self._level,
            sampling_rate=data.recording.sampling_rate,
            noise_covariance=0.5 * (noise + noise.T),
            input_delays=data.shifts if any(data.shifts) else (),
            structure=self._errors.structure,
            input_names=data.recording.input_names,
            output_names=data.recording.output_names,
        )

    def levels(self) -> Array:
        """Level of each segment in the units of the outputs, (segments, l)."""
        data = self._errors.data
        if not data.levels:
            return np.zeros((data.segments, data.outputs.shape[1]))
        levels = np.array([self._level_of(constant) for constant in self._constants])
        return np.asarray(data.output_offsets + data.output_scales * levels)[data.level_of]

    def initial_states(self) -> Array:
        """Initial state of each segment, (segments, n), of a model whose level is the segment's.

        A constant of the predictor's states belongs to the level: ``y - level`` drives the model.
        """
        data = self._errors.data
        pulses = self._drives[:, self._errors.driving :].T
        offsets = (self.levels() - data.output_offsets) / data.output_scales
        return np.asarray(pulses - offsets @ (self._resolvent @ self._K).T)

    def jacobian(self) -> Array:
        """Derivatives of ``[A, B, C, D, K, level]`` by coordinates and linear coefficients.

        Linear coefficients stand output by output.
        """
        changes = [*self._of_coordinates(), *self._of_coefficients()]
        return np.array([self._changed(each) for each in changes]).T

    def _level_of(self, constant: Array) -> Array:
        """Mean of scaled outputs at rest from the constant of the predictor."""
        if not self._errors.innovations:
            return constant
        return np.asarray(np.linalg.lstsq(self._closed, constant, rcond=None)[0])

    def _changed(self, change: _Change) -> Array:
        """Changes of all entries, one matrix after the other."""
        data, K, C, D = self._errors.data, self._K, self._C, self._D
        u, y, resolvent = data.input_scales, data.output_scales, self._resolvent
        dP, dC = self._basis @ change.predictor @ self._inverse, change.outputs @ self._inverse
        dB, dK = self._basis @ change.inputs, self._basis @ change.gain
        dD = change.feedthrough
        dA = dP + dK @ C + K @ dC
        dBu = dB + dK @ D + K @ dD
        dfeedback = dC @ resolvent @ K + C @ resolvent @ (dK + dP @ resolvent @ K)
        dconstant = change.constant + dfeedback @ self._level
        dlevel = np.linalg.lstsq(self._closed, dconstant, rcond=None)[0]
        parts = (dA, dBu / u, dC * y[:, None], dD * y[:, None] / u, dK / y, y * dlevel)
        return np.concatenate([part.ravel() for part in parts])

    def _of_coordinates(self) -> Iterator[_Change]:
        """Changes by the coordinates: poles of the predictor, inputs and gain of its sections."""
        errors = self._errors
        layout, m = errors.layout, errors.data.inputs.shape[1]
        for at in range(layout.dimension):
            change = _Change.none(errors)
            section, place = divmod(at, layout.pair_length)
            single = section >= layout.pairs
            if single:
                section, place = layout.pairs, at - layout.pairs * layout.pair_length
            first = 2 * section
            if place == 0:
                change.predictor[first, first] = 1.0
                if not single:
                    change.predictor[first + 1, first + 1] = 1.0
            elif place == 1 and not single:
                coupling = self._projection.sections.coupling[section]
                change.predictor[first + 1, first] = 1.0 / coupling
            else:
                row, drive = divmod(place - (1 if single else 2), layout.drives)
                if drive < m:
                    change.inputs[first + row, drive] = 1.0
                elif drive < errors.driving:
                    change.gain[first + row, drive - m] = 1.0
            yield change

    def _of_coefficients(self) -> Iterator[_Change]:
        """Changes by the linear coefficients: C, D and constants; drift changes no entry."""
        data, n = self._errors.data, self._errors.order
        direct = np.flatnonzero(data.feedthrough)
        for output in range(data.outputs.shape[1]):
            for place in range(self._projection.regressors.shape[1]):
                change = _Change.none(self._errors)
                if place < n:
                    change.outputs[output, place] = 1.0
                elif place < n + len(direct):
                    change.feedthrough[output, direct[place - n]] = 1.0
                elif place < n + len(direct) + data.levels:
                    change.constant[output] = data.level_shares[place - n - len(direct)]
                yield change


@dataclass(frozen=True, eq=False)
class _Change:
    """Changes of what a point holds: in the states of the sections, and for scaled signals."""

    predictor: Array
    inputs: Array
    gain: Array
    outputs: Array
    feedthrough: Array
    constant: Array

    @classmethod
    def none(cls, errors: StateSpaceErrors) -> _Change:
        """No change yet."""
        n, m, outputs = errors.order, errors.data.inputs.shape[1], errors.data.outputs.shape[1]
        shapes = ((n, n), (n, m), (n, outputs), (outputs, n), (outputs, m), (outputs,))
        return cls(*map(np.zeros, shapes))


def _basis_of(predictor: Array, C: Array) -> Array:
    """The states of the model from those of the sections, (n, n).

    The same ones, unless sections with nearly equal poles cancel each other: entries of A and C
    would be so large that rounding spoils simulations.  The model then has states whose responses
    at the outputs are orthonormal (output-normal form).
    """
    with np.errstate(all="ignore"):
        # Of C, C P, C P^2, ..., twice as many in each step.
        root = np.asarray(np.linalg.qr(np.vstack([C, np.zeros_like(predictor)]), mode="r"))
        power = predictor
        for _ in range(DOUBLINGS):
            root = np.asarray(np.linalg.qr(np.vstack([root, root @ power]), mode="r"))
            power = power @ power
        size = np.linalg.norm(root, axis=0)
        ill = np.linalg.cond(root / size) > ILL_CONDITIONED
        usable = np.isfinite(np.linalg.inv(root)).all() if np.all(np.diag(root)) else False
    return root if ill and usable else np.eye(len(predictor))


# Eigenvalues of the information matrix, its diagonal scaled to one, below this share of the
# largest one come from rounding: they are raised to it, and standard errors are then lower bounds.
UNDETERMINED = 1e-15
# Lags of errors that cost as much as filtering the signals for one pair of outputs.
FILTERED = 20


def parameter_covariance(
    errors: StateSpaceErrors, projection: Projection, weights: Array
) -> ParameterCovariance:
    """Covariance of the entries of ``[A, B, C, D, K, level]``, initial states estimated along.

    ``H^-1 S H^-1``, where H is the Gauss-Newton Hessian and S the covariance of the gradient.  In
    innovations form the errors are white.  Those of an output-error form need not be: S then
    takes their autocovariances, independent of the inputs (Ljung 1999, eq. 9.42).  The free
    choice of the states, n directions of H, is left out.

    Parameters
    ----------
    errors : StateSpaceErrors
    projection : Projection
        Its errors are those of the gradient: of another objective than squares its scores.
    weights : (ny, ny) array
        Of the outputs.
    """
    hessian = _information(errors, projection, weights)
    score = _score_covariance(errors, projection, weights)
    return sandwich(hessian, score, PointModel(errors, projection).jacobian(), errors.order)


def sandwich(hessian: Array, score: Array, mapping: Array, redundant: int) -> ParameterCovariance:
    """``M H^-1 S H^-1 M'`` in factored form.

    Parameters
    ----------
    hessian, score : (n, n) arrays
    mapping : (entries, n) array
        M.
    redundant : int
        Directions of H that change no model.
    """
    scale = np.sqrt(np.diag(hessian))
    unseen = scale == 0.0
    scale[unseen] = 1.0
    values, vectors = np.linalg.eigh(hessian / np.outer(scale, scale))
    kept = np.arange(len(values)) >= redundant
    least = UNDETERMINED * values[-1]
    determined = kept & (values > least)
    inverse = vectors[:, determined] / values[determined]
    middle = inverse.T @ (score / np.outer(scale, scale)) @ inverse
    square, turned = np.linalg.eigh(0.5 * (middle + middle.T))
    root = turned * np.sqrt(np.maximum(square, 0.0))
    mapping = mapping / scale
    # Rounding hides how far along these the data allow to go, but not what they hardly change.
    farthest = vectors[:, kept & ~determined] / np.sqrt(least)
    factor = mapping @ np.hstack([vectors[:, determined] @ root, farthest])
    return ParameterCovariance(factor, mapping[:, unseen])


def _information(errors: StateSpaceErrors, projection: Projection, weights: Array) -> Array:
    """``J' W J`` over coordinates and, output by output, linear coefficients."""
    signals = errors.signals.derivatives(projection.sections, projection.states)
    return _products(
        errors,
        projection,
        (signals, projection.regressors),
        (signals, projection.regressors),
        weights,
    )


def _score_covariance(errors: StateSpaceErrors, projection: Projection, weights: Array) -> Array:
    """Covariance of ``J' W e``, over the same."""
    data = errors.data
    inflation = data.samples / degrees_of_freedom(errors)
    if errors.innovations:
        autocovariances = projection.covariance[None]
    else:
        autocovariances = coloured_autocovariances(projection.errors, data.bounds)
    between = weights @ autocovariances @ weights
    signals = (
        errors.signals.derivatives(projection.sections, projection.states),
        projection.regressors,
    )
    pairs = weights.shape[0] * (weights.shape[0] + 1) // 2
    summed = _summed_by_lags if len(between) < FILTERED * pairs else _summed_by_outputs
    return inflation * summed(errors, projection, signals, between)


def _summed_by_lags(
    errors: StateSpaceErrors, projection: Projection, signals: tuple[Array, Array], between: Array
) -> Array:
    """``sum J_(t+k)' between_k J_t`` over lags k of either sign, ``between_-k = between_k'``."""
    total = np.zeros(2 * (_coefficients(errors, projection),))
    for lag, of_lag in enumerate(between):
        products = np.zeros_like(total)
        for first, stop in pairwise(errors.data.bounds):
            later, earlier = slice(first + lag, stop), slice(first, max(stop - lag, first))
            if first + lag >= stop:
                continue
            products += _products(
                errors,
                projection,
                (signals[0][later], signals[1][later]),
                (signals[0][earlier], signals[1][earlier]),
                of_lag,
            )
        total += products if lag == 0 else products + products.T
    return total


def _summed_by_outputs(
    errors: StateSpaceErrors, projection: Projection, signals: tuple[Array, Array], between: Array
) -> Array:
    """The same for many lags: signals filtered by all of them, for each pair of outputs."""
    outputs = between.shape[1]
    total = np.zeros(2 * (_coefficients(errors, projection),))
    for one in range(outputs):
        for other in range(one + 1):
            of_lags = np.concatenate([between[:0:-1, other, one], between[:, one, other]])
            passed = [filtered(each, of_lags, errors.data.bounds) for each in signals]
            unit = np.zeros((outputs, outputs))
            unit[one, other] = 1.0
            products = _products(errors, projection, signals, (passed[0], passed[1]), unit)
            total += products if one == other else products + products.T
    return total


def filtered(signals: Array, of_lags: Array, bounds: NDArray[np.int64]) -> Array:
    """``sum_k of_lags_k signals_(t-k)`` over lags of either sign, segment by segment."""
    before = len(of_lags) // 2
    passed = np.empty_like(signals)
    for first, stop in pairwise(bounds):
        whole = oaconvolve(signals[first:stop], of_lags[:, None], axes=0)
        passed[first:stop] = whole[before : before + stop - first]
    return passed


def _coefficients(errors: StateSpaceErrors, projection: Projection) -> int:
    """Coordinates and, output by output, linear coefficients."""
    return errors.dimension + projection.linear.size


def _products(
    errors: StateSpaceErrors,
    projection: Projection,
    left: tuple[Array, Array],
    right: tuple[Array, Array],
    between: Array,
) -> Array:
    """``J_left' between J_right`` from the (signals, regressors) that both consist of."""
    c = projection.linear[: errors.order].T
    top = errors.derivatives.contracted(
        projection.sections, left[0].T @ right[0], c.T @ between @ c
    )
    upper = errors.derivatives.by_linear(projection.sections, left[0].T @ right[1], c.T @ between)
    lower = errors.derivatives.by_linear(projection.sections, right[0].T @ left[1], c.T @ between.T)
    bottom = np.kron(between, left[1].T @ right[1])
    return np.block([[top, upper], [lower.T, bottom]])
