"""The problem of several inputs as the global search sees it, and the estimates it starts from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.damped_descent import Optimum
from evopem.estimation.multi_input.descent import TOLERANCE, descend
from evopem.estimation.multi_input.errors import MultiInputErrors
from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.search.root_recombination import (
    Sections,
    product_of,
    recombined_polynomials,
    sections_of,
)
from evopem.estimation.search.section_hopping import (
    PLACES,
    random_sections,
    section_roots,
    without_nearest_section,
)
from evopem.estimation.search.starting_polynomials import (
    noise_model,
    random_denominators,
    steiglitz_mcbride,
)
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import reflect_into_disc, roots

Array = NDArray[np.float64]

# Lags of the long ARX models whose responses are reduced.
LONG_LAGS = (15, 40)
# Steps of a descent of the search; steps and relative tolerance of the last one.
STEPS = 60
POLISH_STEPS, POLISH_TOLERANCE = 500, 1e-12
# Random points of the first batch of a multistart check suffice.
MIN_MULTISTART = 1
# Points with further random poles that are tried, and those that are descended from.
PAIRS, DESCENDED = 12, 2


class MultiInputProblem:
    """Search problem of one record and orders; see :class:`.section_hopping.HoppingProblem`.

    Parameters
    ----------
    errors : MultiInputErrors
    starts : (m, n) array
        Points that the first population is descended from.
    """

    def __init__(self, errors: MultiInputErrors, starts: Array) -> None:
        self.errors = errors
        self._starts: Array | None = starts
        self._denominators = _denominators_of(errors)

    @property
    def min_multistart(self) -> int:
        """Random points that a multistart check takes at least."""
        return MIN_MULTISTART

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A population, and the evaluations that it took; the first one holds the estimates."""
        if self._starts is None:
            return self.random(count, generator), 2 * count
        points = np.vstack(
            [self._starts, self.random(max(count - len(self._starts), 2), generator)]
        )
        self._starts = None
        values = self.values(points)
        best = np.argsort(values, kind="stable")[:count]
        return points[best], 3 * len(points)

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Independent points with random A, C, D and F_i; the rest follows by least squares."""
        points = np.zeros((count, self.errors.dimension))
        for part in self._denominators:
            order = part.stop - part.start
            points[:, part] = random_denominators(count, order, generator)
        return np.array([self.errors.completed(point) for point in points])

    def repair(self, points: Array) -> Array:
        """Move roots beyond the radius inside."""
        return np.array([self.errors.repaired(point) for point in points])

    def values(self, points: Array) -> Array:
        """Objective of each row in percent, (M,)."""
        return np.array([self.errors.value(point) for point in points])

    def descend(self, points: Array) -> Descent:
        """Levenberg-Marquardt from each row."""
        return self._descents(points, STEPS, TOLERANCE)

    def descend_from_neighbours(self, points: Array) -> Descent:
        """Levenberg-Marquardt, whose damping singular matrices do not disturb."""
        return self.descend(points)

    def polish(self, points: Array) -> Descent:
        """Levenberg-Marquardt from each row to the last digits."""
        return self._descents(points, POLISH_STEPS, POLISH_TOLERANCE)

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring whose polynomials have sections from two parents each."""
        pairs = generator.integers(len(parents), size=(2, count))
        offspring = np.zeros((count, parents.shape[1]))
        for part in self._denominators:
            offspring[:, part] = recombined_polynomials(parents[:, part], pairs, generator)
        return np.array([self.errors.completed(point) for point in offspring]), 2 * count

    def neighbours(
        self,
        point: Array,
        value: float,  # noqa: ARG002 - as of other problems
        count: int,
        generator: np.random.Generator,
    ) -> tuple[Array, int]:
        """The lowest of the points with a section of a polynomial elsewhere.

        A section of A or D is moved together with the nearest one of C, or alone.
        """
        o = self.errors.orders
        c = o.part("c")
        moved = []
        for part in self._denominators:
            beside = part in (o.part("a"), o.part("d")) and o.nc >= 2
            found = sections_of(point[part])
            for row, section in enumerate(found.quadratic):
                rest = Sections(np.delete(found.quadratic, row, axis=0), found.single)
                own = np.concatenate([[1.0], product_of(rest)])
                near = without_nearest_section(point[c], section_roots(section)) if beside else None
                for factor in random_sections(PLACES, generator):
                    neighbour = point.copy()
                    neighbour[part] = np.convolve(own, factor)[1:]
                    moved.append(neighbour)
                    if near is not None:
                        both = neighbour.copy()
                        both[c] = np.convolve(near, factor)[1:]
                        moved.append(both)
        if not moved:
            return np.empty((0, len(point))), 0
        points = np.array([self.errors.completed(each) for each in moved])
        best = np.argsort(self.values(points), kind="stable")[:count]
        return points[best], 3 * len(points)

    def _descents(self, points: Array, steps: int, tolerance: float) -> Descent:
        optima = [descend(self.errors, point, steps, tolerance) for point in points]
        return Descent(
            points=np.array([optimum.point for optimum in optima]).reshape(points.shape),
            values=np.array([optimum.value for optimum in optima]),
            converged=np.array([optimum.converged for optimum in optima], dtype=bool),
            evaluations=sum(optimum.evaluations for optimum in optima),
        )


