"""The prediction-error problem of state-space models, with the output matrices eliminated.

The one-step predictor of innovations form, ``x+ = (A - K C) x + (B - K D) u + K y``,
``y = C x + D u + constant + e``, is an output-error model whose inputs are u and y; the
output-error form has u alone.  So one set of coordinates serves both: the sections of the
predictor and their inputs (:mod:`.sections`).  C, D and the constants are linear, the same
regressors serve all outputs, and least squares is therefore optimal whatever the weights of the
outputs are (Zellner 1962).  They are eliminated (variable projection: Golub & Pereyra 1973), and
the Jacobian is that of Kaufman (1975).

A derivative of the errors is a signal of one section times a row of C.  One Gram matrix of all
those signals, whose size does not depend on the number of outputs, gives the normal equations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.linalg.blas import dgemm

from evopem.config.settings import OutputWeighting
from evopem.estimation.state_space.scaled_recording import ScaledRecording
from evopem.estimation.state_space.sections import (
    Layout,
    Sections,
    input_matrix,
    inside,
    largest_radius,
    moved,
    normalised,
    sections_of,
    state_matrix,
)
from evopem.estimation.state_space.state_derivatives import SectionSignals, StateDerivatives
from evopem.models.state_space import PlainStructure

Array = NDArray[np.float64]

# Singular values of the regressors, their columns scaled to unit length, below this share of the
# largest one are rounding.
REGRESSOR_RANK = 1e-9
# Added to the variances of the errors, relative to the power of the outputs: errors of less than a
# ten-millionth of an output carry no information, and a determinant would seek them out.
ROUNDING = 1e-14
# A pole moved to the radius stops just inside it.
EDGE = 1e-9


@dataclass(frozen=True, eq=False)
class Projection:
    """Errors of a point with the best output matrices.

    Attributes
    ----------
    sections : Sections
    states : (N, n) array
    regressors : (N, q) array
        States, inputs with feedthrough, a constant for each level, and the drift.
    basis : (N, rank) array
        Orthonormal basis of the regressors.
    linear : (q, ny) array
        Least-squares coefficients: C, D, constants and drift, transposed.
    errors : (N, ny) array
    covariance : (ny, ny) array
        ``errors' errors / N``.
    """

    sections: Sections
    states: Array
    regressors: Array
    basis: Array
    linear: Array
    errors: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Gradient, (n,), and Gauss-Newton Hessian, (n, n), of the criterion of a point."""

    gradient: Array
    hessian: Array


