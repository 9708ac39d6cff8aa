"""What was decided, against which alternatives, and why: one entry of ``decisions.json``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Alternative:
    """One of the things that could have been chosen.

    Attributes
    ----------
    name : str
    score : float
        Smaller is better; NaN where it could not be computed.
    """

    name: str
    score: float


@dataclass(frozen=True)
class Decision:
    """A decision with its alternatives.

    Attributes
    ----------
    subject : str
        What was decided, such as ``decimation``.
    choice : str
        The name of the alternative that was taken.
    alternatives : tuple of Alternative
        All of them, the chosen one included.
    criterion : str
        What the scores are, with their unit.
    sentence : str
        The reason, for the report.
    """

    subject: str
    choice: str
    alternatives: tuple[Alternative, ...]
    criterion: str
    sentence: str


def given_by_configuration(subject: str, choice: str) -> Decision:
    """A decision that the user has taken."""
    alternatives = (Alternative(choice, np.nan),)
    return Decision(subject, choice, alternatives, "none", "Given by the configuration.")


def lowest(alternatives: Sequence[Alternative], margin: float = 0.0) -> Alternative:
    """The first alternative whose score is within a relative margin of the lowest.

    Alternatives are given from the simplest to the most elaborate.
    """
    scores = np.array([each.score for each in alternatives])
    scores = np.where(np.isfinite(scores), scores, np.inf)
    best = float(np.min(scores))
    if not np.isfinite(best):
        return alternatives[0]
    return alternatives[int(np.flatnonzero(scores <= best + margin * abs(best))[0])]
