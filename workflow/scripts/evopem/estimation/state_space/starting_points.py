"""Points of the search: from poles, from models, from smaller orders, at random."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evopem.arrays import Array, Complex
from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.sections import (
    Layout,
    inside,
    normalised,
    scale_of,
    sections_of,
    state_matrix,
    with_drives,
)
from evopem.models.state_space import StateSpaceModel

# Distance of random poles from the unit circle, log-uniform, and the share of real pairs.
NEAREST, FARTHEST, REAL_PAIRS = 0.003, 0.6, 0.2
# Ridge of the full residues of given poles, relative to the mean square of the regressors.
RESIDUE_RIDGE = 1e-8
# Samples of a segment, and values of its outputs, that determine the initial state of a model.
MOST_SAMPLES, MOST_VALUES = 2000, 8000
# Half the distance that two real poles of a section get at least when a model is converted, and at
# most in shares of their distance from the unit circle: slow poles differ by less.
SEPARATION, SHARE_OF_DISTANCE, NEAREST_ONE = 2e-3, 0.02, 1e-7


def random_poles(order: int, generator: np.random.Generator) -> Complex:
    """Poles spread over frequencies, damping and real axis, (order,)."""
    poles: list[complex] = []
    while len(poles) + 2 <= order:
        radius = 1.0 - _distances(2, generator)
        if generator.random() < REAL_PAIRS:
            signs = np.where(generator.random(2) < 0.8, 1.0, -1.0)
            poles += [complex(value) for value in radius * signs]
        else:
            # Half over all angles alike, half over their logarithm.
            draw = generator.random()
            even = generator.random() < 0.5
            angle = np.pi * (draw if even else 10.0 ** (-2.0 * draw))
            pole = radius[0] * np.exp(1j * angle)
            poles += [pole, pole.conjugate()]
    if len(poles) < order:
        poles.append(complex(1.0 - _distances(1, generator)[0]))
    return np.array(poles)


def poles_only(layout: Layout, poles: Complex, driven: NDArray | None = None) -> Array:
    """A point with some poles, (order,), complex ones in conjugate pairs.

    ``driven``: what the drives give to the eigenvectors of the poles, (order, drives); nothing by
    default.  Real poles that almost coincide are moved apart.
    """
    upper, real = np.flatnonzero(poles.imag > 0.0), np.flatnonzero(poles.imag == 0.0)
    real = real[np.argsort(poles[real].real, kind="stable")]
    values = _apart(poles[real].real)
    drives = layout.drives
    driven = np.zeros((len(poles), drives)) if driven is None else driven
    point = np.zeros(layout.dimension)
    rows = layout.rows(point)
    if layout.single:
        # The real pole farthest from the origin stays alone; neighbours share a section.
        alone = int(np.argmax(np.abs(values)))
        rows[-1, 0], rows[-1, 2 : 2 + drives] = values[alone], driven[real[alone]].real
        real, values = np.delete(real, alone), np.delete(values, alone)
    for row, pole, of_pole in zip(rows, poles[upper], driven[upper], strict=False):
        # x = 2 Re(v q): the states (Re q, -Im q) turn by [[Re, Im], [-Im, Re]].
        row[:2] = pole.real, -(pole.imag**2)
        row[2 : 2 + drives] = of_pole.real
        row[2 + drives :] = -of_pole.imag * (pole.imag / scale_of(row[1]))
    pairs = values.reshape(-1, 2), driven[real].real.reshape(-1, 2, drives)
    for row, (low, high), (of_low, of_high) in zip(rows[len(upper) :], *pairs, strict=False):
        # q_low = p - r, q_high = p + r up to a factor of 2.
        row[:2] = 0.5 * (low + high), 0.25 * (high - low) ** 2
        row[2 : 2 + drives], row[2 + drives :] = of_high + of_low, of_high - of_low
    return point


def _apart(poles: Array) -> Array:
    """Ascending real poles, of which those that almost coincide are moved towards the origin."""
    apart = poles.copy()
    for k in range(len(apart) - 1, 0, -1):
        if apart[k] > 0.0:
            apart[k - 1] = min(apart[k - 1], apart[k] - _least_distance(apart[k]))
    for k in range(1, len(apart)):
        if apart[k - 1] < 0.0:
            apart[k] = max(apart[k], apart[k - 1] + _least_distance(apart[k - 1]))
    return apart


def _least_distance(pole: float) -> float:
    from_circle = max(1.0 - abs(pole), NEAREST_ONE)
    return 2.0 * min(SEPARATION, SHARE_OF_DISTANCE * from_circle)


def point_of(layout: Layout, A: Array, B: Array) -> Array:
    """The point of a state matrix, (n, n), and its drives; equal poles are separated."""
    poles, vectors = np.linalg.eig(A)
    driven = np.linalg.lstsq(vectors, B.astype(complex), rcond=1e-12)[0]
    return poles_only(layout, poles.astype(complex), driven)


def from_poles(errors: StateSpaceErrors, poles: Complex) -> Array:
    """Point with given poles of the predictor, (order,), whose inputs come from full residues.

    Least squares gives a matrix of residues at each pole; its best approximation of rank one gives
    the row by which the signals drive that pole.  Poles beyond the radius are moved inside.
    """
    point = _feasible(errors, poles_only(errors.layout, poles))
    responses = errors.signals.responses(sections_of(errors.layout, point))
    residues = _residues(errors, responses, errors.data.outputs)
    return normalised(errors.layout, _driven(errors, point, *residues))


def _feasible(errors: StateSpaceErrors, point: Array) -> Array:
    """The point with poles beyond the radius moved a little inside it, where descents begin."""
    return inside(errors.layout, point, errors.section_radius * (1.0 - 1e-6))


def _residues(errors: StateSpaceErrors, responses: Array, outputs: Array) -> tuple[Array, Array]:
    """Coefficients of the responses p and r, (sections, drives, ny) each."""
    layout = errors.layout
    direct = [part for part in errors.direct if part.shape[1]]
    x = np.column_stack([responses, *direct])
    solution = ridge(x.T @ x, x.T @ outputs)
    count = layout.sections * layout.drives
    shape = (layout.sections, layout.drives, outputs.shape[1])
    return solution[:count].reshape(shape), solution[count : 2 * count].reshape(shape)


def ridge(gram: Array, products: Array, share: float = RESIDUE_RIDGE) -> Array:
    """Least squares by the Gram matrix of regressors, (k, k), and products with targets.

    ``share``: of the mean square of each regressor, which is added to it.
    """
    sizes = np.sqrt(np.maximum(np.diag(gram), 0.0))
    sizes[sizes == 0.0] = 1.0
    gram = gram / np.outer(sizes, sizes)
    gram[np.diag_indices_from(gram)] += share
    solution: Array = np.linalg.solve(gram, products / sizes[:, None]) / sizes[:, None]
    return solution


def _driven(errors: StateSpaceErrors, point: Array, alpha: Array, beta: Array) -> Array:
    """The point with the inputs of its sections from the leading vectors of their residues. With
    alpha and beta of the responses p and r, residues of a complex pair are ``alpha + i beta``, and
    those of two real poles ``alpha + beta`` and ``alpha - beta``."""
    layout = errors.layout
    point = point.copy()
    drives = layout.drives
    # A pulse has the energy of one sample, a scaled signal that of all.
    weight = np.full(drives, np.sqrt(errors.data.samples))
    weight[errors.signals.driving :] = 1.0
    for m, row in enumerate(layout.rows(point)):
        if row[1] < 0.0:
            leading = _leading(alpha[m] + 1j * beta[m], weight)
            row[2 : 2 + drives], row[2 + drives :] = leading.real, leading.imag
        else:
            high = _leading(alpha[m] + beta[m], weight).real
            low = _leading(alpha[m] - beta[m], weight).real
            row[2 : 2 + drives], row[2 + drives :] = 0.5 * (high + low), 0.5 * (high - low)
    return point


def _leading(residues: NDArray, weight: Array) -> NDArray:
    """Row of drives of the best approximation of rank one to residues, (drives, ny)."""
    left, _, _ = np.linalg.svd(weight[:, None] * residues, full_matrices=False)
    leading: NDArray = left[:, 0] / weight
    return leading


def from_matrices(errors: StateSpaceErrors, A: Array, B: Array) -> Array:
    """Point of a predictor's A, (n, n), and the columns of its signals, (n, driving); at rest."""
    pulses = np.zeros((errors.order, errors.data.segments))
    point = point_of(errors.layout, A, np.column_stack([B, pulses]))
    return with_initial_states(errors, normalised(errors.layout, _feasible(errors, point)))


