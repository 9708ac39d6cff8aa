"""Compiled kernels of ARMAX models: residuals, loss, adjoint gradient, Gauss-Newton, stability."""

from evopem.estimation.pem.kernels.descent import advance_descents, values_and_gradients_at
from evopem.estimation.pem.kernels.gauss_newton import gauss_newton_matrices
from evopem.estimation.pem.kernels.record import (
    MIN_NC,
    LagSums,
    Objective,
    Record,
    Workspace,
    lag_sums_for,
    padded_length,
    workspace_for,
)
from evopem.estimation.pem.kernels.residuals import values
from evopem.estimation.pem.kernels.simd import LANES
from evopem.estimation.pem.kernels.single_model import residuals
from evopem.estimation.pem.kernels.stability import (
    feasible_rows,
    schur_stable,
    stability_barriers,
)

__all__ = [
    "LANES",
    "MIN_NC",
    "LagSums",
    "Objective",
    "Record",
    "Workspace",
    "advance_descents",
    "feasible_rows",
    "gauss_newton_matrices",
    "lag_sums_for",
    "padded_length",
    "residuals",
    "schur_stable",
    "stability_barriers",
    "values",
    "values_and_gradients_at",
    "workspace_for",
]
