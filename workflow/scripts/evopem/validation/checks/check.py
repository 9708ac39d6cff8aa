"""The outcome of one check, and what the checks share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

# Level of the joint tests. At 5 % each, one of a dozen tests would fail in half of all good models.
SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class Check:
    """One check of a model.

    Attributes
    ----------
    name : str
    passed : bool or None
        None where the check could not be judged.
    statement : str
        What was found, with its numbers.
    advice : str
        What to do about it; empty for a check that passed.
    grade : {"defect", "caution", "note"}
        What it means where the check failed: the model or its numbers are wrong for a use; they
        hold with a reservation; or it is no statement about the model, such as an order at the end
        of a range that the configuration gave.
    """

    name: str
    passed: bool | None
    statement: str
    advice: str = ""
    grade: Literal["defect", "caution", "note"] = "defect"

    @property
    def word(self) -> str:
        """What a reader is told of the outcome: "Passed", "Failed", "Caution", "Note"."""
        if self.passed is not False:
            return "Passed" if self.passed else "Not judged"
        return "Failed" if self.grade == "defect" else self.grade.capitalize()


def failed_checks(checks: Iterable[Check]) -> list[Check]:
    """The defects among checks: what headlines, lists and tables count as failed."""
    return [check for check in checks if check.passed is False and check.grade == "defect"]


def p_text(value: float) -> str:
    """A p-value as text: "p = 0.42", "p < 0.0001"."""
    return "p < 0.0001" if value < 1e-4 else f"p = {value:.2g}"
