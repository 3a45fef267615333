"""The grid of the mixed model against matrices written out, and its variances against a balanced one-way layout."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import dem_like_states, joint_inputs, sobol_normals

from analysis.surrogates import mixed_model


@pytest.fixture(scope="module")
def layout():
    """Forty runs: eight points, each in five packings, with values (2, 40)."""
    rng = np.random.default_rng(2)
    inputs, packing = np.tile(joint_inputs(sobol_normals(8, 1)), (5, 1)), np.repeat(np.arange(5), 8)
    smooth = dem_like_states(inputs)
    values = np.stack([smooth["peak"], smooth["critical"]]) + 0.02 * rng.normal(size=(2, 40))
    return inputs, packing, values + 0.04 * rng.normal(size=(2, 5))[:, packing]


def fitted(layout):
    inputs, packing, values = layout
    return mixed_model.posterior(inputs, np.ones(len(inputs), bool), packing, values)


def written_out(layout, noise, g, curvature):
    """Trend (Q, p), covariance (Q, Q) of the runs over the own variance, and of f, for one cell of the grid."""
    inputs, packing, _ = layout
    basis = mixed_model.basis_of(inputs)
    columns = basis(inputs)
    trend, process = columns[:, : basis.trend], columns[:, basis.trend :]
    phi = process @ basis.features(*mixed_model.KERNELS[g % len(mixed_model.KERNELS)])
    off = phi - trend @ np.linalg.lstsq(trend, phi, rcond=None)[0]
    of_f = mixed_model.CURVATURES[curvature] * (phi @ phi.T) / np.mean(np.sum(off**2, axis=1))
    own = np.exp(2 * noise.growth * columns[:, 1])
    own /= own.mean()
    per_packing = np.mean(np.bincount(packing, 1 / own))
    ratio = (1 / np.sqrt(np.prod(noise.bounds)) - 1) / per_packing
    return trend, np.diag(own) + ratio * (packing[:, None] == packing) + of_f, of_f


CELLS = [(0, 2), (47, 4), (93, 6), (34, 3), (66, 8)]


@pytest.mark.parametrize(("g", "curvature"), CELLS)
def test_a_cell_is_generalised_least_squares_with_its_covariance(layout, g, curvature):
    model = fitted(layout)
    noise, kernel = next((noise, kernel) for k, noise, kernel in model.cells() if k == g)
    trend, covariance, of_f = written_out(layout, noise, g, curvature)
    y = layout[2].T
    inverse = np.linalg.inv(covariance)
    beta = np.linalg.solve(trend.T @ inverse @ trend, trend.T @ inverse @ y)
    f = trend @ beta + of_f @ inverse @ (y - trend @ beta)
    weights = np.eye(len(mixed_model.CURVATURES))[[curvature, curvature]]
    coefficients = (model._gain(weights, g, kernel) * model.scores[g].T) @ kernel.to_coefficients
    found = coefficients @ mixed_model.basis_of(layout[0])(layout[0]).T
    assert found == pytest.approx(f.T, abs=1e-6 * np.ptp(y))
    squares = np.einsum("qt,qr,rt->t", y - trend @ beta, inverse, y - trend @ beta)
    assert model.squares[:, g, curvature] == pytest.approx(squares, rel=1e-6)


def test_weights_are_restricted_likelihoods_with_the_priors(layout):
    model = fitted(layout)
    noises = {k: noise for k, noise, _ in model.cells()}

    def log_likelihood(g, curvature):
        trend, covariance, _ = written_out(layout, noises[g], g, curvature)
        inverse = np.linalg.inv(covariance)
        information = trend.T @ inverse @ trend
        y = layout[2].T
        rest = y - trend @ np.linalg.solve(information, trend.T @ inverse @ y)
        s = np.einsum("qt,qr,rt->t", rest, inverse, rest)
        logs = -0.5 * (np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(information)[1] + model.dof * np.log(s))
        growth = mixed_model.GROWTH_PRIOR[mixed_model.GROWTHS.index(noises[g].growth)]
        low, high = noises[g].bounds
        return logs + np.log(growth * np.log(high / low) * mixed_model._curvature_prior(40)[curvature])

    cells = [c for c in CELLS if np.all(model.weights[:, c[0], c[1]] > 0)] + [(70, 3), (82, 4), (87, 2)]
    with np.errstate(divide="ignore"):
        found = np.stack([np.log(model.weights[:, g, j]) for g, j in cells])
    exact = np.stack([log_likelihood(g, j) for g, j in cells])
    kept = np.isfinite(found).all(axis=1)
    assert kept.sum() >= 2
    assert found[kept] - found[kept][0] == pytest.approx(exact[kept] - exact[kept][0], abs=1e-5)


def test_in_a_balanced_layout_the_variance_of_packings_has_its_closed_form(layout):
    """Without curvature and growth: w(B) ~ B^((R - 1) / 2) (SSW + B SSB)^(-dof / 2), with the sums of ANOVA."""
    inputs, packing, values = layout
    model = fitted(layout)
    basis = mixed_model.basis_of(inputs)
    trend = basis(inputs)[:, : basis.trend]
    of_packing = values.reshape(2, 5, 8).mean(axis=2)
    between = 8 * np.sum((of_packing - of_packing.mean(axis=1, keepdims=True)) ** 2, axis=1)
    rest = values - values @ np.linalg.pinv(trend).T @ trend.T
    within = np.sum(rest**2, axis=1) - between
    middle, found = [], []
    for g, noise, _ in model.cells():
        if noise.growth == 0.0 and g % len(mixed_model.KERNELS) == 0:
            middle.append(np.sqrt(np.prod(noise.bounds)))
            found.append(model.squares[:, g, 0])
    middle = np.array(middle)[:, None]
    assert np.array(found) == pytest.approx(within + middle * between, rel=1e-9)
    assert len(found) >= len(mixed_model.SHRINKAGE) - 1
