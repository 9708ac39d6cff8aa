"""Models whose entries are all part of a point: errors of k steps, and hard constraints.

C, D and levels cannot be eliminated there.  A point holds the coordinates of the poles
(:mod:`.pole_coordinates`), then B, K, initial states, C, D, levels and drift, and static gains.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evopem.config.constraints import Constraints
from evopem.estimation import damped_descent
from evopem.estimation.damped_descent import Optimum, Places, Weighing, descend
from evopem.estimation.pem.constrained_parameters import Gain
from evopem.estimation.state_space.errors import ScaledRecording, StateSpaceErrors
from evopem.estimation.state_space.kernels import entry_derivatives
from evopem.estimation.state_space.point_model import COMPLEX_STEP, recorded_model
from evopem.estimation.state_space.pole_coordinates import blocks_of, coupling_of, modal_basis
from evopem.estimation.state_space.problem import (
    POLISH_STEPS,
    POLISH_TOLERANCE,
    STEPS,
    TOLERANCE,
    percent_of_absolute,
)
from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]

# By the kinds of entries of the kernel; R are the coefficients of levels and drift.
PARTS = ("A", "B", "K", "initial", "C", "D", "R")


@dataclass(frozen=True, eq=False)
class EntryErrors:
    """Entries and errors of a point, for scaled signals."""

    parts: dict[str, Array]
    by_point: Array  # (entries, n): derivatives of the entries of EntryProblem.places
    one_step: Array  # (N, l)
    errors: Array  # (N, l): in focus
    derivatives: Array  # (N, l, n)
    covariance: Array


class EntryProblem:
    """Errors of models of one order on a recording, so many samples ahead, under constraints."""

    def __init__(
        self,
        plain: StateSpaceErrors,
        horizon: int = 1,
        constraints: Constraints | None = None,
        absolute: bool = False,
    ) -> None:
        self.plain, self.horizon, self.absolute = plain, horizon, absolute
        data, n = plain.data, plain.order
        self.blocks = blocks_of(
            n, constraints, data.recording.sampling_rate, plain.radius, plain.innovations
        )
        self.gains = {} if constraints is None else _gains_of(constraints, data)
        m, outputs = data.inputs.shape[1], data.outputs.shape[1]
        self.regressors = np.ascontiguousarray(np.hstack([data.constants, data.drift]))
        self.shapes = {
            "A": (n, n),
            "B": (n, m),
            "K": (n, outputs),
            "initial": (n, data.segments),
            "C": (outputs, n),
            "D": (outputs, m),
            "R": (outputs, self.regressors.shape[1]),
        }
        rows = [(0, *place) for k in range(0, n, 2) for place in _of_section(k, n)]
        self._poles = len(rows)
        given = {"D": data.feedthrough, "K": np.full(outputs, plain.innovations)}
        for kind, name in enumerate(PARTS[1:], start=1):
            height, width = self.shapes[name]
            columns = np.flatnonzero(given.get(name, np.ones(width)))
            rows += [(kind, i, int(j)) for i in range(height) for j in columns]
        self.places = np.array(rows, dtype=np.int64)
        ends = np.cumsum([0, *(len(block.codes) for block in self.blocks)])
        self.own = [slice(*pair) for pair in pairwise(ends)]
        at = int(ends[-1]) + len(rows) - self._poles
        self._free = slice(int(ends[-1]), at)
        self.gain_at = {}
        for column, gain in self.gains.items():
            self.gain_at[column] = slice(at, at + len(gain.codes))
            at += len(gain.codes)
        self.dimension = at
        self.weighing: Weighing = "power" if plain.weighting == "power" else "noise"
        self.sizes = data.absolute_sizes
        self._coupling = np.ones(n // 2)
        self._latest: tuple[Array, EntryErrors] | None = None

    def _parts(self, values: NDArray, coupling: Array | None = None) -> dict[str, NDArray]:
        """Matrices with some entries, (..., entries), at the places, and s of the sections of A."""
        parts = {}
        for kind, name in enumerate(PARTS):
            parts[name] = np.zeros((*values.shape[:-1], *self.shapes[name]), dtype=values.dtype)
            chosen = self.places[:, 0] == kind
            rows, columns = self.places[chosen, 1:].T
            parts[name][..., rows, columns] = values[..., chosen]
        if coupling is not None:
            first = 2 * np.arange(len(coupling))
            parts["A"][..., first, first + 1] = coupling
        return parts

    def entries(self, point: Array) -> tuple[Array, Array]:
        """Entries at the places, and their derivatives by the point, (entries, n)."""
        values, by_point = np.empty(len(self.places)), np.zeros((len(self.places), self.dimension))
        values[self._poles :] = point[self._free]
        by_point[self._poles :, self._free] = np.eye(len(values) - self._poles)
        at = 0
        for k, (block, own) in enumerate(zip(self.blocks, self.own, strict=True)):
            of_block, by_own = block.values(point[own])
            if block.states == 1:
                values[at], by_point[at, own] = of_block[0], by_own[0]
                continue
            scale = np.array([1.0, 1.0, self._coupling[k]])
            values[at : at + 3] = of_block[[0, 0, 1]] / scale
            by_point[at : at + 3, own] = by_own[[0, 0, 1]] / scale[:, None]
            at += 3
        for column, gain in self.gains.items():
            self._give(values, by_point, column, *gain.value(point[self.gain_at[column]]))
        return values, by_point

    def _give(
        self, values: Array, by_point: Array, column: int, gain: float, by_own: float
    ) -> None:
        """Change a column of B so that the static gain from its input is the given one."""
        of_b = np.flatnonzero((self.places[:, 0] == 1) & (self.places[:, 2] == column))

        def changed(values: NDArray) -> NDArray:
            parts, b = self._parts(values[..., :-1], self._coupling), values[..., of_b]
            transposed = np.swapaxes(np.eye(len(of_b)) - parts["A"], -2, -1)
            v = np.linalg.solve(transposed, parts["C"][..., :1, :].swapaxes(-2, -1))[..., 0]
            missing = values[..., -1] - parts["D"][..., 0, column] - np.sum(v * b, axis=-1)
            return np.asarray(b + v * (missing / np.sum(v * v, axis=-1))[..., None])

        given = np.append(values, gain)
        steps = 1j * COMPLEX_STEP * np.eye(len(given))
        by_given = changed(given + steps).imag.T / COMPLEX_STEP
        by_point[of_b] = by_given[:, :-1] @ by_point
        by_point[of_b, self.gain_at[column]] += by_own * by_given[:, -1:]
        values[of_b] = changed(given)

    def projection(self, point: Array) -> EntryErrors:
        """Errors of a point and their derivatives."""
        if self._latest is not None and np.array_equal(self._latest[0], point):
            return self._latest[1]
        data, (values, by_point) = self.plain.data, self.entries(point)
        parts = self._parts(values, self._coupling)
        with np.errstate(all="ignore"):
            one_step, by_entries = entry_derivatives(
                *(parts[name] for name in ("A", "B", "K", "C", "D", "R", "initial")),
                *(np.ascontiguousarray(column) for column in self.places.T),
                *(data.inputs, data.outputs, self.regressors, data.bounds),
            )
            errors, by_entries = self._ahead(parts, one_step, by_entries)
            covariance = errors.T @ errors / len(errors)
            derivatives = by_entries @ by_point
        found = EntryErrors(parts, by_point, one_step, errors, derivatives, covariance)
        self._latest = (point.copy(), found)
        return found

    def _ahead(
        self, parts: dict[str, Array], errors: Array, derivatives: Array
    ) -> tuple[Array, Array]:
        """Errors of predictions ``horizon`` samples ahead, and their derivatives."""
        if self.horizon == 1 or not self.plain.innovations:
            return errors, derivatives
        A, K, C = parts["A"], parts["K"], parts["C"]
        kinds, rows, columns = self.places.T
        ahead, by_entries = errors.copy(), derivatives.copy()
        G, dG = K, np.zeros((len(kinds), *K.shape))
        of_a, of_k, of_c = (np.flatnonzero(kinds == PARTS.index(name)) for name in "AKC")
        dG[of_k, rows[of_k], columns[of_k]] = 1.0
        for lag in range(1, self.horizon):
            H, dH = C @ G, C @ dG
            dH[of_c, rows[of_c]] += G[columns[of_c]]
            for first, stop in pairwise(self.plain.data.bounds):
                now, before = slice(first + lag, stop), slice(first, max(stop - lag, first))
                if first + lag < stop:
                    ahead[now] += errors[before] @ H.T
                    by_entries[now] += np.einsum("ij,tjp->tip", H, derivatives[before])
                    by_entries[now] += np.einsum("pij,tj->tip", dH, errors[before])
            dG = A @ dG
            dG[of_a, rows[of_a]] += G[columns[of_a]]
            G = A @ G
        return ahead, by_entries

    def descend(self, point: Array) -> Optimum:
        """The optimum that a descent ends at."""
        if self.absolute:
            return damped_descent.descend_absolute(self, point, damped_descent.SEARCH_WIDTH)
        return descend(self, point, STEPS, TOLERANCE)

    def polish(self, point: Array) -> Optimum:
        """The same to the last digits."""
        if self.absolute:
            return damped_descent.polish_absolute(self, point)
        return descend(self, point, POLISH_STEPS, POLISH_TOLERANCE)

    def percent(self, errors: Array) -> float:
        """Objective of errors, (N, l), in percent."""
        if self.absolute:
            criterion = damped_descent.absolute_criterion(errors / self.sizes, self.weighing)
            return percent_of_absolute(criterion)
        return self.plain.percent(self.plain.criterion(errors.T @ errors / len(errors)))

    # What a descent of squares asks for.

    def begun(self, start: Array) -> Array:
        """A start within its bounds."""
        return self.moved(start, np.zeros_like(start))

    def moved(self, point: Array, step: Array) -> Array:
        """A point after a step, within the bounds of its coordinates."""
        after = point + step
        for block, own in zip(self.blocks, self.own, strict=True):
            after[own] = block.repaired(after[own])
        for column, gain in self.gains.items():
            own = self.gain_at[column]
            upper = 1.0 if gain.lower is not None and gain.upper is not None else np.inf
            after[own] = np.clip(after[own], 0.0, upper)
        return after

    def criterion(self, covariance: Array) -> float:
        """As of the plain problem."""
        return self.plain.criterion(covariance)

    def stable(self, projection: EntryErrors) -> bool:
        """Whether the predictor is stable; the poles of A are within their bounds."""
        parts = projection.parts
        matrix = parts["A"] - parts["K"] @ parts["C"]
        if not np.isfinite(matrix).all():
            return False
        return bool(np.abs(np.linalg.eigvals(matrix)).max() <= self.plain.radius)

    def normal_equations(self, projection: EntryErrors) -> tuple[Array, Array]:
        """Gradient and Gauss-Newton Hessian; coordinates held at a bound have none."""
        weights = self.plain.weights(projection.covariance)
        weighted = np.einsum("ij,tjp->tip", weights, projection.derivatives)
        flat = (-1, self.dimension)
        J, WJ = projection.derivatives.reshape(flat), weighted.reshape(flat)
        per_sample = 2.0 / self.plain.data.samples
        gradient = per_sample * (WJ.T @ projection.errors.ravel())
        hessian = per_sample * (J.T @ WJ)
        held = self._held(gradient)
        gradient[held] = 0.0
        hessian[held], hessian[:, held] = 0.0, 0.0
        return gradient, hessian

    def _held(self, gradient: Array) -> NDArray[np.bool_]:
        """Coordinates at a bound, beyond which the criterion falls; those of kinds."""
        assert self._latest is not None
        point = self._latest[0]
        after = self.moved(point, -1e-6 * np.sign(gradient))
        shares = np.zeros(self.dimension, dtype=bool)
        for block, own in zip(self.blocks, self.own, strict=True):
            shares[own] = block.region is not None or bool(block.known)
        shares[self._free.stop :] = True
        return shares & (after == point)

    # What a descent of absolute errors asks for.

    def errors(self, point: Array) -> Array:
        """Errors over the mean absolute values of their outputs, (N, l)."""
        if not np.isfinite(point).all():
            return np.full(self.plain.data.outputs.shape, np.nan)
        return np.asarray(self.projection(point).errors / self.sizes)

    def jacobians(self, point: Array) -> Iterator[tuple[Array, Places]]:
        """Derivatives of the errors of each output."""
        found = self.projection(point)
        scores = np.sign(found.errors) / self.sizes
        held = self._held(np.einsum("ti,tip->p", scores, found.derivatives))
        for k, size in enumerate(self.sizes):
            columns = found.derivatives[:, k] / size
            columns[:, held] = 0.0
            yield columns, slice(None)

    # To and from models.

    def point_of(self, model: StateSpaceModel, initial: Array, levels: Array) -> Array:
        """The point nearest to a model with states (segments, n) and levels (segments, l).

        It fixes s of each section: points of one problem all stem from one model.
        """
        data = self.plain.data
        u, y = data.input_scales, data.output_scales
        basis, poles = modal_basis(model.A, self.blocks)
        point = np.zeros(self.dimension)
        for k, (block, own, of_block) in enumerate(zip(self.blocks, self.own, poles, strict=True)):
            point[own] = block.coordinates(of_block)
            if block.states == 2:
                self._coupling[k] = coupling_of(block.values(point[own])[0])
        parts = {
            "B": np.linalg.lstsq(basis, model.B * u, rcond=None)[0],
            "K": np.linalg.lstsq(basis, model.K * y, rcond=None)[0],
            "initial": np.linalg.lstsq(basis, initial.T, rcond=None)[0],
            "C": model.C @ basis / y[:, None],
            "D": model.D * u / y[:, None],
            "R": np.zeros(self.shapes["R"]),
        }
        if data.levels:
            _, firsts = np.unique(data.level_of, return_index=True)
            parts["R"][:, : data.levels] = ((levels[firsts] - data.output_offsets) / y).T
        sizes = np.maximum(np.linalg.norm(np.hstack([parts["B"], parts["K"]]), axis=1), 1e-12)
        pairs = self.plain.order // 2 * 2
        sizes[:pairs] = np.repeat(np.max(sizes[:pairs].reshape(-1, 2), axis=1), 2)
        for name in ("B", "K", "initial"):
            parts[name] /= sizes[:, None]
        parts["C"] *= sizes
        free = [parts[PARTS[kind]][i, j] for kind, i, j in self.places[self._poles :]]
        point[self._free] = free
        for column, gain in self.gains.items():
            at_rest = np.linalg.solve(np.eye(model.order) - model.A, model.B[:, column])
            found = float(model.C[0] @ at_rest + model.D[0, column]) * u[column] / float(y[0])
            point[self.gain_at[column]] = gain.coordinates(found)
        self._latest = None
        return point

    def model(self, point: Array) -> StateSpaceModel:
        """The model of a point in the units of the recording, without covariance."""
        found = self.projection(point)
        *matrices, level = self._recorded(found.parts)
        level = self.plain.data.output_offsets + level
        return recorded_model(self.plain, (*matrices, level), found.one_step)

    def model_derivatives(self, found: EntryErrors) -> Array:
        """Derivatives of ``[A, B, C, D, K, level]`` by the point."""
        changes = self._recorded(self._parts(np.eye(len(self.places))))
        by_entries = np.hstack([part.reshape(len(part), -1) for part in changes])
        return np.asarray(by_entries.T @ found.by_point)

    def _recorded(self, parts: dict[str, Array]) -> tuple[Array, ...]:
        """A, B, C, D, K and level, less the offset of the outputs, in the recording's units."""
        data = self.plain.data
        u, y = data.input_scales, data.output_scales
        level = y * (parts["R"][..., : data.levels] @ data.level_shares)
        C, D = parts["C"] * y[:, None], parts["D"] * y[:, None] / u
        return parts["A"], parts["B"] / u, C, D, parts["K"] / y, level

    def active(self, point: Array) -> tuple[tuple[str, ...], NDArray[np.bool_]]:
        """Active inequalities, and the coordinates that they leave free, (n,) of bool."""
        names: set[str] = set()
        free = np.ones(self.dimension, dtype=bool)
        for block, own in zip(self.blocks, self.own, strict=True):
            found, fixed = block.active(point[own])
            names.update(found)
            free[own.start + np.array(fixed, dtype=int)] = False
        for column, gain in self.gains.items():
            own = self.gain_at[column]
            if gain.codes and gain.active(point[own]):
                names.add("static_gain_bounds")
                free[own] = False
        return tuple(sorted(names)), free


def _gains_of(constraints: Constraints, data: ScaledRecording) -> dict[int, Gain]:
    """Static gains from inputs to the one output, in the units of the scaled signals."""
    gains = {}
    for column, name in enumerate(data.recording.input_names or [""] * data.inputs.shape[1]):
        given, bounds = constraints.gain_of(name), constraints.gain_bounds_of(name)
        if given is not None or bounds is not None:
            scale = float(data.input_scales[column] / data.output_scales[0])
            ends = [None if end is None else end * scale for end in bounds or (given, given)]
            gains[column] = Gain(*ends)
    return gains


def _of_section(k: int, order: int) -> list[tuple[int, int]]:
    """Entries of A of a section that depend on its poles."""
    return [(k, k)] if k + 1 == order else [(k, k), (k + 1, k + 1), (k + 1, k)]
