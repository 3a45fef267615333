"""Regression of responses over (mu_s, G_p), which separates the smooth response from the packing noise of each run.

DEM responses are smooth in the inputs and packing noise is not, so a response surface with the same terms at every
strain pools all points.  Two kinds: polynomials in the standardised logarithms of the inputs, and a Gaussian process.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors_and_files import GrainScatterError
from . import regression

#: Runs below which no error is claimed from a response surface.
FEWEST_RUNS = 12
#: Factor on claimed errors: the draws do not include that the terms of the surface were chosen from the same data.
SAFETY = 1.1
#: Standard deviations (of the logarithms of the inputs) by which a surface is continued beyond the runs.
MARGIN = 1.0
#: Degrees of freedom of a noise that is known from elsewhere: as good as infinite.
KNOWN = 1e9


class SurrogateError(GrainScatterError):
    """Data to which no response surface can be fitted."""


@dataclass(frozen=True)
class Surrogate:
    """Response surface of one response at every strain.

    centre, scale (2,) standardise the logarithms of the inputs; low, high (2,) bound them: beyond a bound the surface
    has the value at the bound.  terms (M, 2) are the exponents of the polynomial (kind "polynomial"), or the points
    with correlation lengths `length` (2,) (kind "gp").  coefficients (T, M); covariance (T, M, M) of the coefficients
    for unit noise; noise (T,) standard deviation of a single run about the surface; dof (T,) degrees of freedom of that
    estimate; loo (T, Q) leave-one-out residuals, NaN where a run is missing; loo_error (T,) their root mean square.
    """

    kind: str
    centre: np.ndarray
    scale: np.ndarray
    low: np.ndarray
    high: np.ndarray
    terms: np.ndarray
    length: np.ndarray
    coefficients: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    dof: np.ndarray
    loo: np.ndarray
    loo_error: np.ndarray

    def basis(self, inputs: ArrayLike) -> np.ndarray:
        """Values (n, M) of the basis functions at the inputs (n, 2)."""
        z = np.clip((np.log(np.asarray(inputs, float)) - self.centre) / self.scale, self.low, self.high)
        if self.kind == "polynomial":
            return regression.powers(z, self.terms)
        return regression.gp_basis(z, self.terms, self.length)

    def predict(self, inputs: ArrayLike) -> np.ndarray:
        """Response (T, n) at the inputs (n, 2) [mu_s, G_p in Pa]."""
        return self.coefficients @ self.basis(inputs).T

    def draws(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Coefficients (n, T, M) drawn from their distribution given the runs.

        They are normal with the covariance for a noise that is itself drawn (scaled inverse chi-square, `dof`).
        """
        chi2 = rng.chisquare(self.dof, size=(n, len(self.dof)))
        scale = self.noise * np.sqrt(self.dof / chi2)
        root = np.stack([regression.root(c) for c in self.covariance])
        normal = rng.normal(size=(n, self.coefficients.shape[1]))
        return self.coefficients + scale[:, :, None] * np.einsum("tmk,nk->ntm", root, normal)

    def with_known_noise(self, noise: ArrayLike) -> Surrogate:
        """The surface with a standard deviation `noise` (T,) of a single run that is known, e.g. from replicates."""
        return replace(self, noise=np.asarray(noise, float), dof=self.dof * 0 + KNOWN)


def fit(
    inputs: ArrayLike, values: ArrayLike, kind: str = "polynomial", max_degree: tuple[int, int] = (4, 2)
) -> Surrogate:
    """Response surface through runs at the inputs (Q, 2) [mu_s, G_p in Pa] with the values (T, Q) or (Q,).

    "polynomial": among all sets of exponents up to `max_degree`, the one with the least leave-one-out error (relative
    to the scatter at each strain and pooled over the strains) is used at all strains.  "gp": Gaussian process with a
    linear mean and an anisotropic squared-exponential kernel; hyperparameters from the likelihood of all strains.
    A run without a value (NaN) is left out at that strain.  Raises SurrogateError for fewer than 5 runs at a strain,
    arrays that do not match, inputs that are not positive, or an unknown kind.
    """
    inputs, values = np.asarray(inputs, float), np.atleast_2d(np.asarray(values, float))
    if inputs.ndim != 2 or inputs.shape[1] != 2 or values.shape[1] != len(inputs):
        raise SurrogateError(f"surrogate: inputs {inputs.shape} and values {values.shape} do not match")
    if not np.all(inputs > 0):
        raise SurrogateError(f"surrogate: an input is {inputs.min():g}, all must be positive")
    fewest = int(np.isfinite(values).sum(axis=1).min())
    if fewest < 5:
        raise SurrogateError(f"surrogate: one strain has values of {fewest} runs, at least 5 are needed")
    if kind not in ("polynomial", "gp"):
        raise SurrogateError(f"surrogate: kind {kind!r} is not one of polynomial, gp")
    logs = np.log(inputs)
    centre, scale = logs.mean(axis=0), logs.std(axis=0)
    scale = np.where(scale > 1e-12 * np.abs(centre), scale, 1.0)
    z = (logs - centre) / scale
    best = regression.best_polynomial(z, values, max_degree) if kind == "polynomial" else regression.best_gp(z, values)
    low, high = z.min(axis=0) - MARGIN, z.max(axis=0) + MARGIN
    return Surrogate(kind=kind, centre=centre, scale=scale, low=low, high=high, **best)


def smoothed(inputs: ArrayLike, values: ArrayLike, **options: Any) -> tuple[np.ndarray, np.ndarray, Surrogate]:
    """Responses (T, Q) of the surface at the inputs of the runs, the share (T,) of noise in the variance, the surface.

    The share is noise^2 divided by the variance of the values, at most 1; options as in `fit`.
    """
    surface = fit(inputs, values, **options)
    scatter = np.nanvar(np.atleast_2d(values), axis=1, ddof=1)
    share = np.where(scatter > 0, surface.noise**2 / np.where(scatter > 0, scatter, 1.0), 0.0)
    return surface.predict(inputs), np.minimum(share, 1.0), surface


def fill(inputs: ArrayLike, values: ArrayLike, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """Values (T, Q) whose missing ones come from the response surface through the others, and their mask (T, Q).

    Options and errors as in `fit`.
    """
    values = np.atleast_2d(np.asarray(values, float))
    missing = ~np.isfinite(values)
    surface = fit(inputs, values, **options)
    return np.where(missing, surface.predict(inputs), values), missing
