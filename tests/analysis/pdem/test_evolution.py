"""PDEM: the same probabilities whatever the response does, its statistics, its errors."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import oscillator_cdf, oscillator_moments, oscillator_paths
from scipy.special import ndtr

from analysis.pdem import evolution, weighted

STRAIN = np.concatenate([[0.0, 1e-4, 5e-4], np.linspace(2e-3, 0.4, 37)])
ADVERSARIAL = ("constant", "equal", "step", "zigzag", "outlier", "missing", "crossing", "uneven")


def adversarial(kind: str, points: int = 30) -> np.ndarray:
    """Responses (T, Q) that break careless schemes."""
    rng = np.random.default_rng(7)
    base = np.linspace(0.5, 1.0, points) * (1 - np.exp(-STRAIN[:, None] / 0.01))
    if kind == "constant":
        return np.broadcast_to(rng.normal(size=points), base.shape).copy()
    if kind == "equal":
        return np.full_like(base, 0.7)
    if kind == "step":
        return np.where(STRAIN[:, None] > 0.1, base, -5.0)
    if kind == "zigzag":
        return base + np.where(np.arange(len(STRAIN)) % 2, 1.0, -1.0)[:, None] * rng.normal(size=points)
    if kind == "outlier":
        base[:, 4] = 1e4
    if kind == "missing":
        base[3:9, ::5] = np.nan
        base[20, 1] = np.inf
        base[30:, 2] = np.nan
        base[:5, 3] = np.nan
    if kind == "crossing":
        return np.linspace(-1, 1, points) * (STRAIN[:, None] - 0.2)
    return base


@pytest.mark.parametrize("method", ["exact", "tvd"])
@pytest.mark.parametrize("kind", ADVERSARIAL)
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_probability_is_conserved_and_never_negative(kind, method, scale):
    h = adversarial(kind) * scale
    probability = np.random.default_rng(1).dirichlet(np.ones(h.shape[1]))
    pdf = evolution.evolve(h, probability, STRAIN, method, cells=200)
    assert np.max(np.abs(pdf.p.sum(axis=1) * pdf.dx - 1)) < 1e-10
    assert pdf.p.min() * pdf.dx[0] >= -1e-14
    known = np.isfinite(h)
    assert pdf.lost_probability == pytest.approx(np.where(known, 0, probability).sum(axis=1), abs=1e-15)
    shown = np.sum(pdf.p * pdf.x * pdf.dx[0], axis=1)
    assert np.max(np.abs(shown - pdf.mean)) < 0.5 * pdf.dx[0]


def test_lost_probability_above_its_limit_is_refused_with_the_numbers():
    h = adversarial("missing")
    with pytest.raises(
        evolution.PdemError, match=r"probability 0\.233 of points has no value at strain 0\.002, limit 0\.1"
    ):
        evolution.evolve(h, np.full(30, 1 / 30), STRAIN, max_lost=0.1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"h": np.zeros((3, 2))}, r"shape \(3, 2\), expected \(40 strains, 30 points\)"),
        ({"probability": np.full(30, 0.1)}, "sum 3; expected"),
        ({"strain": np.zeros(40)}, "strain does not increase after entry 0"),
        ({"method": "upwind"}, "method 'upwind' is not one of exact, tvd"),
        ({"rule": "eye"}, "bandwidth rule 'eye'"),
        ({"bandwidth": -1.0}, "bandwidth -1.0 is neither"),
        ({"method": "tvd", "bandwidth": np.ones(40)}, "starts from one bandwidth"),
        ({"method": "tvd", "limiter": "none"}, "limiter 'none' is not one of minmod, vanleer, superbee"),
        ({"cells": 10}, "cells = 10 is below 64"),
    ],
)
def test_bad_arguments_get_one_line(change, message):
    given = {"h": adversarial("uneven"), "probability": np.full(30, 1 / 30), "strain": STRAIN} | change
    with pytest.raises(ValueError, match=message):
        evolution.evolve(**given)


def test_moments_and_quantiles_are_those_of_the_points():
    h = np.array([[1.0, 2.0, 4.0]])
    probability = np.array([0.5, 0.25, 0.25])
    pdf = evolution.evolve(h, probability, [0.0])
    assert pdf.mean[0] == pytest.approx(2.0) and pdf.std[0] == pytest.approx(np.sqrt(1.5))
    assert weighted.quantiles(h, probability, [0.25, 0.625])[0] == pytest.approx([1.0, 2.0])


def test_a_given_bandwidth_is_used_and_reported():
    h = adversarial("uneven")
    pdf = evolution.evolve(h, np.full(30, 1 / 30), STRAIN, bandwidth=0.05, keep_spread=False)
    assert np.all(pdf.bandwidth == 0.05)
    spread = np.sqrt(np.sum(pdf.p * pdf.x**2 * pdf.dx[:, None], axis=1) - pdf.mean**2)
    within_cell = pdf.dx[0] ** 2 / 12
    assert spread[-1] == pytest.approx(np.sqrt(pdf.std[-1] ** 2 + 0.05**2 + within_cell), rel=1e-6)


def test_state_pdf_is_the_single_strain():
    values = np.array([0.5, 0.6, np.nan, 0.9])
    pdf = evolution.state_pdf(values, np.full(4, 0.25), strain=0.4)
    assert pdf.p.shape[0] == 1 and pdf.strain[0] == 0.4
    assert pdf.lost_probability[0] == pytest.approx(0.25)
    assert pdf.mean[0] == pytest.approx(2.0 / 3)


@pytest.mark.parametrize("width", [0.01, 0.03, 0.2])
def test_exact_translation_is_the_sum_of_gaussian_cell_averages(width):
    h = adversarial("crossing")
    probability = np.random.default_rng(5).dirichlet(np.ones(30))
    pdf = evolution.evolve(h, probability, STRAIN, bandwidth=width, cells=150, keep_spread=False)
    edge = (pdf.edges[:, None, :] - h[:, :, None]) / pdf.bandwidth[:, None, None]
    expected = np.einsum("q,tqx->tx", probability, np.diff(ndtr(edge), axis=2))
    assert np.max(np.abs(pdf.p * pdf.dx[:, None] - expected)) < 2e-9


@pytest.mark.parametrize("options", [{"method": "tvd"}, {"method": "exact", "rule": "spacing"}])
def test_random_oscillator_has_its_closed_form(options):
    times = np.linspace(0, 6, 301)
    h, probability = oscillator_paths(200, times)
    pdf = evolution.evolve(h, probability, times, cells=200, **options)
    inner = np.abs(pdf.x) < 0.09
    for k in (50, 100, 200, 300):
        mean, std = oscillator_moments(times[k])
        assert pdf.mean[k] == pytest.approx(mean, abs=0.002 * 0.1)
        assert pdf.std[k] == pytest.approx(std, rel=0.01)
        exact = np.diff(oscillator_cdf(pdf.edges[k], times[k]))
        assert np.abs(pdf.p[k] * pdf.dx[k] - exact)[inner].sum() <= 0.06


def humps(x) -> np.ndarray:
    """Distribution function of two normal humps of equal probability."""
    return 0.5 * ndtr((np.asarray(x) + 1) / 0.15) + 0.5 * ndtr((np.asarray(x) - 1) / 0.15)


def at_middles(cdf, n: int = 100) -> np.ndarray:
    """The n quantiles of a distribution function at the middles of n equal steps."""
    x = np.linspace(-5, 5, 20001)
    return np.interp((np.arange(n) + 0.5) / n, cdf(x), x)


def l1(pdf, cdf) -> float:
    return np.abs(pdf.p[0] * pdf.dx[0] - np.diff(cdf(pdf.edges[0]))).sum()


def test_the_default_width_follows_two_humps_and_a_single_one():
    probability = np.full(100, 0.01)
    for cdf, limit in ((humps, 0.17), (ndtr, 0.04)):
        found = evolution.state_pdf(at_middles(cdf), probability)
        assert l1(found, cdf) < limit
        assert l1(found, cdf) < 0.6 * l1(
            evolution.state_pdf(at_middles(cdf), probability, rule="silverman", keep_spread=False), cdf
        )


@pytest.mark.parametrize("values", [at_middles(ndtr), np.exp(0.5 * at_middles(ndtr)), at_middles(humps)])
def test_the_shown_pdf_keeps_the_mean_and_nearly_the_standard_deviation_of_the_points(values):
    probability = np.full(100, 0.01)
    error = []
    for keep in (True, False):
        pdf = evolution.state_pdf(values, probability, keep_spread=keep)
        mass = pdf.p[0] * pdf.dx[0]
        assert mass @ pdf.x == pytest.approx(pdf.mean[0], abs=1e-6)
        error.append(np.sqrt(mass @ (pdf.x - pdf.mean[0]) ** 2) / pdf.std[0] - 1)
    assert abs(error[0]) < 0.015 and error[1] > 1.8 * abs(error[0])


def test_a_plateau_is_shown_as_a_peak_of_its_probability():
    values = np.minimum(at_middles(ndtr), 0.5)
    share = np.mean(values == 0.5)
    pdf = evolution.state_pdf(values, np.full(100, 0.01))
    inside = np.abs(pdf.x - 0.5) < 2.5 * pdf.dx[0]
    assert np.sum(pdf.p[0, inside]) * pdf.dx[0] == pytest.approx(share, abs=0.03)
    assert 0.1 < pdf.bandwidth[0] < 0.4
    assert np.sum(pdf.p) * pdf.dx[0] == pytest.approx(1.0, abs=1e-12)
    blurred = evolution.state_pdf(values, np.full(100, 0.01), rule="silverman")
    assert np.sum(blurred.p[0, np.abs(blurred.x - 0.5) < 2.5 * blurred.dx[0]]) * blurred.dx[0] < 0.3 * share


def test_points_that_share_two_values_are_two_peaks():
    pdf = evolution.state_pdf(np.repeat([1.0, 2.0], 10), np.full(20, 0.05))
    assert pdf.bandwidth[0] < pdf.dx[0]
    for value in (1.0, 2.0):
        assert np.sum(pdf.p[0, np.abs(pdf.x - value) < 4 * pdf.dx[0]]) * pdf.dx[0] == pytest.approx(0.5, abs=1e-3)


def test_two_equal_values_are_no_plateau():
    values = at_middles(ndtr)
    values[1] = values[0]
    assert not evolution._atoms(values[None], np.full((1, 100), 0.01)).any()


def test_minmod_is_the_default_limiter_and_wins():
    path = at_middles(ndtr) * np.linspace(0.1, 1, 40)[:, None]
    options = ({"limiter": name} for name in ("minmod", "vanleer", "superbee"))
    pdfs = [evolution.evolve(path, np.full(100, 0.01), np.arange(40.0), "tvd", **o) for o in options]
    errors = [l1(pdf.at(-1), ndtr) for pdf in pdfs]
    assert errors[0] < errors[1] < errors[2]
    assert np.array_equal(pdfs[0].p, evolution.evolve(path, np.full(100, 0.01), np.arange(40.0), "tvd").p)


def test_numerical_diffusion_is_reported_and_grows_with_the_path_length():
    smooth = adversarial("uneven")
    noisy = smooth + 0.05 * np.random.default_rng(1).normal(size=smooth.shape)
    probability = np.full(30, 1 / 30)
    widths = [evolution.evolve(h, probability, STRAIN, "tvd").numerical_width[-1] for h in (smooth, noisy)]
    assert 0 < widths[0] < widths[1]
    assert np.all(evolution.evolve(smooth, probability, STRAIN).numerical_width == 0)
