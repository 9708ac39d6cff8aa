"""States of models, and initial ones from a stretch of measured signals by least squares."""

from collections.abc import Sequence

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import ArrayLike

from evopem.arrays import Array
from evopem.signals.correlation import independent_share
from evopem.signals.least_squares import WIDTH

# Singular values of the response to an initial state below this share of the largest one say
# nothing about the state, unless errors need them.
STATE_RANK = 1e-11
TINY, EPSILON = float(np.finfo(float).tiny), float(np.finfo(float).eps)
DECAYED = 1e-20  # share of the largest response to a state below which it has decayed
# Weight of samples that count where others say nothing.
FAINT = 1e-8
FIRST_SHARE = 0.1  # share of a recording without a past that determines the state of its simulation
REWEIGHTINGS = 5  # iterations of reweighted least squares towards least absolute deviations
# A difference of BIC, for all samples, that is very strong evidence (Kass & Raftery 1995).
VERY_STRONG = 10.0


def first_samples(samples: int) -> int:
    """How many of the samples of a recording without a past determine its state."""
    return max(round(FIRST_SHARE * samples), 1)


def fitted(
    columns: Array,
    target: Array,
    spread: Array,
    robust: bool = False,
    prior: Array | None = None,
    unknown: int = 0,
) -> Array:
    """Coefficients, (k,), of columns, (N, ny, k), that fit a target, (N, ny), best.

    Relative to the spread, (ny,); ``robust``: nearly least absolute errors by reweighting.
    ``prior`` (M, k): further rows, of target 0, that are not reweighted.  ``unknown`` first samples
    count where later ones say nothing.
    """
    scale = 1.0 / np.where(np.isfinite(spread) & (spread > 0.0), spread, 1.0)
    if unknown:
        scale = np.where(np.arange(len(target)) < unknown, FAINT, 1.0)[:, None] * scale
    rows = (columns * scale[..., None]).reshape(-1, columns.shape[2])
    goal = (target * scale).ravel()
    said = np.abs(rows)
    # What is left of states long after they have decayed says nothing.
    if not (robust or np.any(said[-1:] > DECAYED * said.max(initial=0.0))):
        said = np.flatnonzero(np.any(said > DECAYED * said.max(axis=0), axis=1))
        rows, goal = (part[: said[-1] + 1 if len(said) else None] for part in (rows, goal))
    # Copies of large arrays take longer than what is computed of them.
    weighted, weighted_goal = rows, goal
    for _ in range(REWEIGHTINGS + 1 if robust else 1):
        if prior is None:
            coefficients = _least_squares(weighted, weighted_goal)
        else:
            coefficients = _determined(weighted, weighted_goal, prior)
        if robust:
            left = np.abs(goal - rows @ coefficients)
            weights = 1.0 / np.sqrt(np.maximum(left, 0.1 * np.mean(left) + 1e-300))
            weighted, weighted_goal = rows * weights[:, None], goal * weights
    return np.asarray(coefficients)


def probable(columns: Array, target: Array, spread: Array, robust: bool, root: Array) -> Array:
    """The most probable coefficients, (k,), of columns, (N, ny, k), that leave noise of a target.

    The first n are normal, ``root`` (n, n) of their second moments, levels behind them with those
    of the target: beside an integrator they would draw ramps.  The noise has the size of what least
    squares leave.  Other arguments as of :func:`fitted`.
    """
    (samples, ny, count), n = columns.shape, len(root)
    scale = np.where(spread > 0.0, spread, 1.0)
    basis, goal = np.linalg.qr((columns / scale[:, None]).reshape(-1, count))[0], target / scale
    left = scale * (goal.ravel() - basis @ (basis.T @ goal.ravel())).reshape(target.shape)
    freedom = samples - count / ny
    squares = left**2 * samples / freedom if ny * freedom >= n else target**2
    noise = np.sqrt(np.maximum(np.mean(squares, axis=0), 1e-20 * np.mean(target**2, axis=0)))
    noise[noise == 0.0] = 1.0
    scaled = np.zeros((count, count))
    scaled[:n, :n] = root
    np.fill_diagonal(scaled[n:, n:], np.sqrt(np.mean(target**2, axis=0)))
    return np.asarray(scaled @ fitted(columns @ scaled, target, noise, robust, np.eye(count)))


