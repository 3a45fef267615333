"""The basis of f over one, two, three and more inputs, and models of known functions of them."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import joint_inputs, sobol_normals
from other_inputs import joint_of, points_of

from analysis.surrogates import basis as bases
from analysis.surrogates import rotation, surrogate
from analysis.surrogates.surrogate import SurrogateError

THREE = ("mu_s", "G_p", "nu")


def test_two_inputs_have_the_plane_a_bend_and_one_grid():
    inputs = joint_inputs(sobol_normals(40, 1))
    basis = bases.basis_of(inputs)
    assert (basis.size, basis.trend, basis.pairs) == (4 + 13 * 9, 4, [(0, 1)])
    logs = np.log(inputs)
    first = (logs[:, 0] - logs[:, 0].mean()) / logs[:, 0].std()
    slope, _ = np.polyfit(logs[:, 0], logs[:, 1], 1)
    rest = logs[:, 1] - logs[:, 1].mean() - slope * (logs[:, 0] - logs[:, 0].mean())
    columns = basis(inputs)
    assert columns[:, 1] == pytest.approx(first) and columns[:, 2] == pytest.approx(rest / rest.std())
    assert columns[:, 3] == pytest.approx(first**2) and columns[:, 4:].sum(axis=1) == pytest.approx(np.ones(40))
    assert (bases.fewest_runs(2), bases.fewest_fitted(2)) == (12, 5)


@pytest.mark.parametrize(("names", "size"), [(("mu_s",), 4 + 13), (THREE, 5 + 13 * 9 + 13 * 7 + 9 * 7)])
def test_the_number_of_terms_follows_the_number_of_inputs(names, size):
    x = points_of(names, 30).x
    basis = bases.basis_of(x)
    assert basis.size == size == basis(x).shape[1]
    u = basis(x)[:, 1 : 1 + len(names)]
    assert u.mean(axis=0) == pytest.approx(np.zeros(len(names)), abs=1e-9)
    assert np.cov(u.T, bias=True) == pytest.approx(np.eye(len(names)) if len(names) > 1 else 1.0, abs=1e-9)
    factor = basis.features("smooth", 1.5)
    assert factor.shape[0] == size - basis.trend


def test_one_input_gives_the_model_of_two_of_which_one_is_constant():
    x = points_of(("mu_s",), 12).x
    y = x[:, 0] / (x[:, 0] + 0.06) + 0.01 * np.random.default_rng(1).normal(size=12)
    alone = surrogate.fit(x, y, np.arange(12) % 4)
    both = surrogate.fit(np.column_stack([x, np.full(12, 29e9)]), y, np.arange(12) % 4)
    at = np.geomspace(0.1, 0.6, 9)
    assert alone.predict(at[:, None]) == pytest.approx(both.predict(np.column_stack([at, np.full(9, 29e9)])), abs=1e-9)
    assert alone.noise == pytest.approx(both.noise)


def test_a_function_of_three_inputs_is_found_again_with_its_noise():
    chosen = points_of(THREE, 40)
    packing = rotation.deal(chosen.x, 8)

    def f(x):
        stiff = (x[:, 1] / 29e9) ** 0.57 * (0.8 / (1.0 - x[:, 2])) ** 0.6
        return np.stack([0.86 * x[:, 0] / (x[:, 0] + 0.06), 170.0 * stiff * (1.0 - 0.2 * x[:, 0])])

    samples = joint_of(THREE).sample(500, np.random.default_rng(2))
    spread, true = f(samples).std(axis=1), f(samples)
    rng = np.random.default_rng(3)
    model = surrogate.fit(chosen.x, f(chosen.x) + 0.1 * spread[:, None] * rng.normal(size=(2, 40)), packing)
    errors = np.sqrt(np.mean((model.predict(samples) - true) ** 2, axis=1)) / spread
    assert np.all(errors < 0.12) and model.noise == pytest.approx(0.1 * spread, rel=0.4)
    mean = model.draws(200, rng).predict(samples).mean(axis=2)
    low, high = np.quantile(mean, [0.025, 0.975], axis=0)
    assert np.all((low < true.mean(axis=1)) & (true.mean(axis=1) < high))


def test_more_inputs_need_more_runs():
    assert [bases.fewest_runs(d) for d in (1, 2, 3, 6)] == [12, 12, 16, 28]
    assert [bases.fewest_fitted(d) for d in (1, 2, 3, 6)] == [5, 5, 6, 9]
    x = points_of(THREE, 8).x[:5]
    with pytest.raises(SurrogateError, match="values of 5 runs, at least 6 are needed"):
        surrogate.fit(x, np.ones(5))
    with pytest.raises(SurrogateError, match="do not match"):
        surrogate.fit(np.empty((5, 0)), np.ones(5))
