"""The contents of ``decisions.json``: what was decided, tried, and left undone."""

from __future__ import annotations

from dataclasses import dataclass

from evopem.automatic.decision import Decision


@dataclass(frozen=True)
class Trial:
    """One remedy that was tried.

    Attributes
    ----------
    check : str
        The check that failed before.
    remedy : str
    model : str
        Name of the candidate.
    score : float
        Error for the purpose on held-out samples, percent.
    whiteness : float
        p-value of the Ljung-Box test of the residuals.
    correlation : float
        Largest cross-correlation of residuals and input, in its 95 % bounds.
    taken : bool
    """

    check: str
    remedy: str
    model: str
    score: float
    whiteness: float
    correlation: float
    taken: bool


@dataclass(frozen=True)
class OtherModel:
    """The model for another purpose than that of ``model.json``.

    Attributes
    ----------
    purpose : {"simulation", "prediction"}
        It stands in ``model.<purpose>.json``.
    model : str
        Structure and orders.
    prediction_error_percent, simulation_error_percent : float
        ``100 ||y - yhat|| / ||y - mean(y)||`` over the validation samples.
    """

    purpose: str
    model: str
    prediction_error_percent: float
    simulation_error_percent: float


@dataclass(frozen=True)
class DecisionRecord:
    """All decisions of one data set, in their order.

    Attributes
    ----------
    purpose : {"simulation", "prediction", "modes"}
        What the model is for.
    decisions : tuple of Decision
    trials : tuple of Trial
        Remedies of failed checks.
    failed : tuple of str
        Checks that no remedy made hold.
    remarks : tuple of str
        Sentences about the record that the decisions led to.
    other : OtherModel
    """

    purpose: str
    decisions: tuple[Decision, ...]
    trials: tuple[Trial, ...]
    failed: tuple[str, ...]
    remarks: tuple[str, ...]
    other: OtherModel