def levels_moved(same: Array, moved: Array, spread: Array, robust: bool) -> bool:
    """Whether errors, (N, ny), with levels of their own refute the model's levels, by the BIC. Next
    to a pole near 1 few samples hardly tell level from state, and a wrong share becomes a ramp.
    Coloured errors count as the independent ones they are."""
    scale, power = np.where(spread > 0.0, spread, 1.0), 1 if robust else 2
    sizes = [max(float(np.sum(np.abs(e / scale) ** power)), TINY) for e in (same, moved)]
    gain = 2.0 / power * len(same) * np.log(sizes[0] / sizes[1])
    least = np.log(len(same)) + VERY_STRONG
    # Autocorrelations only where independent errors say so: they take longer than all else.
    return bool(gain > least and gain * min(independent_share(e) for e in moved.T) > least)


def _determined(columns: Array, goal: Array, prior: Array) -> Array:
    """Beside rows of a prior that leave no direction free: a QR factorization takes a third of the
    time of a singular value decomposition."""
    count, known = columns.shape[1], len(goal)
    rows = np.zeros((count + 1, known + len(prior)))
    rows[:count, :known], rows[count, :known], rows[:count, known:] = columns.T, goal, prior.T
    factors = scipy.linalg.lapack.dgeqrf(rows.T, WIDTH * len(rows), overwrite_a=True)[0]
    triangle, along = factors[:count, :count], factors[:count, count]
    return np.asarray(scipy.linalg.lapack.dtrtrs(triangle, along)[0])


def _least_squares(columns: Array, goal: Array) -> Array:
    """Without the directions that are hardly seen, unless the BIC prefers a fit with them."""
    # States of very different sizes would make the small ones look undetermined.
    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    columns = columns / norms
    coefficients, rank, sizes = _solved(columns, goal, STATE_RANK)
    share = min(len(columns) * EPSILON, STATE_RANK)
    if rank < np.sum(sizes > share * sizes.max(initial=0.0)):
        finer, more, _ = _solved(columns, goal, share)
        left, less = (
            max(float(np.sum((goal - columns @ x) ** 2)), TINY) for x in (coefficients, finer)
        )
        if len(goal) * np.log(left / less) > (more - rank) * np.log(len(goal)):
            return finer / norms
    return coefficients / norms


def _solved(columns: Array, goal: Array, share: float) -> tuple[Array, int, Array]:
    """Coefficients, rank, and singular values, 1 where they are not known."""
    try:
        coefficients, _, rank, sizes = np.linalg.lstsq(columns, goal, share)
    except np.linalg.LinAlgError:
        if not (np.isfinite(columns).all() and np.isfinite(goal).all()):
            raise  # SciPy would raise a plain ValueError, which ends a search
        # The iteration for singular values may not end; a decomposition with pivots needs none.
        coefficients, _, rank, _ = scipy.linalg.lstsq(columns, goal, share, lapack_driver="gelsy")
        sizes = np.ones(columns.shape[1])
    return np.asarray(coefficients), int(rank), np.asarray(sizes)


def states_of(dynamics: Array, drive: Array, initial: ArrayLike | None) -> Array:
    """States x_0 ... x_(N-1) of ``x+ = dynamics x + drive``, (N, n), sample after sample.

    Powers of the dynamics would lead over many samples at once, but those of companion matrices
    of slow poles rise before they fall: their rounding is that of poles outside the circle.
    Without poles, as of finite responses, one state follows after the other.
    """
    samples, n = drive.shape
    start = np.zeros(n) if initial is None else np.asarray(initial, dtype=float)
    rows, columns = np.nonzero(dynamics)
    if np.all(rows < columns) or np.all(rows > columns):
        states = np.vstack([start, drive[:-1]])
        for row in range(n) if np.all(rows > columns) else reversed(range(n)):
            acting = columns[rows == row]
            states[1:, row] += states[:-1, acting] @ dynamics[row, acting]
        return states[:samples]
    from evopem.models.recursions import driven_states  # compiled code takes long to load

    given = np.ascontiguousarray(dynamics), start[None, None], np.ascontiguousarray(drive)[:, None]
    return np.asarray(driven_states(*given, np.array([0, samples]))[:, 0])


def powers_times(matrix: Array, columns: Array, count: int) -> Array:
    """``matrix^k columns`` of (n, n) and (n, m), k = 0 … count - 1: (count, n, m)."""
    products, power = columns[None], matrix  # twice as many at a time
    while len(products) < count:
        products, power = np.concatenate([products, power @ products]), power @ power
    return products[:count]


def delayed(signals: Array, delays: Sequence[int]) -> Array:
    """Columns later by some samples each; 0 before the record."""
    later = np.zeros_like(signals)
    for column, delay in enumerate(delays):
        later[delay:, column] = signals[: max(len(signals) - delay, 0), column]
    return later