def point_of_model(model: StateSpaceModel, errors: StateSpaceErrors) -> Array:
    """The point of a problem that a model of its order and delays is, without K or with one."""
    if not errors.innovations:
        model = replace(model, K=np.zeros_like(model.K))
    drives = (model.B - model.K @ model.D) * errors.data.input_scales
    if errors.innovations:
        drives = np.column_stack([drives, model.K * errors.data.output_scales])
    states = _initial_states(model, errors)
    point = point_of(errors.layout, model.predictor, np.column_stack([drives, states]))
    return normalised(errors.layout, _feasible(errors, point))


def _initial_states(model: StateSpaceModel, errors: StateSpaceErrors) -> Array:
    """The states of a model at the first sample of each segment that fit it, (n, segments)."""
    data, states = errors.data, []
    form = replace(model, input_delays=(), covariance=None)
    for first, end in pairwise(data.bounds):
        stop = min(end, first + min(MOST_SAMPLES, MOST_VALUES // model.outputs))
        u = data.inputs[first:stop] * data.input_scales
        y = data.outputs[first:stop] * data.output_scales + data.output_offsets
        state = form.with_fitted_level(u, y)[1] if data.levels else form.prediction_state(u, y)
        states.append(state)
    return np.nan_to_num(np.array(states).T)


def with_initial_states(errors: StateSpaceErrors, point: Array) -> Array:
    """The point with the initial states of least squares, C, D and constants as they are."""
    layout, bounds, n = errors.layout, errors.data.bounds, errors.order
    pulses = slice(errors.signals.driving, layout.drives)
    at_rest = with_drives(layout, point, pulses, np.zeros((n, errors.data.segments)))
    projection = errors.projection(at_rest)
    dynamics = state_matrix(projection.sections, layout)
    longest = min(int(np.diff(bounds).max()), max(200, 4 * n))
    free = np.empty((longest, errors.data.outputs.shape[1], n))
    response = projection.linear[:n].T
    for t in range(longest):
        free[t] = response
        response = response @ dynamics
    states = []
    for first, stop in pairwise(bounds):
        target = projection.errors[first:stop][:longest]
        columns = free[: len(target)].reshape(target.size, n)
        states.append(np.linalg.lstsq(columns, target.ravel(), rcond=1e-6)[0])
    return normalised(layout, with_drives(layout, at_rest, pulses, np.array(states).T))


def extended(
    larger: StateSpaceErrors, solved: Projection, poles: Sequence[Complex], kept: int
) -> list[Array]:
    """The point of a smaller order with a few more poles, for the best of some sets of them.

    ``solved``: projection of the smaller order.  What the output matrices describe anew of its
    errors follows from products with the states that they add, without another projection.
    """
    added = replace(larger, order=len(poles[0]))
    ranked = []
    for some in poles:
        bare = poles_only(added.layout, some)
        responses = added.signals.responses(sections_of(added.layout, bare))
        extra = _driven(added, bare, *_residues(added, responses, solved.errors))
        states = responses @ _states_of_responses(added.layout, extra)
        known, products = solved.basis.T @ states, states.T @ solved.errors
        gained = products.T @ ridge(states.T @ states - known.T @ known, products)
        value = larger.criterion(solved.covariance - gained / larger.data.samples)
        ranked.append((value, extra))
    best = np.argsort([value for value, _ in ranked], kind="stable")[:kept]
    return [_joined(larger, solved.point, added, ranked[k][1]) for k in best]


def _states_of_responses(layout: Layout, point: Array) -> Array:
    """The states of a point as sums of its responses p, then r: (2 sections drives, order)."""
    sections, drives = sections_of(layout, point), layout.drives
    sums = np.zeros((2, layout.sections, drives, layout.sections, 2))
    for m, (b1, b2, ratio) in enumerate(zip(sections.b1, sections.b2, sections.ratio, strict=True)):
        sums[:, m, :, m, 0], sums[:, m, :, m, 1] = (b1, b2), (b2, ratio * b1)
    return sums.reshape(-1, 2 * layout.sections)[:, : layout.order]


def _joined(larger: StateSpaceErrors, point: Array, added: StateSpaceErrors, extra: Array) -> Array:
    """The point of a smaller order with the sections of another one more."""
    smaller = Layout(larger.order - added.order, larger.layout.drives)
    (pairs, single), (more, last) = (
        np.split(layout.rows(of), [layout.pairs])
        for layout, of in ((smaller, point), (added.layout, extra))
    )
    last = np.vstack([single, last])
    if len(last) == 2:
        drives = last[:, 2 : 2 + larger.layout.drives]
        last = point_of(Layout(2, drives.shape[1]), np.diag(last[:, 0]), drives)[None, :]
    return normalised(larger.layout, np.vstack([pairs, more, last]).ravel())


def _distances(count: int, generator: np.random.Generator) -> Array:
    draws: Array = FARTHEST * (NEAREST / FARTHEST) ** generator.random(count)
    return draws
