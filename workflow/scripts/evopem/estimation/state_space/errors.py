"""The prediction-error problem of state-space models, with the output matrices eliminated.

The one-step predictor of innovations form, ``x+ = (A - K C) x + (B - K D) u + K y``, ``y = C x + D
u + constant + e``, is an output-error model with the inputs u and y: one set of coordinates, the
sections of the predictor (:mod:`.sections`), serves both forms.  C, D and constants are linear, of
the same regressors for all outputs (Zellner 1962), and eliminated by variable projection (Golub &
Pereyra 1973) with the Jacobian of Kaufman (1975).  A derivative is a signal of one section times a
row of C: one Gram matrix of those signals gives the normal equations.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import qr
from scipy.linalg.blas import dgemm
from scipy.linalg.lapack import dpotrf, dtrcon, dtrtri, dtrtrs

from evopem.arrays import Array, Indices
from evopem.config.settings import OutputWeighting
from evopem.estimation.damped_descent import Weighing
from evopem.estimation.state_space.scaled_recording import ScaledRecording
from evopem.estimation.state_space.section_grams import section_gram
from evopem.estimation.state_space.sections import (
    Layout,
    SectionArrays,
    SectionSignals,
    input_matrix,
    inside,
    largest_radius,
    moved,
    normalised,
    section_states,
    sections_of,
    state_matrix,
)
from evopem.models.state_space import PlainStructure

# Singular values of the regressors, their columns scaled to unit length, below this share of the
# largest one are rounding; none can be where the reciprocal condition is above the second for each.
# Above the third their products tell enough, with corrections (Björck 1987).
REGRESSOR_RANK, WELL_CONDITIONED, OF_PRODUCTS, REFINED = 1e-9, 1e-8, 1e-6, 2
# Added to the variances of the errors, relative to the power of the outputs: errors of less than a
# ten-millionth of an output carry no information, and a determinant would seek them out.
ROUNDING = 1e-14
# A predictor that forgets has e**-3 of its initial state left at the end of the longest segment.
# Waves and drifts of others may be fitted to the noise, and go on behind the samples; a predictor
# that has to forget loses the likelihood of a few parameters at most.
FORGETTING = 3.0
# Multiplications from which on Gram matrices of signals follow from equations of their sections, up
# to a radius r of poles: these multiply rounding by ``(1 - r**2)**-3``.
MANY_PRODUCTS, LARGEST_RADIUS = 1e7, 0.9999
EDGE = 1e-9  # a pole moved to the radius stops just inside it


@dataclass(frozen=True, eq=False)
class Projection:
    """Errors of a point with the best output matrices."""

    point: Array
    sections: SectionArrays
    states: Array  # (N, n)
    regressors: Array  # (N, q): states, inputs with feedthrough, constants of levels, and drift
    linear: Array  # (q, ny): least-squares C, D, constants and drift, transposed
    errors: Array  # (N, ny)
    factor: Array | None = None  # (q, q): R of ``regressors = Q R``, where their products tell it
    found_basis: Array | None = None  # (N, rank), where they do not

    @cached_property
    def basis(self) -> Array:
        """Orthonormal, of the regressors, (N, rank)."""
        if self.found_basis is not None:
            return self.found_basis
        basis = self.regressors @ dtrtri(self.factor)[0]
        # It is orthogonal to 1e-4, which products tell well (CholeskyQR2, Yamamoto et al. 2015).
        return np.asarray(basis @ dtrtri(dpotrf(basis.T @ basis)[0])[0])

    @cached_property
    def covariance(self) -> Array:
        """``errors' errors / N``, (ny, ny)."""
        return np.asarray(self.errors.T @ self.errors / len(self.errors))


