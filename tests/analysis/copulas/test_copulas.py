"""Copulas against extended precision, calculus and their own symmetries."""

from __future__ import annotations

import json

import numpy as np
import pytest
from copula_cases import CASES, U, V
from paths import PAIRS_FILE
from scipy import optimize, special, stats

from analysis import copulas
from analysis.copulas import Copula, CopulaError, elliptical
from analysis.copulas.multivariate import (
    GaussianCopula,
    StudentCopula,
    _loglik,
    fit_gaussian,
    from_dict,
    most_likely,
    student_of_known_degrees,
)
from analysis.inputs.pairs import read_pairs

PAIRS = read_pairs(PAIRS_FILE)


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]}{case[1]}")
def copula(request):
    return Copula(*request.param)


def inside(count=400, seed=1):
    return np.random.default_rng(seed).uniform(0.02, 0.98, (2, count))


def test_the_conditional_is_the_slope_of_the_distribution(copula):
    u, v = inside()
    h = 1e-4
    points = [copula.cdf(u + k * h, v) for k in (-2, -1, 1, 2)]
    slope = (points[0] - 8 * points[1] + 8 * points[2] - points[3]) / (12 * h)
    assert copula.conditional(u, v) == pytest.approx(slope, abs=1e-8)


def test_the_pdf_is_the_slope_of_the_conditional(copula):
    u, v = inside(seed=2)
    h = 1e-4
    points = [copula.conditional(u, v + k * h) for k in (-2, -1, 1, 2)]
    slope = (points[0] - 8 * points[1] + 8 * points[2] - points[3]) / (12 * h)
    assert copula.pdf(u, v) == pytest.approx(slope, rel=1e-4, abs=1e-8)


def test_the_distribution_has_uniform_margins_and_bounds(copula):
    u, v = inside(seed=3)
    assert copula.cdf(u, np.ones_like(u)) == pytest.approx(u, abs=1e-12)
    assert copula.cdf(np.ones_like(v), v) == pytest.approx(v, abs=1e-12)
    assert copula.cdf(u, np.zeros_like(u)) == pytest.approx(0.0, abs=1e-12)
    value = copula.cdf(U, V)
    assert np.all(value >= np.maximum(U + V - 1.0, 0.0) - 1e-12)
    assert np.all(value <= np.minimum(U, V) + 1e-12)


def test_inverse_undoes_conditional_into_the_corners(copula):
    v = copula.inverse(U, V)
    rounding = 4.0 * copula.pdf(U, v) * np.spacing(v)
    assert np.all(np.abs(copula.conditional(U, v) - V) < 1e-8 + rounding)
    assert np.all(np.isfinite(copula.logpdf(U, V)))


def test_samples_have_the_closed_form_tau(copula):
    sample = copula.sample(6000, np.random.default_rng(7))
    assert sample.min() > 0.0 and sample.max() < 1.0
    assert stats.kendalltau(*sample.T)[0] == pytest.approx(copula.tau, abs=0.03)
    assert stats.kstest(copula.rosenblatt(sample)[:, 1], "uniform").pvalue > 1e-3


def test_tau_is_the_integral_of_the_conditionals(copula):
    t, w = np.polynomial.legendre.leggauss(60)
    edges = special.ndtr(np.linspace(-6, 6, 13))
    u = (0.5 * np.diff(edges)[:, None] * (t + 1) + edges[:-1, None]).ravel()
    w = (0.5 * np.diff(edges)[:, None] * w).ravel()
    a, b = np.meshgrid(u, u, indexing="ij")
    base = Copula(copula.family.rstrip("0123456789"), copula.parameters)
    du = base.conditional(a, b)
    tau = 1.0 - 4.0 * np.sum(np.outer(w, w) * du * du.T)
    assert abs(copula.tau) == pytest.approx(abs(tau), abs=1e-5)


