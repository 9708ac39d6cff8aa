"""A subspace estimate beside the chosen model, as a short method that must not be better."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.held_out.folds import FoldPlan, HeldOutScores, held_out_scores
from evopem.estimation.search.linear_estimates import subspace_denominator
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import reflect_into_disc
from evopem.signals.recording import Segment

Array = NDArray[np.float64]

SUBJECT = "comparison with a short method"
ORDERS = (1, 2, 3, 4, 6, 8, 12)
SAMPLES_PER_ORDER = 30
LARGEST_RADIUS = 0.99999
# A simulation error that is larger by this share than the subspace estimate's is said to be worse.
CLEARLY = 0.1


def with_subspace_estimate(
    stretches: Sequence[Segment],
    plan: FoldPlan,
    objective: str,
    name: str,
    scores: HeldOutScores,
    fitted_level: bool,
) -> Decision:
    """Score a subspace estimate on the same held-out samples as the chosen model."""
    samples = max(each.samples for each in stretches)
    orders = [n for n in ORDERS if n * SAMPLES_PER_ORDER <= samples] or [1]
    order = min(orders, key=lambda n: _subspace(stretches, n)[1])
    of_estimate = held_out_scores(
        stretches, plan, lambda training: _subspace(training, order)[0], objective == "absolute"
    )
    kind = "fitted_level" if fitted_level else "simulation"
    chosen, estimated = (float(getattr(each, kind)) for each in (scores, of_estimate))
    estimate = f"subspace estimate of order {order}"
    worse = chosen > (1.0 + CLEARLY) * estimated
    sentence = (
        f"Held-out samples are simulated with {chosen:.3g} % by {name} and with {estimated:.3g} %"
        f" by a {estimate}, whose numerator is fitted by least squares"
        + (
            ": the chosen model simulates clearly worse than this short method; structure:"
            " state_space searches models of its kind."
            if worse
            else "."
        )
    )
    return Decision(
        *(SUBJECT, estimate if worse else name),
        (Alternative(name, chosen), Alternative(estimate, estimated)),
        "simulation error on held-out samples, %",
        sentence,
    )


def _subspace(stretches: Sequence[Segment], order: int) -> tuple[PolynomialModel, float]:
    """An output-error model of the longest stretch, and the BIC of its simulation errors.

    Its denominator comes from MOESP (Verhaegen 1994), numerator, level and initial state from least
    squares.
    """
    from scipy.linalg import toeplitz
    from scipy.signal import lfilter

    longest = max(stretches, key=lambda each: each.samples)
    u, y, n = longest.input, longest.output, longest.samples
    denominator = subspace_denominator(u - u.mean(), y - y.mean(), order)
    f = np.ones(order + 1)
    f[1:] = reflect_into_disc(denominator[None, :], LARGEST_RADIUS)[0]
    of_input, decay = lfilter([1.0], f, u), lfilter([1.0], f, np.eye(1, n)[0])
    lagged = toeplitz(of_input, np.zeros(order + 1)), toeplitz(decay, np.zeros(order))
    regressors = np.column_stack([*lagged, np.ones(n)])
    point: Array = np.linalg.lstsq(regressors, y, rcond=1e-10)[0].astype(float)
    errors = y - regressors @ point
    mean_square = max(float(errors @ errors) / n, np.finfo(float).tiny)
    bic = float(np.log(mean_square) + len(point) * np.log(n) / n)
    one = np.ones(1)
    model = PolynomialModel(one, point[: order + 1], one, one, f, 0, level=float(point[-1]))
    return model, bic
