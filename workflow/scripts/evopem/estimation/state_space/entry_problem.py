"""Models whose entries are all part of a point: errors of k steps, and hard constraints.

The *entries* are the sections of A (:mod:`.sections`), which B, K and the initial states drive, and
then C, D, levels and drift of each output, which cannot be eliminated there.  A point holds the
coordinates of the sections (:mod:`.pole_coordinates`), the other entries, and static gains.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evopem.arrays import Array, Flags, Integers
from evopem.config.constraints import Constraints
from evopem.config.settings import Objective
from evopem.estimation.damped_descent import Places
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.point_model import (
    Matrices,
    ScaledModel,
    output_and_gain,
    sandwich,
    scores_of,
)
from evopem.estimation.state_space.pole_coordinates import blocks_of, gains_of, poles_of
from evopem.estimation.state_space.problem import ErrorProblem
from evopem.estimation.state_space.sections import (
    Layout,
    input_matrix,
    normalised,
    scale_of,
    sections_of,
    state_matrix,
)
from evopem.estimation.state_space.starting_points import point_of
from evopem.models.parameter_covariance import COMPLEX_STEP, ParameterCovariance, jacobian_of
from evopem.models.recursions import driven_states


@dataclass(frozen=True, eq=False)
class EntryErrors:
    """Errors of a point, for scaled signals."""

    point: Array
    matrices: Matrices
    states: Array  # (N, n)
    one_step: Array  # (N, l)
    errors: Array  # (N, l): in focus

    @cached_property
    def covariance(self) -> Array:
        """``errors' errors / N``, (l, l)."""
        with np.errstate(all="ignore"):
            return np.asarray(self.errors.T @ self.errors / len(self.errors))


