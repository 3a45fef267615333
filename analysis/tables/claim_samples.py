"""What a claim is judged by: one family's points at all densities, denoised, as draws of the model, or as supposed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..pdem import weighted
from ..results.models import curve_model, state_model
from ..results.reader import Results
from ..runs import peak_critical
from ..surrogates.surrogate import Surrogate

#: Half-width, in strain, over which mean curves are smoothed.
SMOOTHER = 0.04
#: Draws of the model.
DRAWS = 200


@dataclass(frozen=True, eq=False)
class Sample:
    """One family's Q points at D densities, with the denoised values (`draw` None) or those of draws of the model.

    Arrays have the densities first.  `draw` is one of DRAWS or a slice of them; with a slice, the values of a state are
    (D, draws, Q) in place of (D, Q), and only the numbers that are distances can be computed.  With a `scale`, the
    fitted values give way to a supposed truth (`supposed`), whose differences between the densities are multiplied by
    it, and the draws (a slice) are their errors about it; `rough` multiplies the part of an error that the points of a
    density do not share.  With one packing, the model does not know what the points share through it: a draw then also
    shifts each density by a normal error, the standard error of one run, as if all of it were shared.
    """

    results: Results
    family: str
    densities: tuple[float, ...]
    draw: int | slice | None = None
    scale: float | None = None
    rough: float = 1.0

    @property
    def probability(self) -> np.ndarray:
        """Probabilities (D, Q) of the points; those of each density sum to 1."""
        return self._once("probability", lambda: self._stack(self.results.probability))

    def inputs(self, name: str) -> np.ndarray:
        """Values (Q,) of mu_s or G_p at the points."""
        return self._once(("inputs", name), lambda: self.results.family_points(self.family)[name])

    def state(self, state: str, symbol: str) -> np.ndarray:
        """Values (D, Q) of a quantity at a state; NaN where there are too few runs for a model."""
        if self.draw is None:
            return self.values(state, symbol)
        return self.values(state, symbol) + self._once(("state", state, symbol), lambda: None)[2][:, self.draw, None]

    def values(self, state: str, symbol: str) -> np.ndarray:
        """Values (D, Q) for numbers that an error which all points of a density share does not change."""
        fitted, drawn, _ = self._once(("state", state, symbol), lambda: self._state(state, symbol))
        if self.scale is None:
            return fitted if self.draw is None else drawn[:, self.draw]
        centre, difference = self._once(
            ("supposed", state, symbol), lambda: supposed(fitted, drawn - fitted[:, None], self.probability)
        )
        truth = centre + self.scale * difference
        if self.draw is None:
            return truth
        error = drawn[:, self.draw] - fitted[:, None]
        shared = np.einsum("dnq,dq->dn", error, self.probability)[..., None]
        return truth[:, None] + shared + self.rough * (error - shared)

    def spread(self, state: str, symbol: str) -> np.ndarray:
        """Standard deviations (D,) of a quantity over the points, or (D, draws) with draws.

        Without draws it is the root mean square of those of the model's draws: the denoised values, which are the mean
        of the draws, scatter less than the true ones.  With a slice of draws it is that of each draw, multiplied so
        that their root mean square is the same.
        """
        _, drawn, _ = self._once(("state", state, symbol), lambda: self._state(state, symbol))
        best = self._once(("spread", state, symbol), lambda: _rms(self._spreads(drawn)))
        if self.draw is None:
            return best
        found = self._spreads(self.values(state, symbol))
        whole = _rms(found)[:, None]
        return best[:, None] * found / np.where(whole > 0, whole, np.nan)

    def _spreads(self, values: np.ndarray) -> np.ndarray:
        """Standard deviations (D, n) over the points of values (D, n, Q)."""
        return weighted.std(values, self.probability[:, None])

    def curve(self, symbol: str) -> np.ndarray:
        """Mean (D, T) of a response along strain."""
        fitted, drawn = self._once(("curve", symbol), lambda: self._curve(symbol))
        return fitted if self.draw is None else drawn[:, self.draw]

    def noise(self, state: str, symbol: str) -> np.ndarray:
        """Standard deviations (D,) of a single run about the denoised values."""
        models = self.models(state, symbol)
        return np.array([np.nan if model is None else model.noise[0] for model in models])

    def models(self, state: str, symbol: str) -> list[Surrogate | None]:
        """The model of a quantity at a state, per density."""
        return [state_model(self.results, state, symbol, mu_iso, self.family) for mu_iso in self.densities]

    def consolidated(self, symbol: str) -> list[tuple[np.ndarray, np.ndarray]]:
        """Values and probabilities after consolidation, one pair per density."""
        return self._once(
            ("consolidated", symbol), lambda: [self.results.consolidated(symbol, mu_iso) for mu_iso in self.densities]
        )

    def smoother(self) -> np.ndarray:
        """Matrix (T, T) that smooths a curve along strain, over 4 % to either side."""
        strain = self.results.strain
        return self._once("smoother", lambda: peak_critical.smooth(strain, np.eye(len(strain)), width=SMOOTHER))

    def _state(self, state: str, symbol: str) -> tuple[np.ndarray, ...]:
        """Denoised values (D, Q), draws (D, DRAWS, Q), and shifts (D, DRAWS) where there is one packing."""
        parts, points = [], self.results.family_points(self.family).x
        for k, model in enumerate(self.models(state, symbol)):
            if model is None:
                unknown = np.full(len(points), np.nan)
                parts.append((unknown, np.tile(unknown, (DRAWS, 1)), np.zeros(DRAWS)))
                continue
            rng, shift = np.random.default_rng([k, *f"{state}/{symbol}".encode()]), np.zeros(DRAWS)
            if model.packings == 1:
                error = self.results.state_error(state, symbol, self.densities[k], self.family)
                scale = np.nan if error is None else np.sqrt(np.nanmean(error**2))
                shift = scale * rng.normal(size=DRAWS)
            parts.append((model.predict(points)[0], model.draws(DRAWS, rng).predict(points)[:, 0], shift))
        return tuple(np.array(part) for part in zip(*parts, strict=True))

    def _curve(self, symbol: str) -> tuple[np.ndarray, np.ndarray]:
        """Denoised means (D, T) and draws (D, DRAWS, T); draws are NaN where packings are not known."""
        parts, points = [], self.results.family_points(self.family).x
        for mu_iso, probability in zip(self.densities, self.probability, strict=True):
            model = curve_model(self.results, symbol, mu_iso, self.family)
            if model is None:
                unknown = np.full(len(self.results.strain), np.nan)
                parts.append((unknown, np.tile(unknown, (DRAWS, 1))))
                continue
            mean = model.basis(points).T @ probability
            drawn = model.draws(DRAWS, np.random.default_rng(1)).coefficients @ mean
            parts.append((model.coefficients @ mean, drawn if model.knows_packings else np.full_like(drawn, np.nan)))
        fitted, drawn = (np.array(part) for part in zip(*parts, strict=True))
        return fitted, drawn

    def _stack(self, read: Callable[..., np.ndarray]) -> np.ndarray:
        return np.array([read(mu_iso, self.family) for mu_iso in self.densities])

    def _once(self, key: Any, make: Callable[[], Any]) -> Any:
        return self.results.cached(("claims", self.family, key), make)


Samples = dict[str, Sample]


def _rms(values: np.ndarray) -> np.ndarray:
    """Root mean square over the last axis."""
    return np.sqrt(np.mean(values**2, axis=-1))


def supposed(fitted: np.ndarray, errors: np.ndarray, probability: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (Q,) of the densities' fitted values (D, Q), and how each density truly differs from it (D, Q).

    A density differs by its mean and by its shape, the rest.  Errors (D, n, Q) make the shapes differ, too; shapes are
    therefore multiplied by the root of the share of their mean square that errors do not explain.
    """
    centre = fitted.mean(axis=0)
    parts = []
    for values in (fitted[:, None] - centre, errors - errors.mean(axis=0)):
        mean = np.einsum("dnq,dq->dn", values, probability)[..., None]
        parts.append((mean, values - mean, np.einsum("dnq,dq->dn", (values - mean) ** 2, probability).mean()))
    (mean, shape, found), (_, _, by_errors) = parts
    share = 1.0 - by_errors / found if found > by_errors else 0.0
    return centre, (mean + np.sqrt(share) * shape)[:, 0]


def sample(results: Results, family: str, draw: int | None = None) -> Sample:
    """The points of a family, denoised or as one draw of the model."""
    return Sample(results, family, results.family_densities(family), draw)
