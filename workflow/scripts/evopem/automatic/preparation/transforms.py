"""The transform of recordings, decided: a trend taken away, or Box-Cox of the output.

Each alternative is scored by simulations of held-out samples in recorded units.  Removing a trend
is not safe as a rule: a transform is taken only where every fold gains by it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array
from evopem.automatic.cross_validation.simulation import errors_simulated_on
from evopem.automatic.cross_validation.stretches import MOST_SAMPLES, Fold, first_samples
from evopem.automatic.decision import Alternative, Decision, given_by_configuration
from evopem.automatic.fit import FOLD_STAGES, fit, recording_of
from evopem.automatic.preparation.disturbance import LARGEST_ERROR, PROBES, probe_folds
from evopem.automatic.preparation.plan import PreparationPlan, PreparedRecord, centred
from evopem.errors import InputError, NoModelError
from evopem.models.orders import Orders
from evopem.signals.recording import Segment
from evopem.signals.transforms import box_cox, invert_box_cox, likeliest_box_cox, positive_shift

LEAST_GAIN = 0.05  # what a transform must gain over all folds, and in none it may lose
# Level of the test that the spread of the residuals depends on the level.
SPREAD_LEVEL, SPREAD_ORDER = 0.001, 4
# Lags of the ARX model with which a drift is estimated, and the sum of its output coefficients that
# leaves a level.
DRIFT_ORDER, LEAST_DECAY = 4, 1e-3
LEAST_RATIO = 2.0  # a trend of fewer standard errors is not tried
CRITERION = "simulation error on held-out samples in recorded units, % of the output"
LEAST_CURVATURE = 0.1  # Box-Cox parameters this near to 1 change nothing


@dataclass(frozen=True)
class TransformPlan:
    """The transform that is taken, and the decision behind it."""

    box_cox: float | None = None  # parameter of the output's Box-Cox transform
    shift: float = 0.0  # of the output before it
    # slopes that are taken from the channels, in their units per sample; of no input for none
    input_trends: tuple[float, ...] = ()
    output_trend: float = 0.0
    decisions: tuple[Decision, ...] = ()

    @property
    def has_trend(self) -> bool:
        """Whether a trend is taken away."""
        return any(self.input_trends) or self.output_trend != 0.0


PlanOf = Callable[[Sequence[Segment]], TransformPlan]
Transform = tuple[str, PlanOf]
_NONE: Transform = ("none", lambda _: TransformPlan())


def decide_transforms(
    stretches: Sequence[Segment],
    begins: Sequence[int],
    box_cox: bool = False,
    trend: bool = False,
    continued: bool = True,
) -> TransformPlan:
    """Decide the transform of stretches between breaks, in recorded units, of one output.

    ``begins``: Their first samples in their recordings. ``box_cox`` and ``trend``: Whether the
    configuration decides. ``continued``: Whether validation samples continue the estimation's.
    """
    if box_cox and trend:
        return TransformPlan(decisions=(given_by_configuration("transform", "as written"),))
    kept = [
        replace(s, inputs=np.column_stack([s.inputs, begin + np.arange(s.samples)]))
        for s, begin in zip(stretches, begins, strict=True)
    ]
    kept = list(first_samples(kept, MOST_SAMPLES))
    folds, tried, sentences = probe_folds(kept), [_NONE], []
    if not folds:
        sentences.append("The record is too short for folds.")
    elif trend:
        sentences.append("The configuration says of trends what is done.")
    elif not continued:
        sentences.append("The validation samples are of other recordings: no trend is tried.")
    elif abs(ratio := _slope_and_ratio(kept)[1]) < LEAST_RATIO:
        ratio_said = f"({abs(ratio):.1f} standard errors)"
        sentences.append(f"The output has no trend beside its response to the input {ratio_said}.")
    else:
        tried += [("line of each channel", _lines), ("drift of the output", _drift)]
    if folds and not box_cox:
        bent, sentence = _box_cox(kept)
        tried += bent
        sentences.append(sentence)
    errors: list[Array] = []
    for _, plan_of in tried if tried[1:] else []:
        errors.append(_errors(folds, plan_of, errors[0] if errors else None))
    better = [k for k, of_transform in enumerate(errors) if _gains(of_transform, errors[0])]
    chosen = min(better, key=lambda k: _together(errors[k]), default=0)
    if errors:
        simulated = "every part of the held-out samples is simulated better, in recorded units."
        sentences.append(f"With this transform {simulated}" if chosen else f"With none {simulated}")
        if np.isnan(errors).any():
            sentences.append("One that gains nothing in a part is not scored on the others.")
    scores = map(_together, errors) if errors else [np.nan]
    alternatives = tuple(Alternative(tried[k][0], score) for k, score in enumerate(scores))
    name, plan_of = tried[chosen]
    about = Decision("transform", name, alternatives, CRITERION, " ".join(sentences))
    return replace(plan_of(kept), decisions=(about,))


def _box_cox(stretches: Sequence[Segment]) -> tuple[list[Transform], str]:
    """The Box-Cox transform that is tried, if any, and why."""
    probability = spread_test([_transformed(stretch) for stretch in stretches])
    depends = probability < SPREAD_LEVEL
    sentence = (
        f"The spread of the residuals of an ARX model {'depends' if depends else 'does not depend'}"
        f" on the level of the output (p = {probability:.2g} of the correlation of their ranks)."
    )
    if not depends:
        return [], sentence
    outputs = [stretch.output for stretch in stretches]
    shift = positive_shift(*outputs)
    try:
        parameter = round(likeliest_box_cox(np.concatenate(outputs), shift), 2)
    except InputError:
        return [], sentence
    plan = TransformPlan(parameter, shift)
    bends = abs(parameter - 1.0) >= LEAST_CURVATURE
    return [(f"Box-Cox, λ = {parameter:g}", lambda _: plan)] if bends else [], sentence


def _lines(stretches: Sequence[Segment]) -> TransformPlan:
    """Slopes of the lines through all channels, with a level for each recording."""
    signals = np.concatenate([np.column_stack([s.inputs, s.output]) for s in stretches])
    t = signals[:, -2]
    owner = np.concatenate([np.full(stretch.samples, stretch.recording) for stretch in stretches])
    levels = [owner == number for number in dict.fromkeys(owner.tolist())]
    columns = np.column_stack([t - t.mean(), *levels]).astype(float)
    *inputs, _, output = np.linalg.lstsq(columns, signals, rcond=None)[0][0].tolist()
    return TransformPlan(input_trends=tuple(inputs), output_trend=output)


def _drift(stretches: Sequence[Segment]) -> TransformPlan:
    """Slope of the output's drift, estimated along with an ARX model."""
    return TransformPlan(output_trend=_slope_and_ratio(stretches)[0])


