"""Kendall's tau of measured pairs, its interval, and the test of independence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

#: Significance level of the test, and half-width of a 95 % interval in standard errors.
LEVEL, _NORMAL_975 = 0.05, 1.959963984540054


@dataclass(frozen=True)
class Kendall:
    """Kendall's tau-b of n pairs with its 95 % interval and the p-value of independence."""

    tau: float
    low: float
    high: float
    p: float

    @property
    def text(self) -> str:
        """Tau and its interval in words."""
        tau, low, high = (f"{round(value, 2) + 0.0:.2f}" for value in (self.tau, self.low, self.high))
        return f"Kendall's tau = {tau} (95 %: {low} to {high})"

    @property
    def p_text(self) -> str:
        """The p-value in words."""
        return f"p = {self.p:.2g}" if self.p >= 0.001 else "p < 0.001"


def kendall(x: ArrayLike, y: ArrayLike) -> Kendall:
    """Kendall's tau-b of pairs x, y (n,), n >= 5, with allowance for ties.

    p is exact without ties up to 33 pairs, else from the normal distribution with the variance of tied ranks (Kendall
    1970).  The interval is symmetric in Fisher's z of tau with the variance 0.437 / (n - 4) (Fieller, Hartley and
    Pearson 1957).
    """
    tau, p = (float(value) for value in stats.kendalltau(x, y))
    z = np.arctanh(np.clip(tau, -0.999999, 0.999999))
    half = _NORMAL_975 * np.sqrt(0.437 / (len(np.asarray(x)) - 4.0))
    return Kendall(tau, float(np.tanh(z - half)), float(np.tanh(z + half)), p)
