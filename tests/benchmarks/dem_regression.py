"""One regression over all rows of `bench_dem.py`: what each setting of the DEM protocol changes, and the limit.

A response of a row is  level(point, density) + sum of effects(setting) + offset(case) + scatter,  all relative to the
level of its point.  Effects are linear in the share of the rate to the power `exponent`, in the same for grains of
their own inertia (which matters the less, the slower the shear is), in the step, in damping, in the logarithm of the
softness and in 1/N; each has a value of its own at every point where an F test asks for it.  A case is a packing at a
density; all settings of a case start from the same packing, so its offset is a random effect.  Its variance comes from
restricted maximum likelihood: pairs count where packings differ more than runs scatter, and all rows count where they
do not.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd
from dem_errors import RESPONSES
from scipy.stats import f as f_distribution
from scipy.stats import t

EFFECTS = ("rate", "own inertia", "step", "damping", "softness", "size")
#: What the effects are measured from: an infinitely slow shear of 1,000 spheres at the step of the reference.
LIMIT = {"rate": 0.0, "own inertia": 0.0, "step": 0.8, "damping": 0.0, "softness": 0.0, "size": 0.0}
#: Level of the F test for effects that differ between the points.
TEST_LEVEL = 0.05


def coordinates(values: Mapping[str, float], exponent: float) -> dict[str, float]:
    """The effects' coordinates of a setting (a merged dict as `bench_dem.BASE`)."""
    return {
        "rate": values["rate"] ** exponent,
        "own inertia": (1.0 - values["density_scaling"]) * values["rate"] ** exponent,
        "step": values["timestep_factor"],
        "damping": values["damping"] / 0.1,
        "softness": -np.log10(values["stiffness_scale"]),
        "size": 1000.0 / values["N"] - 1.0,
    }


def biases(
    rows: pd.DataFrame,
    settings: Mapping[str, Mapping[str, float]],
    asked: Iterable[str],
    exponent: float,
    against: Mapping[str, float] = LIMIT,
) -> pd.DataFrame:
    """Relative bias of the settings `asked` against coordinates, per response, over all points and at each one.

    `bias_half_width` is its 95 % half width, `interactions` says whether the effects differ between the points, `aic`
    is that of the fit by maximum likelihood, to compare exponents.  A setting that is asked for needs no rows; its
    `rate` may be a dictionary with the share of each point.
    """
    good = rows[rows.failure.isna() & rows.setting.isin(settings)]
    points = sorted(good.point.unique())
    out = []
    for response in RESPONSES:
        known = good[good[response].notna()]
        level = known[known.setting == "base"].groupby("point")[response].mean()
        y = (known[response] / known.point.map(level)).to_numpy(float)
        at = np.array([[coordinates(settings[s], exponent)[e] for e in EFFECTS] for s in known.setting])
        of_point = (known.point.to_numpy()[:, None] == points).astype(float)
        cells = pd.get_dummies(known.point + known.mu_iso.astype(str)).to_numpy(float)
        case = pd.factorize(known.packing.astype(str) + known.mu_iso.astype(str) + known.point)[0]
        shared = np.hstack([cells, at])
        single = np.hstack([cells, *(at * of_point[:, [k]] for k in range(len(points)))])
        few, many = fitted(shared, y, case), fitted(single, y, case)
        interactions = few["p_against"](many) < TEST_LEVEL
        fit = many if interactions else few
        for setting in asked:
            gaps = np.array([_gap(settings[setting], point, exponent, against) for point in points])
            for of in ("all", *points):
                share = np.array([1 / len(points) if of == "all" else float(of == p) for p in points])
                parts = share[:, None] * gaps
                contrast = np.concatenate(
                    [np.zeros(cells.shape[1]), parts.ravel() if interactions else parts.sum(axis=0)]
                )
                bias = contrast @ fit["beta"]
                half = t.ppf(0.975, fit["freedom"]) * np.sqrt(contrast @ fit["covariance"] @ contrast)
                out.append({"setting": setting, "response": response, "of": of, "exponent": exponent, "bias": bias,
                            "bias_half_width": half, "interactions": interactions, "aic": fit["aic"],
                            "rows": len(known)})  # fmt: skip
    return pd.DataFrame(out)


def _gap(values: Mapping, point: str, exponent: float, against: Mapping[str, float]) -> list[float]:
    """Coordinates of a setting at one point, from those of `against`."""
    rate = values["rate"]
    at = coordinates({**values, "rate": rate[point] if isinstance(rate, Mapping) else rate}, exponent)
    return [at[effect] - against[effect] for effect in EFFECTS]


def fitted(x: np.ndarray, y: np.ndarray, case: np.ndarray) -> dict:
    """Generalised least squares of y (n,) on x (n, m) with a random offset of each case (n,).

    The ratio of the offset's variance to that of the rows is the one of the largest restricted likelihood on a grid.
    """
    z = (case[:, None] == np.arange(case.max() + 1)).astype(float)
    rank = np.linalg.matrix_rank(x)
    best: dict = {"likelihood": -np.inf}
    for ratio in np.concatenate([[0.0], np.geomspace(0.01, 1e4, 25)]):
        v = np.eye(len(y)) + ratio * z @ z.T
        whiten = np.linalg.inv(np.linalg.cholesky(v))
        wx, wy = whiten @ x, whiten @ y
        covariance = np.linalg.pinv(wx.T @ wx)
        beta = covariance @ wx.T @ wy
        squares = float(np.sum((wy - wx @ beta) ** 2))
        freedom = len(y) - rank
        singular = np.linalg.svd(wx, compute_uv=False)[:rank]
        log_det = 2 * np.log(np.diag(whiten)).sum()
        likelihood = 0.5 * log_det - np.log(singular).sum() - 0.5 * freedom * np.log(squares)
        if likelihood > best["likelihood"]:
            aic = len(y) * np.log(squares / len(y)) - log_det + 2 * (rank + 2)
            best = {"likelihood": likelihood, "beta": beta, "covariance": covariance * squares / freedom, "aic": aic,
                    "freedom": freedom, "squares": squares, "ratio": ratio, "whiten": whiten}  # fmt: skip

    def p_against(other: dict) -> float:
        """p-value of the F test of this model against a larger one, both with the offsets of the larger one."""
        wx, wy = other["whiten"] @ x, other["whiten"] @ y
        squares = float(np.sum((wy - wx @ np.linalg.lstsq(wx, wy, rcond=None)[0]) ** 2))
        more = len(y) - rank - other["freedom"]
        statistic = (squares - other["squares"]) / more / (other["squares"] / other["freedom"])
        return float(f_distribution.sf(statistic, more, other["freedom"]))

    return best | {"p_against": p_against}