def _slope_and_ratio(stretches: Sequence[Segment]) -> tuple[float, float]:
    """Slope of the output beside its response to the inputs, over its standard error as well. That
    of time and output after all other columns (Frisch & Waugh 1933)."""
    n, rows, targets = DRIFT_ORDER, [], []
    for stretch in (long for long in stretches if long.samples > 2 * DRIFT_ORDER):
        u = stretch.inputs - stretch.inputs.mean(axis=0)
        y = stretch.output - stretch.output.mean()
        lagged = [y[n - k : stretch.samples - k] for k in range(1, n + 1)]
        lagged += [u[n - k : stretch.samples - k, :-1] for k in range(n + 1)]
        rows.append(np.column_stack([*lagged, np.ones(len(y) - n)]))
        targets.append(np.column_stack([u[n:, -1], y[n:]]))
    if not rows:
        return 0.0, 0.0
    columns, goals = np.vstack(rows), np.vstack(targets)
    solution = np.linalg.lstsq(columns, goals, rcond=1e-10)[0]
    time, left = (goals - columns @ solution).T
    power = max(float(time @ time), float(np.finfo(float).tiny))
    slope = float(time @ left) / power
    gain = 1.0 - float(np.sum(solution[:n] @ [-slope, 1.0]))
    left = left - slope * time
    freedom = max(len(left) - columns.shape[1] - 1, 1)
    ratio = slope / max(float(np.sqrt(left @ left / freedom / power)), np.finfo(float).tiny)
    return slope / gain if abs(gain) > LEAST_DECAY else 0.0, ratio


