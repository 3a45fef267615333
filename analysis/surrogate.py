"""Regression of responses over (mu_s, G_p): what the points say together, without each run's packing noise.

DEM responses are smooth in the inputs, and packing noise is not: a response surface through all points, the same at
every strain, pools them.  Two kinds: polynomials in the standardised logarithms of the inputs, and a Gaussian process.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis import regression

MARGIN = 1.0  # standard deviations (of the log inputs) by which a surface is continued beyond the runs


class SurrogateError(ValueError):
    """Data that no response surface can be fitted to."""


@dataclass(frozen=True)
class Surrogate:
    """Response surface of one response at every strain.

    centre, scale (2,) standardise the logarithms of the inputs; low, high (2,) bound them: beyond, a prediction is that
    of the nearest bound.  terms (M, 2) are the exponents of the polynomial (kind "polynomial") or the points themselves
    with `length` (2,) (kind "gp").  coefficients (T, M); covariance (T, M, M) of the coefficients for unit noise;
    noise (T,) standard deviation of a single run about the surface; dof (T,) degrees of freedom of that estimate;
    loo (T, Q) leave-one-out residuals, NaN where a run is missing; loo_error (T,) their root mean square.
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

    def basis(self, inputs) -> np.ndarray:
        """Values (n, M) of the basis functions at the inputs (n, 2)."""
        z = np.clip((np.log(np.asarray(inputs, float)) - self.centre) / self.scale, self.low, self.high)
        if self.kind == "polynomial":
            return regression.powers(z, self.terms)
        return regression.gp_basis(z, self.terms, self.length)

    def predict(self, inputs) -> np.ndarray:
        """Response (T, n) at the inputs (n, 2) [mu_s, G_p in Pa]."""
        return self.coefficients @ self.basis(inputs).T

    def draws(self, n: int, rng) -> np.ndarray:
        """Coefficients (n, T, M) that the data would also allow: normal, the noise drawn from its own distribution."""
        chi2 = rng.chisquare(self.dof, size=(n, len(self.dof)))
        scale = self.noise * np.sqrt(self.dof / chi2)
        root = np.stack([regression.root(c) for c in self.covariance])
        normal = rng.normal(size=(n, self.coefficients.shape[1]))
        return self.coefficients + scale[:, :, None] * np.einsum("tmk,nk->ntm", root, normal)


def fit(inputs, values, kind: str = "polynomial", max_degree: tuple[int, int] = (4, 2)) -> Surrogate:
    """Response surface through runs at the inputs (Q, 2) [mu_s, G_p in Pa] with the values (T, Q) or (Q,).

    "polynomial": of all exponents up to `max_degree` the set with the least leave-one-out error, relative to the
    scatter at each strain and pooled over the strains, is taken for all strains.  "gp": Gaussian process with a linear
    mean and anisotropic squared-exponential kernel, hyperparameters by the likelihood pooled over strains.
    Runs without a value (NaN) are left out of their strains.  Raises SurrogateError below 5 runs.
    """
    inputs, values = np.asarray(inputs, float), np.atleast_2d(np.asarray(values, float))
    if inputs.ndim != 2 or inputs.shape[1] != 2 or values.shape[1] != len(inputs):
        raise SurrogateError(f"surrogate: inputs {inputs.shape} and values {values.shape} do not belong together")
    if not np.all(inputs > 0):
        raise SurrogateError(f"surrogate: an input is {inputs.min():g}, all must be positive")
    fewest = int(np.isfinite(values).sum(axis=1).min())
    if fewest < 5:
        raise SurrogateError(f"surrogate: a strain has values of {fewest} runs, at least 5 are needed")
    if kind not in ("polynomial", "gp"):
        raise SurrogateError(f"surrogate: kind {kind!r} is not one of polynomial, gp")
    logs = np.log(inputs)
    centre, scale = logs.mean(axis=0), logs.std(axis=0)
    scale = np.where(scale > 1e-12 * np.abs(centre), scale, 1.0)
    z = (logs - centre) / scale
    best = regression.best_polynomial(z, values, max_degree) if kind == "polynomial" else regression.best_gp(z, values)
    return Surrogate(kind, centre, scale, z.min(axis=0) - MARGIN, z.max(axis=0) + MARGIN, **best)


def smoothed(inputs, values, **options) -> tuple[np.ndarray, np.ndarray, Surrogate]:
    """Responses (T, Q) of the surface at the runs' own inputs, with the share (T,) of their variance that is noise.

    The share is noise^2 over the plain variance of the values; options as in `fit`.
    """
    surface = fit(inputs, values, **options)
    scatter = np.nanvar(np.atleast_2d(values), axis=1, ddof=1)
    share = np.where(scatter > 0, surface.noise**2 / np.where(scatter > 0, scatter, 1.0), 0.0)
    return surface.predict(inputs), np.minimum(share, 1.0), surface
