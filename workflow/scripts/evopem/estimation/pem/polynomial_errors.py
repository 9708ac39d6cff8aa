"""The prediction-error problem of a polynomial model.  A *point* holds ``[a, b_1 ... b_m, c, d, f_1
... f_m]`` (chapter eq. 18), a level for each recording, for each stretch the states of all plants
(nf_i entries each), then for each stretch the noise state (``max(nc, nd)``): what the unknown past
adds to the first equations of ``F_i x_i = -B_i u_i + g_i`` and ``C e = D v + s``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np

from evopem.arrays import Array, Flags, Indices
from evopem.config.settings import ScoringWindow
from evopem.errors import NoModelError
from evopem.estimation.pem.kernels.gradient import GRADIENTS, VALUES
from evopem.estimation.pem.kernels.polynomials import stability_barriers
from evopem.estimation.pem.kernels.record import Objective
from evopem.estimation.pem.stretch_errors import PLANT_WEIGHT, STATE_WEIGHT, Passes, StretchErrors
from evopem.models.orders import Orders
from evopem.models.polynomial_roots import reflect_into_disc
from evopem.signals.least_squares import triangle_of
from evopem.signals.recording import Segment

MARGIN = 1e-6  # roots are moved this share of the radius inside it
# Relative singular values from which on directions of states count, and steps towards them.
RANKS, STATE_STEPS = (1e-13, 1e-10, 1e-6), 2


class PolynomialErrors:
    """Objective, gradient and curvature of the models of some orders, over one or more stretches:
    ``100 sum|e| / sum|y|`` (chapter eq. 20-21, as ``100 - fit``) or ``100 sum e**2 / sum y**2``
    (eq. 22) of ``A y = (B/F) u + (C/D) e + level``, roots of A and F within ``plant_radius``, of C
    and D within ``noise_radius``.  One ``window`` makes a smaller model a special case of a larger
    one."""

    def __init__(
        self,
        stretches: Sequence[Segment],
        orders: Orders,
        objective: str,
        plant_radius: float,
        noise_radius: float,
        level: bool = False,
        window: ScoringWindow | None = None,
    ) -> None:
        self.window = window or ScoringWindow(orders.first_residual, orders.first_residual)
        first = self.window.loss_start
        needed = first + sum(orders.nf) + orders.noise_states
        self.stretches = tuple(stretch for stretch in stretches if stretch.samples > needed)
        if not self.stretches:
            raise NoModelError(f"no stretch has the {needed + 1} samples that {orders} needs")
        self.orders, self.objective = orders, objective
        self.plant_radius, self.noise_radius = plant_radius, noise_radius
        # Numbers of the recordings, in the order of their levels.
        self.recordings = tuple(dict.fromkeys(stretch.recording for stretch in self.stretches))
        self.levels = len(self.recordings) if level else 0
        longest = max(self.stretches, key=lambda stretch: stretch.samples)
        self.inputs, self.output = longest.inputs[:, : orders.inputs], longest.output
        counted = [stretch.output[first:] for stretch in self.stretches]
        losses = [np.sum(np.abs(y)) if objective == "absolute" else y @ y for y in counted]
        self._scales = np.maximum(losses, np.finfo(float).tiny)
        self._scale = float(np.sum(self._scales))
        self.shares = self._scales / self._scale  # of each stretch
        self.scored_samples = sum(map(len, counted))
        # The errors of each stretch alone, and where its point stands in the point of all.
        self.places = list(zip(self._errors(), self._places(), strict=True))

    def _errors(self) -> Iterator[StretchErrors]:
        """The part of the objective of each stretch."""
        factor, absolute = self.loss_factor, self.objective == "absolute"
        for stretch, scale in zip(self.stretches, self._scales, strict=True):
            # A square in the unit of the loss.
            unit = float(scale) / (stretch.samples - self.window.loss_start) if absolute else 1.0
            objective = Objective(
                absolute=absolute,
                factor=factor,
                plant_state_weight=PLANT_WEIGHT * factor / unit,
                noise_state_weight=STATE_WEIGHT * factor / unit,
                plant_radius=self.plant_radius,
                noise_radius=self.noise_radius,
            )
            inputs = stretch.inputs[:, : self.orders.inputs]
            yield StretchErrors(
                inputs, stretch.output, self.orders, self.window, objective, self.level
            )

    def _places(self) -> Iterator[Indices]:
        """Where the point of each stretch alone stands in the point of all."""
        parts, o = self.parts, self.orders
        nf, states = sum(o.nf), o.noise_states
        for number, stretch in enumerate(self.stretches):
            level = parts["level"].start + self.recordings.index(stretch.recording)
            plant = parts["plant"].start + number * nf
            noise = parts["noise"].start + number * states
            of_states = [*range(plant, plant + nf), *range(noise, noise + states)]
            entries = [*range(o.parameters), *[level][: self.levels], *of_states]
            yield np.array(entries, dtype=np.intp)

    @property
    def level(self) -> bool:
        """Whether a constant is estimated for each recording."""
        return self.levels > 0

    @property
    def parameters(self) -> int:
        """Number of coefficients and levels, without the states."""
        return self.orders.parameters + self.levels

    @cached_property
    def dimension(self) -> int:
        """Length of a point."""
        states = sum(self.orders.nf) + self.orders.noise_states
        return self.parameters + len(self.stretches) * states

    @cached_property
    def parts(self) -> dict[str, slice]:
        """Where a, c, d, all b, all f, the levels, plant and noise states stand in a point."""
        o, count = self.orders, len(self.stretches)
        lengths = {"a": o.na, "b": sum(o.nb), "c": o.nc, "d": o.nd, "f": sum(o.nf)}
        lengths["level"] = self.levels
        lengths |= {"plant": count * sum(o.nf), "noise": count * o.noise_states}
        ends = np.cumsum([0, *lengths.values()]).tolist()
        return dict(zip(lengths, map(slice, ends, ends[1:]), strict=True))

    @cached_property
    def polynomials(self) -> list[tuple[str, slice]]:
        """Letter and place in a point of each of A, C, D and F_i that has coefficients."""
        o = self.orders
        parts = [(name, o.part(name)) for name in "acd"]
        parts += [("f", o.part("f", place)) for place in range(o.inputs)]
        return [(name, part) for name, part in parts if part.stop > part.start]

    def linear(self, *names: str) -> Flags:
        """Which entries of a point some parts are."""
        chosen = np.zeros(self.dimension, dtype=bool)
        for name in names:
            chosen[self.parts[name]] = True
        return chosen

    def radius_of(self, name: str) -> float:
        """Largest allowed radius of the roots of a polynomial, "a", "c", "d" or "f"."""
        return self.plant_radius if name in "af" else self.noise_radius

    def scaled(self, means: Array, input_scales: Array, output_scale: float) -> PolynomialErrors:
        """The problem of inputs less their means and of outputs, divided by scales."""
        divided = [
            Segment((errors.inputs - means) / input_scales, s.outputs / output_scale, s.recording)
            for s, (errors, _) in zip(self.stretches, self.places, strict=True)
        ]
        return self.of_other(divided)

    def of_other(self, stretches: Sequence[Segment]) -> PolynomialErrors:
        """The problem of other stretches."""
        return self._with(stretches=stretches)

    def of_orders(self, orders: Orders) -> PolynomialErrors:
        """The problem of other orders, whose residuals may have to start later."""
        return self._with(orders=orders, window=self.window.from_first(orders.first_residual))

    def within_radius(self, radius: float, noise_radius: float | None = None) -> PolynomialErrors:
        """The same problem with another allowed radius of all roots, or of C and D another one."""
        return self._with(plant_radius=radius, noise_radius=noise_radius or radius)

    def _with(self, **changes: object) -> PolynomialErrors:
        names = ("stretches", "orders", "objective", "plant_radius", "noise_radius", "level")
        given = {name: getattr(self, name) for name in (*names, "window")}
        return PolynomialErrors(**(given | changes))

    def of_stretches(self, point: Array) -> list[tuple[StretchErrors, Array]]:
        """The errors of each stretch alone, and its point."""
        return [(errors, point[at]) for errors, at in self.places]

    def residual_counts(self) -> list[int]:
        """Number of residuals that count in each stretch."""
        return [stretch.samples - self.window.loss_start for stretch in self.stretches]

    @property
    def loss_factor(self) -> float:
        """What the objective multiplies the sum of losses by."""
        return 100.0 / self._scale

    def loss(self, residuals: Array) -> float:
        """The objective of residuals that count, percent, without the states."""
        losses = np.abs(residuals) if self.objective == "absolute" else residuals**2
        return float(self.loss_factor * np.sum(losses))

    def state_weights(self) -> Array:
        """Weights of the squares of a point's entries in the objective, (n,): of its states."""
        weights, o = np.zeros(self.dimension), self.orders
        for errors, at in self.places:
            of_noise = len(at) - o.noise_states
            weights[at[of_noise - sum(o.nf) : of_noise]] = errors.objective.plant_state_weight
            weights[at[of_noise:]] = errors.objective.noise_state_weight
        return weights

    def values(self, points: Array) -> Array:
        """Objective of each row of an (M, n) population, in percent; infeasible rows are inf.  The
        weak squares of the states are part of it."""
        none = np.zeros(len(points))
        return self.passes.passed(VALUES, points, none, none)[0]

    def values_and_gradients(
        self, points: Array, smoothing: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective of each row and its gradient; infeasible rows are inf and 0.
        Magnitudes are ``sqrt(e**2 + smoothing**2)``; ``barriers``, percent, weigh the edge of the
        stability region."""
        return self.passes.passed(GRADIENTS, points, smoothing, barriers)

    @cached_property
    def passes(self) -> Passes:
        """Compiled passes, of which each stretch counts its share of the barriers."""
        return Passes(self.places, self.shares)

    def curvatures(self, points: Array, smoothing: Array, barriers: Array) -> Array:
        """Gauss-Newton approximation of the Hessian of the smoothed objective, (M, n, n)."""
        matrices = self._curvatures(points, smoothing, False)
        for (_, part), barrier in zip(self.polynomials, self._barriers(points), strict=True):
            matrices[:, part, part] += barriers[:, None, None] * barrier[2]
        return matrices

    def curvatures_of(self, points: Array, smoothing: Array, entries: Flags) -> Array:
        """The same of some entries of a point alone, (M, k, k), without barriers."""
        nonlinear = entries & ~self.linear("b", "level", "plant", "noise")
        matrices = self._curvatures(points, smoothing, not nonlinear.any())
        return matrices[:, entries][:, :, entries]

    def curvature_root(self, point: Array, smoothing: float, barrier: float) -> Array:
        """R, (n, n), with ``R'R`` the matrix of :meth:`curvatures` at a point.  By decompositions
        of the derivatives: products of columns that hardly differ, as those of poles close together
        near 1, lose half of the digits."""
        of_point = point[None, :]
        matrix = self._curvatures(of_point, np.array([smoothing]), False)[0]
        triangle, counted = triangle_of(self.jacobian_blocks(point)), slice(self.parameters)
        size = np.sum(triangle[:, counted] ** 2)
        rows = [np.sqrt(np.trace(matrix[counted, counted]) / size) * triangle]
        rows.append(np.diag(np.sqrt(2.0 * self.state_weights())))
        for (_, part), (_, _, bends) in zip(
            self.polynomials, self._barriers(of_point), strict=True
        ):
            values, vectors = np.linalg.eigh(barrier * bends[0])
            rows.append(np.zeros((len(values), len(point))))
            rows[-1][:, part] = (np.sqrt(np.maximum(values, 0.0)) * vectors).T
        return np.asarray(np.linalg.qr(np.concatenate(rows), mode="r"))

    def _curvatures(self, points: Array, smoothing: Array, linear: bool) -> Array:
        if len(self.places) == 1:
            return self.places[0][0].curvatures(points, smoothing, linear)
        matrices = np.zeros((*points.shape, points.shape[1]))
        for errors, at in self.places:
            matrices[:, at[:, None], at] += errors.curvatures(points[:, at], smoothing, linear)
        return matrices

    def barriers(self, points: Array) -> tuple[Array, Array, Array]:
        """Barriers at the edge of the stability region, (M,), their gradients and curvatures."""
        values, gradients = np.zeros(len(points)), np.zeros(points.shape)
        curvatures = np.zeros((*points.shape, points.shape[1]))
        for (_, part), barrier in zip(self.polynomials, self._barriers(points), strict=True):
            values += barrier[0]
            gradients[:, part], curvatures[:, part, part] = barrier[1:]
        return values, gradients, curvatures

    def _barriers(self, points: Array) -> Iterator[tuple[Array, Array, Array]]:
        """The same of each polynomial alone, by its own coefficients."""
        for name, part in self.polynomials:
            yield stability_barriers(np.ascontiguousarray(points[:, part]), self.radius_of(name))

    def mean_absolute_residuals(self, values: Array) -> Array:
        """Mean (absolute objective) or root mean square (quadratic) residual, from values."""
        mean = values / 100.0 * self._scale / self.scored_samples
        return mean if self.objective == "absolute" else np.sqrt(mean)

    def residuals(self, point: Array) -> Array:
        """Residuals of one point that count, of all stretches one after the other."""
        return np.concatenate(self.residuals_of_stretches(point))

    def residuals_of_stretches(self, point: Array) -> list[Array]:
        """Residuals of one point that count, stretch by stretch."""
        first = self.window.loss_start
        return [errors.residuals(at)[first:] for errors, at in self.of_stretches(point)]

    def all_residuals(self, point: Array) -> Array:
        """Residuals of one point at all samples of all stretches, NaN before the first ones."""
        parts = [errors.residuals(at) for errors, at in self.of_stretches(point)]
        for part in parts:
            part[: self.window.residual_start] = np.nan
        return np.concatenate(parts)

    def scored_outputs(self) -> Array:
        """The outputs of the residuals that count, of all stretches one after the other."""
        return np.concatenate(
            [stretch.output[self.window.loss_start :] for stretch in self.stretches]
        )

    def jacobian(self, point: Array) -> Array:
        """Derivatives of the residuals that count by a point, (N, n)."""
        return np.concatenate(list(self.jacobian_blocks(point)))

    def jacobian_blocks(self, point: Array) -> Iterator[Array]:
        """Consecutive rows of :meth:`jacobian`, which long recordings need."""
        for errors, at in self.places:
            before = self.window.loss_start - self.window.residual_start
            for stretch_block in errors.jacobian_blocks(point[at]):
                block = np.zeros((max(len(stretch_block) - before, 0), self.dimension))
                block[:, at] = stretch_block[before:]
                before = max(before - len(stretch_block), 0)
                yield block

    def completed_by_states(self, known: Array) -> Array:
        """A point of known coefficients, with levels and states of least squared residuals, beside
        their weak squares.  Never worse than states at rest: columns of states that hardly decay
        are dependent.  A second step takes back the rounding of the first (Björck 1967)."""
        point, linear = np.zeros(self.dimension), slice(self.orders.parameters, None)
        point[: self.orders.parameters] = known[: self.orders.parameters]
        weights = PLANT_WEIGHT * self.linear("plant") + STATE_WEIGHT * self.linear("noise")
        weak = np.sqrt(weights[linear])

        def left_of(completed: Array) -> Array:
            return np.concatenate([self.residuals(completed), weak * completed[linear]])

        columns = np.concatenate([self.jacobian(point)[:, linear], np.diag(weak)])
        best, at_rest = point, left_of(point)
        least = float(at_rest @ at_rest)
        left, sizes, right = np.linalg.svd(columns, full_matrices=False)
        for rcond in RANKS if columns.shape[1] else ():
            known = sizes > rcond * sizes[0]
            completed, reached = point.copy(), at_rest
            for _ in range(STATE_STEPS):
                completed[linear] -= right[known].T @ (left[:, known].T @ reached / sizes[known])
                reached = left_of(completed)
                if reached @ reached < least:
                    best, least = completed.copy(), float(reached @ reached)
        return best

    def feasible(self, points: Array) -> Flags:
        """Whether all roots of A, C, D and F_i of each row lie within their radii."""
        feasible = np.isfinite(points).all(axis=1)
        for value, _, _ in self._barriers(points):
            feasible &= np.isfinite(value)
        return np.asarray(feasible)

    def repair(self, points: Array) -> Array:
        """Move the roots of infeasible rows inside by reflection at the unit circle, which leaves
        the spectrum of C as it was but for a constant (Söderström & Stoica 1989, section 6.2)."""
        moved = points.copy()
        rows = np.flatnonzero(~self.feasible(points))
        if not len(rows):
            return moved
        finite = np.where(np.isfinite(points[rows]), points[rows], 0.0)
        for name, part in self.polynomials:
            inside = self.radius_of(name) * (1.0 - MARGIN)
            finite[:, part] = reflect_into_disc(finite[:, part], inside)
        moved[rows] = finite
        return moved
