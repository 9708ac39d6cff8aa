"""When a search is certified to have found the lowest value, and how often that is wrong.  The
rates are measured: searches of random problems against ten times the evaluations."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import scipy  # whose parts load on first use

from evopem.estimation.search.problem import SearchDiagnostics

# Independent restarts that must end at the lowest value: batches of random points alone may miss an
# optimum on the edge of the stability region.
AGREEING = 5
# Undiscovered probability above which random points find many optima: more agreement is asked for,
# and more searches next to the optimum, since all restarts may fall into one wide funnel.
MANY_OPTIMA = 0.05
# Largest undiscovered probability, agreeing restarts, and their share of all.
AGREEMENTS = ((MANY_OPTIMA, AGREEING, 0.5), (1.0, 8, 0.8))
# Undiscovered probability at which descents from random points are evidence enough: that of 17
# or more which all end at one optimum.
ONE_OPTIMUM = 0.0075
# Of agreements once the evaluations are spent: two batches of random points and an independent
# search of another kind; all of two restarts or more, on sections that the record supports.
OF_SPENT = ((0.15, 3, 0.75), (1.0, 2, 1.0))


@dataclass(frozen=True)
class Calibration:
    """What was measured: certified problems, those of them with a lower value elsewhere, and by how
    many percent 95 % of the searches without a certificate were at most above the best known
    value."""

    certified: int
    wrong: int
    lower_elsewhere: float

    @property
    def largest_error_rate(self) -> float:
        """Share of certified searches that miss a lower value: at most, with 95 % confidence.  The
        upper limit of Clopper & Pearson (1934)."""
        return float(scipy.stats.beta.ppf(0.95, self.wrong + 1, self.certified - self.wrong))


# At the default evaluations (benchmarks/search_certificate.py, docs/evidence/search.md).
POLYNOMIALS = Calibration(certified=541, wrong=0, lower_elsewhere=0.87)
# Of benchmarks/state_space_certificate.py, see docs/evidence/search.md.
STATE_SPACE = Calibration(certified=32, wrong=0, lower_elsewhere=1.4)


def enough_agree(
    agreeing: int, restarts: int, undiscovered: float, spent: bool = False, supported: bool = True
) -> bool:
    """Whether so many of some independent restarts at the lowest value are evidence enough.
    ``undiscovered``: probability that a descent from a random point leads to an undiscovered
    optimum.  ``spent``: of a polynomial's search without evaluations left, ``supported`` whether
    the record supports all sections."""
    return any(
        undiscovered <= most and agreeing >= least and agreeing / restarts >= share
        for most, least, share in (*AGREEMENTS, *OF_SPENT[: spent + (spent and supported)])
    )


def has_agreed(diagnostics: SearchDiagnostics, polynomial: bool = True) -> bool:
    """Whether most restarts, random points of one optimum among them, or enough of them ended at
    the lowest value."""
    agreeing, restarts = diagnostics.n_confirming + 1, diagnostics.n_restarts
    undiscovered = diagnostics.undiscovered_probability
    one_optimum = agreeing > 1 and 2 * agreeing > restarts and undiscovered <= ONE_OPTIMUM
    spent = polynomial and diagnostics.withstood, diagnostics.supported
    return one_optimum or enough_agree(agreeing, restarts, undiscovered, *spent)


def is_certified(diagnostics: SearchDiagnostics, polynomial: bool = True) -> bool:
    """Whether restarts have agreed, and where they are few, on sections that the record supports:
    spare ones have an optimum nearly everywhere."""
    if diagnostics.supported:
        return has_agreed(diagnostics, polynomial)
    agreeing, restarts = diagnostics.n_confirming + 1, diagnostics.n_restarts
    return enough_agree(agreeing, restarts, diagnostics.undiscovered_probability)


# The limits of likely gains were exceeded in 3 to 9 % of the random problems of
# ``benchmarks/search_certificate.py``, half of them of orders twice too large.
# By how much BIC still falls, times samples over parameters: after the first pass of a race, where
# its descents found few optima, and where they found many; after the batches of random points;
# after a section replacement, or a restart with basin hopping.
AFTER_FEW_OPTIMA, AFTER_FIRST_PASS, AFTER_BATCHES, AFTER_RESTART = 0.1, 1.85, 1.3, 0.6
FEW_OPTIMA = 0.22  # undiscovered probability of 8 descents that ended at 3 optima


class Target(NamedTuple):
    """What a search has to reach to be worth its evaluations.  ``value``: of the objective.
    ``unit``: decrease of the logarithm of the objective that a likely gain of 1 is."""

    value: float
    unit: float

    def is_unlikely(self, lowest: float, likely_gain: float) -> bool:
        """Whether a search that is at some value hardly gets so low."""
        return lowest * math.exp(-self.unit * likely_gain) > self.value


def gain_after_first_pass(undiscovered: float) -> float:
    """Likely gain by the probability that a further descent ends at an undiscovered optimum."""
    return AFTER_FEW_OPTIMA if undiscovered <= FEW_OPTIMA else AFTER_FIRST_PASS
