"""The objective, quadratic or absolute, decided by the distribution of residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import FitSettings, fit, log_loss
from evopem.errors import NoModelError
from evopem.models.structures import Orders
from evopem.signals.recording import Segment, total_samples

# Orders of the ARX models whose residuals decide between the objectives, as far as there are
# SAMPLES_PER_ORDER samples for each, and how much likelier Laplace's distribution must be than the
# normal one for the absolute objective, as a logarithm.
OBJECTIVE_ORDERS, SAMPLES_PER_ORDER = (2, 4, 8, 12, 16), 25
LEAST_EVIDENCE = 3.0


def decide_objective(stretches: Sequence[Segment]) -> tuple[str, Decision]:
    """The objective whose distribution of residuals is the likelier one.

    Least squares is the maximum-likelihood estimate for normal residuals, least absolute deviations
    that for residuals of Laplace's distribution.  Both are fitted to ARX models, which whiten the
    residuals; each objective is represented by the order at which it is likeliest.
    """
    criterion = "negative log-likelihood of a residual by its BIC"
    likelihoods = {
        objective: _arx_likelihood(stretches, objective) for objective in ("quadratic", "absolute")
    }
    alternatives = tuple(Alternative(name, value) for name, value in likelihoods.items())
    samples = total_samples(stretches)
    evidence = samples * (likelihoods["quadratic"] - likelihoods["absolute"])
    objective = "absolute" if evidence > LEAST_EVIDENCE else "quadratic"
    sentence = (
        "The residuals of ARX models are likelier to have Laplace's distribution than a normal one:"
        " a few large ones stand out, and the absolute objective is used."
        if objective == "absolute"
        else "The residuals of ARX models are not likelier to have Laplace's distribution than a"
        " normal one: outliers do not call for the absolute objective."
    )
    return objective, Decision("objective", objective, alternatives, criterion, sentence)


def _arx_likelihood(stretches: Sequence[Segment], objective: str) -> float:
    """Lowest negative log-likelihood of a residual over ARX orders, with the penalty of BIC."""
    samples = total_samples(stretches)
    orders = [n for n in OBJECTIVE_ORDERS if n * SAMPLES_PER_ORDER <= samples] or [1]
    settings, lowest_value = FitSettings(objective), np.inf
    for n in orders:
        try:
            found = fit(stretches, Orders(na=n, nb=n + 1), settings)
        except NoModelError:
            continue
        residuals = np.concatenate(found.residuals)
        count = len(residuals)
        value = 0.5 * (
            log_loss(residuals, objective) + found.parameters * np.log(count) / max(count, 1)
        )
        lowest_value = min(lowest_value, value)
    return lowest_value
