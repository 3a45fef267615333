"""The PDF of a response along strain: one value for every method that computes it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors_and_files import GrainScatterError
from . import tails

if TYPE_CHECKING:
    import h5py

_OPTIONAL = ("low", "high", "values", "probability")
_VECTORS = ("strain", "mean", "std", "bandwidth", "lost_probability", "numerical_width", "spacing")


class PdemError(GrainScatterError):
    """A response, its probabilities or a setting that PDEM cannot use, or a group of a file without a PDF."""


@dataclass(frozen=True)
class PDF:
    """PDF of one response along strain, as cell averages on equal cells.

    strain (T,); x (X,) or (T, X) cell centres; p (T, X) with p.sum(axis=1) * dx == 1; mean and std (T,) of the *points*
    (or samples), not of the widened PDF.  All (T,) in the unit of x: `bandwidth`, the standard deviation of the initial
    kernel of each point; `numerical_width`, the standard deviation that the numerical scheme adds; `spacing`, the
    typical distance between neighbouring points.  `lost_probability` (T,) is the probability of points without a value;
    the probabilities of the others are normalised.  `low` and `high` (T, X) are a pointwise band on p, if computed.
    `values` and `probability` (T, Q) are the points behind the PDF, if known; `with_points` adds them.  Exceedance
    probabilities and quantiles then come from the points and do not contain the kernel; `cdf` is that of the shown PDF.
    """

    strain: np.ndarray
    x: np.ndarray
    p: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    bandwidth: np.ndarray
    method: str
    lost_probability: np.ndarray
    numerical_width: np.ndarray
    spacing: np.ndarray
    low: np.ndarray | None = field(default=None)
    high: np.ndarray | None = field(default=None)
    values: np.ndarray | None = field(default=None)
    probability: np.ndarray | None = field(default=None)

    @property
    def dx(self) -> np.ndarray:
        """Cell width, (T,)."""
        x = np.atleast_2d(self.x)
        return np.broadcast_to((x[:, -1] - x[:, 0]) / (x.shape[1] - 1), self.strain.shape)

    @property
    def shown_width(self) -> np.ndarray:
        """Standard deviation (T,) of all that widens the shown PDF beyond its points."""
        return np.hypot(self.bandwidth, self.numerical_width)

    @property
    def edges(self) -> np.ndarray:
        """Cell edges, (T, X + 1)."""
        centres = np.broadcast_to(self.x, self.p.shape)
        half = 0.5 * self.dx[:, None]
        return np.concatenate([centres - half, centres[:, -1:] + half], axis=1)

    def cdf(self, at: ArrayLike | None = None) -> np.ndarray:
        """Distribution function (T, X + 1) of the shown PDF at the cell edges, or (T, n) at the values `at` (n,)."""
        steps = np.concatenate([np.zeros((len(self.p), 1)), np.cumsum(self.p * self.dx[:, None], axis=1)], axis=1)
        total = np.clip(steps / steps[:, -1:], 0.0, 1.0)
        if at is None:
            return total
        at = np.atleast_1d(np.asarray(at, float))
        return np.stack(
            [np.interp(at, edge, row, left=0.0, right=1.0) for edge, row in zip(self.edges, total, strict=True)]
        )

    def quantile(self, level: ArrayLike) -> np.ndarray:
        """Quantiles (T, n) at the probabilities `level` (n,); (T,) for a single level.

        They come from the points (`tails.quantile`), or from the shown PDF if it has none.
        Raises ValueError for a level outside 0 ... 1.
        """
        levels = _levels(level)
        if self.values is not None:
            quantiles = np.stack([tails.quantile(*row, levels) for row in self._points()])
        else:
            # A tiny slope keeps the distribution function strictly increasing where the PDF is zero.
            ramp = np.linspace(0.0, 1e-14, self.p.shape[1] + 1)
            quantiles = np.stack(
                [np.interp(levels, row + ramp, edge) for row, edge in zip(self.cdf(), self.edges, strict=True)]
            )
        return quantiles if np.ndim(level) else quantiles[:, 0]

    def exceedance(self, threshold: ArrayLike) -> np.ndarray:
        """Probability (T,), or (T, n) for n values, that the response exceeds `threshold`.

        It comes from the points (`tails.exceedance`), or from the shown PDF if it has none.
        """
        at = np.atleast_1d(np.asarray(threshold, float))
        if self.values is not None:
            above = np.stack([tails.exceedance(*row, at) for row in self._points()])
        else:
            above = 1.0 - self.cdf(at)
        return above if np.ndim(threshold) else above[:, 0]

    def quantile_interval(
        self, level: ArrayLike, noise: ArrayLike = 0.0, confidence: float = tails.LEVEL
    ) -> tuple[np.ndarray, np.ndarray]:
        """Interval low, high of the quantiles, each in the shape of `quantile`, from one set of representative points.

        noise: standard deviation of a single run's own noise, a number or (T,), in the unit of x; see
        `tails.exceedance_interval`.  Raises PdemError if the PDF has no points, ValueError for a level outside 0 ... 1.
        """
        return self._interval(tails.quantile_interval, _levels(level), noise, confidence, np.ndim(level))

    def exceedance_interval(
        self, threshold: ArrayLike, noise: ArrayLike = 0.0, confidence: float = tails.LEVEL
    ) -> tuple[np.ndarray, np.ndarray]:
        """Interval low, high of the exceedance probabilities, in the shape of `exceedance`; see `quantile_interval`."""
        at = np.atleast_1d(np.asarray(threshold, float))
        return self._interval(tails.exceedance_interval, at, noise, confidence, np.ndim(threshold))

    def with_points(self, values: ArrayLike, probability: ArrayLike) -> PDF:
        """The PDF with the points behind it: values (T, Q), NaN where a point has none, probability (Q,) or (T, Q)."""
        values = np.asarray(values, float)
        return replace(self, values=values, probability=np.broadcast_to(np.asarray(probability, float), values.shape))

    def _points(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Values and probabilities (Q,) of the points at each strain."""
        if self.values is None or self.probability is None:
            raise PdemError(f"PDF by {self.method}: an interval needs the points, which `with_points` adds")
        return zip(self.values, self.probability, strict=True)

    def _interval(
        self, function: Callable[..., Any], at: np.ndarray, noise: ArrayLike, confidence: float, dimensions: int
    ) -> tuple[np.ndarray, np.ndarray]:
        noise = np.broadcast_to(np.asarray(noise, float), self.strain.shape)
        rows = zip(self._points(), noise, strict=True)
        ends = np.stack([function(*points, at, float(own), confidence) for points, own in rows], axis=1)
        low, high = ends if dimensions else ends[..., 0]
        return low, high

    def at(self, k: int) -> PDF:
        """The PDF at the k-th strain alone (T = 1)."""
        pick = slice(k, k + 1) if k != -1 else slice(-1, None)
        rows: dict[str, Any] = {name: getattr(self, name)[pick] for name in (*_VECTORS, "p")}
        rows["x"] = self.x if self.x.ndim == 1 else self.x[pick]
        rows |= {name: None if (kept := getattr(self, name)) is None else kept[pick] for name in _OPTIONAL}
        return replace(self, **rows)

    def to_hdf5(self, group: h5py.Group) -> None:
        """Write into an open h5py group: datasets pdf, x, mean, std, ... and the attributes method and bandwidth.

        The points are not written.
        """
        arrays = {"pdf": self.p, "x": self.x, "pdf_low": self.low, "pdf_high": self.high}
        arrays |= {name: getattr(self, name) for name in _VECTORS}
        for name, value in arrays.items():
            if name in group:
                del group[name]
            if value is not None:
                group[name] = value
        group.attrs["method"] = self.method
        group.attrs["bandwidth"] = float(np.median(self.bandwidth))

    @classmethod
    def from_hdf5(cls, group: h5py.Group) -> PDF:
        """Read what `to_hdf5` wrote; raises PdemError if a dataset is missing."""
        missing = [name for name in ("pdf", "x", *_VECTORS) if name not in group]
        if missing:
            raise PdemError(f"{group.file.filename}{group.name}: no PDF here, {missing[0]} is missing")
        rows = {name: group[name][()] for name in _VECTORS}
        low, high = (group[name][()] if name in group else None for name in ("pdf_low", "pdf_high"))
        method = str(group.attrs["method"])
        return cls(x=group["x"][()], p=group["pdf"][()], method=method, low=low, high=high, **rows)


def _levels(level: ArrayLike) -> np.ndarray:
    levels = np.atleast_1d(np.asarray(level, float))
    if np.any((levels < 0) | (levels > 1)):
        raise ValueError(f"quantile: level {levels.min():g} ... {levels.max():g} is not within 0 ... 1")
    return levels


def wasserstein(a: PDF, b: PDF) -> np.ndarray:
    """Wasserstein-1 distance (T,) of two PDFs at each strain: the integral of |F_a - F_b| over x."""
    gaps = [(np.diff(edge), np.abs(one - two)) for edge, one, two in common_cdfs(a, b)]
    return np.stack([np.sum(0.5 * (gap[1:] + gap[:-1]) * width) for width, gap in gaps])


def common_cdfs(a: PDF, b: PDF) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """At each strain the cell edges of both PDFs, and both distribution functions there."""
    edges = np.sort(np.concatenate([a.edges, b.edges], axis=1), axis=1)
    for k, edge in enumerate(edges):
        yield edge, a.at(k).cdf(edge)[0], b.at(k).cdf(edge)[0]
