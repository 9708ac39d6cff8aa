"""Residuals that repeat with the period of the input, and how many samples tell something new.

A periodic input makes the errors of a linear model of a nonlinear system periodic as well
(Pintelon & Schoukens 2012, chapter 4).  Every further period then repeats the same errors: a
criterion that counts all samples as independent takes a model of too many parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evopem.arrays import Array
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import likeliest_arx
from evopem.signals.correlation import LONGEST_LAG, repetition_lag
from evopem.signals.recording import Segment

# Orders of the ARX models whose residuals are judged, with SAMPLES_PER_ORDER samples for each.
ORDERS, SAMPLES_PER_ORDER = (2, 4, 8, 12, 16), 25
# A correlation of this many standard errors is significant (1 %).
SIGNIFICANT = 2.6


@dataclass(frozen=True)
class Repetition:
    """How far residuals repeat with the input."""

    # samples after which the input repeats, as it is or with the opposite sign; 0 for none
    lag: int
    correlation: float  # of residuals whole lags apart, with the sign of the input's
    # share of the samples that are independent: ``1 / (1 + 2 r sum_k (1 - k lag / N))`` with that
    # correlation r (the design effect; Kish 1965)
    independent: float
    decision: Decision


def decide_repetition(stretches: Sequence[Segment]) -> Repetition:
    """Judge the residuals of ARX models of the longest stretch."""
    stretch = max(stretches, key=lambda stretch: stretch.samples)
    if stretch.inputs.shape[1] != 1 or stretch.outputs.shape[1] != 1:
        return _of(0, 0.0, 1.0, "Of several channels every sample counts.")
    lag = repetition_lag(stretch.input)
    if lag == 0:
        return _of(0, 0.0, 1.0, "The input does not repeat: every sample counts.")
    correlation = repeated_correlation(arx_residuals(stretch), stretch.input, lag)
    n = stretch.samples
    if not correlation > SIGNIFICANT / np.sqrt(n - lag):
        return _of(
            *(lag, correlation, 1.0),
            f"The input repeats after {lag} samples; the residuals do not: every sample counts.",
        )
    pairs = float(np.sum(1.0 - lag * np.arange(1, -(-n // lag)) / n))
    independent = 1.0 / (1.0 + 2.0 * pairs * correlation)
    return _of(
        *(lag, correlation, independent),
        f"The input repeats after {lag} samples, and so do the residuals (correlation"
        f" {correlation:.2f}): they are caused by the input, in a way that no linear model"
        f" describes. Repetitions add little information, so that {n} samples count as"
        f" {round(independent * n)} in the BIC.",
    )


def _of(lag: int, correlation: float, independent: float, sentence: str) -> Repetition:
    alternatives = (Alternative("repeated", correlation), Alternative("all", 0.0))
    choice = "all" if independent == 1.0 else f"{100.0 * independent:.0f} %"
    decision = Decision(
        *("independent samples", choice, alternatives),
        *("correlation of residuals where the input repeats", sentence),
    )
    return Repetition(lag, correlation, independent, decision)


def repeated_correlation(residuals: Array, signal: Array, lag: int) -> float:
    """Mean correlation of residuals 1, 2, ... lags apart, each with the sign of the input's.

    The residuals, (M,), are those of the last M samples of the input, (N,).
    """
    e = residuals - residuals.mean()
    u = (signal - signal.mean())[-len(e) :]
    power = float(e @ e) / len(e)
    if not power > 0.0:
        return 0.0
    multiples = range(lag, int(LONGEST_LAG * len(e)) + 1, lag)
    correlations = [
        float(np.sign(u[k:] @ u[:-k])) * float(e[k:] @ e[:-k]) / ((len(e) - k) * power)
        for k in multiples
    ]
    return float(np.mean(correlations)) if correlations else 0.0


def arx_residuals(stretch: Segment) -> Array:
    """Residuals of the ARX model of the lowest BIC, (M,), of the last M samples."""
    first, n = max(ORDERS), stretch.samples
    orders = [order for order in ORDERS if n >= max(order * SAMPLES_PER_ORDER, 3 * first)]
    likeliest = likeliest_arx([stretch], orders, first)
    if likeliest is None:
        return np.asarray(stretch.output[first:] - stretch.output[first:].mean())
    return likeliest.residuals
