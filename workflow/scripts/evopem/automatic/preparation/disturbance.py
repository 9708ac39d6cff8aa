"""What the disturbance asks for: differences where it is a random walk, and the objective."""

from collections.abc import Sequence
from contextlib import suppress
from itertools import product

import numpy as np

from evopem.arrays import Array
from evopem.automatic.cross_validation.simulation import errors_simulated_on
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import ArxFit, fit, likeliest_arx, log_loss
from evopem.errors import NoModelError
from evopem.estimation.delays import likely_delays, longest_delay
from evopem.models.orders import Orders
from evopem.signals.recording import Segment, total_samples
from evopem.validation.held_out_tests import left_by

MOST_DIFFERENCES = 2
# Orders of the ARX models that are compared, with SAMPLES_PER_ORDER samples for each.
ORDERS, SAMPLES_PER_ORDER = (1, 2, 3, 4, 6, 8, 10, 12, 16, 20, 24), 25
# Those whose residuals decide between the objectives, and how much likelier Laplace's distribution
# must be than the normal one for the absolute objective, as a logarithm.
OBJECTIVE_ORDERS, LEAST_EVIDENCE = (2, 4, 8, 12, 16), 3.0
# Share of the ranks of their sizes that earlier changes of the inputs explain, of so many samples,
# from which large residuals are what a linear model misses; standard deviations of that by chance.
OF_INPUT, CHANGES, DEVIATIONS = 0.05, 16, 4.0
# A difference of BIC, not divided by the samples, that is very strong evidence (Kass & Raftery
# 1995), and the share of the output's mean square that the response to the input must leave over.
VERY_STRONG, HIDDEN = 10.0, 0.5


def decide_differences(stretches: Sequence[Segment]) -> tuple[int, Decision]:
    """How often all channels are differenced.

    Each output has an ARX model of all inputs, and the BIC of all outputs are added up.  An ARX
    model of signals that were differenced d times is one of the signals themselves whose A
    and B have d common roots at 1: the disturbance is integrated d times, the plant is not.  The
    BIC compares both on the same samples; it is a test for unit roots of the disturbance (Said &
    Dickey 1984; by an information criterion as Phillips & Ploberger 1994).  Where the response to
    the inputs is most of an output nevertheless, nothing is differenced: the model describes the
    drift, and differences would weight it by high frequencies.

    Behind a delay longer than the largest ARX model the response to an input looks like a
    disturbance: there the delays are taken out before.

    `stretches`: Centred, with an input.
    """
    times, about = _differences(stretches)
    if times and (behind := _behind_delays(stretches, ORDERS)):
        times, about = _differences(behind)
    return times, about


def _behind_delays(stretches: Sequence[Segment], orders: Sequence[int]) -> list[Segment]:
    """Stretches with the delays taken out, where one is longer than the largest ARX model is."""
    limits = [(0, longest_delay(stretches))] * stretches[0].inputs.shape[1]
    delays = [likely.delay for likely in likely_delays(stretches, limits)]
    if (longest := max(delays, default=0)) <= max(_orders(stretches, orders), default=0):
        return []
    return [_behind(stretch, delays) for stretch in stretches if stretch.samples > longest]


def _behind(stretch: Segment, delays: Sequence[int]) -> Segment:
    """A stretch whose inputs come later by their delays."""
    longest, count = max(delays), stretch.samples
    later = [stretch.inputs[longest - d : count - d, k] for k, d in enumerate(delays)]
    return Segment(np.column_stack(later), stretch.outputs[longest:], stretch.recording)


