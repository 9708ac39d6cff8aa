"""Residuals and Jacobian by SciPy's filters, for the solvers that the search is compared with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.pem.stretch_errors import STATE_WEIGHT

Array = NDArray[np.float64]


class FilteredResiduals:
    """Scored residuals of a point, and their derivatives, as SciPy's least squares wants them.

    The weighted noise state stands below the residuals: the objective is that of the search.
    """

    def __init__(self, errors: PolynomialErrors) -> None:
        o, start, samples = errors.orders, errors.window.residual_start, len(errors.output)
        u, y = errors.inputs[:, 0], errors.output
        past = [y[start - i : samples - i] for i in range(1, o.na + 1)]
        past += [
            -u[start - o.single.nk - j : samples - o.single.nk - j] for j in range(o.single.nb)
        ]
        self.orders = o
        self.kept = slice(errors.window.loss_start - start, None)
        self.output = y[start:]
        self.regressors = np.column_stack(past)
        self.impulses = np.eye(samples - start, o.nc)
        self.states = np.sqrt(STATE_WEIGHT) * np.eye(o.nc, o.parameters + o.nc, o.parameters)

    def residuals(self, point: Array) -> Array:
        """Scored residuals and weighted noise state, (N + nc,)."""
        return np.concatenate([self._from_the_start(point)[self.kept], self.states @ point])

    def jacobian(self, point: Array) -> Array:
        """Their derivatives, (N + nc, n + nc)."""
        nc = self.orders.nc
        padded = np.concatenate([np.zeros(nc), self._from_the_start(point)])
        lagged = [-padded[nc - k : len(padded) - k] for k in range(1, nc + 1)]
        columns = np.column_stack([self.regressors, *lagged, self.impulses])
        scored = lfilter([1.0], self._c(point), columns, axis=0)[self.kept]
        return np.concatenate([scored, self.states])

    def _from_the_start(self, point: Array) -> Array:
        o = self.orders
        equation = self.output + self.regressors @ point[: o.na + o.single.nb]
        equation += self.impulses @ point[o.parameters :]
        return lfilter([1.0], self._c(point), equation)

    def _c(self, point: Array) -> Array:
        return np.concatenate(
            [[1.0], point[self.orders.na + self.orders.single.nb : self.orders.parameters]]
        )
