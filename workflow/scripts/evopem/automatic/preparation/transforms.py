"""Transforms of recordings, decided: trends, and Box-Cox of the output.

Each alternative is scored by simulations of held-out samples in recorded units.  Removing a trend
is not safe as a rule: a transform is taken only where every fold gains by it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decision import Alternative, Decision, given_by_configuration
from evopem.automatic.fit import FOLD_STAGES, FitSettings, fit
from evopem.automatic.held_out.simulation import simulated_on
from evopem.automatic.held_out.stretches import MOST_SAMPLES, Fold, first_samples, folds_of
from evopem.automatic.preparation.plan import PreparationPlan, PreparedRecord
from evopem.errors import InputError, NoModelError
from evopem.models.structures import Orders
from evopem.signals.recording import Segment, total_samples
from evopem.signals.transforms import (
    box_cox,
    invert_box_cox,
    likeliest_box_cox,
    positive_shift,
)

Array = NDArray[np.float64]

# Models whose simulations are scored.
PROBES = (
    Orders(na=2, nb=3, nk=0),
    Orders(na=6, nb=7, nk=0),
    Orders(nb=2, nf=2, nk=0),
    Orders(nb=4, nf=4, nk=0),
)
# Halves and interleaved blocks, as (folds, blocks of each).
DESIGNS = ((2, 1), (2, 3))
# Samples that a block has at least.
SHORTEST = 40
# Errors beyond this share of the output are all the same: useless.
LARGEST_ERROR = 10.0
# What a transform must gain over all folds, and in none it may lose.
LEAST_GAIN = 0.05
# Level of the test that the spread of the residuals depends on the level.
SPREAD_LEVEL = 0.001
SPREAD_ORDER = 4
# Lags of the ARX model with which a drift is estimated, and the sum of its output coefficients that
# leaves a level.
DRIFT_ORDER, LEAST_DECAY = 4, 1e-3
Slopes = Callable[[Sequence[Segment]], tuple[float, float]]
CRITERION = "simulation error on held-out samples in recorded units, % of the output"
# Box-Cox parameters this near to 1 change nothing.
LEAST_CURVATURE = 0.1


@dataclass(frozen=True)
class TransformPlan:
    """The transforms that are taken."""

    box_cox: float | None = None  # parameter of the output's Box-Cox transform
    input_trend: float = 0.0  # slopes that are taken from the channels, in their units per sample
    output_trend: float = 0.0
    decisions: tuple[Decision, ...] = ()

    @property
    def has_trend(self) -> bool:
        """Whether a trend is taken away."""
        return self.input_trend != 0.0 or self.output_trend != 0.0

    @property
    def changes_samples(self) -> bool:
        """Whether any transform is taken."""
        return self.box_cox is not None or self.has_trend


def decide_transforms(
    stretches: Sequence[Segment],
    begins: Sequence[int],
    box_cox: bool = False,
    trend: bool = False,
    continued: bool = True,
) -> TransformPlan:
    """Decide the transforms of stretches between breaks, in recorded units, of one input.

    ``begins`` are their first samples in their recordings.  ``box_cox`` and ``trend`` tell whether
    the configuration says what is done, ``continued`` whether the validation samples continue the
    estimation samples, and their trend.
    """
    kept = [
        replace(each, inputs=np.column_stack([each.inputs, begin + np.arange(each.samples)]))
        for each, begin in zip(stretches, begins, strict=True)
    ]
    kept = list(first_samples(kept, MOST_SAMPLES))
    folds = _folds(kept)
    plain = None
    if folds and not ((trend or not continued) and box_cox):
        plain = _errors(folds)
    slopes, about_trend = (0.0, 0.0), _not_tried("trend", "none")
    if trend:
        about_trend = given_by_configuration("trend", "none")
    elif not continued:
        about_trend = _not_tried("trend", "none", "The validation samples are of other recordings.")
    elif plain is not None:
        slopes, about_trend = _decide_trend(kept, folds, plain)
    parameter, about_box_cox = None, _not_tried("Box-Cox", "none")
    if box_cox:
        about_box_cox = given_by_configuration("Box-Cox", "as written")
    elif plain is not None and not any(slopes):
        parameter, about_box_cox = _decide_box_cox(kept, folds, plain)
    return TransformPlan(parameter, *slopes, decisions=(about_trend, about_box_cox))


def _decide_trend(
    stretches: Sequence[Segment], folds: Sequence[Fold], plain: Array
) -> tuple[tuple[float, float], Decision]:
    """The slopes of input and output: lines through both, or a drift estimated with a model."""
    kinds = {"line of each channel": _lines, "drift of the output": _drift}
    errors = {name: _errors(folds, _plans_by(slopes)) for name, slopes in kinds.items()}
    alternatives = tuple(
        Alternative(name, _together(found)) for name, found in ({"none": plain} | errors).items()
    )
    better = [name for name, found in errors.items() if _gains(found, plain)]
    if not better:
        sentence = (
            "No trend that is taken away simulates every part of the held-out samples better, its"
            " continuation included."
        )
        return (0.0, 0.0), Decision("trend", "none", alternatives, CRITERION, sentence)
    name = min(better, key=lambda each: _together(errors[each]))
    sentence = (
        "Without this trend every part of the held-out samples is simulated better, its"
        " continuation included."
    )
    return kinds[name](stretches), Decision("trend", name, alternatives, CRITERION, sentence)


def _lines(stretches: Sequence[Segment]) -> tuple[float, float]:
    """Slopes of the lines through input and output, with a level for each recording."""
    u, t = np.concatenate([each.inputs for each in stretches]).T
    y = np.concatenate([each.output for each in stretches])
    owner = np.concatenate([np.full(each.samples, each.recording) for each in stretches])
    levels = [owner == number for number in dict.fromkeys(owner.tolist())]
    columns = np.column_stack([t - t.mean(), *levels]).astype(float)
    solution = np.linalg.lstsq(columns, np.column_stack([u, y]), rcond=None)[0]
    return float(solution[0, 0]), float(solution[0, 1])


def _drift(stretches: Sequence[Segment]) -> tuple[float, float]:
    """Slope of the output's drift, estimated along with an ARX model."""
    n, rows, target = DRIFT_ORDER, [], []
    for each in (long for long in stretches if long.samples > 2 * DRIFT_ORDER):
        u, t = (each.inputs - each.inputs.mean(axis=0)).T
        y = each.output - each.output.mean()
        lagged = [y[n - k : each.samples - k] for k in range(1, n + 1)]
        lagged += [u[n - k : each.samples - k] for k in range(n + 1)]
        rows.append(np.column_stack([*lagged, t[n:], np.ones(len(y) - n)]))
        target.append(y[n:])
    if not rows:
        return 0.0, 0.0
    solution = np.linalg.lstsq(np.vstack(rows), np.concatenate(target), rcond=1e-10)[0]
    gain = 1.0 - float(np.sum(solution[:n]))
    return 0.0, float(solution[-2]) / gain if abs(gain) > LEAST_DECAY else 0.0


