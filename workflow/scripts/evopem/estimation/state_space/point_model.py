"""The model of a point in the units of the recording, and the covariance of its entries."""

from collections.abc import Callable
from functools import partial
from itertools import combinations_with_replacement, pairwise
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import NDArray

from evopem.arrays import Array, Indices, Integers
from evopem.config.settings import Objective
from evopem.estimation.criteria import coloured_autocovariances, lies_at_bound
from evopem.estimation.damped_descent import output_weights
from evopem.estimation.pem.covariance import density_at_zero
from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.sections import input_matrix, sections_of, state_matrix
from evopem.models.parameter_covariance import ParameterCovariance, jacobian_of
from evopem.models.state_space import StateSpaceModel

# Condition of the states' responses at the outputs, scaled to one, above which another basis of the
# states is taken, and doublings of the number of samples that they are seen over.
ILL_CONDITIONED, DOUBLINGS = 1e4, 20


class Matrices(NamedTuple):
    """Of scaled signals; or their derivatives, with a last axis of coordinates."""

    A: NDArray
    drives: NDArray  # [B, K of innovations form, initial states], (n, drives)
    outputs: NDArray  # [C, columns of D, levels, drift], (l, n + regressors)


def output_and_gain(errors: StateSpaceErrors, matrices: Matrices) -> tuple[NDArray, NDArray]:
    """C and K."""
    K = matrices.drives[:, errors.data.inputs.shape[1] : errors.signals.driving]
    if not errors.innovations:
        K = np.zeros((errors.order, len(matrices.outputs), *K.shape[2:]))
    return matrices.outputs[:, : errors.order], K


class ScaledModel:
    """A model of scaled signals, with its errors of one step, (N, l)."""

    def __init__(self, errors: StateSpaceErrors, matrices: Matrices, one_step: Array) -> None:
        self.errors, self.matrices, self.one_step = errors, matrices, one_step

    def recorded(self) -> tuple[NDArray, ...]:
        """A, B, C, D, K and level, less the offset of the outputs, in the recording's units."""
        data, (A, drives, outputs) = self.errors.data, self.matrices
        u, y, m = data.input_scales, data.output_scales, data.inputs.shape[1]
        C, K = output_and_gain(self.errors, self.matrices)
        D = np.zeros((len(C), m), dtype=outputs.dtype)
        D[:, data.feedthrough] = outputs[:, len(A) : len(A) + data.feedthrough.sum()]
        level = y * (outputs[:, self.errors.level_columns] @ data.level_shares)
        return A, drives[:, :m] / u, C * y[:, None], D * y[:, None] / u, K / y, level

    def model(self) -> StateSpaceModel:
        """In the units of the recording, without covariance."""
        data = self.errors.data
        recording, y = data.recording, data.output_scales
        e = self.one_step * y
        noise = e.T @ e / degrees_of_freedom(self.errors)
        A, B, C, D, K, level = self.recorded()
        level = data.output_offsets + level
        return StateSpaceModel(
            *(A, B, C, D, K, recording.sampling_rate, level, 0.5 * (noise + noise.T)),
            input_delays=data.shifts if any(data.shifts) else (),
            structure=self.errors.structure,
            input_names=recording.input_names,
            output_names=recording.output_names,
        )

    def levels(self) -> Array:
        """Level of each segment in the units of the outputs, (segments, l)."""
        data = self.errors.data
        if not data.levels:
            return np.zeros((data.segments, data.outputs.shape[1]))
        levels = self.matrices.outputs[:, self.errors.level_columns].T
        return np.asarray(data.output_offsets + data.output_scales * levels)[data.level_of]

    def initial_states(self) -> Array:
        """Initial state of each segment, (segments, n), of a model whose level is the segment's."""
        return self.matrices.drives[:, self.errors.signals.driving :].T.copy()


def degrees_of_freedom(errors: StateSpaceErrors) -> float:
    """Samples less the estimates for each output."""
    outputs = errors.data.outputs.shape[1]
    return float(max(errors.data.samples - errors.estimated / outputs, 1.0))