class StateSpaceErrors:
    """Criterion, normal equations and feasibility of models of one order on a recording.

    The criterion is the logarithm of the determinant of the errors' covariance
    (``determinant``: maximum likelihood for white errors), the sum of the logarithms of their
    variances (``noise``: each output weighed by its own noise, iterated to agreement), or the sum
    of the variances relative to the power of the outputs (``power``).

    Parameters
    ----------
    data : ScaledRecording
    order : int
        Number of states.
    structure : {"ss", "ss_oe"}
    weighting : {"determinant", "noise", "power"}
    radius : float
        Largest allowed radius of the eigenvalues of A and of ``A - K C``.
    """

    def __init__(
        self,
        data: ScaledRecording,
        order: int,
        structure: PlainStructure,
        weighting: OutputWeighting = "determinant",
        radius: float = 0.9999,
    ) -> None:
        self.data, self.order, self.structure = data, order, structure
        self.weighting, self.radius = weighting, radius
        self.innovations = structure == "ss"
        driving = [data.inputs, data.outputs] if self.innovations else [data.inputs]
        signals = np.column_stack(driving)
        self.driving = signals.shape[1]
        self.layout = Layout(order, self.driving + data.segments)
        self.signals = SectionSignals(self.layout, signals, data.bounds)
        self.direct = [data.inputs[:, data.feedthrough], data.constants, data.drift]

    @property
    def dimension(self) -> int:
        """Length of a point."""
        return self.layout.dimension

    @cached_property
    def derivatives(self) -> StateDerivatives:
        """Derivatives of the states by the coordinates."""
        return StateDerivatives(self.layout)

    @property
    def parameters(self) -> int:
        """Independent parameters: coefficients, level and drift, without initial states."""
        ny, n = self.data.outputs.shape[1], self.order
        nu = self.data.inputs.shape[1]
        count = n * (nu + ny) + ny * int(self.data.feedthrough.sum())
        count += n * ny if self.innovations else 0
        return count + ny * (int(self.data.levels > 0) + self.data.drift.shape[1])

    @property
    def cost(self) -> float:
        """Multiplications of one set of normal equations."""
        signals = 2 * self.layout.sections * self.layout.drives + 2 * self.order
        return float(self.data.samples) * signals**2

    @property
    def logarithmic(self) -> bool:
        """Whether N times the criterion is comparable with twice a log likelihood."""
        return self.weighting != "power"

    def of_order(self, order: int) -> StateSpaceErrors:
        """The same problem for another order."""
        return StateSpaceErrors(self.data, order, self.structure, self.weighting, self.radius)

    def with_outputs(self, outputs: Array) -> StateSpaceErrors:
        """The same problem for other scaled outputs, (N, ny)."""
        data = replace(self.data, outputs=outputs)
        return StateSpaceErrors(data, self.order, self.structure, self.weighting, self.radius)

    def of_structure(self, structure: PlainStructure) -> StateSpaceErrors:
        """The same problem for another form."""
        return StateSpaceErrors(self.data, self.order, structure, self.weighting, self.radius)

    def projection(self, point: Array) -> Projection:
        """Errors with the best C, D and constants."""
        sections, states, regressors = self._regression(point)
        sizes = np.linalg.norm(regressors, axis=0)
        sizes[sizes == 0.0] = 1.0
        # Several times as fast on long records as numpy's, with the same routine.
        q, triangle = qr(regressors / sizes, mode="economic", check_finite=False)
        left, singular, right = np.linalg.svd(triangle)
        kept = singular > REGRESSOR_RANK * singular[0]
        basis = q @ left[:, kept]
        y = self.data.outputs
        along = basis.T @ y
        linear = (right[kept].T / singular[kept]) @ along / sizes[:, None]
        errors = y - basis @ along
        return Projection(
            sections,
            states,
            regressors,
            basis,
            linear,
            errors,
            errors.T @ errors / len(y),
        )

    def with_linear(self, point: Array, linear: Array) -> Projection:
        """Errors with given C, D and constants, (q, ny) as those of a projection; no basis."""
        sections, states, regressors = self._regression(point)
        errors = self.data.outputs - regressors @ linear
        basis = np.empty((len(errors), 0))
        covariance = errors.T @ errors / len(errors)
        return Projection(sections, states, regressors, basis, linear, errors, covariance)

    def _regression(self, point: Array) -> tuple[Sections, Array, Array]:
        """Sections of a point, the states, and all regressors."""
        sections = sections_of(self.layout, point)
        states = self.signals.states(sections)
        return sections, states, np.column_stack([states, *self.direct])

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
        """A criterion as a percentage of the power of the outputs.

        The geometric mean over outputs (``determinant``: over principal directions), or for
        ``power`` the arithmetic mean.  For one output each is ``100 sum e**2 / sum y**2``, y less
        its mean where a constant is estimated.
        """
        mean = criterion / self.data.outputs.shape[1]
        return 100.0 * (mean if self.weighting == "power" else float(np.exp(mean)))

    def value(self, point: Array) -> float:
        """Criterion of a point; infinite where it is not feasible."""
        if not np.isfinite(point).all() or largest_radius(self.layout, point) > self.radius:
            return float("inf")
        projection = self.projection(point)
        return self.criterion(projection.covariance) if self.stable(projection) else float("inf")

    def stable(self, projection: Projection) -> bool:
        """Whether the eigenvalues of A lie within the radius; those of A - K C do."""
        if not self.innovations:
            return True
        if not np.isfinite(projection.linear).all():
            return False
        radii = np.abs(np.linalg.eigvals(self.state_matrix(projection)))
        return bool(radii.max() <= self.radius)

    def state_matrix(self, projection: Projection) -> Array:
        """A, (n, n), in the states of the point."""
        A = state_matrix(projection.sections, self.layout)
        if not self.innovations:
            return A
        return A + self.gain(projection) @ projection.linear[: self.order].T

    def gain(self, projection: Projection) -> Array:
        """K, (n, ny), in the states of the point and for scaled outputs."""
        if not self.innovations:
            return np.zeros((self.order, self.data.outputs.shape[1]))
        return self.drive_matrix(projection)[:, self.data.inputs.shape[1] : self.driving]

    def drive_matrix(self, projection: Projection) -> Array:
        """Columns by which the drives enter the states, (n, drives)."""
        return input_matrix(projection.sections, self.layout)

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
        return normalised(self.layout, inside(self.layout, start, self.radius * (1.0 - EDGE)))

    def moved(self, point: Array, step: Array) -> Array:
        """A point after a step, its poles within the radius."""
        after = moved(self.layout, point, step)
        return inside(self.layout, after, self.radius * (1.0 - EDGE))

    def normal_equations(self, projection: Projection) -> NormalEquations:
        """Gradient and Gauss-Newton Hessian of the criterion, s of each section held."""
        signals = self.signals.derivatives(projection.sections, projection.states)
        along = projection.basis.T @ signals
        # Less their part in the space of the regressors, without another array of this size.
        signals = dgemm(-1.0, along.T, projection.basis.T, 1.0, signals.T, overwrite_c=True).T
        c = projection.linear[: self.order].T
        weights = self.weights(projection.covariance)
        per_sample = 2.0 / self.data.samples
        hessian = per_sample * self.derivatives.contracted(
            projection.sections, signals.T @ signals, c.T @ weights @ c
        )
        against = signals.T @ (projection.errors @ (weights @ c))
        gradient = self.derivatives.summed(projection.sections, -against)
        return NormalEquations(per_sample * gradient, hessian)