def _decide_box_cox(
    stretches: Sequence[Segment], folds: Sequence[Fold], plain: Array
) -> tuple[float | None, Decision]:
    probability = spread_test([_transformed(each) for each in stretches])
    spread = (
        "The spread of the residuals of an ARX model {} on the level of the output"
        f" (p = {probability:.2g} of the correlation of their ranks)"
    )
    none = Alternative("none", _together(plain))
    if not probability < SPREAD_LEVEL:
        sentence = spread.format("does not depend") + "."
        return None, Decision("Box-Cox", "none", (none,), CRITERION, sentence)
    outputs = [each.output for each in stretches]
    shift = positive_shift(*outputs)
    try:
        parameter = round(likeliest_box_cox(np.concatenate(outputs), shift), 2)
    except InputError:
        parameter = 1.0
    transformed = np.full_like(plain, LARGEST_ERROR)
    if abs(parameter - 1.0) >= LEAST_CURVATURE:
        transformed = _errors(folds, lambda _: TransformPlan(parameter), shift)
    alternatives = none, Alternative(f"λ = {parameter:g}", _together(transformed))
    taken = _gains(transformed, plain)
    sentence = spread.format("depends") + (
        f", {'and' if taken else 'yet'} models of the transformed output"
        f" {'simulate' if taken else 'do not simulate'} every part of the held-out samples better"
        " in recorded units."
    )
    choice = alternatives[int(taken)].name
    return (parameter if taken else None), Decision(
        "Box-Cox", choice, alternatives, CRITERION, sentence
    )