def naive(family: str, u, v, theta):
    """Textbook log PDF, distribution and conditional in extended precision, without any care for the corners."""
    u, v, theta = np.longdouble(u), np.longdouble(v), np.longdouble(theta)
    one = np.longdouble(1)
    if family == "frank":
        g = np.expm1(-theta)
        a, b = np.expm1(-theta * u), np.expm1(-theta * v)
        pdf = -theta * g * np.exp(-theta * (u + v)) / (g + a * b) ** 2
        return np.log(pdf), -np.log1p(a * b / g) / theta, np.exp(-theta * u) * b / (g + a * b)
    if family == "plackett":
        eta = theta - 1
        s = 1 + eta * (u + v)
        r2 = s * s - 4 * u * v * theta * eta
        logpdf = np.log(theta * (1 + eta * (u + v - 2 * u * v))) - 1.5 * np.log(r2)
        return logpdf, (s - np.sqrt(r2)) / (2 * eta), 0.5 - (1 + eta * u - (theta + 1) * v) / (2 * np.sqrt(r2))
    if family == "clayton":
        s = u**-theta + v**-theta - 1
        logpdf = np.log1p(theta) - (1 + theta) * (np.log(u) + np.log(v)) - (2 + 1 / theta) * np.log(s)
        return logpdf, s ** (-1 / theta), u ** (-theta - 1) * s ** (-1 / theta - 1)
    if family == "gumbel":
        x, y = -np.log(u), -np.log(v)
        t = (x**theta + y**theta) ** (1 / theta)
        logpdf = x + y - t + (theta - 1) * np.log(x * y) + (1 - 2 * theta) * np.log(t) + np.log(t + theta - 1)
        return logpdf, np.exp(-t), np.exp(x - t) * (x / t) ** (theta - 1)
    a, b = (one - u) ** theta, (one - v) ** theta
    s = a + b - a * b
    logpdf = (1 / theta - 2) * np.log(s) + (theta - 1) * np.log((one - u) * (one - v)) + np.log(theta - 1 + s)
    return logpdf, 1 - s ** (1 / theta), s ** (1 / theta - 1) * (one - u) ** (theta - 1) * (1 - b)


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="needs 80-bit long doubles")
@pytest.mark.parametrize(
    ("family", "theta"),
    [("frank", -5.4), ("frank", 12.0), ("plackett", 0.09), ("plackett", 7.0)]
    + [("clayton", 2.0), ("gumbel", 1.7), ("gumbel", 5.0), ("joe", 2.3), ("joe", 6.0)],
)
def test_closed_forms_hold_to_1e_8_in_the_corners(family, theta):
    with np.errstate(over="ignore"):
        logpdf, cdf, conditional = (np.asarray(value, dtype=float) for value in naive(family, U, V, theta))
    copula = Copula(family, (theta,))
    sound = np.isfinite(logpdf)
    assert sound.mean() > 0.9
    assert copula.logpdf(U, V)[sound] == pytest.approx(logpdf[sound], abs=1e-8)
    assert copula.cdf(U, V) == pytest.approx(cdf, abs=1e-10)
    assert copula.conditional(U, V) == pytest.approx(conditional, abs=1e-8)


def test_the_gaussian_distribution_meets_owens_t():
    off_centre = (U != 0.5) | (V != 0.5)
    u, v = U[off_centre], V[off_centre]
    x, y = special.ndtri(u), special.ndtri(v)
    for rho in (-0.738, 0.3, 0.95):
        a, b = ((s - rho * t) / (t * np.sqrt(1 - rho**2)) for s, t in ((y, x + 1e-300), (x, y + 1e-300)))
        lower = np.where((x * y > 0) | ((x * y == 0) & (x + y >= 0)), 0.0, 0.5)
        exact = 0.5 * (u + v) - special.owens_t(x, a) - special.owens_t(y, b) - lower
        assert Copula("gaussian", (rho,)).cdf(u, v) == pytest.approx(exact, abs=1e-13)
        assert Copula("gaussian", (rho,)).cdf(0.5, 0.5) == pytest.approx(0.25 + np.arcsin(rho) / (2 * np.pi), abs=1e-14)


