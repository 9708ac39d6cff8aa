"""Objectives made from that of one-step errors: of predictions some steps ahead, or of coordinates
of its points: those of constrained points, or the reflection coefficients of sections."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from evopem.arrays import Array
from evopem.config.constraints import Constraints, Prior
from evopem.estimation.pem.kernels.polynomials import filter_rows
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.pem.stretch_errors import DENSITY_BANDWIDTH, StretchErrors
from evopem.models.constraint_checks import coefficient_index
from evopem.models.modes import modes_of, pole_mode
from evopem.models.orders import Orders
from evopem.models.polynomial_roots import roots


class KStepErrors:
    """Objective, gradient and curvature of the k-step prediction errors.  Samples that count,
    states and stability are those of the one-step problem."""

    def __init__(self, errors: PolynomialErrors, horizon: int) -> None:
        self.one_step, self.horizon = errors, horizon
        self.objective = errors.objective

    def weights(self, point: Array) -> Array:
        """The first k terms of the impulse response of H, (k,)."""
        a, c, d = self._noise_model(point)
        return divided(divided(np.append(c, np.zeros(self.horizon))[: self.horizon], a), d)

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
        jacobian = _filtered(weights, np.concatenate(list(errors.jacobian_blocks(point))))
        by_c = divided(divided(np.eye(1, self.horizon)[0], a), d)
        by_a, by_d = -divided(weights, a), -divided(weights, d)
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
        a, c, d = (np.append(1.0, point[self.one_step.orders.part(name)]) for name in "acd")
        return a, c, d


def divided(response: Array, denominator: Array) -> Array:
    """A signal, or the first terms of a response, through ``1/denominator`` from rest."""
    through = response[None, :].copy()
    filter_rows(through, denominator, np.zeros((1, len(denominator) - 1)))
    return through[0]


def _filtered(response: Array, signals: Array) -> Array:
    """Signals, (N,) or (N, m), through a finite impulse response."""
    filtered: Array = response[0] * signals
    for lag in range(1, min(len(response), len(signals))):
        filtered[lag:] += response[lag] * signals[:-lag]
    return filtered


class Priors:
    """Deviations of a point from its priors, in standard deviations.  ``terms``: in the units of a
    point, those of coefficients with their places in it.  ``parts`` says where a, b0, ... and f0,
    ... stand in a point."""

    def __init__(
        self,
        terms: Sequence[tuple[Prior, int | None]],
        parts: Mapping[str, slice],
        sampling_rate: float,
    ) -> None:
        self.terms, self.parts, self.sampling_rate = terms, parts, sampling_rate
        # Where the polynomials stand whose roots are poles of the plant.
        self.denominators = [part for name, part in parts.items() if name[0] in "af"]

    def deviations(self, point: Array) -> tuple[Array, Array]:
        """Deviations (m,) and their derivatives by the point, (m, n)."""
        deviations = np.zeros(len(self.terms))
        derivatives = np.zeros((len(self.terms), len(point)))
        for row, (term, index) in enumerate(self.terms):
            value, gradient = self._quantity(term, index, point)
            deviations[row] = (value - term.mean) / term.standard_deviation
            derivatives[row] = gradient / term.standard_deviation
        return deviations, derivatives

    def _quantity(self, term: Prior, index: int | None, point: Array) -> tuple[float, Array]:
        gradient = np.zeros(len(point))
        if index is not None:
            gradient[index] = 1.0
            return float(point[index]), gradient
        if term.quantity == "static_gain":
            of_b, of_a, of_f = (self.parts[name] for name in ("b0", "a", "f0"))
            b = float(np.sum(point[of_b]))
            a, f = (1.0 + float(np.sum(point[part])) for part in (of_a, of_f))
            gradient[of_b] = 1.0 / (a * f)
            gradient[of_a] = -b / (a * a * f)
            gradient[of_f] = -b / (a * f * f)
            return b / (a * f), gradient
        near = term.mean if term.mode_hz is None else term.mode_hz
        part, pole = self._mode(near, point)
        values, slopes = pole_mode(point[part], pole, self.sampling_rate)
        row = 0 if term.quantity == "frequency" else 1
        gradient[part] = slopes[row]
        return float(values[row]), gradient

    def _mode(self, near: float, point: Array) -> tuple[slice, complex]:
        """The pole nearest in natural frequency: a mode where there is one, or a real pole."""
        modes = [
            (abs(mode.frequency_hz - near), part, mode.pole)
            for part in self.denominators
            for mode in modes_of(point[part], self.sampling_rate)
        ]
        if modes:
            _, part, pole = min(modes, key=lambda mode: mode[0])
            return part, pole
        real = [(part, z) for part in self.denominators for z in roots(point[part]) if z != 0.0]
        wanted = np.exp(2j * np.pi * near / self.sampling_rate)
        without = (self.denominators[-1], 0j)
        return min(real, key=lambda indexed_pole: abs(indexed_pole[1] - wanted), default=without)


def priors_of(
    constraints: Constraints,
    parts: Mapping[str, slice],
    orders: Orders,
    sampling_rate: float,
    b_scales: Sequence[float] | Array = (),
) -> Priors:
    """The priors among constraints, in the units of a point; ``b_scales``: what B_i of it are to be
    multiplied by."""
    terms = []
    b_scale = float(b_scales[0]) if len(b_scales) else 1.0
    for prior in constraints.priors:
        place = coefficient_index(prior.quantity, orders)
        scale = b_scale if prior.quantity == "static_gain" or prior.quantity[0] == "b" else 1.0
        mean, deviation = prior.mean / scale, prior.standard_deviation / scale
        term = replace(prior, mean=mean, standard_deviation=deviation)
        terms.append((term, place and orders.part(place[0]).start + place[1]))
    return Priors(terms, parts, sampling_rate)


class Mapped(NamedTuple):
    """Points of coordinates z, which move with *bounded* functions of each of these."""

    points: Array  # (M, n)
    derivatives: Array  # (M, n, k), by the bounded coordinates
    slopes: Array  # (M, k), of the bounded coordinates
    bends: Array  # (M, k), their second derivatives
    barriers: tuple[Array, Array, Array]  # with derivatives: (M,), (M, k), (M, k, k)


class Coordinates(Protocol):
    """How points follow from coordinates."""

    def mapped(self, z: Array) -> Mapped:
        """The points of rows of coordinates, (M, k)."""


class CoordinateErrors:
    """The objective of errors by coordinates, with ``prior_weight`` times the squared deviations
    from priors, in standard deviations."""

    def __init__(
        self,
        errors: PolynomialErrors | KStepErrors,
        coordinates: Coordinates,
        priors: Priors | None = None,
        prior_weight: float = 0.0,
    ) -> None:
        self.errors, self.coordinates, self.objective = errors, coordinates, errors.objective
        self.priors, self.prior_weight = priors, prior_weight

    def points(self, z: Array) -> Array:
        """Points of rows of coordinates, (M, n)."""
        return self.coordinates.mapped(z).points

    def values(self, z: Array) -> Array:
        """Objective of each row with its priors; inf where a barrier is crossed."""
        mapped = self._mapped(z)
        values = self.errors.values(mapped.points) + self._of_priors(mapped.points)[0]
        return np.where(np.isfinite(mapped.barriers[0]), values, np.inf)

    def values_and_gradients(
        self, z: Array, smoothing: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective of each row with barriers and priors, and its gradient."""
        mapped = self._mapped(z)
        barrier, by_bounded, _ = mapped.barriers
        values, slopes = self.errors.values_and_gradients(mapped.points, smoothing, barriers)
        prior, of_prior, _ = self._of_priors(mapped.points)
        inside = np.isfinite(values + barrier)
        weights = np.where(inside, barriers, 0.0)
        values = np.where(inside, values + prior + weights * np.where(inside, barrier, 0.0), np.inf)
        total = np.einsum("mn,mnk->mk", slopes + of_prior, mapped.derivatives)
        gradients = mapped.slopes * (total + weights[:, None] * by_bounded)
        return values, np.where(inside[:, None], gradients, 0.0)

    def curvatures(self, z: Array, smoothing: Array, barriers: Array) -> Array:
        """Gauss-Newton matrices, with the bend of bounded coordinates where it is positive."""
        mapped = self._mapped(z)
        matrices = self.errors.curvatures(mapped.points, smoothing, barriers)
        _, slopes = self.errors.values_and_gradients(mapped.points, smoothing, barriers)
        _, of_prior, of_priors = self._of_priors(mapped.points)
        moves = mapped.derivatives
        curved = np.swapaxes(moves, 1, 2) @ (matrices + of_priors) @ moves
        curved += barriers[:, None, None] * mapped.barriers[2]
        curved *= mapped.slopes[:, :, None] * mapped.slopes[:, None, :]
        # At an end of a bounded coordinate its slope vanishes, and this is the curvature.
        total = np.einsum("mn,mnk->mk", slopes + of_prior, moves)
        np.einsum("ijj->ij", curved)[:] += np.maximum(total * mapped.bends, 0.0)
        return np.asarray(curved)

    def _mapped(self, z: Array) -> Mapped:
        mapped = self.coordinates.mapped(z)
        # Errors of points beyond a barrier, which do not count, would overflow.
        mapped.points[~np.isfinite(mapped.barriers[0])] = 0.0
        return mapped

    def mean_absolute_residuals(self, values: Array) -> Array:
        """Size of the residuals that belong to values of the objective."""
        return self.errors.mean_absolute_residuals(values)

    def _of_priors(self, points: Array) -> tuple[Array, Array, Array]:
        """What the priors add to the objective, with derivatives by the points."""
        count, n = points.shape
        value, slope, bend = np.zeros(count), np.zeros((count, n)), np.zeros((count, n, n))
        if self.priors is not None and self.priors.terms:
            for row, point in enumerate(points):
                away, by_point = self.priors.deviations(point)
                value[row] = self.prior_weight * float(away @ away)
                slope[row] = 2.0 * self.prior_weight * (away @ by_point)
                bend[row] = 2.0 * self.prior_weight * (by_point.T @ by_point)
        return value, slope, bend
