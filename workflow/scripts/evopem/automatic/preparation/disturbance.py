"""What the disturbance asks for: a high-pass filter where it drifts, and the objective."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array
from evopem.automatic.cross_validation.simulation import errors_simulated_on
from evopem.automatic.cross_validation.stretches import MOST_SAMPLES, Fold, first_samples, folds_of
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import FOLD_STAGES, ArxFit, fit, likeliest_arx, log_loss
from evopem.errors import NoModelError
from evopem.estimation.delays import likely_delays, longest_delay
from evopem.models.orders import Orders
from evopem.models.states import VERY_STRONG
from evopem.signals.recording import Segment, total_samples
from evopem.signals.transforms import NO_FILTER, HighPass, difference
from evopem.validation.held_out_tests import left_by

POLES, MOST_DIFFERENCES = (0.8, 0.9, 0.97, 0.99, 0.997), 2
FILTERS = (NO_FILTER, HighPass(1), HighPass(2), *(HighPass(1, pole) for pole in POLES))
# Orders of the ARX models that are compared, with SAMPLES_PER_ORDER samples for each.
ORDERS, SAMPLES_PER_ORDER = (1, 2, 3, 4, 6, 8, 10, 12, 16, 20, 24), 25
# Those whose residuals decide between the objectives, and how much likelier Laplace's distribution
# must be than the normal one for the absolute objective, as a logarithm.
OBJECTIVE_ORDERS, LEAST_EVIDENCE = (2, 4, 8, 12, 16), 3.0
# Share of the ranks of their sizes that earlier changes of the inputs explain, of so many samples,
# from which large residuals are what a linear model misses; standard deviations of that by chance.
OF_INPUT, CHANGES, DEVIATIONS = 0.05, 16, 4.0
# The share of the power of the response to the inputs that a filter leaves at least, of an output
# that drift has, or of samples that repeat the last; and by what logarithm simulations may lose.
HALF, MOST_WORSE = 0.5, 0.01
# Orders na, nb and nf of the models whose simulations are scored, nb and nf of each input.
PROBES = ((2, 3, 0), (6, 7, 0), (0, 2, 2), (0, 4, 4))
# Halves and interleaved blocks, as (folds, blocks of each), and samples that a block has at least.
DESIGNS, SHORTEST = ((2, 1), (2, 3)), 40
LARGEST_ERROR = 10.0  # as a share of the output; beyond it all are useless


def decide_high_pass(stretches: Sequence[Segment]) -> tuple[HighPass, Decision]:
    """The high-pass filter of all channels that makes the disturbance of an output stationary.

    A filter leaves the plant as it is, and is causal and monic: the BIC of ARX models, added up
    over the outputs, compares filters on the same samples. Of differences that is a test for unit
    roots (Said & Dickey 1984; by a criterion Phillips & Ploberger 1994). The sum of a walk and
    white noise is white behind the filter whose pole is its zero.
    A plant that is not linear leaves slow errors as well. So a filter must leave half of the power
    of the response to the inputs, and models of filtered samples must simulate held-out ones, not
    filtered, no worse; or the response is less than half of each output, which is differenced.
    Behind a delay longer than the ARX models the response looks like a disturbance: there the
    delays are taken out before. `stretches`: Centred, with an input.
    """
    high_pass, about = _high_pass(stretches)
    if high_pass.times and (behind := _behind_delays(stretches, ORDERS)):
        high_pass, about = _high_pass(behind)
    return high_pass, about


def _behind_delays(stretches: Sequence[Segment], orders: Sequence[int]) -> list[Segment]:
    """Stretches with the delays taken out, where one fills half of the lags of an ARX model."""
    limits = [(0, longest_delay(stretches))] * stretches[0].inputs.shape[1]
    delays = [likely.delay for likely in likely_delays(stretches, limits)]
    if 2 * (longest := max(delays, default=0)) <= max(_orders(stretches, orders), default=0):
        return []
    return [_behind(s, delays) for s in stretches if s.samples > longest + MOST_DIFFERENCES]


def _behind(stretch: Segment, delays: Sequence[int]) -> Segment:
    """A stretch whose inputs come later by their delays."""
    longest, count = max(delays), stretch.samples
    later = [stretch.inputs[longest - d : count - d, k] for k, d in enumerate(delays)]
    return Segment(np.column_stack(later), stretch.outputs[longest:], stretch.recording)


def _high_pass(stretches: Sequence[Segment]) -> tuple[HighPass, Decision]:
    """What ARX models without delays say of the filter."""
    fits = {path: _likeliest(stretches, path) for path in FILTERS}
    bic = {path: sum(model.bic for model in models) or np.nan for path, models in fits.items()}
    clear = [path for path in bic if bic[NO_FILTER] - bic[path] > VERY_STRONG]
    shares = {path: _shares(fits[path], stretches, path) for path in FILTERS if clear}
    mild = [path for path in clear if shares[path][0] >= HALF]
    best = min(mild or clear or bic, key=lambda path: bic[path])
    worse = _worse_simulated(stretches, best) if mild else np.inf
    chosen = best if worse <= MOST_WORSE else NO_FILTER
    stable = [path for path in clear if np.isfinite(shares[path][1])]
    strong = [path for path in stable if path.pole == 0.0 and chosen == NO_FILTER]
    if strong and min(left for _, left in shares.values()) >= HALF:
        chosen = best = min(strong, key=lambda path: bic[path])
    sentence = "Nothing speaks for a disturbance that drifts."
    if clear:
        why = f"but behind it ({best}) held-out simulations err {np.exp(worse):.2f} times as much"
        if chosen == best:
            why = f"and all channels pass a filter ({best}); simulations are scored behind it"
        elif not mild:
            why = "but filters that tell it leave less than half of the response to the inputs"
        elif not np.isfinite(worse):
            why = "but the record is too short to simulate held-out samples: nothing is filtered"
        sentence = f"The disturbance drifts (BIC {bic[NO_FILTER] - bic[best]:.3g} lower), {why}."
    criterion = "BIC of ARX models on the same samples, not divided by their number"
    alternatives = tuple(Alternative(str(path), value) for path, value in bic.items())
    return chosen, Decision("drift", str(chosen), alternatives, criterion, sentence)


def passed(stretch: Segment, high_pass: HighPass) -> Segment:
    """All channels behind the filter, ``times`` samples shorter."""
    times, pole = high_pass.times, high_pass.pole
    u, y = (difference(signals, times, pole)[0] for signals in (stretch.inputs, stretch.outputs))
    return Segment(u, y, stretch.recording, stretch.first + times)


def _of_outputs(stretches: Sequence[Segment]) -> list[list[Segment]]:
    """The stretches of each output alone, beside all inputs."""
    outputs = range(stretches[0].outputs.shape[1])
    return [[stretch.of_output(place) for stretch in stretches] for place in outputs]


def _orders(stretches: Sequence[Segment], orders: Sequence[int]) -> list[int]:
    """The orders of ARX models of an output that the samples carry."""
    samples = 2 * total_samples(stretches) / (1 + stretches[0].inputs.shape[1])
    return [n for n in orders if n * SAMPLES_PER_ORDER <= samples]


def _likeliest(stretches: Sequence[Segment], high_pass: HighPass) -> list[ArxFit]:
    """Of each output the ARX model of the lowest BIC of filtered signals; none of too few."""
    orders = _orders(stretches, ORDERS)
    first = max(orders, default=0) + MOST_DIFFERENCES - high_pass.times
    lower = [passed(stretch, high_pass) for stretch in stretches]
    levels = high_pass.pole > 0.0 or high_pass.times == 0
    fits = [likeliest_arx(alone, orders, first, levels) for alone in _of_outputs(lower)]
    known = [fit for fit in fits if fit is not None]
    return known if len(known) == len(fits) else []


def _shares(fits: Sequence[ArxFit], stretches: Sequence[Segment], path: HighPass) -> Array:
    """Least shares: of the response's power behind a filter, of an output's that it leaves."""
    shares = [(0.0, np.inf)] if not fits else []
    with np.errstate(all="ignore"):
        for arx, alone in zip(fits, _of_outputs(stretches), strict=False):
            errors = [errors_simulated_on(arx.model, None, s, True) for s in alone]
            before = [s.outputs[-len(e) :] + e for s, e in zip(alone, errors, strict=True)]
            behind = [difference(y, path.times, path.pole)[0] for y in before]
            parts = behind, before, errors, [s.outputs for s in alone]
            passing, whole, left, output = (np.concatenate(part).var() for part in parts)
            shares.append((passing / whole, left / output))
    return np.asarray(np.where(np.isnan(shares), (0.0, np.inf), shares).min(axis=0))


def _worse_simulated(stretches: Sequence[Segment], high_pass: HighPass) -> float:
    """Logarithm of how much larger simulation errors of models of filtered samples are: of each
    output the median of folds, as a model near instability in one may err there by any factor."""

    def worse(fold: Fold) -> float:
        parts = [passed(s, high_pass) for s in fold.training], fold.training
        filtered, plain = (np.log(_probe_errors(fold, part)) for part in parts)
        return float(np.mean(filtered - plain))

    outputs = _of_outputs(first_samples(stretches, MOST_SAMPLES))
    logarithms = [[worse(fold) for fold in probe_folds(alone)] for alone in outputs]
    return float(np.mean(np.median(logarithms, axis=1))) if all(logarithms) else np.inf


def probe_folds(stretches: Sequence[Segment]) -> list[Fold]:
    """Those on which transforms and filters are judged."""
    samples = total_samples(stretches)
    return [
        fold
        for count, blocks in DESIGNS
        if samples >= count * blocks * SHORTEST
        for fold in folds_of(tuple(stretches), count, blocks, SHORTEST)
    ]


def _probe_errors(fold: Fold, training: Sequence[Segment]) -> Array:
    """Errors of small models and the likeliest ARX model on the held-out samples of a fold."""
    power = np.mean(np.concatenate([s.output - s.output.mean() for s in fold.held_out]) ** 2)
    inputs, orders = training[0].inputs.shape[1], _orders(training, ORDERS)
    errors = np.full(len(PROBES) + 1, LARGEST_ERROR)
    probes = [Orders(na=na, nb=(nb,) * inputs, nf=(nf,) * inputs) for na, nb, nf in PROBES]
    for row, probe in enumerate([*probes, None]):
        with suppress(NoModelError), np.errstate(all="ignore"):
            fitted = (
                likeliest_arx(training, orders, max(orders, default=0))
                if probe is None
                else fit(training, probe, stages=FOLD_STAGES)
            )
            if fitted is not None:
                parts = zip(fold.before, fold.held_out, strict=True)
                left = [errors_simulated_on(fitted.model, *part, True) for part in parts]
                error = np.sqrt(np.mean(np.concatenate(left) ** 2) / power)
                errors[row] = np.nan_to_num(np.minimum(error, LARGEST_ERROR), nan=LARGEST_ERROR)
    return np.maximum(errors, np.finfo(float).tiny)


def decide_objective(
    stretches: Sequence[Segment], recorded: Sequence[Segment] = ()
) -> tuple[str, Decision]:
    """The objective whose distribution of residuals is the likelier one.

    Least squares is the maximum-likelihood estimate for normal residuals, least absolute deviations
    that for residuals of Laplace's distribution.  Both are fitted to ARX models, which whiten the
    residuals; each is represented by its likeliest order.  Normal residuals of several outputs may
    be correlated, as their models have it, and absolute ones may not.

    Disturbances come whatever the input does.  Where the sizes of the residuals follow its changes,
    they are what a linear model misses, as of friction, and least squares give the linear model of
    the lowest simulation error (Enqvist & Ljung 2005).  So are those behind a delay longer than the
    largest ARX model: there the delays are taken out before.

    Absolute deviations fit the median.  That of the next sample is the last one, whatever the
    input does, where the sensor resolves so little that more than half of them repeat it.
    `recorded`: The stretches before a filter, whose repeated samples count.
    """
    objective, about = _objective(stretches)
    if objective == "absolute" and (behind := _behind_delays(stretches, OBJECTIVE_ORDERS)):
        objective, about = _objective(behind)
    repeats = [np.diff(s.outputs, axis=0) == 0.0 for s in recorded]
    if objective == "absolute" and repeats and np.concatenate(repeats).mean(axis=0).max() > HALF:
        said = "Most samples repeat the last, and their median follows no input: squares are taken."
        objective, about = "quadratic", replace(about, choice="quadratic", sentence=said)
    return objective, about


def _objective(stretches: Sequence[Segment]) -> tuple[str, Decision]:
    """What ARX models without delays say of the objective."""
    orders, inputs = _orders(stretches, OBJECTIVE_ORDERS) or [1], stretches[0].inputs.shape[1]
    lowest, left = dict.fromkeys(("quadratic", "absolute"), np.inf), np.empty((0, 0))
    outputs, known = _of_outputs(stretches), dict[int, list[Any]]()
    for name, n in product(lowest, orders):
        with suppress(NoModelError):
            model = Orders(na=n, nb=(n + 1,) * inputs)
            # A linear regression has one optimum by each: a descent from the other's suffices.
            starts = [[f.model] for f in known.get(n, ())] or [[]] * len(outputs)
            pairs = zip(outputs, starts, strict=True)
            known[n] = fits = [fit(y, model, name, start, not start) for y, start in pairs]
            parts = [np.hstack(part) for part in zip(*(f.residuals for f in fits), strict=True)]
            residuals, parameters = np.concatenate(parts), sum(f.parameters for f in fits)
            penalty = parameters * np.log(len(residuals)) / len(residuals)
            half = 0.5 * (log_loss(residuals, name) + float(penalty))
            if half < lowest[name]:
                lowest[name], left = half, max(parts, key=len)
    evidence = total_samples(stretches) * (lowest["quadratic"] - lowest["absolute"])
    is_heavy = evidence > LEAST_EVIDENCE
    longest = max(stretches, key=lambda stretch: stretch.samples)
    is_absolute = is_heavy and not any(follow_input(longest, e) for e in left.T)
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
    changes = np.abs(np.diff(stretch.inputs, axis=0, prepend=stretch.inputs[:1]))
    end, n = len(changes), min(len(residuals), len(changes) - CHANGES)
    count = CHANGES * changes.shape[1]
    sizes = scipy.stats.rankdata(np.abs(residuals))[len(residuals) - n :]
    if not n > 2 * count > 0 or not np.ptp(sizes) > 0.0:
        return False
    ranks, freedom = scipy.stats.rankdata(changes, axis=0), n - count - 1
    earlier = [ranks[end - n - k : end - k] for k in range(1, CHANGES + 1)]
    left = left_by(np.hstack([np.ones((n, 1)), *earlier]), sizes)
    share = 1.0 - float(np.var(left) / np.var(sizes)) * (n - 1) / freedom
    return share >= max(OF_INPUT, DEVIATIONS * np.sqrt(2.0 * count) / n)