def spread_test(stretches: Sequence[Segment]) -> float:
    """p-value of a rank correlation between the size of ARX residuals and the predicted output.

    NaN where there are too few samples.
    """
    scaled = PreparedRecord.of(recording_of(centred(stretches)), PreparationPlan(())).stretches
    orders = Orders(na=SPREAD_ORDER, nb=(SPREAD_ORDER + 1,) * scaled[0].inputs.shape[1])
    try:
        fitted = fit(scaled, orders)
    except NoModelError:
        return float("nan")
    longer = [stretch for stretch in scaled if stretch.samples > fitted.first + 1]
    outputs = [s.output[-len(e) :] for s, e in zip(longer, fitted.residuals, strict=False)]
    residuals = np.concatenate(fitted.residuals)[:, 0]
    return float(
        scipy.stats.spearmanr(np.abs(residuals), np.concatenate(outputs) - residuals).pvalue
    )


def _transformed(stretch: Segment, plan: TransformPlan = TransformPlan()) -> Segment:
    """A stretch, whose last input is the time, by a plan."""
    u, t = stretch.inputs[:, :-1], stretch.inputs[:, -1]
    y = stretch.output - plan.output_trend * t
    if plan.box_cox is not None and len(y):
        y = box_cox(y, plan.box_cox, plan.shift)
    if plan.input_trends:
        u = u - np.outer(t, plan.input_trends)
    return replace(stretch, inputs=u, outputs=y)


def _errors(folds: Sequence[Fold], plan_of: PlanOf, plain: Array | None) -> Array:
    """Relative error of each probe in each fold, (probes, folds); NaN behind one without a gain."""
    errors = np.full((len(PROBES), len(folds)), np.nan)
    for column, fold in enumerate(folds):
        errors[:, column] = _errors_of(fold, plan_of)
        if plain is not None and not _ratios(errors, plain)[column] < 0.0:
            break
    return errors


def _errors_of(fold: Fold, plan_of: PlanOf) -> Array:
    """Error of each probe, (probes,); slopes are those of the training samples."""
    errors = np.full(len(PROBES), LARGEST_ERROR)
    inputs = fold.training[0].inputs.shape[1] - 1  # beside the time
    outputs = [stretch.output - stretch.output.mean() for stretch in fold.held_out]
    power = float(np.mean(np.concatenate(outputs) ** 2))
    try:
        plan = plan_of(fold.training)
        fitted = [_transformed(stretch, plan) for stretch in fold.training]
        pasts = [_transformed(stretch, plan) for stretch in fold.before]
        held_out = [_transformed(stretch, plan) for stretch in fold.held_out]
    except InputError:
        return errors
    for row, (na, nb, nf) in enumerate(PROBES):
        orders, left = Orders(na=na, nb=(nb,) * inputs, nf=(nf,) * inputs), []
        try:
            model = fit(fitted, orders, stages=FOLD_STAGES).model
            for whole, past, stretch in zip(fold.held_out, pasts, held_out, strict=True):
                simulated = errors_simulated_on(model, past, stretch, fitted_level=True)[:, 0]
                simulated = simulated + stretch.output[-len(simulated) :]
                if plan.box_cox is not None:
                    simulated = invert_box_cox(simulated, plan.box_cox, plan.shift)
                t, y = (x[-len(simulated) :] for x in (whole.inputs[:, -1], whole.output))
                left.append(simulated + plan.output_trend * t - y)
        except (NoModelError, InputError):
            continue
        with np.errstate(all="ignore"):
            error = float(np.sqrt(np.mean(np.concatenate(left) ** 2) / power))
        if np.isfinite(error):
            errors[row] = min(error, LARGEST_ERROR)
    return np.maximum(errors, np.finfo(float).tiny)


def _ratios(errors: Array, plain: Array) -> Array:
    """Mean logarithms over the probes of the ratios of errors in each fold, (folds,)."""
    return np.asarray(np.mean(np.log(errors / plain), axis=0))


def _together(errors: Array) -> float:
    """Geometric mean over probes and folds, in percent."""
    return float(100.0 * np.exp(np.mean(np.log(errors))))


def _gains(errors: Array, plain: Array) -> bool:
    """Whether models of equal orders gain in each fold, and the best, whose poles may be levels."""
    ratios = _ratios(errors, plain)
    best = np.mean(np.log(errors.min(axis=0) / plain.min(axis=0)))
    gain = np.log(1.0 - LEAST_GAIN)
    return bool(np.all(ratios < 0.0) and np.mean(ratios) < gain and best <= 0.0)