def test_student_scores_are_quantiles_far_into_the_tail():
    tail = np.concatenate([10.0 ** -np.linspace(0.31, 100, 500), np.linspace(0.01, 0.5, 99)])
    for nu in (1.0, 2.5, 6.05, 40.0, 201.0):
        score = elliptical.student_score(tail, 1.0 - tail, nu)
        assert special.stdtr(nu, score) / tail == pytest.approx(np.ones(599), abs=1e-9)
        assert elliptical.student_score(1.0 - tail, tail, nu) == pytest.approx(-score, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("family", ["gaussian", "frank", "plackett", "clayton90", "gumbel270", "joe90", "student"])
def test_the_fit_finds_its_parameter(family):
    truth = dict(CASES).get(family) or {"clayton90": (2.0,), "gumbel270": (1.7,), "joe90": (2.3,)}[family]
    sample = Copula(family, truth).sample(4000, np.random.default_rng(11))
    fit = copulas.fit(*sample.T, family)
    assert abs(fit.parameters[0] - truth[0]) < 3.5 * fit.se[0]
    low, high = fit.interval[0]
    assert low < fit.parameters[0] < high
    u, v = (copulas.pseudo_observations(column) for column in sample.T)
    for shift in (-1e-3, 1e-3):
        moved = Copula(family, (fit.parameters[0] * (1 + shift), *fit.parameters[1:]))
        assert moved.logpdf(u, v).sum() < fit.loglik
    assert fit.aic == pytest.approx(2 * len(truth) - 2 * fit.loglik)


def test_many_fits_at_once_are_the_single_fits():
    samples = Copula("student", (-0.6, 5.0)).sample(94 * 6, np.random.default_rng(2)).reshape(6, 94, 2)
    u, v = (copulas.pseudo_observations(samples[..., i]) for i in (0, 1))
    for family in ("gaussian", "student", "frank", "plackett", "clayton90", "gumbel270", "joe90"):
        together = copulas.fit_rows(u, v, family)[:, 0]
        alone = [copulas.fit(a, b, family).parameters[0] for a, b in zip(u, v, strict=True)]
        assert together == pytest.approx(alone, rel=2e-3 if family == "student" else 1e-6)


def test_property_monotone_rescaling_and_relabelling_change_nothing():
    rng = np.random.default_rng(3)
    for _ in range(5):
        x, y = Copula("gaussian", (rng.uniform(-0.8, 0.8),)).sample(40, rng).T
        a, b, order = rng.uniform(0.5, 3.0), rng.uniform(0.5, 3.0), rng.permutation(40)
        for family in ("gaussian", "student", "frank", "plackett"):
            fit = copulas.fit(x, y, family)
            other = copulas.fit(np.exp(a * x)[order], (5.0 + y[order]) ** b, family)
            assert other.parameters == pytest.approx(fit.parameters, rel=1e-6)
            assert other.loglik == pytest.approx(fit.loglik, abs=1e-8)
            swapped = copulas.fit(y, x, family)
            assert swapped.parameters == pytest.approx(fit.parameters, rel=1e-5)


def test_property_reflections_turn_the_rotations():
    rng = np.random.default_rng(4)
    for base in ("clayton", "gumbel", "joe"):
        x, y = Copula(base, (2.0,)).sample(60, rng).T
        theta = copulas.fit(x, y, base).parameters
        assert copulas.fit(-x, y, f"{base}90").parameters == pytest.approx(theta, rel=1e-6)
        assert copulas.fit(-x, -y, f"{base}180").parameters == pytest.approx(theta, rel=1e-6)
        assert copulas.fit(x, -y, f"{base}270").parameters == pytest.approx(theta, rel=1e-6)
        u, v = inside(50)
        assert Copula(base, (2.0,)).logpdf(u, v) == pytest.approx(Copula(base, (2.0,)).logpdf(v, u), rel=1e-9)


def test_ties_and_duplicates_get_mid_ranks():
    assert copulas.pseudo_observations([3.0, 1.0, 3.0, 2.0]) == pytest.approx(np.array([3.5, 1.0, 3.5, 2.0]) / 5)
    x, y = Copula("gaussian", (0.6,)).sample(50, np.random.default_rng(5)).T
    rounded = copulas.fit(np.round(x, 1), np.round(y, 1), "gaussian")
    twice = copulas.fit(np.tile(x, 2), np.tile(y, 2), "gaussian")
    assert rounded.parameters[0] == pytest.approx(copulas.fit(x, y, "gaussian").parameters[0], abs=0.08)
    assert twice.parameters[0] == pytest.approx(copulas.fit(x, y, "gaussian").parameters[0], abs=0.05)


def test_ten_pairs_are_enough_and_say_how_little_they_know():
    x, y = Copula("gaussian", (-0.7,)).sample(10, np.random.default_rng(6)).T
    fits = copulas.select(x, y, n_boot=50)
    gaussian = next(fit for fit in fits if fit.family == "gaussian")
    assert np.diff(gaussian.interval[0])[0] > 0.3
    assert all(np.isfinite(fit.aic) for fit in fits)


def test_perfect_dependence_stops_at_the_edge():
    x = np.arange(20.0)
    assert copulas.fit(x, x, "gaussian").parameters[0] > 0.95
    assert copulas.fit(x, -x, "frank").parameters[0] < -20


@pytest.mark.parametrize(
    ("x", "y", "family", "words"),
    [
        (np.arange(9.0), -np.arange(9.0), "clayton", "turn it by 90 or 270 degrees"),
        (np.arange(9.0), np.arange(9.0), "joe90", "turn it by 0 or 180 degrees"),
        (np.ones(9), np.arange(9.0), "gaussian", "one column is constant"),
        (np.array([1.0, np.nan, 3, 4, 5]), np.arange(5.0), "frank", "not finite"),
        (np.array([1.0, np.inf, 3, 4, 5]), np.arange(5.0), "frank", "not finite"),
        (np.arange(4.0), np.arange(4.0), "gaussian", "at least 5"),
        (np.arange(9.0), np.arange(8.0), "gaussian", "same length"),
        (np.arange(9.0), np.arange(9.0), "normal", "unknown copula family 'normal'"),
    ],
)
def test_what_cannot_be_fitted_is_refused(x, y, family, words):
    with pytest.raises(CopulaError, match=words):
        copulas.fit(x, y, family)


def test_parameters_and_probabilities_are_checked():
    with pytest.raises(CopulaError, match="rho = 1.2 is outside"):
        Copula("gaussian", (1.2,))
    with pytest.raises(CopulaError, match="expected 2 parameters"):
        Copula("student", (0.5,))
    with pytest.raises(CopulaError, match="probabilities"):
        Copula("gaussian", (0.5,)).cdf(1.5, 0.5)


def test_table_2_comes_back_from_the_reconstructed_pairs():
    fits = copulas.select(*PAIRS.T, n_boot=200)
    best, note = copulas.choose(fits)
    table = {fit.family: fit for fit in fits}
    assert best.family == min(fits, key=lambda fit: fit.aic).family == "gaussian"
    assert best.accepted and "smallest pseudo-AIC" in note
    assert best.parameters[0] == pytest.approx(-0.738, rel=0.01)
    assert table["student"].parameters[0] == pytest.approx(-0.722, rel=0.01)
    assert table["student"].aic - best.aic == pytest.approx(1.31, abs=0.5)
    assert not table["independence"].accepted
    assert {"clayton90", "gumbel270"} < set(table) and "clayton" not in table


def test_when_nothing_is_accepted_the_choice_says_so():
    fits = copulas.select(*PAIRS.T, families=("independence",), n_boot=100)
    assert "rejects all 1 families" in copulas.choose(fits)[1]


def test_fits_and_copulas_survive_json():
    for fit in copulas.select(*PAIRS.T, families=copulas.PAPER_FAMILIES, n_boot=20):
        assert copulas.CopulaFit.from_dict(json.loads(json.dumps(fit.to_dict()))) == fit
        assert Copula.from_dict(json.loads(json.dumps(fit.copula.to_dict()))) == fit.copula


def test_the_gaussian_copula_of_three_variables_contains_that_of_two():
    matrix = ((1.0, -0.7, 0.2), (-0.7, 1.0, 0.1), (0.2, 0.1, 1.0))
    three, two = GaussianCopula(matrix), Copula("gaussian", (-0.7,))
    u = np.random.default_rng(8).random((7, 3))
    assert three.rosenblatt(u)[:, :2] == pytest.approx(two.rosenblatt(u[:, :2]), abs=1e-12)
    assert three.inverse_rosenblatt(three.rosenblatt(u)) == pytest.approx(u, abs=1e-12)
    flat = GaussianCopula(tuple(row[:2] for row in matrix[:2]))
    assert flat.logpdf(u[:, :2]) == pytest.approx(two.logpdf(u[:, 0], u[:, 1]), abs=1e-12)
    sample = three.sample(3000, np.random.default_rng(9))
    assert np.array(fit_gaussian(sample).correlation) == pytest.approx(np.array(matrix), abs=0.05)
    with pytest.raises(CopulaError, match="positive eigenvalues"):
        GaussianCopula(((1.0, 0.9, -0.9), (0.9, 1.0, 0.9), (-0.9, 0.9, 1.0)))


THREE = ((1.0, -0.722, 0.3), (-0.722, 1.0, 0.1), (0.3, 0.1, 1.0))


@pytest.mark.parametrize("nu", [1.5, 6.05, 40.0])
def test_students_copula_of_two_variables_is_the_bivariate_one(nu):
    two, flat = Copula("student", (-0.722, nu)), StudentCopula(((1.0, -0.722), (-0.722, 1.0)), nu)
    u = np.random.default_rng(8).random((50, 2))
    assert flat.logpdf(u) == pytest.approx(two.logpdf(u[:, 0], u[:, 1]), abs=1e-11)
    assert flat.rosenblatt(u) == pytest.approx(two.rosenblatt(u), abs=1e-12)
    assert flat.inverse_rosenblatt(u) == pytest.approx(two.inverse_rosenblatt(u), abs=1e-12)
    assert flat.cdf(u[:9]) == pytest.approx(two.cdf(u[:9, 0], u[:9, 1]), abs=2e-5)


def test_students_copula_of_three_variables():
    three = StudentCopula(THREE, 5.0)
    u = np.random.default_rng(8).random((50, 3))
    assert three.rosenblatt(u)[:, :2] == pytest.approx(Copula("student", (-0.722, 5.0)).rosenblatt(u[:, :2]), abs=1e-12)
    assert three.inverse_rosenblatt(three.rosenblatt(u)) == pytest.approx(u, abs=1e-11)
    law, one = stats.multivariate_t(np.zeros(3), THREE, 5.0), stats.t(5.0)
    x = one.ppf(u)
    assert three.logpdf(u) == pytest.approx(law.logpdf(x) - one.logpdf(x).sum(axis=1), abs=1e-7)
    sample = three.sample(20_000, np.random.default_rng(9))
    assert np.mean(np.all(sample < [0.3, 0.6, 0.4], axis=1)) == pytest.approx(
        float(three.cdf(np.array([0.3, 0.6, 0.4]))), abs=0.01
    )
    fitted = student_of_known_degrees(sample[:3000], 5.0)
    assert np.array(fitted.correlation) == pytest.approx(np.array(THREE), abs=0.05)
    assert from_dict(json.loads(json.dumps(three.to_dict()))) == three
    assert from_dict(GaussianCopula(THREE).to_dict()) == GaussianCopula(THREE)


def test_students_copula_of_one_variable_is_the_uniform_distribution():
    u = np.linspace(0.01, 0.99, 7)[:, None]
    one = StudentCopula(((1.0,),), 4.0)
    assert one.rosenblatt(u) == pytest.approx(u) and one.inverse_rosenblatt(u) == pytest.approx(u)
    assert one.logpdf(u) == pytest.approx(0.0, abs=1e-14) and one.cdf(u) == pytest.approx(u[:, 0], abs=1e-6)


def test_what_is_no_copula_of_students_is_refused():
    with pytest.raises(CopulaError, match=r"degrees_of_freedom = 0.5 is outside \[1, 200\]"):
        StudentCopula(THREE, 0.5)
    with pytest.raises(CopulaError, match="student: the correlation matrix needs a unit diagonal"):
        StudentCopula(((1.0, 1.1), (1.1, 1.0)), 5.0)
    with pytest.raises(CopulaError, match="student: one column is constant"):
        student_of_known_degrees(np.column_stack([np.arange(9.0), np.ones(9)]), 5.0)


def test_a_sample_in_which_one_variable_is_a_function_of_others_gives_a_copula():
    x = np.random.default_rng(3).normal(size=(12, 2))
    fitted = student_of_known_degrees(np.column_stack([x, x[:, 0]]), 5.0)
    assert np.linalg.eigvalsh(fitted.correlation)[0] > 0.0


@pytest.mark.parametrize(
    "family, theta, u, p",
    [
        ("joe180", 5.0, 0.25278452946120444, 0.00013992176731492315),
        ("joe", 30.0, 0.0816486107851291, 0.924955099062971),
    ],
)
def test_the_inverse_is_found_where_newtons_steps_change_sides(family, theta, u, p):
    """Newton's method alone has not converged here after 200 steps."""
    copula = Copula(family, (theta,))
    assert copula.conditional(u, copula.inverse(u, p)) == pytest.approx(p, rel=1e-9)


def correlated(n, d, seed):
    """n values of d normal variables with a random correlation."""
    rng = np.random.default_rng([n, d, seed])
    return rng.normal(size=(n, d)) @ rng.normal(size=(d, d))


def pairwise_loglik(x):
    """Log-likelihood of the Gaussian copula whose correlations are those of the pairs, or minus infinity."""
    d = x.shape[1]
    matrix = np.eye(d)
    for i in range(d):
        for j in range(i):
            matrix[i, j] = matrix[j, i] = copulas.fit(x[:, i], x[:, j], "gaussian").parameters[0]
    return loglik(matrix, x) if np.linalg.eigvalsh(matrix)[0] > 0.0 else -np.inf


def loglik(matrix, x):
    return GaussianCopula(matrix).logpdf(copulas.pseudo_observations(x.T).T).sum()


@pytest.mark.parametrize("n, d", [(10, 2), (10, 3), (30, 10), (94, 4), (655, 7), (2000, 10), (100_000, 5)])
def test_all_correlations_of_a_gaussian_copula_maximise_the_likelihood_together(n, d):
    x = correlated(n, d, seed=1)
    found = np.array(fit_gaussian(x).correlation)
    scores = stats.norm.ppf(copulas.pseudo_observations(x.T))
    inverse = np.linalg.inv(found)
    gradient = inverse @ (scores @ scores.T / n) @ inverse - inverse
    assert np.abs(gradient[~np.eye(d, dtype=bool)]).max() < 1e-10 * np.abs(inverse).max()
    if n < 3000:
        assert loglik(found, x) >= pairwise_loglik(x) - 1e-9


def test_the_pairs_alone_do_not_maximise_the_likelihood():
    gains = []
    for seed in range(10):
        x = correlated(200, 4, seed)
        gains.append(loglik(fit_gaussian(x).correlation, x) - pairwise_loglik(x))
    assert min(gains) > 1e-4


@pytest.mark.parametrize("n", [10, 94, 3000])
@pytest.mark.parametrize("slope", [-3.0, -0.2, 0.0, 1.0])
def test_two_variables_have_the_correlation_of_the_bivariate_fit(n, slope):
    x = np.random.default_rng([n, 2]).normal(size=(n, 2)) @ [[1.0, slope], [0.0, 1.0]]
    rho = copulas.fit(*x.T, "gaussian").parameters[0]
    assert fit_gaussian(x).correlation[0][1] == pytest.approx(rho, abs=1e-6)


#: Mean products of the normal scores of 7 log concentrations in 655 water samples (Cook and Johnson 1986, Technometrics
#: 28, 123; the data set `uranium` of the R package copula), lower triangle: U, Li, Co, K, Cs, Sc, Ti.
URANIUM = """
0.982890
0.178275 0.981567
0.030104 0.013528 0.982630
0.282915 0.175415 -0.147777 0.982932
0.611385 0.176961 0.225981 0.260960 0.982723
0.083167 0.166763 0.710171 -0.178389 0.330667 0.982662
0.154295 0.034482 0.490600 0.045505 0.438402 0.593532 0.982936
"""


def test_seven_published_variables_have_their_joint_maximum():
    """The maximum is that of a general optimiser from independence; the correlations of the pairs give 751.272."""
    rows = [[float(word) for word in line.split()] for line in URANIUM.split("\n") if line]
    S = np.array([[rows[max(i, j)][min(i, j)] for j in range(7)] for i in range(7)])
    found = most_likely(S)
    value = 655 * (_loglik(found, S) + 0.5 * np.trace(S))
    assert value == pytest.approx(751.3018, abs=2e-4)

    def cost(t):
        rows = np.eye(7)
        rows[np.tril_indices(7, -1)] = t
        rows /= np.linalg.norm(rows, axis=1)[:, None]
        return -_loglik(rows @ rows.T, S)

    general = optimize.minimize(cost, np.zeros(21), method="BFGS")
    assert -general.fun == pytest.approx(_loglik(found, S), abs=1e-8)


@pytest.mark.parametrize("x", [correlated(10, 10, 1), np.repeat(correlated(50, 2, 1), 2, axis=1)])
def test_a_singular_matrix_of_scores_still_gives_a_copula(x):
    found = fit_gaussian(x)
    assert np.isfinite(found.logpdf(copulas.pseudo_observations(x.T).T)).all()


@pytest.mark.parametrize("x, text", [(np.ones((4, 3)), "5 rows"), (np.full((9, 3), np.nan), "not finite"),
                                     (np.eye(9, 3) * [1, 1, 0], "constant")])  # fmt: skip
def test_values_that_have_no_gaussian_copula_are_refused(x, text):
    with pytest.raises(CopulaError, match=text):
        fit_gaussian(x)


def test_a_fit_says_when_it_stands_at_a_wall():
    x = np.random.default_rng(1).lognormal(0.0, 0.3, 40)
    ends = {family: copulas.fit(x, 1.0 / x, family).at_bounds for family in copulas.PAPER_FAMILIES}
    assert ends == {
        "gaussian": (("rho", -0.9999, ""),),
        "student": (("rho", -0.9999, ""), ("nu", 1.0, "")),
        "frank": (("theta", -60.0, ""),),
        "plackett": (("theta", 1e-5, ""),),
    }
    assert copulas.fit(x, x, "clayton180").at_bounds == (("theta", 50.0, ""),)


def test_an_end_that_is_a_simpler_copula_is_named():
    x = np.random.default_rng(3).normal(size=(400, 2)) @ [[1.0, 0.5], [0.0, 1.0]]
    assert copulas.fit(*x.T, "student").at_bounds in ((), (("nu", 200.0, "gaussian"),))
    wide = copulas.CopulaFit("student", (0.4, 200.0), ("rho", "nu"), (), (), 400, 0.0, 0.0, 0.0, 0.3)
    assert wide.at_bounds == (("nu", 200.0, "gaussian"),)
    flat = copulas.CopulaFit("joe90", (1.00001,), ("theta",), (), (), 400, 0.0, 0.0, 0.0, 0.0)
    assert flat.at_bounds == (("theta", 1.00001, "independence"),)
    assert all(copulas.fit(*PAIRS.T, family).at_bounds == () for family in copulas.PAPER_FAMILIES)
