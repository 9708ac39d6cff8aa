"""Models whose entries are all part of a point: errors of k steps, and hard constraints.

Where errors other than those of one step count, or the poles of A or a static gain are restricted,
C, D and levels cannot be eliminated as in :mod:`.errors`.  A point holds the coordinates of the
poles (:mod:`.pole_coordinates`), then B, K, initial states, C, D and the coefficients of levels and
drift, and those of static gains.  Descents are those of the other problems.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.absolute_descent import Places, Weighing
from evopem.estimation.pem.constrained_parameters import Gain
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.kernels import entry_derivatives
from evopem.estimation.state_space.point_model import degrees_of_freedom
from evopem.estimation.state_space.pole_coordinates import Block, coupling_of, modal_basis
from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

PARTS = ("A", "B", "K", "initial", "C", "D", "R")


@dataclass(frozen=True, eq=False)
class Entries:
    """Matrices of a point, for scaled signals, and the derivatives of their entries by the point.

    Attributes
    ----------
    A, B, K, initial, C, D, R : arrays
        R are the coefficients of levels and drift, (l, q), initial the states, (n, segments).
    derivatives : (entries, n) array
        Of the entries of :attr:`EntryProblem.places`.
    """

    A: Array
    B: Array
    K: Array
    initial: Array
    C: Array
    D: Array
    R: Array
    derivatives: Array


@dataclass(frozen=True, eq=False)
class EntryErrors:
    """Errors in focus of a point, (N, l), their derivatives, (N, l, n), and their covariance."""

    entries: Entries
    one_step: Array
    errors: Array
    derivatives: Array
    covariance: Array


class EntryProblem:
    """Errors of models of one order on a recording, with all entries in the point.

    Parameters
    ----------
    plain : StateSpaceErrors
        Recording, order, structure, weighting and radius.
    blocks : sequence of Block
        Of the poles of A.
    horizon : int
        Samples ahead.
    gains : mapping of int to Gain
        Static gains from inputs to the one output, in the units of the scaled signals.
    """

    def __init__(
        self,
        plain: StateSpaceErrors,
        blocks: Sequence[Block],
        horizon: int = 1,
        gains: Mapping[int, Gain] | None = None,
    ) -> None:
        self.plain, self.blocks, self.horizon = plain, tuple(blocks), horizon
        self.gains = dict(gains or {})
        data, n = plain.data, plain.order
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
        places = [place for k in range(0, n, 2) for place in _of_section(k, n)]
        rows: list[tuple[int, int, int]] = [(0, *place) for place in places]
        for kind, name in enumerate(PARTS[1:], start=1):
            shape = self.shapes[name]
            columns: Sequence[int] = range(shape[1])
            if name == "D":
                columns = [int(k) for k in np.flatnonzero(data.feedthrough)]
            if name != "K" or plain.innovations:
                rows += [(kind, i, j) for i in range(shape[0]) for j in columns]
        self.places = np.array(rows, dtype=np.int64)
        ends = np.cumsum([0, *(len(block.codes) for block in self.blocks)])
        self.own = [slice(*pair) for pair in pairwise(ends)]
        self.first = int(ends[-1])
        self.entries_of_poles = len(places)
        self.gain_at = {}
        at = self.first + len(rows) - len(places)
        for column, gain in self.gains.items():
            self.gain_at[column] = slice(at, at + len(gain.codes))
            at += len(gain.codes)
        self.dimension = at
        self.weighing: Weighing = "power" if plain.weighting == "power" else "noise"
        self.sizes = data.absolute_sizes
        self._coupling = np.ones(n // 2)
        self._latest: tuple[Array, EntryErrors] | None = None

    def entries(self, point: Array) -> Entries:
        """Matrices of a point."""
        parts = {name: np.zeros(shape) for name, shape in self.shapes.items()}
        count, poles = len(self.places), self.entries_of_poles
        derivatives = np.zeros((count, self.dimension))
        derivatives[poles:, self.first : self.first + count - poles] = np.eye(count - poles)
        at = 0
        for k, (block, own) in enumerate(zip(self.blocks, self.own, strict=True)):
            values, by_own = block.values(point[own])
            i = 2 * k
            if block.states == 1:
                parts["A"][i, i] = values[0]
                derivatives[at, own] = by_own[0]
                at += 1
                continue
            s = self._coupling[k]
            parts["A"][i : i + 2, i : i + 2] = [[values[0], s], [values[1] / s, values[0]]]
            derivatives[at : at + 3, own] = by_own[[0, 0, 1]] / np.array([[1.0], [1.0], [s]])
            at += 3
        free = point[self.first : self.first + count - poles]
        for kind, name in enumerate(PARTS[1:], start=1):
            chosen = self.places[poles:, 0] == kind
            _, rows, columns = self.places[poles:][chosen].T
            parts[name][rows, columns] = free[chosen]
        for column, gain in self.gains.items():
            self._give(parts, derivatives, column, gain, point[self.gain_at[column]])
        return Entries(**parts, derivatives=derivatives)

    def _give(
        self, parts: dict[str, Array], derivatives: Array, column: int, gain: Gain, own: Array
    ) -> None:
        """Change a column of B so that the static gain from its input is the given one."""
        value, by_own = gain.value(own)
        inverse = np.linalg.inv(np.eye(len(parts["A"])) - parts["A"])
        v = (parts["C"] @ inverse)[0]
        size = float(v @ v)
        w, b = v / size, parts["B"][:, column].copy()
        missing = value - parts["D"][0, column] - float(v @ b)
        kinds, rows, columns = self.places.T
        # By each entry: of v, and of what is missing.
        dv = np.zeros((len(self.places), len(v)))
        poles, outs = kinds == 0, kinds == 4
        dv[poles] = v[rows[poles], None] * inverse[columns[poles]]
        dv[outs] = inverse[columns[outs]]
        missed = -dv @ b
        missed[(kinds == 5) & (columns == column)] -= 1.0
        of_b = (kinds == 1) & (columns == column)
        missed[of_b] -= v[rows[of_b]]
        dw = dv / size - np.outer(2.0 * (dv @ v) / size**2, v)
        change = dw * missing + np.outer(missed, w)
        change_by_point = change.T @ derivatives
        if len(own):
            change_by_point[:, self.gain_at[column]] += by_own * w[:, None]
        parts["B"][:, column] = b + w * missing
        derivatives[np.flatnonzero(of_b)[np.argsort(rows[of_b])]] += change_by_point

    def projection(self, point: Array) -> EntryErrors:
        """Errors of a point and their derivatives."""
        if self._latest is not None and np.array_equal(self._latest[0], point):
            return self._latest[1]
        data, entries = self.plain.data, self.entries(point)
        matrices = [getattr(entries, name) for name in ("A", "B", "K", "C", "D", "R", "initial")]
        with np.errstate(all="ignore"):
            one_step, by_entries = entry_derivatives(
                *(np.ascontiguousarray(each) for each in matrices),
                *(np.ascontiguousarray(column) for column in self.places.T),
                *(data.inputs, data.outputs, self.regressors, data.bounds),
            )
            errors, by_entries = self._ahead(entries, one_step, by_entries)
            covariance = errors.T @ errors / len(errors)
            derivatives = by_entries @ entries.derivatives
        found = EntryErrors(entries, one_step, errors, derivatives, covariance)
        self._latest = (point.copy(), found)
        return found

    def _ahead(self, entries: Entries, errors: Array, derivatives: Array) -> tuple[Array, Array]:
        """Errors of predictions ``horizon`` samples ahead, and their derivatives."""
        if self.horizon == 1 or not self.plain.innovations:
            return errors, derivatives
        A, K, C = entries.A, entries.K, entries.C
        kinds, rows, columns = self.places.T
        ahead, by_entries = errors.copy(), derivatives.copy()
        G, dG = K, np.zeros((len(kinds), *K.shape))
        of_k = np.flatnonzero(kinds == 2)
        dG[of_k, rows[of_k], columns[of_k]] = 1.0
        of_a, of_c = np.flatnonzero(kinds == 0), np.flatnonzero(kinds == 4)
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
        entries = projection.entries
        matrix = entries.A - entries.K @ entries.C
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
            if block.region is not None or block.known:
                shares[own] = True
        for own in self.gain_at.values():
            shares[own] = True
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

    def is_stable(self, point: Array) -> bool:
        """Whether the predictor is stable."""
        return self.stable(self.projection(point))

    # To and from models.

    def point_of(self, model: StateSpaceModel, initial: Array, levels: Array) -> Array:
        """The point nearest to a model of this order, with the states and levels of segments.

        It fixes s of each section: points of one problem all stem from one model.

        Parameters
        ----------
        model : StateSpaceModel
        initial : (segments, n) array
        levels : (segments, l) array
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
        for kind, name in enumerate(PARTS[1:], start=1):
            chosen = self.places[:, 0] == kind
            _, rows, columns = self.places[chosen].T
            at = self.first + np.flatnonzero(chosen) - self.entries_of_poles
            point[at] = parts[name][rows, columns]
        for column, gain in self.gains.items():
            resolvent = np.linalg.solve(
                np.eye(model.order) - model.A, model.B[:, column] * u[column]
            )
            found = float(model.C[0] @ resolvent + model.D[0, column] * u[column]) / float(y[0])
            point[self.gain_at[column]] = gain.coordinates(found)
        self._latest = None
        return point

    def model(self, point: Array) -> StateSpaceModel:
        """The model of a point in the units of the recording, without covariance."""
        data, found = self.plain.data, self.projection(point)
        u, y, entries = data.input_scales, data.output_scales, found.entries
        noise = found.one_step.T @ found.one_step / degrees_of_freedom(self.plain)
        level = data.output_offsets + y * (entries.R[:, : data.levels] @ data.level_shares)
        return StateSpaceModel(
            A=entries.A,
            B=entries.B / u,
            C=entries.C * y[:, None],
            D=entries.D * y[:, None] / u,
            K=entries.K / y,
            level=level,
            sampling_rate=data.recording.sampling_rate,
            noise_covariance=noise * np.outer(y, y),
            input_delays=data.shifts if any(data.shifts) else (),
            structure=self.plain.structure,
            input_names=data.recording.input_names,
            output_names=data.recording.output_names,
        )

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


def _of_section(k: int, order: int) -> list[tuple[int, int]]:
    """Entries of A of a section that depend on its poles."""
    return [(k, k)] if k + 1 == order else [(k, k), (k + 1, k + 1), (k + 1, k)]