class PointModel(ScaledModel):
    """That of a point; the states are those of the sections times a basis."""

    def __init__(self, errors: StateSpaceErrors, projection: Projection) -> None:
        self.errors, self._projection = errors, projection
        sections = state_matrix(projection.sections, errors.layout)
        self._basis = _basis_of(sections, projection.linear[: errors.order].T)
        self._inverse = np.linalg.inv(self._basis)
        matrices = self._matrices(projection.point, projection.linear)
        super().__init__(errors, matrices, projection.errors)

    def jacobian(self) -> Array:
        """Derivatives of ``[A, B, C, D, K, level]`` by coordinates and linear coefficients.

        The latter output by output.  By complex steps, s of each section held.
        """
        point, linear = self._projection.point, self._projection.linear

        def recorded(moved: NDArray) -> tuple[NDArray, ...]:
            coefficients = moved[point.size :].reshape(linear.shape[::-1]).T
            matrices = self._matrices(moved[: point.size], coefficients)
            return ScaledModel(self.errors, matrices, self.one_step).recorded()

        return jacobian_of(recorded, np.concatenate([point, linear.T.ravel()]))

    def _matrices(self, point: NDArray, linear: NDArray) -> Matrices:
        """From those of the predictor, ``x+ = P x + (B - K D) u + K y``."""
        errors, data, n = self.errors, self.errors.data, self.errors.order
        sections = sections_of(errors.layout, point, self._projection.sections.scale)
        P = self._basis @ state_matrix(sections, errors.layout) @ self._inverse
        drives = self._basis @ input_matrix(sections, errors.layout)
        outputs = np.hstack([linear[:n].T @ self._inverse, linear[n:].T])
        if not errors.innovations:
            return Matrices(P, drives, outputs)
        m, driving, at = data.inputs.shape[1], errors.signals.driving, errors.level_columns
        C, K = outputs[:, :n], drives[:, m:driving]
        drives[:, :m][:, data.feedthrough] += K @ outputs[:, n : at.start]
        # A constant of the predictor is a level, at which its states rest.
        at_rest = np.linalg.solve(np.eye(n) - P, K)
        outputs[:, at] = np.linalg.solve(np.eye(len(C)) - C @ at_rest, outputs[:, at])
        if data.levels:
            drives[:, driving:] -= at_rest @ outputs[:, at][:, data.level_of]
        return Matrices(P + K @ C, drives, outputs)


def _basis_of(predictor: Array, C: Array) -> Array:
    """The states of the model from those of the sections, (n, n): the same, unless ill-conditioned.
    Where sections with nearly equal poles cancel, rounding would spoil simulations: the states then
    have orthonormal responses at the outputs (output-normal form)."""
    with np.errstate(all="ignore"):
        # Of C, C P, C P^2, ..., twice as many in each step.
        root = np.asarray(np.linalg.qr(np.vstack([C, np.zeros_like(predictor)]), mode="r"))
        power = predictor
        for _ in range(DOUBLINGS):
            root = np.asarray(np.linalg.qr(np.vstack([root, root @ power]), mode="r"))
            power = power @ power
        size = np.linalg.norm(root, axis=0)
        # Sections are stable, so that no power of them grows; some states may be seen nowhere.
        usable = bool(np.all(np.diag(root))) and np.isfinite(root / size).all()
        ill = usable and np.linalg.cond(root / size) > ILL_CONDITIONED
    return root if ill else np.eye(len(predictor))


# Eigenvalues of the information matrix, its diagonal scaled to one, below this share of the
# largest one come from rounding: they are raised to it, and standard errors are then lower bounds.
UNDETERMINED = 1e-15


def parameter_covariance(
    errors: StateSpaceErrors, projection: Projection, objective: Objective = "quadratic"
) -> ParameterCovariance | None:
    """Covariance of the entries of ``[A, B, C, D, K, level]``, initial states estimated along."""
    scored = scores_of(errors, projection.errors, objective)
    if scored is None:
        return None
    derivatives = errors.signals.derivatives(projection.sections, projection.states)
    model = PointModel(errors, projection)
    radius = float(np.abs(np.linalg.eigvals(model.matrices.A)).max())
    return sandwich(
        errors,
        partial(errors.jacobian, projection, derivatives),
        *scored,
        model.jacobian(),
        errors.order,
        at_bound=lies_at_bound(radius, errors.radius),
        weighed=partial(weighed_jacobians, errors, projection, derivatives),
    )


def weighed_jacobians(
    errors: StateSpaceErrors, solved: Projection, signals: Array, weights: Array
) -> Array:
    """``sum_ij weights_ij J_i' J_j`` of the Jacobian of each output, in their places.

    ``weights``, (l, l), are symmetric.  From one Gram matrix of all signals and regressors.
    """
    of_sections, c, x = errors.signals, solved.linear[: errors.order].T, solved.regressors
    hessian = of_sections.contracted(solved.sections, signals.T @ signals, c.T @ weights @ c)
    across = of_sections.across(solved.sections, signals.T @ x, c.T @ weights)
    return np.block([[hessian, across], [across.T, np.kron(weights, x.T @ x)]])


