"""Marginal distributions of one measured property: maximum likelihood, information criteria, goodness of fit.

`FAMILIES` are the candidates of a fit; `kernel`, a density without a family, is fitted only where it is asked for.

Every estimator works on many samples at once, the rows of an (R, n) array: R = 1 for one fit, R = 2,000 for the
reference distributions of the Kolmogorov-Smirnov and Anderson-Darling statistics *with fitted parameters*.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import kernel_marginal
from .marginal_families import FAMILIES, MarginalError, MarginalFamily
from .marginal_families import family_of as parametric_family

SIMULATIONS = 2000
_LARGEST_SIMULATION = 4_000_000  # simulated values at most; large samples have fewer simulations
#: Larger samples are compared with simulated samples of this size: sqrt(n) D and A^2 no longer depend on n there.
#: With ties they do; then so many values of the sample, chosen at random, are tested in its place.
LARGEST_SIMULATED = 20_000
#: Significance level of the two tests.
LEVEL = 0.05
#: Asymptotic 5 % point of sqrt(n) times the Kolmogorov-Smirnov statistic for known parameters.
_KS_POINT = 1.358


@dataclass(frozen=True)
class Marginal:
    """A distribution of one property, with the record of its fit (None if it was not fitted to data).

    `params` and standard errors `se` are keyed by parameter name.  `values` are the centres of a kernel density, whose
    `aic` is -2 times its log-likelihood with each value left out; it has no test.  `ks` and `ad` are the
    Kolmogorov-Smirnov and the Anderson-Darling statistic.  `ks_critical` is the 5 % value for known parameters,
    1.358 / sqrt(n), as in the paper; `ks_critical_fitted`, `ad_critical_fitted` and the two p-values allow for fitted
    parameters (parametric bootstrap, Lilliefors 1967).  Raises MarginalError for an unknown family or parameters out of
    range.
    """

    family: str
    params: dict[str, float]
    values: tuple[float, ...] = ()
    se: dict[str, float] = field(default_factory=dict)
    n: int | None = None
    loglik: float | None = None
    aic: float | None = None
    bic: float | None = None
    ks: float | None = None
    ks_critical: float | None = None
    ks_critical_fitted: float | None = None
    ks_p_fitted: float | None = None
    ad: float | None = None
    ad_critical_fitted: float | None = None
    ad_p_fitted: float | None = None

    def __post_init__(self) -> None:
        family_of(self.family).check(self.params)
        object.__setattr__(self, "values", tuple(float(value) for value in self.values))
        if (self.family == kernel_marginal.NAME) != bool(self.values):
            raise MarginalError(f"{self.family}: has {len(self.values)} centres of kernels")
        if self.values and not (np.isfinite(self.values).all() and min(self.values) > 0.0):
            raise MarginalError(f"{self.family}: a centre of the kernels is not a positive number")

    @property
    def _arguments(self) -> tuple[Any, ...]:
        return (*self.params.values(), *((np.array(self.values),) if self.values else ()))

    def _call(self, name: str, x: ArrayLike) -> np.ndarray:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return getattr(family_of(self.family), name)(np.asarray(x, dtype=float), *self._arguments)

    def logpdf(self, x: ArrayLike) -> np.ndarray:
        """Log PDF at x, -inf outside the support."""
        return self._call("logpdf", x)

    def pdf(self, x: ArrayLike) -> np.ndarray:
        """PDF at x, in 1 / unit of x."""
        return np.exp(self.logpdf(x))

    def cdf(self, x: ArrayLike) -> np.ndarray:
        """P(X <= x)."""
        return self._call("cdf", x)

    def sf(self, x: ArrayLike) -> np.ndarray:
        """P(X > x), accurate in the upper tail."""
        return self._call("sf", x)

    def ppf(self, u: ArrayLike) -> np.ndarray:
        """Quantile at probability u."""
        return self._call("ppf", u)

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """n independent values, shape (n,)."""
        return self.ppf(rng.random(n))

    @property
    def mean(self) -> float:
        """Expected value."""
        return family_of(self.family).moments(*self._arguments)[0]

    @property
    def std(self) -> float:
        """Standard deviation."""
        return float(np.sqrt(family_of(self.family).moments(*self._arguments)[1]))

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary; `values` only where there are some."""
        return {name: value for name, value in asdict(self).items() if name != "values" or value}

    @staticmethod
    def from_dict(data: dict[str, Any]) -> Marginal:
        """The inverse of to_dict."""
        return Marginal(**data)


