"""The outcome of one check, and what the checks share."""

from __future__ import annotations

from dataclasses import dataclass

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
    """

    name: str
    passed: bool | None
    statement: str
    advice: str = ""


def p_text(value: float) -> str:
    """A p-value as text: "p = 0.42", "p < 0.0001"."""
    return "p < 0.0001" if value < 1e-4 else f"p = {value:.2g}"
