"""What all points say together: where the scatter of a state comes from, and PDEM against Monte Carlo on a surface.

A response surface over (mu_s, G_p) pools the points of one density; what it leaves over is packing noise.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy import stats
from scipy.stats import qmc

from analysis import bands, sensitivity, surrogate, weighted
from analysis.density import wasserstein
from analysis.inputs import FEWEST_PAIRS
from analysis.joint import Joint, bootstrap_joints
from analysis.montecarlo import monte_carlo
from analysis.packing_noise import common_error
from analysis.quantities import QUANTITIES
from analysis.results import read_results
from analysis.stopping import LEAST

#: States and quantities that are pooled.
POOLED = (("peak", "eta"), ("critical", "eta"), ("critical", "e"), ("critical", "Z"), ("critical", "Phi_dev"),
          ("peak", "D_p"), ("probe", "G_0"))  # fmt: skip
QUANTILES = (0.05, 0.5, 0.95)
#: log2 of the samples behind the means and standard deviations that bands lie around.
CENTRE_POWER = 12
#: Responses compared along strain, and the strain from which on: before, all points start from one state.
ALONG, ALONG_FROM = ("eta", "e", "e_m", "Z", "Z_m", "Phi_dev"), 0.01


def variance_sources(results, power=12) -> pd.DataFrame:
    """Shares of every state's variance per density: what either property adds once the other is known, and the rest.

    The two properties depend on each other, so most of what mu_s tells G_p tells too: `shared` is what either of them
    explains, `only mu_s` and `only G_p` what one adds to the other (independent total indices), `noise` what the
    response surface leaves over.  2^power samples of the joint distribution; a density with fewer than 12 runs has no
    rows.  `leave-one-out error` is the surface's, over the standard deviation of the points.
    """
    rows = []
    for mu_iso, state, symbol, surface, samples, spread in _surfaces(results, power):
        shares = sensitivity.from_surrogate(surface, samples)
        noise = min(float(surface.noise[0]) ** 2 / spread**2, 1.0)
        parts = (1 - noise) * np.array([*shares.alone[0], shares.shared[0]])
        rows.append((mu_iso, state, symbol, *parts, noise, float(surface.loo_error[0]) / spread))
    columns = ["mu_iso", "state", "quantity", "only mu_s", "only G_p", "shared", "noise", "leave-one-out error"]
    return pd.DataFrame(rows, columns=columns)


def monte_carlo_check(results, power=17) -> pd.DataFrame:
    """Moments and quantiles of every state from the points and from 2^power samples, and how they differ.

    The samples go through the response surface; "sd, Monte Carlo with noise" and the quantiles have the surface's
    residual scatter added, which the points carry too.  Differences are points minus Monte Carlo over the latter's
    standard deviation (of the standard deviation: relative, against the one with noise); all else in shown units.
    """
    results = read_results(results)
    rows = []
    for mu_iso, state, symbol, surface, samples, _ in _surfaces(results, power):
        factor = QUANTITIES[symbol].shown_factor
        values, weight = factor * results.state(state, symbol, mu_iso), results.weights(mu_iso)
        drawn = factor * surface.predict(samples)[0]
        sd, noisy = drawn.std(), float(np.hypot(drawn.std(), factor * surface.noise[0]))
        pairs = [(weighted.mean(values, weight), drawn.mean()), (weighted.std(values, weight), sd)]
        scattered = drawn + factor * surface.noise[0] * np.random.default_rng(1).normal(size=len(drawn))
        pairs += [(weighted.quantile(values, weight, q), np.quantile(scattered, q)) for q in QUANTILES]
        off = [(a - b) / noisy if k != 1 else a / noisy - 1 for k, (a, b) in enumerate(pairs)]
        numbers = (*(float(v) for pair in pairs for v in pair), noisy, *map(float, off))
        rows.append((mu_iso, state, QUANTITIES[symbol].heading, *numbers))
    names = ("mean", "sd", *(f"{q:.0%}" for q in QUANTILES))
    columns = [column for name in names for column in (name, f"{name}, Monte Carlo")]
    columns += ["sd, Monte Carlo with noise", *(f"difference of {name}" for name in names)]
    return pd.DataFrame(rows, columns=["mu_iso", "state", "quantity", *columns])


def monte_carlo_along(results, power=14) -> pd.DataFrame:
    """PDEM's density of every response against Monte Carlo through the response surface, along strain.

    2^power samples of the joint inputs, with the surface's residual scatter, which the points carry too.  The largest
    difference over the strains beyond 1 %, over Monte Carlo's standard deviation: of means, standard deviations
    (relative) and 5 and 95 % quantiles; "PDF" is the Wasserstein-1 distance, largest and averaged over the strains.
    """
    results = read_results(results)
    names = ["mu_iso", "quantity", "mean", "sd", "5%", "95%", "PDF", "PDF, average"]
    if not results.inputs["joint"]:
        return pd.DataFrame(columns=names)
    samples = _samples(results, power)
    points = results.family_points()[["mu_s", "G_p"]].to_numpy()
    late = results.strain >= ALONG_FROM
    rows = []
    for mu_iso in results.family_densities():
        for symbol in (s for s in ALONG if s in results.symbols(mu_iso)):
            response = results.response(symbol, mu_iso)
            run = np.where(results.filled(mu_iso), np.nan, response.values)
            if np.isfinite(run).sum(axis=1).min() < LEAST:
                continue
            surface, density = surrogate.fit(points, run), response.density
            drawn = monte_carlo(surface, samples, results.strain, density, noise=surface.noise,
                                rng=np.random.default_rng(1))  # fmt: skip
            spread = np.where(late, drawn.std, np.nan)
            off = {"mean": (density.mean - drawn.mean) / spread, "sd": density.std / spread - 1}
            off |= {f"{q:.0%}": (density.quantile(q) - drawn.quantile(q)) / spread for q in (0.05, 0.95)}
            off["PDF"] = wasserstein(density, drawn) / spread
            largest = {name: float(np.nanmax(np.abs(values))) for name, values in off.items()}
            average = {"PDF, average": float(np.nanmean(off["PDF"]))}
            rows.append({"mu_iso": mu_iso, "quantity": QUANTITIES[symbol].heading} | largest | average)
    return pd.DataFrame(rows, columns=names)


def moment_bands(results, n_boot=200, power=9, seed=1) -> pd.DataFrame:
    """95 % bands of mean and standard deviation of every state: from the runs' noise and from the finite set of pairs.

    Through the response surface, so without packing noise in the standard deviation; the inputs are refitted to n_boot
    resamplings of the pairs, and the error that all points of a density share (`packing_noise.common_error`) is added
    to the mean's where it is known.  "from runs" is the share of the mean's squared error that more or larger runs
    could take away, the rest is that of the pairs; "packings" whether packing noise is in it.  In shown units.
    Bands come from 2^power samples a refitted input, their centre from 2^12: a steep surface needs as many.
    """
    results = read_results(results)
    columns = ["mu_iso", "state", "quantity", "mean", "mean, from", "mean, to", "sd", "sd, from", "sd, to", "from runs",
               "packings"]
    if not results.inputs["joint"] or len(results.pairs) < FEWEST_PAIRS:
        return pd.DataFrame(columns=columns)
    rng = np.random.default_rng(seed)
    uniforms = qmc.Sobol(2, seed=1).random_base2(power)
    fitted = Joint.from_dict(results.inputs["joint"])
    others = bootstrap_joints(results.pairs, n_boot, rng, fitted)
    drawn = np.stack([joint.inverse_rosenblatt(uniforms) for joint in others])
    densities, rows = results.family_densities(), []
    for mu_iso, state, symbol, surface, samples, _ in _surfaces(results, CENTRE_POWER):
        found, factor = bands.moment_bands(surface, samples, drawn, rng), QUANTITIES[symbol].shown_factor
        shared = common_error(results, state, symbol)[0][densities.index(mu_iso)]
        error = float(np.hypot(found.mean_error[0], np.nan_to_num(shared)))
        of_pairs = found.mean_error[0] ** 2 * (1 - found.noise_part[0])
        mean, half = factor * found.mean[0], factor * stats.norm.ppf(0.975) * error
        spread = [float(factor * part[0]) for part in (found.std, found.std_low, found.std_high)]
        share, known = 1 - of_pairs / error**2, "in" if np.isfinite(shared) else "not known"
        rows.append((mu_iso, state, QUANTITIES[symbol].heading, mean, mean - half, mean + half, *spread, share, known))
    return pd.DataFrame(rows, columns=columns)


def _samples(results, power):
    """2^power samples of the fitted joint inputs, Sobol' points."""
    return Joint.from_dict(results.inputs["joint"]).inverse_rosenblatt(qmc.Sobol(2, seed=1).random_base2(power))


def _surfaces(results, power):
    """Every pooled state of every density that has runs enough: its surface, samples of the inputs, and its spread."""
    results = read_results(results)
    if not results.inputs["joint"]:
        return
    samples = _samples(results, power)
    points = results.family_points()[["mu_s", "G_p"]].to_numpy()
    for mu_iso in results.family_densities():
        for state, symbol in POOLED:
            if symbol not in results.state_symbols(state, mu_iso):
                continue
            values = results.measured(state, symbol, mu_iso)
            spread = float(weighted.std(results.state(state, symbol, mu_iso), results.weights(mu_iso)))
            if np.isfinite(values).sum() >= LEAST and spread > 0:
                yield mu_iso, state, symbol, surrogate.fit(points, values), samples, spread
