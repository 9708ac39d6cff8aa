"""What the disturbance asks for: differences where it is a random walk, and the objective."""

from collections.abc import Sequence
from contextlib import suppress
from itertools import product

import numpy as np

from evopem.automatic.cross_validation.simulation import errors_simulated_on
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import ArxFit, fit, likeliest_arx, log_loss
from evopem.errors import NoModelError
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Segment, total_samples

MOST_DIFFERENCES = 2
# Orders of the ARX models that are compared, with SAMPLES_PER_ORDER samples for each.
ORDERS, SAMPLES_PER_ORDER = (1, 2, 3, 4, 6, 8, 10, 12, 16, 20, 24), 25
# Those whose residuals decide between the objectives, and how much likelier Laplace's distribution
# must be than the normal one for the absolute objective, as a logarithm.
OBJECTIVE_ORDERS, LEAST_EVIDENCE = (2, 4, 8, 12, 16), 3.0
# A difference of BIC, not divided by the samples, that is very strong evidence (Kass & Raftery
# 1995), and the share of the output's mean square that the response to the input must leave over.
VERY_STRONG, HIDDEN = 10.0, 0.5


def decide_differences(stretches: Sequence[Segment]) -> tuple[int, Decision]:
    """How often both channels are differenced.

    An ARX model of signals that were differenced d times is one of the signals themselves whose A
    and B have d common roots at 1: the disturbance is integrated d times, the plant is not.  The
    BIC compares both on the same samples; it is a test for unit roots of the disturbance (Said &
    Dickey 1984; by an information criterion as Phillips & Ploberger 1994).  Where the response to
    the input is most of the output nevertheless, nothing is differenced: the model describes the
    drift, and differences would weight it by high frequencies.

    `stretches`: Centred.
    """
    found = [_likeliest(stretches, d) for d in range(MOST_DIFFERENCES + 1)]
    times, left, level = 0, 0.0, found[0]
    if level is None:
        sentence = "The record is too short to decide whether the output drifts."
    else:
        known = [each for each in found if each is not None]
        best = min(known, key=lambda each: each.bic)
        times, evidence = found.index(best), level.bic - best.bic
        # Any model tells of a stationary response, though roots at 1 may describe it best.
        left = min(_left_over(each.model, stretches) for each in known) if times else 0.0
        walk = f"a random walk (the BIC falls by {evidence:.3g})"
        if times == 0 or evidence < VERY_STRONG:
            times, sentence = 0, "Nothing speaks for a disturbance that is a random walk."
        elif left < HIDDEN:
            times = 0
            sentence = (
                f"The disturbance is likely to be {walk}, but the response to the input leaves"
                f" only {100 * left:.0f} % of the output's mean square: nothing is differenced."
            )
        elif not np.isfinite(_left_over(best.model, stretches)):
            times = 0
            sentence = "The model of differenced signals is unstable: nothing is differenced."
        else:
            sentence = (
                f"The disturbance is {walk}{' that is summed up once more' * (times == 2)}, and"
                f" the response to the input leaves {100 * left:.0f} % of the output's mean"
                " square. Both channels are differenced, which leaves the plant as it is."
                " Simulations are scored on differenced samples."
            )
    criterion = "BIC of ARX models on the same samples, not divided by their number"
    alternatives = tuple(
        Alternative(str(d), np.nan if each is None else each.bic) for d, each in enumerate(found)
    )
    return times, Decision("differences", str(times), alternatives, criterion, sentence)


def differenced(stretch: Segment, times: int) -> Segment:
    """All channels differenced, ``times`` samples shorter."""
    inputs, outputs = (np.diff(each, times, axis=0) for each in (stretch.inputs, stretch.outputs))
    return Segment(inputs, outputs, stretch.recording)


def _likeliest(stretches: Sequence[Segment], times: int) -> ArxFit | None:
    """The ARX model of the lowest BIC of signals that were differenced some times."""
    samples = total_samples(stretches)
    orders = [n for n in ORDERS if n * SAMPLES_PER_ORDER <= samples]
    first = max(orders, default=0) + MOST_DIFFERENCES
    lower = [differenced(each, times) for each in stretches]
    return likeliest_arx(lower, orders, first - times, levels=times == 0)


def _left_over(model: PolynomialModel, stretches: Sequence[Segment]) -> float:
    """Share of the output's mean square that the simulation of a model leaves over."""
    with np.errstate(all="ignore"):
        errors = np.concatenate([errors_simulated_on(model, None, s, True) for s in stretches])
        output = np.concatenate([s.output - s.output.mean() for s in stretches])
        left = float(np.mean(errors**2) / np.mean(output**2))
    return left if np.isfinite(left) else np.inf


def decide_objective(stretches: Sequence[Segment]) -> tuple[str, Decision]:
    """The objective whose distribution of residuals is the likelier one.

    Least squares is the maximum-likelihood estimate for normal residuals, least absolute deviations
    that for residuals of Laplace's distribution.  Both are fitted to ARX models, which whiten the
    residuals; each objective is represented by the order at which it is likeliest.
    """
    samples = total_samples(stretches)
    orders = [n for n in OBJECTIVE_ORDERS if n * SAMPLES_PER_ORDER <= samples] or [1]
    lowest = dict.fromkeys(("quadratic", "absolute"), np.inf)
    for name, n in product(lowest, orders):
        with suppress(NoModelError):
            found = fit(stretches, Orders(na=n, nb=n + 1), name)
            residuals = np.concatenate(found.residuals)
            penalty = found.parameters * np.log(len(residuals)) / len(residuals)
            lowest[name] = min(lowest[name], 0.5 * (log_loss(residuals, name) + penalty))
    evidence = samples * (lowest["quadratic"] - lowest["absolute"])
    is_absolute = evidence > LEAST_EVIDENCE
    sentence = (
        f"The residuals of ARX models are {'' if is_absolute else 'not '}likelier to have Laplace's"
        " distribution than a normal one: "
        + (
            "a few large ones stand out, and the absolute objective is used."
            if is_absolute
            else "outliers do not call for the absolute objective."
        )
    )
    objective = "absolute" if is_absolute else "quadratic"
    alternatives = tuple(Alternative(*each) for each in lowest.items())
    criterion = "negative log-likelihood of a residual by its BIC"
    return objective, Decision("objective", objective, alternatives, criterion, sentence)
