"""What was decided, against which alternatives, and why: one entry of ``decisions.json``."""

from __future__ import annotations

from collections.abc import Sequence
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
