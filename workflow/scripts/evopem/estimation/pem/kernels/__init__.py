"""Compiled kernels of polynomial models: residuals, loss, gradient, Gauss-Newton, stability."""

from evopem.estimation.pem.kernels.descent import (
    advance_descents,
    residuals,
    values,
    values_and_gradients,
)
from evopem.estimation.pem.kernels.gauss_newton import gauss_newton_matrices
from evopem.estimation.pem.kernels.lag_sums import LagSums, lag_sums_for
from evopem.estimation.pem.kernels.record import (
    Objective,
    Record,
    Workspace,
    record_of,
    workspace_for,
)
from evopem.estimation.pem.kernels.residuals import feasible_rows
from evopem.estimation.pem.kernels.simd import LANES
from evopem.estimation.pem.kernels.stability import schur_stable, stability_barriers

__all__ = [
    "LANES",
    "LagSums",
    "Objective",
    "Record",
    "Workspace",
    "advance_descents",
    "feasible_rows",
    "gauss_newton_matrices",
    "lag_sums_for",
    "record_of",
    "residuals",
    "schur_stable",
    "stability_barriers",
    "values",
    "values_and_gradients",
    "workspace_for",
]
