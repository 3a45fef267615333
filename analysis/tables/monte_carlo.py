"""The points and PDEM against Monte Carlo samples through the model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..pdem import weighted
from ..pdem.pdf import wasserstein
from ..quantities import QUANTITIES
from ..results.models import curve_model, joint_samples, runs_needed
from ..results.reader import Results
from ..surrogates.monte_carlo import monte_carlo
from ..surrogates.surrogate import Surrogate
from .columns import QUANTILES, named, unit
from .pooled_states import pooled_states

#: Responses that are compared along strain, and the strain to start from: before it all points are near one state.
ALONG, ALONG_FROM = ("eta", "e", "e_m", "Z", "Z_m", "Phi_dev"), 0.01
NAMES = ("mean", "sd", *QUANTILES)


def monte_carlo_check(results: Results, power: int = 17) -> pd.DataFrame:
    """Moments and quantiles of every state from the points and from 2^power samples (`_mc`), and their differences.

    The samples go through the model.  `sd_mc_noise` and the quantiles include the noise of a
    run, which the points contain too.  A difference (`_diff`) is points minus Monte Carlo, over `sd_mc_noise`; that
    of the standard deviation is relative to it.  All else is in displayed units.
    """
    rows = []
    for mu_iso, state, symbol, model, samples in pooled_states(results, power):
        factor = QUANTITIES[symbol].shown_factor
        values, probability = factor * results.shown_state(state, symbol, mu_iso), results.probability(mu_iso)
        drawn = factor * model.predict(samples)[0]
        noise = factor * _noise(results, mu_iso, model)[0]
        sd, noisy = drawn.std(), float(np.hypot(drawn.std(), noise))
        pairs = [(weighted.mean(values, probability), drawn.mean()), (weighted.std(values, probability), sd)]
        scattered = drawn + noise * np.random.default_rng(1).normal(size=len(drawn))
        pairs += [(weighted.quantile(values, probability, q), np.quantile(scattered, q)) for q in QUANTILES.values()]
        differences = [(a - b) / noisy if k != 1 else a / noisy - 1 for k, (a, b) in enumerate(pairs)]
        numbers = (*(float(v) for pair in pairs for v in pair), noisy, *map(float, differences))
        rows.append((mu_iso, state, symbol, unit(symbol), *numbers))
    columns = [column for name in NAMES for column in (name, f"{name}_mc")]
    columns += ["sd_mc_noise", *(f"{name}_diff" for name in NAMES)]
    return pd.DataFrame(rows, columns=["mu_iso", "state", "quantity", "unit", *columns])


def monte_carlo_along(results: Results, power: int = 14) -> pd.DataFrame:
    """PDEM's PDF of every response along strain against Monte Carlo through the model.

    From 2^power samples of the joint inputs with the noise of a run, which the points contain too.
    Each column is the largest difference over the strains beyond 1 %, over the standard deviation of Monte Carlo: of
    means, of standard deviations (relative), of 5 and 95 % quantiles; `W1` is the Wasserstein-1 distance of the PDFs,
    `W1_average` its average over the strains.  No rows for a density of which tests ended early.
    """
    columns = ["mu_iso", "quantity", "unit", "mean", "sd", "q05", "q95", "W1", "W1_average"]
    if not results.inputs["joint"]:
        return pd.DataFrame(columns=columns)
    samples, held = joint_samples(results, power), results.loading.is_undrained
    late = results.strain >= ALONG_FROM
    rows = []
    for mu_iso in results.family_densities():
        if results.has_early_ends(mu_iso):
            continue
        for symbol in (s for s in ALONG if s in results.symbols(mu_iso) and not (s == "e" and held)):
            response = results.response(symbol, mu_iso)
            run = np.where(results.filled(mu_iso), np.nan, response.values)
            model = curve_model(results, symbol, mu_iso)
            if model is None or np.isfinite(run).sum(axis=1).min() < runs_needed(results):
                continue
            pdf = response.pdf
            noise = _noise(results, mu_iso, model)
            drawn = monte_carlo(model, samples, results.strain, pdf, noise=noise, rng=np.random.default_rng(1))
            spread = np.where(late, drawn.std, np.nan)
            differences = {"mean": (pdf.mean - drawn.mean) / spread, "sd": pdf.std / spread - 1}
            for name in ("q05", "q95"):
                differences[name] = (pdf.quantile(QUANTILES[name]) - drawn.quantile(QUANTILES[name])) / spread
            differences["W1"] = wasserstein(pdf, drawn) / spread
            row: dict[str, Any] = {"mu_iso": mu_iso, **named(symbol)}
            row |= {name: float(np.nanmax(np.abs(values))) for name, values in differences.items()}
            rows.append(row | {"W1_average": float(np.nanmean(differences["W1"]))})
    return pd.DataFrame(rows, columns=columns)


def _noise(results: Results, mu_iso: float, model: Surrogate) -> np.ndarray:
    """Noise (T,) in the spread of the points: without that of packings, if all points have the same one."""
    several = len(np.unique(results.packing(mu_iso))) > 1
    return model.noise if several else model.noise_own
