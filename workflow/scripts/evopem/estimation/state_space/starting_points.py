"""Points of the search: from poles, from models, from smaller orders, at random."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.sections import (
    inside,
    normalised,
    point_of,
    poles_only,
    sections_of,
)

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Distance of random poles from the unit circle, log-uniform, and the share of real pairs.
NEAREST, FARTHEST, REAL_PAIRS = 0.003, 0.6, 0.2
# Ridge of the full residues of given poles, relative to the mean square of the regressors.
RESIDUE_RIDGE = 1e-8


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


def from_poles(errors: StateSpaceErrors, poles: Complex) -> Array:
    """Point with given poles of the predictor whose inputs come from full residues.

    Least squares gives a full matrix of residues at each pole.  Its best approximation by one
    column times one row gives the row by which the signals drive that pole.

    Parameters
    ----------
    errors : StateSpaceErrors
    poles : (order,) array
        Complex ones in conjugate pairs; moved inside the radius where they are not.
    """
    layout = errors.layout
    point = inside(layout, poles_only(layout, poles), errors.radius * (1.0 - 1e-6))
    alpha, beta = _residues(errors, point, errors.data.outputs)
    return with_inputs(errors, point, alpha, beta, range(layout.sections))


def _residues(errors: StateSpaceErrors, point: Array, outputs: Array) -> tuple[Array, Array]:
    """Coefficients of the responses p and r, (sections, drives, ny) each."""
    layout, data = errors.layout, errors.data
    sections = sections_of(layout, point)
    responses = errors.signals.responses(sections)
    direct = [part for part in errors.direct if part.shape[1]]
    x = np.column_stack([responses, *direct])
    sizes = np.linalg.norm(x, axis=0)
    sizes[sizes == 0.0] = 1.0
    x = x / sizes
    gram = x.T @ x
    gram[np.diag_indices_from(gram)] += RESIDUE_RIDGE
    solution = np.linalg.solve(gram, x.T @ outputs) / sizes[:, None]
    count = layout.sections * layout.drives
    shape = (layout.sections, layout.drives, data.outputs.shape[1])
    return solution[:count].reshape(shape), solution[count : 2 * count].reshape(shape)


def with_inputs(
    errors: StateSpaceErrors, point: Array, alpha: Array, beta: Array, which: range
) -> Array:
    """The point with inputs of some sections from the leading vectors of their residues.

    ``alpha`` and ``beta`` (sections, drives, ny) belong to the responses p and r.  With
    ``ratio = -1`` the residues of a pair of complex poles are ``alpha + i beta``, with
    ``ratio = 1`` those of the two real ones ``alpha + beta`` and ``alpha - beta``.
    """
    layout = errors.layout
    point = point.copy()
    rows, drives = layout.pair_rows(point), layout.drives
    weight = _drive_sizes(errors)
    for m in which:
        if m >= layout.pairs:
            layout.single_row(point)[1:] = _leading(alpha[m], weight).real
            continue
        row = rows[m]
        if row[1] < 0.0:
            leading = _leading(alpha[m] + 1j * beta[m], weight)
            row[2 : 2 + drives], row[2 + drives :] = leading.real, leading.imag
        else:
            high = _leading(alpha[m] + beta[m], weight).real
            low = _leading(alpha[m] - beta[m], weight).real
            row[2 : 2 + drives], row[2 + drives :] = 0.5 * (high + low), 0.5 * (high - low)
    return normalised(layout, point)


def _drive_sizes(errors: StateSpaceErrors) -> Array:
    """How much a drive counts in the approximation of residues, (drives,).

    A pulse has the energy of one sample, a scaled signal that of all.
    """
    sizes = np.full(errors.layout.drives, np.sqrt(errors.data.samples))
    sizes[errors.driving :] = 1.0
    return sizes


def _leading(residues: NDArray, weight: Array) -> NDArray:
    """Row of drives of the best approximation of rank one to residues, (drives, ny)."""
    left, _, _ = np.linalg.svd(weight[:, None] * residues, full_matrices=False)
    leading: NDArray = left[:, 0] / weight
    return leading


def from_matrices(errors: StateSpaceErrors, A: Array, B: Array) -> Array:
    """Point of a predictor's A, (n, n), and the columns of its signals, (n, driving); at rest."""
    pulses = np.zeros((errors.order, errors.data.segments))
    point = point_of(errors.layout, A, np.column_stack([B, pulses]))
    point = inside(errors.layout, point, errors.radius * (1.0 - 1e-6))
    return with_initial_states(errors, normalised(errors.layout, point))


