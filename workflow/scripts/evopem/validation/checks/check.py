"""The outcome of one check, what it is judged by, and what the checks share.

A check is a function of the evidence with :func:`check` in one of the modules beside this one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from scipy.special import ndtri

from evopem.models.parameter_covariance import NORMAL_95
from evopem.validation.held_out_tests import SIGNIFICANCE
from evopem.validation.validation import Check, Validation

if TYPE_CHECKING:
    from evopem.estimation.model_record import ModelRecord
    from evopem.signals.recording_info import RecordingInfo

LISTED = 6  # names that a sentence lists at most


@dataclass(frozen=True)
class OrderRange:
    """The range in which an order was searched."""

    name: str  # such as "na"
    key: str  # of the configuration
    value: int  # that was selected
    low: int
    high: int
    least: int = 1  # smallest value there can be


@dataclass(frozen=True, eq=False)
class Evidence:
    """What checks are judged by."""

    model: ModelRecord
    validation: Validation
    recording: RecordingInfo
    ranges: tuple[OrderRange, ...] = field(default=())  # of all orders that were searched
    # Checks that revisions of the automatic recipe were tried against; None without the recipe
    revised: tuple[str, ...] | None = None


Found = tuple[bool | None, str] | tuple[bool | None, str, str]
"""Whether a check passed, the statement, and other advice than usual."""


@dataclass(frozen=True)
class Judge:
    """A check of every model: calls give its outcome, or None where it does not apply."""

    name: str
    advice: str
    grade: Literal["defect", "caution", "note"]
    outcome_of: Callable[[Evidence], Found | None]
    of_noise: bool = False  # of residuals that are more than rounding errors

    def __call__(self, evidence: Evidence) -> Check | None:
        """The outcome for a model."""
        if (finding := self.outcome_of(evidence)) is None:
            return None
        if self.of_noise and evidence.validation.without_noise:
            finding = True, "There is no noise: the residuals are rounding errors."
        passed, statement, *advice = finding
        advised = "" if passed else (advice or [self.advice])[0]
        return Check(self.name, passed, statement, advised, self.grade)


def check(
    name: str,
    advice: str = "",
    grade: Literal["defect", "caution", "note"] = "defect",
    of_noise: bool = False,
) -> Callable[[Callable[[Evidence], Found | None]], Judge]:
    """Make a check of a function that finds whether it passed, and says why."""
    return lambda outcome_of: Judge(name, advice, grade, outcome_of, of_noise)


def failed_checks(checks: Iterable[Check]) -> list[Check]:
    """The defects among checks: what headlines, lists and tables count as failed."""
    return [check for check in checks if check.passed is False and check.grade == "defect"]


def p_text(value: float) -> str:
    """A p-value as text: "p = 0.42", "p < 0.0001"."""
    return "p < 0.0001" if value < 1e-4 else f"p = {value:.2g}"


def superscript(power: int) -> str:
    """A power as superscript digits."""
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def whole(value: int) -> str:
    """A whole number with its thousands set apart, by narrow no-break spaces."""
    return f"{value:,}".replace(",", "\u202f")


def root_text(root: complex) -> str:
    """A root of a real polynomial to four decimals, a complex one with its conjugate."""
    real = f"{root.real:z.4f}".replace("-", "−")
    return real if abs(root.imag) < 5e-5 else f"{real} ± {abs(root.imag):.4f}i"


def largest_by_chance(count: int) -> float:
    """The largest of some correlations in 95 % bounds that is not significant.

    Bonferroni's inequality needs no independence.
    """
    return float("inf") if count == 0 else float(ndtri(1 - SIGNIFICANCE / (2 * count))) / NORMAL_95


def listed(names: Sequence[str]) -> str:
    """Names as a list, the last ones as their number where there are many."""
    shown = ", ".join(names[:LISTED])
    return shown if len(names) <= LISTED else f"{shown} and {len(names) - LISTED} more"
