"""Bands: standard errors against closed forms, the share of noise, the band on a PDF."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import MEDIAN, SIGMA_LN, dem_like_states, joint_inputs, sobol_normals
from pdf_checks import with_surface_band

from analysis.pdem import bands, evolution
from analysis.surrogates import surrogate


def linear_campaign(noise: float, seed: int = 1):
    """Runs of 2 + 0.1 ln(mu_s / median) with noise: the mean's error is known."""
    inputs = joint_inputs(sobol_normals(64, seed))
    values = 2 + 0.1 * np.log(inputs[:, 0] / MEDIAN[0])
    return inputs, surrogate.fit(inputs, values + noise * np.random.default_rng(seed).normal(size=64))


def refitted(rng, pairs: int, count: int) -> np.ndarray:
    """Samples from the inputs refitted to bootstrap samples of so many pairs, through common random numbers."""
    z = sobol_normals(512, 9)
    out = []
    for _ in range(count):
        logs = np.log(joint_inputs(rng.normal(size=(pairs, 2))))
        rho = np.corrcoef(logs.T)[0, 1]
        both = np.stack([z[:, 0], rho * z[:, 0] + np.sqrt(1 - rho**2) * z[:, 1]], axis=1)
        out.append(np.exp(logs.mean(axis=0) + logs.std(axis=0, ddof=1) * both))
    return np.array(out)


def test_standard_errors_are_those_of_a_normal_sample():
    rng = np.random.default_rng(5)
    samples = joint_inputs(sobol_normals(512, 9))
    moments = bands.surface_moment_bands(linear_campaign(1e-6)[1], samples, refitted(rng, 94, 400), rng)
    scatter = 0.1 * SIGMA_LN[0]
    assert moments.mean_error[0] == pytest.approx(scatter / np.sqrt(94), rel=0.12)
    assert moments.std_error[0] == pytest.approx(scatter / np.sqrt(2 * 93), rel=0.12)
    assert moments.noise_part[0] < 0.01
    assert moments.mean_high[0] - moments.mean_low[0] == pytest.approx(2 * 1.96 * moments.mean_error[0], rel=1e-3)


def test_with_known_inputs_only_the_noise_is_left():
    rng = np.random.default_rng(6)
    samples = joint_inputs(sobol_normals(512, 9))
    fixed = np.repeat(samples[None], 300, axis=0)
    moments = bands.surface_moment_bands(linear_campaign(0.05)[1], samples, fixed, rng)
    assert moments.noise_part[0] == pytest.approx(1)
    assert moments.mean_error[0] == pytest.approx(0.05 / np.sqrt(64), rel=0.3)
    louder = bands.surface_moment_bands(linear_campaign(0.05)[1], samples, fixed, rng, noise=[0.2])
    assert louder.mean_error[0] == pytest.approx(4 * moments.mean_error[0], rel=0.35)


def test_band_on_a_pdf_holds_the_pdf_and_narrows_with_less_noise():
    rng = np.random.default_rng(7)
    inputs = joint_inputs(sobol_normals(64, 1))
    smooth = dem_like_states(inputs)["critical"]
    widths = []
    for noise in (0.01, 0.03):
        surface = surrogate.fit(inputs, smooth + noise * rng.normal(size=64))
        boot = refitted(rng, 94, 60)
        fitted = joint_inputs(sobol_normals(512, 9))
        pdf = evolution.evolve(surface.predict(fitted), np.full(512, 1 / 512), [0.4])
        shown = with_surface_band(pdf, surface, boot, rng)
        assert np.all(shown.low <= shown.high) and shown.low.min() >= 0
        inside = (shown.p >= shown.low) & (shown.p <= shown.high)
        assert np.sum(shown.p[inside]) > 0.8 * np.sum(shown.p)
        widths.append(np.sum(shown.high - shown.low) * shown.dx[0])
    assert widths[0] < widths[1]


def test_too_few_bootstrap_samples_are_refused():
    with pytest.raises(ValueError, match=r"shape \(10, 512, 2\), expected \(B >= 50, n, 2\)"):
        bands.surface_moment_bands(linear_campaign(0.1)[1], None, np.zeros((10, 512, 2)), np.random.default_rng(0))