def _differences(stretches: Sequence[Segment]) -> tuple[int, Decision]:
    """What the BIC of ARX models without delays says of differences."""
    likeliest = [_likeliest(stretches, d) for d in range(MOST_DIFFERENCES + 1)]
    times, left, level = 0, 0.0, likeliest[0]
    if level is None:
        sentence = "The record is too short to decide whether the output drifts."
    else:
        known = [fits for fits in likeliest if fits is not None]
        best = min(known, key=_bic)
        times, evidence = likeliest.index(best), _bic(level) - _bic(best)
        # Any model tells of a stationary response, though roots at 1 may describe it best.
        shares = [_left_over(fits, stretches) for fits in known] if times else [[0.0]]
        left = min(map(min, zip(*shares, strict=True)))
        walk = f"a random walk (the BIC falls by {evidence:.3g})"
        if times == 0 or evidence < VERY_STRONG:
            times, sentence = 0, "Nothing speaks for a disturbance that is a random walk."
        elif left < HIDDEN:
            times = 0
            sentence = (
                f"The disturbance is likely to be {walk}, but the response to the inputs leaves"
                f" only {100 * left:.0f} % of an output's mean square: nothing is differenced."
            )
        elif not np.isfinite(_left_over(best, stretches)).all():
            times = 0
            sentence = "The model of differenced signals is unstable: nothing is differenced."
        else:
            sentence = (
                f"The disturbance is {walk}{' that is summed up once more' * (times == 2)}, and"
                f" the response to the inputs leaves {100 * left:.0f} % of an output's mean square,"
                " or more. All channels are differenced, which leaves the plant as it is."
                " Simulations are scored on differenced samples."
            )
    criterion = "BIC of ARX models on the same samples, not divided by their number"
    alternatives = tuple(
        Alternative(str(d), np.nan if f is None else _bic(f)) for d, f in enumerate(likeliest)
    )
    return times, Decision("differences", str(times), alternatives, criterion, sentence)


def differenced(stretch: Segment, times: int) -> Segment:
    """All channels differenced, ``times`` samples shorter."""
    inputs, outputs = (np.diff(s, times, axis=0) for s in (stretch.inputs, stretch.outputs))
    return Segment(inputs, outputs, stretch.recording, stretch.first + times)


def _of_outputs(stretches: Sequence[Segment]) -> list[list[Segment]]:
    """The stretches of each output alone, beside all inputs."""
    outputs = range(stretches[0].outputs.shape[1])
    return [[stretch.of_output(place) for stretch in stretches] for place in outputs]


def _orders(stretches: Sequence[Segment], orders: Sequence[int]) -> list[int]:
    """The orders of ARX models of an output that the samples carry."""
    samples = 2 * total_samples(stretches) / (1 + stretches[0].inputs.shape[1])
    return [n for n in orders if n * SAMPLES_PER_ORDER <= samples]


def _likeliest(stretches: Sequence[Segment], times: int) -> list[ArxFit] | None:
    """Of each output the ARX model of the lowest BIC of signals differenced some times."""
    orders = _orders(stretches, ORDERS)
    first = max(orders, default=0) + MOST_DIFFERENCES
    lower = [differenced(stretch, times) for stretch in stretches]
    fits = [
        likeliest_arx(alone, orders, first - times, levels=times == 0)
        for alone in _of_outputs(lower)
    ]
    known = [fit for fit in fits if fit is not None]
    return known if len(known) == len(fits) else None


def _bic(fits: Sequence[ArxFit]) -> float:
    return sum(fit.bic for fit in fits)


def _left_over(fits: Sequence[ArxFit], stretches: Sequence[Segment]) -> list[float]:
    """Share of each output's mean square that the simulation of its model leaves over."""
    shares = []
    with np.errstate(all="ignore"):
        for fit, alone in zip(fits, _of_outputs(stretches), strict=True):
            errors = [errors_simulated_on(fit.model, None, s, True) for s in alone]
            output = np.concatenate([s.output - s.output.mean() for s in alone])
            left = float(np.mean(np.concatenate(errors) ** 2) / np.mean(output**2))
            shares.append(left if np.isfinite(left) else np.inf)
    return shares