def spread_test(stretches: Sequence[Segment]) -> float:
    """p-value of a rank correlation between the size of ARX residuals and the predicted output.

    NaN where there are too few samples.
    """
    from scipy.stats import spearmanr

    scaled = PreparedRecord.scaled(stretches, 1.0, PreparationPlan(())).stretches
    try:
        found = fit(scaled, Orders(na=SPREAD_ORDER, nb=SPREAD_ORDER + 1), FitSettings())
    except NoModelError:
        return float("nan")
    longer = [each for each in scaled if each.samples > found.first + 1]
    outputs = [each.output[-len(e) :] for each, e in zip(longer, found.residuals, strict=False)]
    residuals = np.concatenate(found.residuals)[:, 0]
    return float(spearmanr(np.abs(residuals), np.concatenate(outputs) - residuals).pvalue)


def _folds(stretches: Sequence[Segment]) -> list[Fold]:
    samples = total_samples(stretches)
    return [
        fold
        for count, blocks in DESIGNS
        if samples >= count * blocks * SHORTEST
        for fold in folds_of(stretches, count, blocks, SHORTEST)
    ]


def _plans_by(slopes_of: Slopes) -> Callable[[Sequence[Segment]], TransformPlan]:
    """Plans with the slopes of training samples, which are taken from the held-out ones, too."""
    return lambda training: TransformPlan(None, *slopes_of(training))


def _transformed(
    stretch: Segment, plan: TransformPlan = TransformPlan(), shift: float = 0.0
) -> Segment:
    """A stretch, whose second input is the time, by a plan."""
    u, t = stretch.inputs.T
    y = stretch.output - plan.output_trend * t
    if plan.box_cox is not None and len(y):
        y = box_cox(y, plan.box_cox, shift)
    return replace(stretch, inputs=u - plan.input_trend * t, outputs=y)


def _errors(
    folds: Sequence[Fold],
    plan_of: Callable[[Sequence[Segment]], TransformPlan] = lambda _: TransformPlan(),
    shift: float = 0.0,
) -> Array:
    """Error of each probe in each fold, (probes, folds), as a share of the output's deviation."""
    errors = np.full((len(PROBES), len(folds)), LARGEST_ERROR)
    for (column, fold), (row, orders) in product(enumerate(folds), enumerate(PROBES)):
        outputs = [each.output - each.output.mean() for each in fold.held_out]
        power = float(np.mean(np.concatenate(outputs) ** 2))
        try:
            plan = plan_of(fold.training)
            fitted = [_transformed(each, plan, shift) for each in fold.training]
            model = fit(fitted, orders, FitSettings(), stages=FOLD_STAGES).model
            left = []
            for parts in zip(fold.before, fold.held_out, strict=True):
                past, stretch = (_transformed(each, plan, shift) for each in parts)
                found = simulated_on(model, past, stretch, fitted_level=True)[:, 0]
                if plan.box_cox is not None:
                    found = invert_box_cox(found, plan.box_cox, shift)
                u_and_t, y = (each[-len(found) :] for each in (parts[1].inputs, parts[1].output))
                left.append(found + plan.output_trend * u_and_t[:, 1] - y)
        except (NoModelError, InputError):
            continue
        with np.errstate(all="ignore"):
            error = float(np.sqrt(np.mean(np.concatenate(left) ** 2) / power))
        if np.isfinite(error):
            errors[row, column] = min(error, LARGEST_ERROR)
    return np.maximum(errors, np.finfo(float).tiny)


def _together(errors: Array) -> float:
    """Geometric mean over probes and folds, in percent."""
    return float(100.0 * np.exp(np.mean(np.log(errors))))


def _gains(errors: Array, plain: Array) -> bool:
    """Whether models of equal orders gain by a transform in each fold, and the best model too.

    The best models alone would not tell: poles near 1 stand in for a level or a trend.
    """
    ratios = np.mean(np.log(errors / plain), axis=0)
    best = np.mean(np.log(errors.min(axis=0) / plain.min(axis=0)))
    gain = np.log(1.0 - LEAST_GAIN)
    return bool(np.all(ratios < 0.0) and np.mean(ratios) < gain and best <= 0.0)


def _not_tried(subject: str, choice: str, reason: str = "") -> Decision:
    reason = reason or "The record is too short for folds, or another transform is taken."
    return Decision(
        subject, choice, (Alternative(choice, np.nan),), CRITERION, f"Not tried. {reason}"
    )