def with_initial_states(errors: StateSpaceErrors, point: Array) -> Array:
    """The point with the initial states of least squares, C, D and constants as they are."""
    layout = errors.layout
    point = point.copy()
    pulses = slice(errors.driving, layout.drives)
    rows = layout.pair_rows(point)
    drives = layout.drives
    first, second = rows[:, 2 : 2 + drives], rows[:, 2 + drives :]
    single = layout.single_row(point)
    first[:, pulses] = 0.0
    second[:, pulses] = 0.0
    if layout.single:
        single[1:][pulses] = 0.0
    projection = errors.projection(point)
    c = projection.linear[: errors.order]
    count = layout.sections * drives
    ratio = projection.sections.ratio
    responses = errors.signals.responses(projection.sections)
    for k in range(errors.data.segments):
        rows_of = slice(errors.data.bounds[k], errors.data.bounds[k + 1])
        # Free responses of the states: a pulse into the first and into the second of a pair.
        p = responses[rows_of, :count].reshape(-1, layout.sections, drives)
        r = responses[rows_of, count:].reshape(-1, layout.sections, drives)
        p, r = p[:, :, errors.driving + k], r[:, :, errors.driving + k]
        length = min(len(p), max(200, 4 * errors.order))
        columns = []
        for m in range(layout.pairs):
            into_first = np.outer(p[:length, m], c[2 * m]) + ratio[m] * np.outer(
                r[:length, m], c[2 * m + 1]
            )
            into_second = np.outer(r[:length, m], c[2 * m]) + np.outer(p[:length, m], c[2 * m + 1])
            columns += [into_first.ravel(), into_second.ravel()]
        if layout.single:
            columns.append(np.outer(p[:length, -1], c[-1]).ravel())
        target = projection.errors[rows_of][:length].ravel()
        state = np.linalg.lstsq(np.column_stack(columns), target, rcond=1e-6)[0]
        pairs = layout.pairs
        first[:, errors.driving + k] = state[0 : 2 * pairs : 2]
        second[:, errors.driving + k] = state[1 : 2 * pairs : 2]
        if layout.single:
            single[1 + errors.driving + k] = state[-1]
    return normalised(layout, point)


def extended(
    larger: StateSpaceErrors,
    smaller: StateSpaceErrors,
    point: Array,
    remainder: Array,
    poles: Complex,
) -> Array:
    """The point of a smaller order with more poles, whose inputs fit what was left.

    Parameters
    ----------
    larger, smaller : StateSpaceErrors
        Problems of the two orders.
    point : (n,) array
        Of the smaller order.
    remainder : (N, ny) array
        Its errors.
    poles : array
        As many as the orders differ: two, or one where the smaller order is even.
    """
    added = larger.of_order(len(poles))
    bare = poles_only(added.layout, poles)
    alpha, beta = _residues(added, bare, remainder)
    extra = with_inputs(added, bare, alpha, beta, range(added.layout.sections))
    into, from_, more = larger.layout, smaller.layout, added.layout
    result = np.zeros(into.dimension)
    result_rows = into.pair_rows(result)
    result_rows[: from_.pairs] = from_.pair_rows(point)
    result_rows[from_.pairs : from_.pairs + more.pairs] = more.pair_rows(extra)
    single = from_.single_row(point) if from_.single else more.single_row(extra)
    if into.single:
        into.single_row(result)[:] = single
    return normalised(into, result)


def _distances(count: int, generator: np.random.Generator) -> Array:
    draws: Array = FARTHEST * (NEAREST / FARTHEST) ** generator.random(count)
    return draws
