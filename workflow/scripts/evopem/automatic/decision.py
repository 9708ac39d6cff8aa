"""Decisions and trials, with their reasons: the entries and the contents of ``decisions.json``."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Alternative:
    """One of the things that could have been chosen."""

    name: str
    score: float  # smaller is better; NaN where it could not be computed


@dataclass(frozen=True)
class Decision:
    """A decision with its alternatives."""

    subject: str  # what was decided, such as ``decimation``
    choice: str  # the name of the alternative that was taken
    alternatives: tuple[Alternative, ...]  # all of them, the chosen one included
    criterion: str  # what the scores are, with their unit
    sentence: str  # the reason, for the report


def given_by_configuration(subject: str, choice: str) -> Decision:
    """A decision that the user has taken."""
    alternatives = (Alternative(choice, np.nan),)
    return Decision(subject, choice, alternatives, "none", "Given by the configuration.")


@dataclass(frozen=True)
class Trial:
    """One revision that was tried."""

    check: str  # that failed before
    revision: str
    model: str  # name of the candidate
    # error for the purpose on held-out samples, percent; infinite where checks and BIC refuse it
    score: float
    whiteness: float  # p-value of the Ljung-Box test of the residuals
    correlation: float  # largest cross-correlation of residuals and input, in its 95 % bounds
    taken: bool


@dataclass(frozen=True)
class OtherModel:
    """The model for another purpose than that of ``model.json``, in ``model.<purpose>.json``.

    Errors are ``100 ||y - yhat|| / ||y - mean(y)||`` over the validation samples.
    """

    purpose: str
    model: str  # structure and orders
    prediction_error_percent: float
    simulation_error_percent: float


@dataclass(frozen=True)
class DecisionRecord:
    """All decisions of one data set, in their order."""

    purpose: str  # what the model is for: simulation, prediction or modes
    decisions: tuple[Decision, ...]
    trials: tuple[Trial, ...]  # revisions after failed checks
    failed: tuple[str, ...]  # checks that no revision made hold
    remarks: tuple[str, ...]  # sentences about the record that the decisions led to
    other_model: OtherModel | None  # None without an input
    # Of each input, those that together have 95 % of the probability, in samples of the model
    likely_delays: tuple[tuple[int, ...], ...] = ()