def fit(x: ArrayLike, family: str, n_sim: int = SIMULATIONS, seed: int = 1) -> Marginal:
    """Fit one family to x (n,) by maximum likelihood, with standard errors from the observed information.

    `n_sim` samples from the fit give the reference distributions of the two goodness-of-fit statistics; with 0 those
    fields are None.  Each sample gets the ties of x.  Above LARGEST_SIMULATED values the samples have that size.
    Raises MarginalError for an unknown family, fewer than 3 values, values outside the support, or values without
    scatter.
    """
    x = _checked(x, family)
    if family == kernel_marginal.NAME:
        return _fit_kernel(x)
    kind = family_of(family)
    n = x.size
    estimate = kind.mle(x[None, :])[0]
    if not np.all(np.isfinite(estimate)):
        raise MarginalError(f"{family}: the likelihood has no maximum for these {n} values")
    params = dict(zip(kind.names, estimate.tolist(), strict=True))
    loglik = float(kind.logpdf(x, *estimate).sum())
    k = len(params)
    ks, ad = (float(value[0]) for value in _statistics(kind, x[None, :], estimate[None, :]))
    tests: dict[str, Any] = _tested(kind, x, estimate, (ks, ad), n_sim, seed) if n_sim else {}
    return Marginal(
        family=family,
        params=params,
        se=dict(zip(kind.names, _standard_errors(kind, x, estimate), strict=True)),
        n=n,
        loglik=loglik,
        aic=2 * k - 2 * loglik,
        bic=float(k * np.log(n) - 2 * loglik),
        ks=ks,
        ks_critical=float(_KS_POINT / np.sqrt(n)),
        ad=ad,
        **tests,
    )


