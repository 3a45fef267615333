"""One model for every response, state and strain: y = f(inputs) + packing + own noise of a run.

The fit separates what the inputs do (f, "denoised") from what the packing and the run add.  It gives f with its error,
and the standard deviations of both kinds of noise with their intervals (`mixed_model` has the equations).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors_and_files import GrainScatterError
from . import mixed_model
from .basis import Basis, fewest_fitted

#: Packings below which the error that the runs share through their packings is not judged.
FEWEST_PACKINGS = 3
LEVEL = 0.95
_DRAWS = 1000


class SurrogateError(GrainScatterError):
    """Data to which no response surface can be fitted."""


@dataclass(frozen=True)
class Draws:
    """Models that are as plausible as the fitted one, given the runs.

    coefficients (n, T, M) of f; noise_packing and noise_own (n, T): standard deviations, as in `Surrogate`; growth
    (n, T): the own noise is proportional to exp(growth u1), with u1 the standardised ln mu_s.
    """

    basis: Basis
    coefficients: np.ndarray
    noise_packing: np.ndarray
    noise_own: np.ndarray
    growth: np.ndarray

    @property
    def noise(self) -> np.ndarray:
        """Standard deviations (n, T) of a single run about f."""
        return np.hypot(np.nan_to_num(self.noise_packing), self.noise_own)

    def __getitem__(self, k: int) -> Draws:
        """One draw, with coefficients (T, M) and noise (T,)."""
        return Draws(self.basis, self.coefficients[k], self.noise_packing[k], self.noise_own[k], self.growth[k])

    def predict(self, inputs: ArrayLike) -> np.ndarray:
        """f (n, T, m) at the inputs (m, d)."""
        return self.coefficients @ self.basis(inputs).T


@dataclass(frozen=True)
class Surrogate:
    """Mixed model of rows (T,), e.g. one response at every strain, from runs (Q,).

    coefficients (T, M): mean of f.  packings: number of packings, 1 where they are not known.  noise_packing (T,) and
    noise_own (T,): standard deviations that packings add to all their runs and that each run adds by itself; noise (T,)
    of a single run about f, both together; *_interval (T, 2): their 95 % intervals.  They are root mean squares over
    the runs: the own noise is proportional to exp(growth u1), growth (T,), with u1 the standardised ln mu_s.  With one
    packing, noise_packing is not known (NaN), and f contains the effect of this packing.  With one run per packing,
    only the sum of both is known (`noise`).  loo (T, Q): leave-one-out residuals, NaN where a run is missing; loo_error
    (T,) their root mean square.
    """

    basis: Basis
    coefficients: np.ndarray
    packings: int
    noise_packing: np.ndarray
    noise_own: np.ndarray
    noise: np.ndarray
    packing_interval: np.ndarray
    own_interval: np.ndarray
    noise_interval: np.ndarray
    growth: np.ndarray
    loo: np.ndarray
    loo_error: np.ndarray
    parts: list[tuple[np.ndarray, mixed_model.Posterior]]

    @property
    def knows_packings(self) -> bool:
        """Whether the error of f contains what the runs share through their packings."""
        return self.packings >= FEWEST_PACKINGS

    def predict(self, inputs: ArrayLike) -> np.ndarray:
        """Mean of f (T, n) at the inputs (n, d)."""
        return self.coefficients @ self.basis(inputs).T

    def draws(self, n: int, rng: np.random.Generator) -> Draws:
        """n draws of the model from its distribution given the runs."""
        return _draws(self.basis, self.parts, len(self.coefficients), n, rng)


def fit(inputs: ArrayLike, values: ArrayLike, packing: ArrayLike | None = None) -> Surrogate:
    """Model of runs at the inputs (Q, d), such as mu_s and G_p in Pa, with the values (T, Q) or (Q,).

    packing (Q,): the packing of each run, any labels; None: one packing for all.  A run without a value (NaN) is left
    out at that row.  Raises SurrogateError for fewer than `fewest_fitted` runs at a row, arrays that do not match, or
    inputs that are not positive.
    """
    inputs, values = np.asarray(inputs, float), np.atleast_2d(np.asarray(values, float))
    labels = np.zeros(len(inputs)) if packing is None else np.asarray(packing)
    if inputs.ndim != 2 or inputs.shape[1] < 1 or values.shape[1] != len(inputs) or labels.shape != (len(inputs),):
        raise SurrogateError(
            f"surrogate: inputs {inputs.shape}, values {values.shape} and packing {labels.shape} do not match"
        )
    if not np.all(inputs > 0):
        raise SurrogateError(f"surrogate: an input is {inputs.min():g}, all must be positive")
    fewest = int(np.isfinite(values).sum(axis=1).min())
    needed = fewest_fitted(inputs.shape[1])
    if fewest < needed:
        raise SurrogateError(f"surrogate: one row has values of {fewest} runs, at least {needed} are needed")
    codes = np.unique(labels, return_inverse=True)[1].ravel()
    basis = mixed_model.basis_of(inputs)
    patterns, which = np.unique(np.isfinite(values), axis=0, return_inverse=True)
    loo, parts, separate = np.full(values.shape, np.nan), [], np.zeros(len(values), bool)
    for k, known in enumerate(patterns):
        rows, counts = np.flatnonzero(which.ravel() == k), np.unique(codes[known], return_counts=True)[1]
        separate[rows] = 1 < len(counts) < known.sum()
        part = mixed_model.posterior(inputs, known, codes[known] if separate[rows[0]] else None,
                                     values[np.ix_(rows, known)])  # fmt: skip
        loo[np.ix_(rows, known)] = part.loo
        parts.append((rows, part))
    packings = len(np.unique(labels))
    draws = _draws(basis, parts, len(values), _DRAWS, np.random.default_rng(0), noise_only=True)
    ends = [0.5 - LEVEL / 2, 0.5, 0.5 + LEVEL / 2]
    sums = np.quantile(draws.noise, ends, axis=0)
    of_packing, own = (np.where(separate, np.quantile(np.nan_to_num(noise), ends, axis=0), np.nan)
                       for noise in (draws.noise_packing, draws.noise_own))  # fmt: skip
    if packings == 1:
        own = sums
    coefficients = np.zeros((len(values), basis.size))
    for rows, part in parts:
        coefficients[rows] = part.mean()
    return Surrogate(
        basis=basis,
        coefficients=coefficients,
        packings=packings,
        noise_packing=of_packing[1],
        noise_own=own[1],
        noise=sums[1],
        packing_interval=of_packing[[0, 2]].T,
        own_interval=own[[0, 2]].T,
        noise_interval=sums[[0, 2]].T,
        growth=draws.growth.mean(axis=0),
        loo=loo,
        loo_error=np.sqrt(np.nanmean(loo**2, axis=1)),
        parts=parts,
    )


def _draws(basis, parts, rows, n, rng, noise_only=False):
    """n draws of all rows; every part has the same random numbers."""
    seed = int(rng.integers(2**63))
    coefficients = np.zeros((n, rows, 0 if noise_only else basis.size))
    noises = np.zeros((3, n, rows))
    for at, part in parts:
        coefficients[:, at], *noise = part.draws(n, np.random.default_rng(seed), noise_only)
        noises[:, :, at] = noise
    return Draws(basis, coefficients, *noises)


def fill(inputs: ArrayLike, values: ArrayLike, packing: ArrayLike | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Values (T, Q) whose missing ones come from f through the others, and their mask (T, Q).

    Arguments and errors as in `fit`.
    """
    values = np.atleast_2d(np.asarray(values, float))
    missing = ~np.isfinite(values)
    return np.where(missing, fit(inputs, values, packing).predict(inputs), values), missing