@dataclass(frozen=True, eq=False)
class StateSpaceErrors:
    """Criterion, normal equations and feasibility of models of one order on a recording.

    The criterion is the logarithm of the determinant of the errors' covariance (``determinant``),
    the sum of the logarithms of their variances (``noise``), or of the relative variances
    (``power``).
    """

    data: ScaledRecording
    order: int
    structure: PlainStructure
    weighting: OutputWeighting = "determinant"
    radius: float = 0.9999
    forgets: bool = False  # whether a predictor of innovations form forgets its initial state

    @property
    def innovations(self) -> bool:
        """Whether there is a K."""
        return self.structure == "ss"

    @property
    def layout(self) -> Layout:
        """Of a point."""
        return self.signals.layout

    @cached_property
    def signals(self) -> SectionSignals:
        """The signals that drive the states, and a pulse for each segment."""
        outputs = [self.data.outputs] if self.innovations else []
        driving = np.column_stack([self.data.inputs, *outputs])
        layout = Layout(self.order, driving.shape[1] + self.data.segments)
        return SectionSignals(layout, driving, self.data.bounds)

    @cached_property
    def direct(self) -> tuple[Array, ...]:
        """Regressors beside the states."""
        return self.data.inputs[:, self.data.feedthrough], self.data.constants, self.data.drift

    @property
    def section_radius(self) -> float:
        """The largest radius of the sections, poles of the predictor."""
        if not (self.forgets and self.innovations):
            return self.radius
        return min(self.radius, float(np.exp(-FORGETTING / np.diff(self.data.bounds).max())))

    @property
    def level_columns(self) -> slice:
        """Where levels stand among the regressors, behind the states and inputs at once."""
        first = self.order + int(self.data.feedthrough.sum())
        return slice(first, first + self.data.levels)

    @property
    def weighing(self) -> Weighing:
        """The weighting of absolute errors: outputs by their power, or by their noise."""
        return "power" if self.weighting == "power" else "noise"

    @property
    def parameters(self) -> int:
        """Independent parameters: coefficients, level and drift, without initial states."""
        nu, ny, n = self.data.inputs.shape[1], self.data.outputs.shape[1], self.order
        count = n * (nu + ny) + ny * int(self.data.feedthrough.sum())
        count += n * ny if self.innovations else 0
        return count + ny * (int(self.data.levels > 0) + self.data.drift.shape[1])

    @property
    def estimated(self) -> int:
        """Parameters and initial states."""
        return self.parameters + self.order * self.data.segments

    @property
    def cost(self) -> float:
        """Multiplications of one set of normal equations."""
        signals = 2 * self.layout.sections * self.layout.drives + 2 * self.order
        return float(self.data.samples) * signals**2

    def projection(self, point: Array) -> Projection:
        """Errors with the best C, D and constants."""
        solved = self._regression(point)
        regressors, y = solved[-1], self.data.outputs
        gram = regressors.T @ regressors
        sizes = np.sqrt(np.diag(gram))
        sizes[sizes == 0.0] = 1.0
        triangle, failed = dpotrf(gram / np.outer(sizes, sizes))
        if not failed and dtrcon(triangle)[0] > OF_PRODUCTS:
            factor, linear, errors = triangle * sizes, np.zeros((len(sizes), y.shape[1])), y
            for _ in range(REFINED):
                step = dtrtrs(factor, dtrtrs(factor, regressors.T @ errors, trans=1)[0])[0]
                linear, errors = linear + step, errors - regressors @ step
            return Projection(*solved, linear, errors, factor=factor)
        basis, triangle = qr(regressors / sizes, mode="economic", check_finite=False)
        if dtrcon(triangle)[0] > WELL_CONDITIONED * len(sizes):
            along = basis.T @ y
            linear = dtrtrs(triangle, along)[0]
        else:
            left, singular, right = np.linalg.svd(triangle)
            kept = singular > REGRESSOR_RANK * singular[0]
            basis = basis @ left[:, kept]
            along = basis.T @ y
            linear = (right[kept].T / singular[kept]) @ along
        linear, errors = linear / sizes[:, None], y - basis @ along
        return Projection(*solved, linear, errors, found_basis=basis)

    def with_linear(self, point: Array, linear: Array) -> Projection:
        """Errors with given C, D and constants, (q, ny) as those of a projection; no basis."""
        solved = self._regression(point)
        return Projection(*solved, linear, self.data.outputs - solved[-1] @ linear)

    def _regression(self, point: Array) -> tuple[Array, SectionArrays, Array, Array]:
        """A point, its sections, the states, and all regressors."""
        sections = sections_of(self.layout, point)
        drives = input_matrix(sections, self.layout)
        inputs = self.signals.of_drives @ drives[:, : self.signals.driving].T
        initial = np.ascontiguousarray(drives[:, self.signals.driving :].T)
        poles = sections.sigma, sections.coupling, sections.back
        states = section_states(*poles, initial, inputs, self.data.bounds)
        return point, sections, states, np.column_stack([states, *self.direct])

    def jacobian(self, solved: Projection, signals: Array, output: int) -> tuple[Array, Indices]:
        """Derivatives of what is predicted of an output, from those signals of the sections.

        By the coordinates and by its own linear coefficients, and where these stand among the
        coordinates and all coefficients, output by output.
        """
        q, c = solved.regressors.shape[1], solved.linear[: self.order, output]
        by_coordinates = self.signals.of_output(solved.sections, signals, c)
        output_columns = self.layout.dimension + output * q + np.arange(q)
        columns = np.column_stack([by_coordinates, solved.regressors])
        return columns, np.concatenate([np.arange(self.layout.dimension), output_columns])

    def criterion(self, covariance: Array) -> float:
        """Criterion of the errors' covariance, (ny, ny); its unit is one for each output."""
        if not np.isfinite(covariance).all():
            return float("inf")
        floor = ROUNDING * np.eye(len(covariance))
        if self.weighting == "determinant":
            return float(np.linalg.slogdet(covariance + floor)[1])
        if self.weighting == "noise":
            return float(np.sum(np.log(np.diag(covariance + floor))))
        return float(np.trace(covariance))

    def percent(self, criterion: float) -> float:
        """A criterion as a percentage of the power of the outputs, y less its mean with a level.

        The geometric mean over outputs or principal directions; for ``power`` the arithmetic one.
        """
        mean = criterion / self.data.outputs.shape[1]
        return 100.0 * (mean if self.weighting == "power" else float(np.exp(mean)))

    def stable(self, projection: Projection) -> bool:
        """Whether the eigenvalues of A lie within the radius; those of A - K C do."""
        if not self.innovations:
            return True
        if not np.isfinite(projection.linear).all():
            return False
        drives = input_matrix(projection.sections, self.layout)
        gain = drives[:, self.data.inputs.shape[1] : self.signals.driving]
        predictor = state_matrix(projection.sections, self.layout)
        A = predictor + gain @ projection.linear[: self.order].T
        return bool(np.abs(np.linalg.eigvals(A)).max() <= self.radius)

    def weights(self, covariance: Array) -> Array:
        """Derivative of the criterion by the covariance: weights of the outputs, (ny, ny)."""
        floor = ROUNDING * np.eye(len(covariance))
        if self.weighting == "determinant":
            weights = np.linalg.inv(covariance + floor)
            return np.asarray(0.5 * (weights + weights.T), dtype=float)
        if self.weighting == "noise":
            return np.diag(1.0 / np.diag(covariance + floor))
        return np.eye(len(covariance))

    def begun(self, start: Array) -> Array:
        """A start whose poles lie within the radius, in its normal form."""
        within = inside(self.layout, start, self.section_radius * (1.0 - EDGE))
        return normalised(self.layout, within)

    def moved(self, point: Array, step: Array) -> Array:
        """A point after a step, its poles within the radius."""
        after = moved(self.layout, point, step)
        return inside(self.layout, after, self.section_radius * (1.0 - EDGE))

    def normal_equations(self, projection: Projection) -> tuple[Array, Array]:
        """Gradient and Gauss-Newton Hessian of the criterion, s of each section held."""
        gram, against = self._sums(projection)
        c = projection.linear[: self.order].T
        weights = self.weights(projection.covariance)
        per_sample = 2.0 / self.data.samples
        hessian = per_sample * self.signals.contracted(projection.sections, gram, c.T @ weights @ c)
        gradient = self.signals.summed(projection.sections, -against @ (weights @ c))
        return per_sample * gradient, hessian

    def _sums(self, projection: Projection) -> tuple[Array, Array]:
        """Sums of products of the derivatives' signals, less their part in the space of the
        regressors: with each other, (n, n), and with the errors, (n, ny)."""
        sections, states = projection.sections, projection.states
        signals = self.signals.derivatives(sections, states)
        many = projection.factor is not None and signals.size * signals.shape[1] > MANY_PRODUCTS
        if many and largest_radius(self.layout, projection.point) <= LARGEST_RADIUS:
            factors = [projection.errors, self.signals.of_drives, *self.direct]
            ends = np.cumsum([factor.shape[1] for factor in factors[:2]])
            against, driven, direct = np.split(signals.T @ np.hstack(factors), ends, axis=1)
            gram, of_states = section_gram(self.signals, sections, signals, states, driven)
            regressed = np.vstack([of_states, direct.T])
            along = dtrtrs(projection.factor, regressed, trans=1)[0]
            return gram - along.T @ along, against
        along, against = projection.basis.T @ signals, signals.T @ projection.errors
        # Without another array of this size.
        signals = dgemm(-1.0, along.T, projection.basis.T, 1.0, signals.T, overwrite_c=True).T
        return signals.T @ signals, against