def starting_points(
    errors: MultiInputErrors,
    smaller: Sequence[PolynomialModel] = (),
    generator: np.random.Generator | None = None,
) -> list[Array]:
    """Points from estimates by linear algebra, and from models of smaller orders.

    Parameters
    ----------
    errors : MultiInputErrors
    smaller : sequence of PolynomialModel
    generator : numpy.random.Generator, optional
        Of the poles that are added to the smaller models.
    """
    points = []
    for denominators in _plants(errors):
        points += _with_noise(errors, _with_plant(errors, denominators))
    for model in smaller:
        points.append(errors.point_of(model))
        if generator is not None:
            points += _with_further_poles(errors, model, generator)
    return points


def adapted_point(errors: MultiInputErrors, model: PolynomialModel) -> Array:
    """The best point next to a model of neighbouring orders.

    A polynomial that is shorter by one loses its last coefficient, or one of its real roots.
    """
    o, other, parameters = errors.orders, model.orders, model.parameters
    shorter = []
    for letter, place in [("a", 0), ("c", 0), ("d", 0), *(("f", i) for i in range(o.inputs))]:
        coefficients = parameters[other.part(letter, place)]
        part = o.part(letter, place)
        if part.stop - part.start != len(coefficients) - 1:
            continue
        found = roots(coefficients)
        real = [k for k in range(len(found)) if found[k].imag == 0.0]
        without = [np.atleast_1d(np.real(np.poly(np.delete(found, k))))[1:] for k in real]
        shorter.append([(part, each) for each in (coefficients[:-1], *without)])
    base = errors.point_of(model)
    best, lowest = base, errors.value(base)
    for choice in product(*shorter):
        point = base.copy()
        for part, coefficients in choice:
            point[part] = coefficients
        point = errors.completed(point)
        value = errors.value(point)
        if value < lowest:
            best, lowest = point, value
    return best


def descended(errors: MultiInputErrors, starts: Sequence[Array], count: int) -> list[Optimum]:
    """Optima from the best starts, the lowest first; infeasible ones are left out."""
    values = [errors.value(start) for start in starts]
    order = np.argsort(values, kind="stable")[:count]
    optima = [descend(errors, starts[k], STEPS, TOLERANCE) for k in order]
    found = [optimum for optimum in optima if np.isfinite(optimum.value)]
    return sorted(found, key=lambda optimum: optimum.value)


def _denominators_of(errors: MultiInputErrors) -> list[slice]:
    """Where the monic polynomials stand that have coefficients."""
    o = errors.orders
    parts = [o.part("a"), o.part("c"), o.part("d"), *(o.part("f", i) for i in range(o.inputs))]
    return [part for part in parts if part.stop > part.start]


def _plants(errors: MultiInputErrors) -> Iterator[list[Array]]:
    """Denominators of the responses to all inputs: one polynomial for each."""
    from scipy.signal import lfilter

    o, record = errors.orders, errors.record
    order = max(o.na, *o.nf)
    if order == 0:
        yield [np.empty(0)] * o.inputs
        return
    yield [_arx(errors, order, tuple(o.nb))[0]] * o.inputs
    for lag in LONG_LAGS:
        if (lag + o.inputs * lag) * 4 > record.samples or lag <= order:
            continue
        a, bs = _arx(errors, lag, (lag,) * o.inputs)
        a = reflect_into_disc(a[None, :], 0.9999)[0]
        responses = [lfilter(b, np.concatenate([[1.0], a]), np.eye(1, 6 * lag)[0]) for b in bs]
        if not all(np.isfinite(each).all() for each in responses):
            continue
        yield [_reduced(responses, order)] * o.inputs
        if not any(o.nf):
            continue
        each = [_reduced([response], nf) for response, nf in zip(responses, o.nf, strict=True)]
        yield each
        yield _one_by_one(errors, each)


