"""k-step prediction errors: ``W_k(q) e_t``, W_k the first k terms of ``H = C / (A D)`` (Ljung 1999,
eq. 3.29-3.31).  Derivatives are W_k times those of e plus e filtered through ``dW_k/dc_j = q^-j /
(A D)``, ``dW_k/da_j = -q^-j H / A``, ``dW_k/dd_j = -q^-j H / D``, each cut to k terms."""

import numpy as np

from evopem.arrays import Array
from evopem.estimation.pem.kernels.polynomials import filter_rows
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.pem.stretch_errors import DENSITY_BANDWIDTH, StretchErrors


class KStepErrors:
    """Objective, gradient and curvature of the k-step prediction errors.  Samples that count,
    states and stability are those of the one-step problem."""

    def __init__(self, errors: PolynomialErrors, horizon: int) -> None:
        self.one_step, self.horizon = errors, horizon
        self.objective = errors.objective

    def weights(self, point: Array) -> Array:
        """The first k terms of the impulse response of H, (k,)."""
        a, c, d = self._noise_model(point)
        first = np.append(c, np.zeros(self.horizon))[: self.horizon]
        return _divided(_divided(first, a), d)

    def residuals(self, point: Array) -> Array:
        """k-step errors that count, of all stretches one after the other."""
        weights = self.weights(point)
        return np.concatenate(
            [
                _filtered(weights, errors.residuals(point[at])[errors.residual_start :])[
                    errors.loss_start - errors.residual_start :
                ]
                for errors, at in self.one_step.places
            ]
        )

    def jacobian(self, point: Array) -> Array:
        """Derivatives of :meth:`residuals` by a point, (N, n)."""
        blocks = []
        for errors, at in self.one_step.places:
            columns = self._jacobian(errors, point[at])
            block = np.zeros((len(columns), len(point)))
            block[:, at] = columns
            blocks.append(block)
        return np.concatenate(blocks)

    def _jacobian(self, errors: StretchErrors, point: Array) -> Array:
        a, _, d = self._noise_model(point)
        weights, e = self.weights(point), errors.residuals(point)[errors.residual_start :]
        jacobian = _filtered(weights, errors.jacobian(point))
        by_c = _divided(_divided(np.eye(1, self.horizon)[0], a), d)
        by_a, by_d = -_divided(weights, a), -_divided(weights, d)
        for name, response in (("a", by_a), ("c", by_c), ("d", by_d)):
            part = errors.orders.part(name)
            # The j-th derivative has k - j terms, delayed by j samples.
            for j in range(1, min(part.stop - part.start + 1, self.horizon)):
                through = _filtered(response[: self.horizon - j], e)
                jacobian[j:, part.start + j - 1] += through[: len(e) - j]
        return np.asarray(jacobian[errors.loss_start - errors.residual_start :], dtype=float)

    def values(self, points: Array) -> Array:
        """Objective of each row, (M,), in percent; infeasible rows are inf."""
        values = np.full(len(points), np.inf)
        for row in np.flatnonzero(self.one_step.feasible(points)):
            values[row] = self.one_step.loss(self.residuals(points[row]))
        values += self.one_step.state_weights() @ points.T**2
        return np.where(np.isfinite(values), values, np.inf)

    def values_and_gradients(
        self, points: Array, smoothing: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective with barriers, and its gradient; infeasible rows are inf and 0."""
        values, gradients = np.full(len(points), np.inf), np.zeros(points.shape)
        weights, factor = self.one_step.state_weights(), self.one_step.loss_factor
        of_roots, by_roots, _ = self.one_step.barriers(points)
        for row in np.flatnonzero(np.isfinite(of_roots)):
            point = points[row]
            losses, slopes, _ = self._losses(self.residuals(point), smoothing[row])
            value = factor * np.sum(losses) + weights @ point**2 + barriers[row] * of_roots[row]
            gradient = factor * (slopes @ self.jacobian(point)) + 2.0 * weights * point
            gradient += barriers[row] * by_roots[row]
            if np.isfinite(value) and np.isfinite(gradient).all():
                values[row], gradients[row] = value, gradient
        return values, gradients

    def curvatures(self, points: Array, smoothing: Array, barriers: Array) -> Array:
        """Gauss-Newton matrices, (M, n, n)."""
        matrices = np.zeros((*points.shape, points.shape[1]))
        weights, factor = self.one_step.state_weights(), self.one_step.loss_factor
        for row, point in enumerate(points):
            jacobian = self.jacobian(point)
            _, _, bend = self._losses(self.residuals(point), smoothing[row])
            matrices[row] = factor * bend * (jacobian.T @ jacobian) + 2.0 * np.diag(weights)
        return matrices + barriers[:, None, None] * self.one_step.barriers(points)[2]

    def mean_absolute_residuals(self, values: Array) -> Array:
        """Size of the errors that belong to values of the objective."""
        return self.one_step.mean_absolute_residuals(values)

    def _losses(self, residuals: Array, smoothing: float) -> tuple[Array, Array, float]:
        """Losses, their derivatives, and the mean second derivative for Gauss-Newton."""
        if self.objective == "quadratic":
            return residuals**2, 2.0 * residuals, 2.0
        losses = np.sqrt(residuals**2 + smoothing**2)
        width = max(DENSITY_BANDWIDTH * float(np.mean(np.abs(residuals))), smoothing, 1e-300)
        bend = float(np.mean(width**2 / (residuals**2 + width**2) ** 1.5))
        return losses, residuals / losses, bend

    def _noise_model(self, point: Array) -> tuple[Array, Array, Array]:
        part = self.one_step.orders.part
        a, c, d = (np.append(1.0, point[part(name)]) for name in "acd")
        return a, c, d


def _divided(response: Array, denominator: Array) -> Array:
    """The first terms of a response through ``1/denominator``."""
    divided = response[None, :].copy()
    filter_rows(divided, denominator, np.zeros((1, len(denominator) - 1)))
    return divided[0]


def _filtered(response: Array, signals: Array) -> Array:
    """Signals, (N,) or (N, m), through a finite impulse response."""
    filtered: Array = response[0] * signals
    for lag in range(1, min(len(response), len(signals))):
        filtered[lag:] += response[lag] * signals[:-lag]
    return filtered
