"""The result of a joint test of residuals."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WhitenessTest:
    """Joint test that the residuals of a fitted model are white.

    Attributes
    ----------
    statistic : float
        Ljung-Box statistic ``N (N + 2) sum r_k^2 / (N - k)``.
    expected : float
        Its expected value under white innovations, the fit taken into account.  It takes the
        place of the degrees of freedom.
    p_value : float
        NaN where no autocorrelation is left free by the fit.
    lags : int
        Number of lags tested jointly.
    """

    statistic: float
    expected: float
    p_value: float
    lags: int