class EntryProblem(ErrorProblem):
    """Errors of models of one order on a recording, so many samples ahead, under constraints."""

    def __init__(
        self,
        plain: StateSpaceErrors,
        horizon: int = 1,
        constraints: Constraints | None = None,
        objective: Objective = "quadratic",
    ) -> None:
        super().__init__(plain, objective)
        self.layout = plain.layout
        self.horizon = horizon if plain.innovations else 1
        data, layout = plain.data, plain.layout
        self.blocks = blocks_of(plain, constraints)
        self.gains = {} if constraints is None else gains_of(constraints, data)
        self.regressors = np.hstack(plain.direct)
        self._outputs = data.outputs.shape[1], plain.order + self.regressors.shape[1]
        # Which entries are coordinates themselves: neither poles, nor without effect.
        free = layout.free()
        free[:, :2] = False
        self._rest = np.append(free.ravel(), np.ones(np.prod(self._outputs), dtype=bool))
        sizes = [*(len(block.codes) for block in self.blocks), int(self._rest.sum())]
        sizes += [len(gain.codes) for gain in self.gains.values()]
        slices = [slice(*pair) for pair in pairwise(np.cumsum([0, *sizes]).tolist())]
        self.columns, self._free = slices[: len(self.blocks)], slices[len(self.blocks)]
        self.gain_at = dict(zip(self.gains, slices[len(self.blocks) + 1 :], strict=True))
        self.dimension = sum(sizes)
        self.criterion = plain.criterion
        given = sum(len(block.known) for block in self.blocks)
        given += sum(not gain.codes for gain in self.gains.values())
        self.parameters = plain.parameters - given
        self._latest: EntryErrors | None = None
        self._derivatives: tuple[EntryErrors, Array] | None = None

    def entries(self, point: Array) -> tuple[Array, Array]:
        """Entries, then the static gains, and their derivatives by a point."""
        entries = np.zeros(len(self._rest) + len(self.gains))
        by_point = np.zeros((len(entries), self.dimension))
        rest = np.flatnonzero(self._rest)
        entries[rest] = point[self._free]
        by_point[rest, self._free] = np.eye(len(rest))
        places = np.arange(self.layout.dimension).reshape(self.layout.sections, -1)
        for at, block, columns in zip(places[:, :2], self.blocks, self.columns, strict=True):
            entries[at], by_point[at, columns] = block.values(point[columns])
        for at, (column, gain) in enumerate(self.gains.items(), len(self._rest)):
            columns = self.gain_at[column]
            entries[at], by_point[at, columns] = gain.value(point[columns])
        return entries, by_point

    def matrices(self, entries: NDArray, scale: Array | None = None) -> Matrices:
        """Those of entries and gains, (numbers, ...); s of the sections may be given."""
        layout, n = self.layout, self.layout.order
        outputs = entries[layout.dimension : len(self._rest)]
        outputs = outputs.reshape(*self._outputs, *entries.shape[1:])
        sections = sections_of(layout, entries, scale)
        A, drives = state_matrix(sections, layout), input_matrix(sections, layout)
        for column, gain in zip(self.gains, entries[len(self._rest) :], strict=True):
            # The least change of a column of B to a given static gain.
            at_rest = np.eye(n) - np.moveaxis(A, (0, 1), (-1, -2))
            of_output = np.moveaxis(outputs[0, :n], 0, -1)[..., None]
            v = np.moveaxis(np.linalg.solve(at_rest, of_output)[..., 0], -1, 0)
            missing = gain - np.sum(v * drives[:, column], axis=0)
            missing = missing - self._direct(column, outputs[0])
            drives[:, column] += missing / np.sum(v * v, axis=0) * v
        return Matrices(A, drives, outputs)

    def by_point(
        self, point: Array, function: Callable[[Matrices], Iterable[NDArray]]
    ) -> list[Array]:
        """Derivatives by a point of what follows from its matrices, s of each section held."""
        entries, by_point = self.entries(point)
        steps = entries[:, None] + 1j * COMPLEX_STEP * np.eye(len(entries))
        scale = np.repeat(self._scales(point)[:, None], len(entries), axis=1)
        stepped = function(self.matrices(steps, scale))
        return [moved.imag / COMPLEX_STEP @ by_point for moved in stepped]

    def _direct(self, column: int, outputs: NDArray) -> NDArray | float:
        """The entry of D of an input, of the row of an output."""
        feedthrough = self.plain.data.feedthrough
        at = self.layout.order + int(feedthrough[:column].sum())
        return outputs[at] if feedthrough[column] else 0.0

    def projection(self, point: Array) -> EntryErrors:
        """Errors of a point."""
        if self._latest is not None and np.array_equal(self._latest.point, point):
            return self._latest
        data, driving = self.plain.data, self.plain.signals.driving
        now = self.matrices(self.entries(point)[0])
        C, K = output_and_gain(self.plain, now)
        with np.errstate(all="ignore"):
            # e = left - C x
            left = data.outputs - self.regressors @ now.outputs[:, self.layout.order :].T
            inputs = data.inputs @ now.drives[:, : data.inputs.shape[1]].T + left @ K.T
            initial = now.drives[:, driving:].T
            states = driven_states(now.A - K @ C, initial[:, None], inputs[:, None], data.bounds)
            one_step = left - states[:, 0] @ C.T
            errors = self._ahead(now, one_step)
        self._latest = EntryErrors(point.copy(), now, states[:, 0], one_step, errors)
        return self._latest

    def derivatives(self, errors: EntryErrors) -> Array:
        """Derivatives of the errors by the point, (N, l, n)."""
        if self._derivatives is None or self._derivatives[0] is not errors:
            data, now, driving = self.plain.data, errors.matrices, self.plain.signals.driving
            by = Matrices(*self.by_point(errors.point, tuple))
            C, K = output_and_gain(self.plain, now)
            seen = np.hstack([errors.states, self.regressors])
            signals = np.hstack([errors.states, data.inputs, errors.one_step])
            with np.errstate(all="ignore"):
                direct = np.tensordot(seen, by.outputs.T, ([1], [1]))
                inputs = np.tensordot(signals[:, : len(C.T)], by.A.T, ([1], [1])) - direct @ K.T
                acting = signals[:, len(C.T) :][:, :driving]
                inputs += np.tensordot(acting, by.drives[:, :driving].T, ([1], [1]))
                initial = np.moveaxis(by.drives[:, driving:].T, 1, 0)
                states = driven_states(now.A - K @ C, initial, inputs, data.bounds)
                of_one_step = -np.swapaxes(states @ C.T + direct, 1, 2)
                self._derivatives = errors, self._derivatives_ahead(errors, of_one_step)
        return self._derivatives[1]

    def _responses(self, now: Matrices) -> Iterator[NDArray]:
        """Responses of the noise filter, ``C A^(k-1) K`` of lags k below the horizon, (l, l)."""
        C, G = output_and_gain(self.plain, now)
        for _ in range(1, self.horizon):
            yield np.einsum("in...,nj...->ij...", C, G)
            G = np.einsum("mn...,nj...->mj...", now.A, G)

    def _ahead(self, now: Matrices, errors: Array) -> Array:
        """Errors of predictions ``horizon`` samples ahead from those of one step."""
        ahead = errors.copy()
        for lag, H in enumerate(self._responses(now), 1):
            for after, before in _lagged(self.plain.data.bounds, lag):
                ahead[after] += errors[before] @ H.T
        return ahead

    def _derivatives_ahead(self, errors: EntryErrors, derivatives: Array) -> Array:
        """Their derivatives from those of the errors of one step."""
        ahead = derivatives.copy()
        responses = self._responses(errors.matrices), self.by_point(errors.point, self._responses)
        for lag, (H, dH) in enumerate(zip(*responses, strict=True), 1):
            for after, before in _lagged(self.plain.data.bounds, lag):
                ahead[after] += H @ derivatives[before]
                ahead[after] += np.tensordot(errors.one_step[before], dH, ([1], [1]))
        return ahead

    def scaled(self, point: Array) -> ScaledModel:
        """The model of a point."""
        projection = self.projection(point)
        return ScaledModel(self.plain, projection.matrices, projection.one_step)

    # What a descent of squares asks for.

    def begun(self, start: Array) -> Array:
        """A start within its bounds."""
        return self.moved(start, np.zeros_like(start))

    def moved(self, point: Array, step: Array) -> Array:
        """A point after a step, within the bounds of its coordinates; s of sections follows."""
        after = point + step
        for block, columns in zip(self.blocks, self.columns, strict=True):
            after[columns] = block.repaired(after[columns])
        for column, gain in self.gains.items():
            columns = self.gain_at[column]
            upper = 1.0 if np.isfinite(gain.upper - gain.lower) else np.inf
            after[columns] = np.clip(after[columns], 0.0, upper)
        ratio = self._scales(after) / self._scales(point)
        factors, dimension = np.ones(len(self._rest)), self.layout.dimension
        self.layout.rows(factors)[:, 2 + self.layout.drives :] /= ratio[:, None]
        of_outputs = factors[dimension:].reshape(self._outputs)
        of_outputs[:, 1 : self.layout.order : 2] *= ratio[: self.layout.pairs]
        after[self._free] *= factors[self._rest]
        return after

    def _scales(self, point: Array) -> Array:
        """s of each section."""
        blocks = zip(self.blocks, self.columns, strict=True)
        return scale_of(np.array([block.values(point[columns])[0][1] for block, columns in blocks]))

    def stable(self, projection: EntryErrors) -> bool:
        """Whether the predictor is stable; the poles of A are within their bounds."""
        C, K = output_and_gain(self.plain, projection.matrices)
        matrix = projection.matrices.A - K @ C
        if not np.isfinite(matrix).all():
            return False
        return bool(np.abs(np.linalg.eigvals(matrix)).max() <= self.plain.radius)

    def normal_equations(self, projection: EntryErrors) -> tuple[Array, Array]:
        """Gradient and Gauss-Newton Hessian; coordinates held at a bound have none."""
        derivatives = self.derivatives(projection)
        J = derivatives.reshape(-1, self.dimension)
        WJ = (self.plain.weights(projection.covariance) @ derivatives).reshape(J.shape)
        per_sample = 2.0 / self.plain.data.samples
        gradient = per_sample * (WJ.T @ projection.errors.ravel())
        hessian = per_sample * (J.T @ WJ)
        held = self._held(projection.point, gradient)
        gradient[held] = 0.0
        hessian[held], hessian[:, held] = 0.0, 0.0
        return gradient, hessian

    def _held(self, point: Array, gradient: Array) -> Flags:
        """Coordinates at a bound, beyond which the criterion falls; those of kinds."""
        after = self.moved(point, -1e-6 * np.sign(gradient))
        shares = np.zeros(self.dimension, dtype=bool)
        for block, columns in zip(self.blocks, self.columns, strict=True):
            shares[columns] = block.allowed is not None
        shares[self._free.stop :] = True
        return shares & (after == point)

    # What a descent of absolute errors asks for.

    def jacobians(self, point: Array) -> Iterator[tuple[Array, Places]]:
        """Derivatives of the errors of each output."""
        projection = self.projection(point)
        derivatives, scores = self.derivatives(projection), np.sign(projection.errors) / self.sizes
        held = self._held(point, np.tensordot(scores, derivatives, 2))
        for k in range(len(self.sizes)):
            columns = np.where(held, 0.0, derivatives[:, k])
            yield columns, slice(None)

    # To and from models.

    def point_of(self, matrices: Matrices) -> Array:
        """The point nearest to a model of scaled signals."""
        layout, n = self.layout, self.layout.order
        # The states of the sections from those of the model, as further drives.
        wide = Layout(n, layout.drives + n)
        drives = np.hstack([matrices.drives, np.eye(n)])
        rows = wide.rows(normalised(wide, point_of(wide, matrices.A, drives)))
        rows = rows[self._matched(rows[:, :2])]
        into = input_matrix(sections_of(wide, rows.ravel()), wide)
        outputs = matrices.outputs.copy()
        outputs[:, :n] = outputs[:, :n] @ np.linalg.inv(into[:, -n:])
        b1, b2 = np.split(rows[:, 2:], 2, axis=1)
        entries = np.hstack([rows[:, :2], b1[:, :-n], b2[:, :-n]])
        point = np.zeros(self.dimension)
        point[self._free] = np.append(entries, outputs)[self._rest]
        for block, columns, row in zip(self.blocks, self.columns, rows, strict=True):
            point[columns] = block.coordinates(row[:2])
        for column, gain in self.gains.items():
            at_rest = np.linalg.solve(np.eye(n) - matrices.A, matrices.drives[:, column])
            direct = self._direct(column, matrices.outputs[0])
            value = float(matrices.outputs[0, :n] @ at_rest + direct)
            point[self.gain_at[column]] = gain.coordinates(value)
        return point

    def _matched(self, sections: Array) -> list[int]:
        """Which sections the blocks are, those with given poles the nearest ones."""
        left, order = list(range(self.layout.pairs)), []
        for block in self.blocks[: self.layout.pairs]:
            known = np.array(block.known or (np.inf,))[:, None]
            order.append(min(left, key=lambda k: np.abs(known - poles_of(sections[k])).min()))
            left.remove(order[-1])
        return order + list(range(self.layout.pairs, self.layout.sections))

    def covariance(self, point: Array) -> ParameterCovariance | None:
        """Covariance of the entries of the model, zero across active constraints.

        None of errors of several steps under the absolute objective, which are coloured.
        """
        plain, projection, several = self.plain, self.projection(point), self.horizon > 1
        scored = scores_of(plain, projection.errors, self.objective)
        if scored is None or (several and self.objective == "absolute"):
            return None
        free = self.active(point)[1]
        J, columns = self.derivatives(projection)[:, :, free], np.arange(free.sum())
        (entries, by_point), scale = self.entries(point), self._scales(point)

        def recorded(moved: NDArray) -> tuple[NDArray, ...]:
            return ScaledModel(plain, self.matrices(moved, scale), projection.one_step).recorded()

        mapping = jacobian_of(recorded, entries) @ by_point
        return sandwich(
            plain,
            lambda output: (J[:, output], columns),
            *scored,
            mapping[:, free],
            plain.order + len(self.gains),
            coloured=several,
        )

    def active(self, point: Array) -> tuple[tuple[str, ...], Flags]:
        """Active inequalities, and the coordinates that they leave free, (n,) of bool."""
        names: set[str] = set()
        free = np.ones(self.dimension, dtype=bool)
        for block, columns in zip(self.blocks, self.columns, strict=True):
            is_active, fixed = block.active(point[columns])
            names.update(is_active)
            free[columns.start + np.array(fixed, dtype=int)] = False
        for column, gain in self.gains.items():
            columns = self.gain_at[column]
            if gain.codes and gain.active(point[columns]):
                names.add("static_gain_bounds")
                free[columns] = False
        return tuple(sorted(names)), free


def _lagged(bounds: Integers, lag: int) -> Iterator[tuple[slice, slice]]:
    """Of each segment the samples that have others so much earlier, and those."""
    for first, stop in pairwise(bounds):
        yield slice(first + lag, stop), slice(first, max(stop - lag, first))
