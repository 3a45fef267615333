"""Maximum pseudo-likelihood on ranks, of one sample or many at once, with standard errors that allow for the ranks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, stats

from . import elliptical
from .family import CopulaError, Family
from .model import Copula, evaluate, family_of

#: 97.5 % quantile of the standard normal distribution: half-width of a 95 % interval in standard errors.
_NORMAL_975 = 1.959963984540054
_TAU_GRID = np.linspace(-0.9, 0.9, 19)
_KAPPA_GRID = np.concatenate([[1.0 / elliptical.LARGEST_NU], np.linspace(0.02, 0.5, 25), [0.6, 0.8, 1.0]])


@dataclass(frozen=True)
class CopulaFit:
    """One family fitted to n pairs of pseudo-observations, with its test of fit, if made.

    `loglik`, `aic` and `bic` are pseudo-likelihood values, because they are computed from ranks.  `se` and `interval`
    (95 %) follow Genest, Ghoudi and Rivest (1995).  `S` (mean of the two orders of the columns), `p_bootstrap`,
    `accepted` (p_bootstrap > 0.05), `p_paper` (the paper's test: the given order, against independent uniforms) and
    `n_boot` are None before `select` has tested the fit.
    """

    family: str
    parameters: tuple[float, ...]
    names: tuple[str, ...]
    se: tuple[float, ...]
    interval: tuple[tuple[float, float], ...]
    n: int
    loglik: float
    aic: float
    bic: float
    tau: float
    S: float | None = None
    p_paper: float | None = None
    p_bootstrap: float | None = None
    accepted: bool | None = None
    n_boot: int | None = None

    @property
    def copula(self) -> Copula:
        """The fitted copula."""
        return Copula(self.family, self.parameters)

    @property
    def at_bounds(self) -> tuple[tuple[str, float, str], ...]:
        """Parameters at an end of their range: (name, limit, the simpler copula that it practically is, or "")."""
        return _ends(family_of(self.family), self.parameters)

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary."""
        return asdict(self)

    @staticmethod
    def from_dict(data: dict[str, Any]) -> CopulaFit:
        """The inverse of to_dict."""
        tuples = {key: tuple(data[key]) for key in ("parameters", "names", "se")}
        return CopulaFit(**{**data, **tuples, "interval": tuple(tuple(pair) for pair in data["interval"])})


def pseudo_observations(x: ArrayLike) -> np.ndarray:
    """Ranks over n + 1 along the last axis, mid-ranks for ties: (..., n) values to (..., n) numbers in (0, 1)."""
    x = np.asarray(x, dtype=float)
    return stats.rankdata(x, axis=-1) / (x.shape[-1] + 1.0)


def fit(x: ArrayLike, y: ArrayLike, family: str, ranks: bool = True) -> CopulaFit:
    """Fit one family to n pairs by maximum pseudo-likelihood; x, y (n,) are ranked first (they may be ranks already).

    With `ranks=False` x and y are the probabilities themselves.  Raises CopulaError for fewer than 5 pairs, non-finite
    values, a constant column, or a family whose sign of dependence is opposite to that of the data.
    """
    kind = family_of(family)
    u, v = _checked(x, y, family, ranks)
    tau = stats.kendalltau(u, v)[0]
    if kind.sign * tau < 0.0:
        turned = "90 or 270" if kind.sign > 0 else "0 or 180"
        raise CopulaError(
            f"{family}: Kendall's tau of the pairs is {tau:.3f}, which it cannot have; turn it by {turned} degrees"
        )
    if not kind.names:
        return CopulaFit(
            family=family, parameters=(), names=(), se=(), interval=(), n=u.size, loglik=0.0, aic=0.0, bic=0.0, tau=0.0
        )
    estimate = fit_rows(u[None], v[None], family)[0]
    free = np.array([float(value) for value in kind.to_free(*estimate)])
    spread = _free_spread(kind, u, v, free, ranks)
    se, interval = _delta(kind, free, spread)
    loglik = float(evaluate(kind, "logpdf", u, v, *estimate).sum())
    k, n = len(estimate), u.size
    aic, bic = 2 * k - 2 * loglik, k * float(np.log(n)) - 2 * loglik
    parameters = tuple(float(value) for value in estimate)
    return CopulaFit(
        family=family,
        parameters=parameters,
        names=kind.names,
        se=se,
        interval=interval,
        n=n,
        loglik=loglik,
        aic=aic,
        bic=bic,
        tau=Copula(family, parameters).tau,
    )


def fit_rows(u: np.ndarray, v: np.ndarray, family: str, start: ArrayLike | None = None) -> np.ndarray:
    """Maximum-likelihood parameters (R, k) of each row of u, v (R, n) in (0, 1).

    `start`, a value of the first parameter near those of all rows, replaces the search over a grid: half the time.
    """
    kind = family_of(family)
    if not kind.names:
        return np.empty((len(u), 0))
    if family == "student":
        return _student_rows(u, v)
    if family == "gaussian":
        x, y = elliptical.normal_score(u, 1.0 - u), elliptical.normal_score(v, 1.0 - v)
        squares, product = np.mean(x * x + y * y, axis=1), np.mean(x * y, axis=1)

        def loglik(t: np.ndarray, rows: np.ndarray) -> np.ndarray:
            rho = np.tanh(t)
            r2 = 1.0 - rho**2
            return -0.5 * np.log(r2) - rho * (rho * squares[rows] - 2.0 * product[rows]) / (2.0 * r2)
    else:

        def loglik(t: np.ndarray, rows: np.ndarray) -> np.ndarray:
            return evaluate(kind, "logpdf", u[rows], v[rows], *(p[:, None] for p in kind.from_free(t))).mean(axis=1)

    (low, high) = kind.bounds[0]
    if start is None:
        taus = _TAU_GRID if kind.sign == 0 else kind.sign * np.linspace(0.01, 0.9, 12)
        start = kind.from_tau(taus)
    grid = kind.to_free(np.clip(np.atleast_1d(start), low, high))[0]
    limits = np.sort([float(kind.to_free(np.asarray(bound))[0]) for bound in (low, high)])
    t = _maximise(loglik, np.sort(grid), limits, len(u))
    return np.stack(kind.from_free(t), axis=1)


def _maximise(
    function: Callable[[np.ndarray, np.ndarray], np.ndarray], grid: np.ndarray, limits: np.ndarray, count: int
) -> np.ndarray:
    """Maximise a smooth function of one variable for many rows: best point of a grid, then bracketed Newton steps.

    function(t, rows) gives the values of these rows at t; rows that have converged are left out.
    """
    all_rows = np.arange(count)
    best = np.zeros(count, dtype=int)
    if len(grid) > 1:
        best = np.argmax(np.stack([function(np.full(count, t), all_rows) for t in grid]), axis=0)
    edges = np.concatenate([limits[:1], grid, limits[1:]])
    low, t, high = edges[best], grid[best], edges[best + 2]
    active, h = all_rows, 1e-4
    for _ in range(40):
        at = t[active]
        left, centre, right = (function(at + step, active) for step in (-h, 0.0, h))
        slope, curvature = (right - left) / (2.0 * h), (right - 2.0 * centre + left) / h**2
        low[active] = np.where(slope > 0.0, at, low[active])
        high[active] = np.where(slope > 0.0, high[active], at)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = at - slope / curvature
        usable = (curvature < 0.0) & (newton > low[active]) & (newton < high[active])
        t[active] = np.where(usable, newton, 0.5 * (low[active] + high[active]))
        active = active[np.abs(t[active] - at) > 1e-7 * np.maximum(1.0, np.abs(at))]
        if active.size == 0:
            break
    return np.clip(t, limits[0] + 2 * h, limits[1] - 2 * h)


def _student_rows(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Parameters (R, 2) of Student's copula: profile over a grid of kappa = 1/nu, parabola through the best three.

    A single row is then maximised to full precision.
    """
    unique, index = np.unique(np.concatenate([u.ravel(), v.ravel()]), return_inverse=True)
    index = index.reshape(2, *u.shape)
    tau = np.array([stats.kendalltau(a, b)[0] for a, b in zip(u, v, strict=True)])
    t = np.arctanh(np.clip(np.sin(0.5 * np.pi * tau), -0.99, 0.99))
    profile, free = np.empty((2, len(_KAPPA_GRID), len(u)))
    for k, kappa in enumerate(_KAPPA_GRID):
        profile[k], free[k] = _student_profile(unique, index, kappa, t)
        t = free[k]
    kappa, t = _interpolated_maximum(profile, free)
    if len(u) == 1:
        best = int(np.argmax(profile[:, 0]))
        ends = _KAPPA_GRID[[max(best - 1, 0), min(best + 1, len(_KAPPA_GRID) - 1)]]
        optimum = optimize.minimize_scalar(
            lambda k: -_student_profile(unique, index, k, t)[0][0],
            bounds=ends,
            method="bounded",
            options={"xatol": 1e-9},
        )
        kappa = np.array([optimum.x]) if -optimum.fun >= profile[best, 0] else _KAPPA_GRID[[best]]
        t = _student_profile(unique, index, kappa[0], t)[1]
    return np.stack([np.tanh(t), 1.0 / kappa], axis=1)


def _student_profile(
    unique: np.ndarray, index: np.ndarray, kappa: float, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean log-likelihood at nu = 1/kappa, maximised over rho = tanh(t) by Newton's method from t (R,): (value, t)."""
    scores = elliptical.student_score(unique, 1.0 - unique, 1.0 / kappa)
    x, y = scores[index[0]], scores[index[1]]
    squares, product = (x * x + y * y) * kappa, 2.0 * x * y * kappa
    power = 0.5 / kappa + 1.0
    for _ in range(12):
        r = np.tanh(t)
        r2 = 1.0 - r * r
        column, column2 = r[:, None], r2[:, None]
        q = (squares - column * product) / column2
        q_r = (2.0 * column * q - product) / column2
        q_rr = (2.0 * q + 4.0 * column * q_r) / column2
        slope = r / r2 - power * np.mean(q_r / (1.0 + q), axis=1)
        bend = (1.0 + r * r) / r2**2 - power * np.mean(q_rr / (1.0 + q) - (q_r / (1.0 + q)) ** 2, axis=1)
        first, second = slope * r2, bend * r2**2 - 2.0 * r * r2 * slope
        downward = second < 0.0
        step = np.where(downward, np.clip(-first / np.where(downward, second, -1.0), -0.5, 0.5), np.sign(first) * 0.1)
        t = np.clip(t + step, -4.9, 4.9)
        if np.max(np.abs(step)) < 1e-9:
            break
    r = np.tanh(t)
    marginals = elliptical.student_logpdf(x, y, 0.0, 1.0 / kappa) + power * np.log1p(squares)
    q = (squares - r[:, None] * product) / (1.0 - r * r)[:, None]
    return marginals.mean(axis=1) - 0.5 * np.log(1.0 - r * r) - power * np.log1p(q).mean(axis=1), t


def _interpolated_maximum(profile: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Maximum of each column of the profile over _KAPPA_GRID, and the other coordinate there: (kappa, t)."""
    best = np.argmax(profile, axis=0)
    middle = np.clip(best, 1, len(_KAPPA_GRID) - 2)
    column = np.arange(profile.shape[1])
    x = np.stack([_KAPPA_GRID[middle + s] for s in (-1, 0, 1)])
    f, t = (np.stack([table[middle + s, column] for s in (-1, 0, 1)]) for table in (profile, free))
    first = (f[1] - f[0]) / (x[1] - x[0])
    second = ((f[2] - f[1]) / (x[2] - x[1]) - first) / (x[2] - x[0])
    with np.errstate(divide="ignore", invalid="ignore"):
        peak = 0.5 * (x[0] + x[1]) - first / (2.0 * second)
    inside = (second < 0.0) & (best == middle)
    kappa = np.where(inside, np.clip(peak, x[0], x[2]), _KAPPA_GRID[best])
    weights = [
        (kappa - x[(i + 1) % 3]) * (kappa - x[(i + 2) % 3]) / ((x[i] - x[(i + 1) % 3]) * (x[i] - x[(i + 2) % 3]))
        for i in range(3)
    ]
    return kappa, np.asarray(sum(weight * value for weight, value in zip(weights, t, strict=True)))


def _free_spread(kind: Family, u: np.ndarray, v: np.ndarray, free: np.ndarray, ranks: bool) -> np.ndarray:
    """Covariance (k, k) of the estimate in free coordinates: the sandwich of Genest, Ghoudi and Rivest (1995)."""
    n, k = u.size, free.size
    h = 1e-4

    def logpdf(shift: np.ndarray, du: Any = 0.0, dv: Any = 0.0) -> np.ndarray:
        return evaluate(kind, "logpdf", u + du, v + dv, *kind.from_free(*(free + shift)))

    unit = h * np.eye(k)

    def score(du: Any = 0.0, dv: Any = 0.0) -> np.ndarray:
        return np.stack([(logpdf(e, du, dv) - logpdf(-e, du, dv)) / (2.0 * h) for e in unit], axis=1)

    bread = np.empty((k, k))
    for i in range(k):
        for j in range(k):
            corners = [s * t * logpdf(s * unit[i] + t * unit[j]).mean() for s in (1, -1) for t in (1, -1)]
            bread[i, j] = -sum(corners) / (4.0 * h * h)
    influence = score()
    if ranks:
        for w, name in ((u, "du"), (v, "dv")):
            step = 1e-3 * np.minimum(w, 1.0 - w)
            change = (score(**{name: step}) - score(**{name: -step})) / (2.0 * step[:, None])
            order = np.argsort(w, kind="stable")
            above = np.cumsum(change[order][::-1], axis=0)[::-1] / n
            first = np.searchsorted(w[order], w, side="left")
            influence = influence + above[first] - np.mean(w[:, None] * change, axis=0)
    meat = np.cov(influence.T, ddof=0).reshape(k, k)
    inverse = np.linalg.pinv(bread)
    return inverse @ meat @ inverse / n


def _ends(kind: Family, parameters: tuple[float, ...]) -> tuple[tuple[str, float, str], ...]:
    """As `CopulaFit.at_bounds`.  A fit stops a little before a limit, and Student's rho at tanh 4.9."""
    found = []
    for j, (name, limits) in enumerate(zip(kind.names, kind.bounds, strict=True)):
        for limit in limits:
            at = tuple(limit if i == j else value for i, value in enumerate(parameters))
            distance = abs(float(kind.to_free(*at)[j]) - float(kind.to_free(*parameters)[j]))
            if distance <= (0.06 if name == "rho" else 1e-3):
                found.append((name, limit, _simpler(kind, name, limit)))
    return tuple(found)


def _simpler(kind: Family, name: str, limit: float) -> str:
    """The copula that a family practically is at a limit: Gaussian for many degrees of freedom, or independence."""
    if name == "nu":
        return "gaussian" if limit == elliptical.LARGEST_NU else ""
    return "independence" if kind.sign and limit == kind.bounds[0][0] else ""


def _delta(
    kind: Family, free: np.ndarray, spread: np.ndarray
) -> tuple[tuple[float, ...], tuple[tuple[float, float], ...]]:
    """Standard errors of the parameters by the delta method, and 95 % intervals mapped from the free coordinates."""
    half = _NORMAL_975 * np.sqrt(np.diag(spread))
    se: list[float] = []
    interval: list[tuple[float, float]] = []
    for j, (low, high) in enumerate(kind.bounds):
        limits = np.sort(
            [float(kind.to_free(*(b[i] for i in range(len(free))))[j]) for b in zip(*kind.bounds, strict=False)]
        )
        ends = np.clip([free[j] - half[j], free[j] + half[j]], *limits)
        mapped = sorted(float(kind.from_free(*np.where(np.arange(len(free)) == j, e, free))[j]) for e in ends)
        step = 1e-5
        slope = np.diff([float(kind.from_free(*(free + s * step * np.eye(len(free))[j]))[j]) for s in (-1, 1)])[0]
        se.append(float(abs(slope) / (2.0 * step) * half[j] / _NORMAL_975))
        interval.append((max(mapped[0], low), min(mapped[1], high)))
    return tuple(se), tuple(interval)


def _checked(x: ArrayLike, y: ArrayLike, family: str, ranks: bool) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.asarray(x, dtype=float).ravel(), np.asarray(y, dtype=float).ravel()
    if x.size != y.size or x.size < 5:
        raise CopulaError(f"{family}: {x.size} and {y.size} values; need two columns of the same length, at least 5")
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(y))):
        raise CopulaError(f"{family}: the pairs contain a value that is not finite")
    if np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        raise CopulaError(f"{family}: one column is constant, so it has no ranks and no dependence")
    if not ranks and (min(x.min(), y.min()) <= 0.0 or max(x.max(), y.max()) >= 1.0):
        raise CopulaError(f"{family}: probabilities must lie strictly between 0 and 1")
    return (pseudo_observations(x), pseudo_observations(y)) if ranks else (x, y)