def _tested(
    kind: MarginalFamily, x: np.ndarray, estimate: np.ndarray, found: tuple[float, float], n_sim: int, seed: int
) -> dict[str, float]:
    """Critical values and p-values of both statistics of x (n,), which are `found` for its fit `estimate` (k,)."""
    rng = np.random.default_rng(seed)
    n, size = x.size, min(x.size, LARGEST_SIMULATED)
    rows = max(200, min(n_sim, _LARGEST_SIMULATION // size))
    samples = kind.ppf(rng.random((rows, size)), *estimate)
    scale = np.sqrt(size / n)
    tied = np.unique(x).size < n
    if tied and n > size:
        x, scale = rng.choice(x, size, replace=False), 1.0
        ours = _statistics(kind, x[None, :], kind.mle(x[None, :]))
        found = float(ours[0][0]), float(ours[1][0])
    if tied:
        samples = _with_ties(samples, x)
    tests: dict[str, float] = {}
    distances, squares = _statistics(kind, samples, kind.mle(samples))
    for name, value, reference in (("ks", found[0], distances * scale), ("ad", found[1], squares)):
        tests[f"{name}_critical_fitted"] = float(np.quantile(reference, 0.95))
        tests[f"{name}_p_fitted"] = float((0.5 + np.sum(reference >= value)) / (rows + 1))
    return tests


def _with_ties(samples: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Sorted samples (R, n) with the ties of x (n,): values at the places of tied values of x get their mean."""
    starts = np.unique(np.sort(x), return_index=True)[1]
    sizes = np.diff(np.append(starts, x.size))
    return np.repeat(np.add.reduceat(np.sort(samples, axis=1), starts, axis=1) / sizes, sizes, axis=1)


def _fit_kernel(x: np.ndarray) -> Marginal:
    """A kernel density of x (n,), without standard errors and without a test."""
    h = kernel_marginal.bandwidth(x)
    plain = Marginal(kernel_marginal.NAME, {"bandwidth_ln": h}, tuple(kernel_marginal.centres(x, h)))
    return replace(
        plain, n=x.size, loglik=float(plain.logpdf(x).sum()), aic=-2.0 * kernel_marginal.left_out_loglik(x, h)
    )


def family_of(name: str) -> MarginalFamily:
    """The family of that name, the kernel density included; raises MarginalError if there is none."""
    if name == kernel_marginal.NAME:
        return kernel_marginal.KERNEL
    try:
        return parametric_family(name)
    except MarginalError as error:
        raise MarginalError(f"{error}, {kernel_marginal.NAME}") from None


def fit_all(
    x: ArrayLike, families: Iterable[str] = tuple(FAMILIES), n_sim: int = SIMULATIONS, seed: int = 1
) -> list[Marginal]:
    """Fit every family to x (n,) and return the Marginals, smallest AIC first; raises MarginalError as `fit` does."""
    fits = [fit(x, family, n_sim, seed) for family in families]
    return sorted(fits, key=lambda marginal: math.inf if marginal.aic is None else marginal.aic)


def verdict(fitted: Marginal) -> str:
    """Outcome of the two tests with fitted parameters at the level of 5 %: accepted, rejected, or rejected by one."""
    if fitted.ks_p_fitted is None or fitted.ad_p_fitted is None:
        return "not tested"
    ks, ad = fitted.ks_p_fitted <= LEVEL, fitted.ad_p_fitted <= LEVEL
    if ks == ad:
        return "rejected" if ks else "accepted"
    return f"rejected by {'KS' if ks else 'AD'} alone"


def fit_rows(samples: np.ndarray, family: str) -> np.ndarray:
    """Maximum-likelihood parameters (R, k) of every row of samples (R, n), in the order of the family's names."""
    return family_of(family).mle(np.asarray(samples, dtype=float))


def _checked(x: ArrayLike, family: str) -> np.ndarray:
    kind = family_of(family)
    x = np.asarray(x, dtype=float).ravel()
    if x.size < 3:
        raise MarginalError(f"{family}: {x.size} values, need at least 3")
    if not np.all(np.isfinite(x)):
        raise MarginalError(f"{family}: value {np.flatnonzero(~np.isfinite(x))[0] + 1} is not finite")
    if kind.positive and x.min() <= 0.0:
        raise MarginalError(f"{family}: value {x.min():g} is outside its support, x > 0")
    if np.ptp(x) <= 1e-12 * np.abs(x).max():
        raise MarginalError(f"{family}: all {x.size} values are {x[0]:g}, so there is no scatter to fit")
    return x


def _statistics(kind: MarginalFamily, samples: np.ndarray, params: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Kolmogorov-Smirnov and Anderson-Darling statistics (R,) of each row of samples (R, n) against its fit (R, k)."""
    x = np.sort(samples, axis=1)
    n = x.shape[1]
    columns = [params[:, [j]] for j in range(params.shape[1])]
    F = kind.cdf(x, *columns)
    step = np.arange(1, n + 1) / n
    ks = np.maximum(step - F, F - (step - 1.0 / n)).max(axis=1)
    tiny = 1e-300
    log_F, log_S = np.log(np.maximum(F, tiny)), np.log(np.maximum(kind.sf(x, *columns), tiny))
    weight = 2.0 * np.arange(1, n + 1) - 1.0
    return ks, -n - np.mean(weight * (log_F + log_S[:, ::-1]), axis=1)


def _standard_errors(kind: MarginalFamily, x: np.ndarray, estimate: np.ndarray) -> list[float]:
    """Square roots of the diagonal of the inverse observed information, by central differences."""
    k = len(estimate)
    positive = [name in kind.positive_params for name in kind.names]
    step = 1e-4 * np.where(positive, np.abs(estimate), np.std(x))
    information = np.empty((k, k))

    def loglik(shift: np.ndarray) -> float:
        return kind.logpdf(x, *(estimate + shift * step)).sum()

    unit = np.eye(k)
    for i in range(k):
        for j in range(k):
            corners = [s * t * loglik(s * unit[i] + t * unit[j]) for s in (1, -1) for t in (1, -1)]
            information[i, j] = -sum(corners) / 4.0
    variance = np.diag(np.linalg.pinv(information))
    return (step * np.sqrt(np.where(variance > 0, variance, np.nan))).tolist()
