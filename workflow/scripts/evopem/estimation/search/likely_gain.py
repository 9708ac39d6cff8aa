"""How much a search may still gain, as far as it has come, and when that is too little.

The limits were exceeded in 3 to 9 % of the random problems of ``benchmarks/search_certificate.py``,
half of them of orders twice too large.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# By how much BIC still falls, times samples over parameters: after the first pass of a race, where
# its descents found few optima, and where they found many; after the batches of random points;
# after a search by growth and exchange, or a restart with hops.
AFTER_FEW_OPTIMA, AFTER_FIRST_PASS, AFTER_BATCHES, AFTER_RESTART = 0.1, 1.85, 1.3, 0.6
# Undiscovered probability of 8 descents that ended at 3 optima.
FEW_OPTIMA = 0.22


class Aim(NamedTuple):
    """What a search has to reach to be worth its evaluations.

    ``value``: of the objective.  ``unit``: decrease of the logarithm of the objective that a likely
    gain of 1 is.
    """

    value: float
    unit: float

    def is_unlikely(self, lowest: float, likely_gain: float) -> bool:
        """Whether a search that is at some value hardly gets so low."""
        return lowest * np.exp(-self.unit * likely_gain) > self.value


def gain_after_first_pass(undiscovered: float) -> float:
    """Likely gain by the probability that a further descent ends at an undiscovered optimum."""
    return AFTER_FEW_OPTIMA if undiscovered <= FEW_OPTIMA else AFTER_FIRST_PASS
