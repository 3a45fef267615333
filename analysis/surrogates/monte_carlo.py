"""Monte Carlo through a response surface: the reference for PDEM, with the same kind of result."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from ..pdem.pdf import PDF
from .surrogate import Surrogate

_CHUNK = 2_000_000  # predictions in memory at a time


def monte_carlo(
    surface: Surrogate,
    samples: ArrayLike,
    strain: ArrayLike,
    like: PDF | None = None,
    cells: int = 400,
    noise: ArrayLike | None = None,
    rng: np.random.Generator | None = None,
) -> PDF:
    """PDF of a response along strain from samples (n, d) of the inputs and a Surrogate: denoised without `noise`.

    strain (T,).  The cells are those of `like`, extended if samples fall outside, or else `cells` equal ones over the
    range.  noise (T,), e.g. `surface.noise`, adds a normal scatter of that standard deviation to every sample,
    with `rng`: as simulated.
    The PDF is a histogram without a kernel: bandwidth 0, spacing = cell width.  n = 10^6 takes seconds.
    Raises ValueError without samples, if strain does not fit the surface, or for noise without rng.
    """
    samples, strain = np.asarray(samples, float), np.asarray(strain, float)
    rows = len(surface.coefficients)
    if rows != len(strain):
        raise ValueError(f"monte_carlo: the surface has {rows} strains, {len(strain)} were given")
    if not len(samples):
        raise ValueError("monte_carlo: there are no samples")
    if noise is not None and rng is None:
        raise ValueError("monte_carlo: noise needs an rng")
    size = max(1, _CHUNK // rows)
    chunks = [samples[k : k + size] for k in range(0, len(samples), size)]
    seeds = np.zeros(len(chunks)) if rng is None else rng.integers(2**63, size=len(chunks))

    def values() -> Iterator[np.ndarray]:
        for chunk, seed in zip(chunks, seeds, strict=True):
            y = surface.predict(chunk)
            if noise is not None:
                scatter = np.broadcast_to(np.asarray(noise, float), (rows,))[:, None]
                y += scatter * np.random.default_rng(seed).normal(size=y.shape)
            yield y

    low, high = np.inf, -np.inf
    mean, square = np.zeros(rows), np.zeros(rows)
    middle = np.zeros((rows, 1))
    for k, y in enumerate(values()):
        middle = y.mean(axis=1, keepdims=True) if k == 0 else middle
        low, high = min(low, y.min()), max(high, y.max())
        y -= middle
        mean, square = mean + y.sum(axis=1) / len(samples), square + np.sum(y * y, axis=1) / len(samples)
    left, dx, cells = _cells(low, high, like, cells)
    counts = np.zeros(rows * cells)
    for y in values():
        y -= left
        y *= 1.0 / dx
        place = np.clip(y.astype(np.int32), 0, cells - 1) + cells * np.arange(rows, dtype=np.int64)[:, None]
        counts += np.bincount(place.ravel(), minlength=len(counts))
    zeros = np.zeros(rows)
    return PDF(
        strain=strain,
        x=left + dx * (np.arange(cells) + 0.5),
        p=counts.reshape(rows, cells) / (len(samples) * dx),
        mean=mean + middle[:, 0],
        std=np.sqrt(np.maximum(square - mean**2, 0.0)),
        bandwidth=zeros,
        method="monte-carlo",
        lost_probability=zeros,
        numerical_width=zeros,
        spacing=np.full(rows, dx),
    )


def _cells(low: float, high: float, like: PDF | None, cells: int) -> tuple[float, float, int]:
    """Left edge, width and number of the cells."""
    if like is None or like.x.ndim != 1:
        span = (high - low) or abs(high) * 1e-3 or 1.0
        return low - 0.01 * span, 1.02 * span / cells, cells
    dx = like.dx[0]
    left = like.x[0] - 0.5 * dx
    before = max(0, int(np.ceil((left - low) / dx)))
    after = max(0, int(np.ceil((high - (left + dx * len(like.x))) / dx)))
    return left - before * dx, dx, len(like.x) + before + after