def scores_of(
    errors: StateSpaceErrors, whitened: Array, objective: Objective
) -> tuple[Array, Array] | None:
    """Errors, (N, l), and their weights, (l, l), in a covariance, or what takes their place.

    Of absolute errors signs over twice the density at zero (Bassett & Koenker 1978); else None.
    """
    if objective == "quadratic":
        return whitened, errors.weights(whitened.T @ whitened / len(whitened))
    vanishing = -(-errors.estimated // whitened.shape[1])
    density = np.array([density_at_zero(column, vanishing) for column in whitened.T])
    if not np.all(density > 0.0):
        return None
    sizes, left = errors.data.absolute_sizes, np.mean(np.abs(whitened), axis=0)
    by_sums = output_weights(left / sizes, errors.weighing) / len(whitened) / sizes
    return np.sign(whitened) / (2.0 * density), np.diag(2.0 * density * by_sums)


def sandwich(
    errors: StateSpaceErrors,
    jacobian: Callable[[int], tuple[Array, Indices]],
    scores: Array,
    weights: Array,
    mapping: Array,
    redundant: int,
    coloured: bool = False,
    at_bound: bool = False,
    weighed: Callable[[Array], Array] | None = None,
) -> ParameterCovariance:
    """``M H^-1 S H^-1 M'`` in factored form; ``redundant`` directions of H change no model.

    ``at_bound``: the step to the optimum beyond a bound that holds the estimates counts as an error
    of theirs, which cannot follow the samples there.
    H is the Gauss-Newton Hessian and S the covariance of the gradient, in output-error form or of
    ``coloured`` errors with their autocovariances (Ljung 1999, eq. 9.42).  ``jacobian``: of an
    output the derivatives of its errors, (N, k), and the columns of the mapping M that they are of.
    ``weighed``: sums over pairs of outputs of their products, with weights (l, l), at once.
    """
    data, count = errors.data, mapping.shape[1]
    autocovariances = (scores.T @ scores / len(scores))[None]
    if coloured or not errors.innovations:
        autocovariances = coloured_autocovariances(scores, data.bounds)
    between = weights @ autocovariances @ weights
    gradient = np.zeros(count)
    for row in range(len(weights) if at_bound else 0):
        columns, places = jacobian(row)
        gradient[places] += columns.T @ (scores @ weights[row])
    if weighed is not None and len(between) == 1:
        hessian, score = weighed(weights), weighed(between[0])
    else:
        hessian, score = _sums_over_pairs(jacobian, weights, between, data.bounds, count)
    score *= data.samples / degrees_of_freedom(errors)
    seen = np.diag(hessian) > 0.0
    unseen, mapping = mapping[:, ~seen], mapping[:, seen]
    hessian, score = (matrix[np.ix_(seen, seen)] for matrix in (hessian, score))
    scale = np.sqrt(np.diag(hessian))
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
    step = vectors[:, determined] @ (inverse.T @ (gradient[seen] / scale))
    beyond = [step[:, None]] if at_bound else []
    factor = mapping @ np.hstack([vectors[:, determined] @ root, farthest, *beyond])
    return ParameterCovariance(factor, unseen[:, unseen.any(axis=0)])


def _sums_over_pairs(
    jacobian: Callable[[int], tuple[Array, Indices]],
    weights: Array,
    between: Array,
    bounds: Integers,
    count: int,
) -> tuple[Array, Array]:
    """H and S, (count, count), the latter with weights (lags, l, l) of each lag from 0 on."""
    hessian, score = np.zeros((count, count)), np.zeros((count, count))
    for row, column in combinations_with_replacement(range(len(weights)), 2):
        (columns, weighted), (others, their) = jacobian(row), jacobian(column)
        gram = columns.T @ others
        of_lags = np.concatenate([between[:0:-1, column, row], between[:, row, column]])
        summed = of_lags[0] * gram
        if len(of_lags) > 1:
            summed = columns.T @ _filtered(others, of_lags, bounds)
        for total, of_pair in ((hessian, weights[row, column] * gram), (score, summed)):
            total[np.ix_(weighted, their)] += of_pair
            if row != column:
                total[np.ix_(their, weighted)] += of_pair.T
    return hessian, score


def _filtered(signals: Array, of_lags: Array, bounds: Integers) -> Array:
    """``sum_k of_lags_k signals_(t-k)`` over lags of either sign, segment by segment."""
    before = len(of_lags) // 2
    passed = np.empty_like(signals)
    for first, stop in pairwise(bounds):
        whole = scipy.signal.oaconvolve(signals[first:stop], of_lags[:, None], axes=0)
        passed[first:stop] = whole[before : before + stop - first]
    return passed
