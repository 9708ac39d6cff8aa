"""Prediction-error estimation of ARMAX models by the hybrid search."""

from evopem.estimation.estimate import Estimate, estimate
from evopem.estimation.search.memetic import SearchSettings

__all__ = ["Estimate", "SearchSettings", "estimate"]