def decide_objective(stretches: Sequence[Segment]) -> tuple[str, Decision]:
    """The objective whose distribution of residuals is the likelier one.

    Least squares is the maximum-likelihood estimate for normal residuals, least absolute deviations
    that for residuals of Laplace's distribution.  Both are fitted to ARX models, which whiten the
    residuals; each objective is represented by the order at which it is likeliest.  The logarithms
    of several outputs are added up.

    Disturbances come whatever the input does.  Where the sizes of the residuals follow its changes,
    they are what a linear model misses, as of friction, and least squares give the linear model of
    the lowest simulation error (Enqvist & Ljung 2005).  So are those behind a delay longer than the
    largest ARX model: there the delays are taken out before.
    """
    objective, about = _objective(stretches)
    if objective == "absolute" and (behind := _behind_delays(stretches, OBJECTIVE_ORDERS)):
        objective, about = _objective(behind)
    return objective, about


def _objective(stretches: Sequence[Segment]) -> tuple[str, Decision]:
    """What ARX models without delays say of the objective."""
    orders, inputs = _orders(stretches, OBJECTIVE_ORDERS) or [1], stretches[0].inputs.shape[1]
    lowest, left = dict.fromkeys(("quadratic", "absolute"), np.inf), []
    for name, n in product(lowest, orders):
        with suppress(NoModelError):
            total, model, parts = 0.0, Orders(na=n, nb=(n + 1,) * inputs), []
            for alone in _of_outputs(stretches):
                fitted = fit(alone, model, name)
                parts.append(max(fitted.residuals, key=len)[:, 0])
                residuals = np.concatenate(fitted.residuals)
                penalty = fitted.parameters * np.log(len(residuals)) / len(residuals)
                total += 0.5 * (log_loss(residuals, name) + penalty)
            if total < lowest[name]:
                lowest[name], left = total, parts
    evidence = total_samples(stretches) * (lowest["quadratic"] - lowest["absolute"])
    is_heavy = evidence > LEAST_EVIDENCE
    longest = max(stretches, key=lambda stretch: stretch.samples)
    is_absolute = is_heavy and not any(follow_input(longest, e) for e in left)
    said = "Outliers do not call for the absolute objective."
    if is_heavy:
        said = "The large ones follow changes of the input: they are what a linear model misses."
    if is_absolute:
        said = "A few large ones stand out, and the absolute objective is used."
    sentence = (
        f"The residuals of ARX models are {'' if is_heavy else 'not '}likelier to have Laplace's"
        f" distribution than a normal one. {said}"
    )
    objective = "absolute" if is_absolute else "quadratic"
    alternatives = tuple(Alternative(*item) for item in lowest.items())
    criterion = "negative log-likelihood of a residual by its BIC"
    return objective, Decision("objective", objective, alternatives, criterion, sentence)


def follow_input(stretch: Segment, residuals: Array) -> bool:
    """Whether sizes of residuals, of the last samples of a stretch, follow changes of the inputs.

    Then they are what a linear model misses, and no disturbance.  By a regression of ranks, on
    those of the changes at earlier samples, which outliers under feedback have no part in; its
    share by chance is taken off.
    """
    from scipy.stats import rankdata

    changes = np.abs(np.diff(stretch.inputs, axis=0, prepend=stretch.inputs[:1]))
    end, n = len(changes), min(len(residuals), len(changes) - CHANGES)
    count, sizes = CHANGES * changes.shape[1], rankdata(np.abs(residuals))[len(residuals) - n :]
    if not n > 2 * count > 0 or not np.ptp(sizes) > 0.0:
        return False
    ranks, freedom = rankdata(changes, axis=0), n - count - 1
    earlier = [ranks[end - n - k : end - k] for k in range(1, CHANGES + 1)]
    left = left_by(np.hstack([np.ones((n, 1)), *earlier]), sizes)
    share = 1.0 - float(np.var(left) / np.var(sizes)) * (n - 1) / freedom
    return share >= max(OF_INPUT, DEVIATIONS * np.sqrt(2.0 * count) / n)
