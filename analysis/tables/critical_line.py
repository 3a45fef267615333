"""The critical state line of one campaign or several: void ratio against ln p', and the stress ratio by direction.

Least squares in e, e = e_100 - slope ln(p' / 100 kPa), over the points that reached the critical state.  Grain
properties move the line, so it is fitted twice: alone, and with the logarithms of the inputs and the square of the
first; the second fit gives the slope and the scatter at given properties.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from ..results.reader import Results

REFERENCE_PRESSURE = 100e3
#: Least ratio of the largest to the smallest p' (kPa) with which a line has a meaning.
WIDEST, FEWEST = 3.0, 8
POINTS = ["campaign", "path", "direction", "mu_iso", "packing", "p_kPa", "e", "eta", "probability"]
LINES = ["fitted_to", "points", "p_low_kPa", "p_high_kPa", "e_100", "slope", "slope_error", "scatter",
         "slope_given_inputs", "scatter_given_inputs"]  # fmt: skip
ALL = "all campaigns"
PATHS = {"drained": "drained", "constant_p": "constant p'", "undrained": "undrained"}


def critical_points(campaigns: Sequence[tuple[str, Results]]) -> pd.DataFrame:
    """Critical states of every point that reached one: campaign, test, density, packing, p', e, eta, probability.

    The inputs follow as columns named after their symbols, in SI units.  Probabilities are those of a density's points.
    """
    parts = []
    for name, results in campaigns:
        inputs = results.family_points().columns()
        columns = {symbol: values for symbol, values in inputs.items() if symbol in results.points.names}
        for mu_iso in results.family_densities():
            p, e, eta = (results.shown_state("critical", symbol, mu_iso) for symbol in ("p", "e", "eta"))
            head = {"campaign": name, **results.loading._asdict(), "mu_iso": mu_iso, "packing": results.packing(mu_iso)}
            values = {"p_kPa": 1e-3 * p, "e": e, "eta": eta, "probability": results.probability(mu_iso)}
            frame = pd.DataFrame(head | values | columns)
            parts.append(frame[np.isfinite(p) & np.isfinite(e) & (frame["probability"] > 0)])
    return pd.concat(parts, ignore_index=True)


def critical_lines(points: pd.DataFrame) -> pd.DataFrame:
    """Lines through `critical_points`: one row per path and one for all of them, where p' varies enough.

    `e_100`: void ratio at 100 kPa; `slope` per unit of ln p', its standard error from leaving out one packing of one
    density at a time (NaN with fewer than three); `scatter`: standard deviation of e about the line, in the fit alone
    and in that with the inputs.
    """
    rows = []
    for name, part in _sets(points):
        if not _is_wide(part):
            continue
        (e_100, slope), scatter, _ = _fit(part, [])
        inputs = _inputs(points)
        given = (np.nan, np.nan)
        if inputs and len(part) >= FEWEST + 2 * len(inputs):
            (_, of_given), of_scatter, _ = _fit(part, inputs)
            given = (of_given, of_scatter)
        reach = (part["p_kPa"].min(), part["p_kPa"].max())
        rows.append((name, len(part), *reach, e_100, slope, _slope_error(part), scatter, *given))
    return pd.DataFrame(rows, columns=LINES)


def critical_offsets(points: pd.DataFrame) -> pd.DataFrame:
    """How far each campaign lies from the line of the drained and constant-p' ones, or of all: mean and scatter of e.

    `fitted_to`: which line; with the inputs in the fit where there are enough points.  No rows without a line.
    """
    dry = points[points["path"] != "undrained"]
    columns = ["campaign", "path", "direction", "points", "fitted_to", "offset", "scatter", "scatter_of_line"]
    candidates = [(name, part) for name, part in (("drained and constant p'", dry), (ALL, points)) if _is_wide(part)]
    if not candidates:
        return pd.DataFrame(columns=columns)
    name, part = candidates[0]
    inputs = _inputs(points)
    inputs = inputs if len(part) >= FEWEST + 2 * len(inputs) else []
    _, scatter, predict = _fit(part, inputs)
    rows = []
    for (campaign, path, direction), of in points.groupby(["campaign", "path", "direction"], sort=False):
        off, weight = of["e"].to_numpy() - predict(of), of["probability"].to_numpy() / of["probability"].sum()
        mean = float(off @ weight)
        spread = float(np.sqrt(weight @ (off - mean) ** 2))
        rows.append((campaign, path, direction, len(of), name, mean, spread, scatter))
    return pd.DataFrame(rows, columns=columns)


def of_one(results: Results) -> pd.DataFrame:
    """`critical_points` of one campaign."""
    return critical_points([(str(results.attrs.get("campaign", "")), results)])


def lines_of_one(results: Results) -> pd.DataFrame:
    """`critical_lines` of one campaign; without columns for drained and constant-p' tests, whose p' hardly varies."""
    return critical_lines(of_one(results)) if results.loading.is_undrained else pd.DataFrame()


def _sets(points: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    there = [(PATHS[path], points[points["path"] == path]) for path in PATHS if (points["path"] == path).any()]
    return there if len(there) == 1 else [*there, (ALL, points)]


def _is_wide(part: pd.DataFrame) -> bool:
    """Whether there are enough points, over a wide enough range of p', for a line."""
    return len(part) >= FEWEST and part["p_kPa"].max() >= WIDEST * part["p_kPa"].min()


def _inputs(points: pd.DataFrame) -> list[str]:
    """Inputs that all points have and that vary; not the stress, which is p' itself in drained tests."""
    names = [name for name in points.columns if name not in (*POINTS, "sigma_3")]
    return [name for name in names if points[name].notna().all() and points[name].nunique() > 2]


def _fit(
    part: pd.DataFrame, inputs: Sequence[str]
) -> tuple[tuple[float, float], float, Callable[[pd.DataFrame], np.ndarray]]:
    """(e_100, slope), scatter (standard deviation of the residuals) and a predictor of a weighted least-squares fit."""
    centre = {name: float(np.log(part[name]).mean()) for name in inputs}

    def columns(frame: pd.DataFrame) -> np.ndarray:
        logs = [np.log(frame[name].to_numpy(float)) - centre[name] for name in inputs]
        line = [np.ones(len(frame)), -np.log(1e3 * frame["p_kPa"].to_numpy(float) / REFERENCE_PRESSURE)]
        return np.column_stack([*line, *logs, *([logs[0] ** 2] if logs else [])])

    weight = np.sqrt(part["probability"].to_numpy(float))
    x, e = columns(part), part["e"].to_numpy(float)
    found = np.linalg.lstsq(x * weight[:, None], e * weight, rcond=None)[0]
    residual, share = e - x @ found, weight**2 / np.sum(weight**2)
    freedom = max(len(part) - x.shape[1], 1) / len(part)
    scatter = float(np.sqrt(share @ residual**2 / freedom))
    return (float(found[0]), float(found[1])), scatter, lambda frame: columns(frame) @ found


def _slope_error(part: pd.DataFrame) -> float:
    """Jackknife over the packings of each campaign and density."""
    groups = part.groupby(["campaign", "mu_iso", "packing"], sort=False).ngroup().to_numpy()
    count = int(groups.max()) + 1
    if count < 3:
        return np.nan
    slopes = np.array([_fit(part[groups != k], [])[0][1] for k in range(count)])
    return float(np.sqrt((count - 1) / count * np.sum((slopes - slopes.mean()) ** 2)))