def _arx(errors: MultiInputErrors, na: int, nb: tuple[int, ...]) -> tuple[Array, list[Array]]:
    """A and B_i of the ARX model of least squares, with a level for each record."""
    record, nk = errors.record, errors.orders.nk
    rows, targets = [], []
    for place, (u, y) in enumerate(zip(record.inputs, record.outputs, strict=True)):
        first = max(na, record.start, *(k + n for k, n in zip(nk, nb, strict=True)))
        if len(y) <= first:
            continue
        columns = [-y[first - i : len(y) - i] for i in range(1, na + 1)]
        for i, count in enumerate(nb):
            lags = range(nk[i], nk[i] + count)
            columns += [u[first - lag : len(y) - lag, i] for lag in lags]
        level = np.zeros((len(y) - first, len(record.outputs)))
        level[:, place] = 1.0
        rows.append(np.column_stack([*columns, level]))
        targets.append(y[first:])
    if not rows:
        return np.zeros(na), [np.zeros(count) for count in nb]
    theta = np.linalg.lstsq(np.concatenate(rows), np.concatenate(targets), rcond=1e-12)[0]
    ends = np.cumsum([na, *nb])
    return theta[:na], [theta[a:b] for a, b in pairwise(ends.tolist())]


def _reduced(responses: Sequence[Array], order: int) -> Array:
    """Common denominator of impulse responses by a singular value decomposition (Kung 1978)."""
    if order == 0:
        return np.empty(0)
    length = len(responses[0])
    rows = length // 2
    windows = np.lib.stride_tricks.sliding_window_view
    hankel = np.hstack([windows(each[1:], length - rows)[: rows - 1] for each in responses])
    left, singular, _ = np.linalg.svd(hankel, full_matrices=False)
    states = left[:, :order] * np.sqrt(singular[:order])
    shift = np.linalg.lstsq(states[:-1], states[1:], rcond=None)[0]
    return np.real(np.poly(shift))[1:]


def _one_by_one(errors: MultiInputErrors, denominators: list[Array]) -> list[Array]:
    """Each F_i by Steiglitz-McBride iterations on what the other inputs leave of the output."""
    o, record = errors.orders, errors.record
    point = _with_plant(errors, denominators)
    model = errors.model(point, 1.0, 1.0)
    simulated = model.simulate(record.inputs[0] * record.input_scales)
    y = record.outputs[0] * record.output_scale + record.offset
    found = []
    for i in range(o.inputs):
        alone = np.zeros_like(record.inputs[0])
        alone[:, i] = record.inputs[0][:, i] * record.input_scales[i]
        own = model.simulate(alone) - model.level / float(np.sum(model.A))
        rest = y - simulated + own
        steps = list(steiglitz_mcbride(alone[:, i], rest, o.nf[i], o.nb[i], o.nk[i], errors.radius))
        found.append(steps[-1] if steps and o.nf[i] else denominators[i])
    return found


def _with_plant(errors: MultiInputErrors, denominators: Sequence[Array]) -> Array:
    """The point with denominators as F_i, or as A where there are no F_i, and white noise."""
    o = errors.orders
    point = np.zeros(errors.dimension)
    if not any(o.nf):
        kept = denominators[0][: o.na]
        point[o.part("a")][: len(kept)] = kept
    for i, denominator in enumerate(denominators):
        point[o.part("f", i)] = denominator[: o.nf[i]]
    return errors.completed(point)


def _with_noise(errors: MultiInputErrors, white: Array) -> list[Array]:
    """A point with white noise, and with the noise model of its residuals."""
    o = errors.orders
    if o.noise_states == 0:
        return [white]
    residuals = errors.residuals(white)[: errors.record.bounds[1]]
    if not np.isfinite(residuals).all() or len(residuals) < 4 * (o.nc + o.nd) + 20:
        return [white]
    coloured = white.copy()
    coloured[o.part("c")], coloured[o.part("d")] = noise_model(residuals, o.nc, o.nd)
    return [white, errors.completed(coloured)]


def _with_further_poles(
    errors: MultiInputErrors, model: PolynomialModel, generator: np.random.Generator
) -> list[Array]:
    """The best of a model with random further poles, where these orders have more of them."""
    o, other = errors.orders, model.orders
    base = errors.point_of(model)
    points = []
    for _ in range(PAIRS):
        point = base.copy()
        for letter, places, own, before in (
            ("a", (0,), (model.A,), (other.na,)),
            ("f", range(o.inputs), model.F, other.nf),
        ):
            for place, monic, order in zip(places, own, before, strict=True):
                part = o.part(letter, place)
                more = part.stop - part.start - order
                if more > 0:
                    further = random_denominators(1, more, generator)[0]
                    point[part] = np.convolve(monic, np.concatenate([[1.0], further]))[1:]
        points.append(errors.completed(point))
    values = [errors.value(point) for point in points]
    return [points[k] for k in np.argsort(values, kind="stable")[:DESCENDED]]
