"""What all points say together: where the scatter of a state comes from, and PDEM against Monte Carlo on a surface.

A response surface over (mu_s, G_p) pools the points of one density; what it leaves over is packing noise.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.stats import qmc

from analysis import sensitivity, surrogate, weighted
from analysis.joint import Joint
from analysis.quantities import QUANTITIES
from analysis.results import read_results
from analysis.stopping import LEAST

#: States and quantities that are pooled.
POOLED = (("peak", "eta"), ("critical", "eta"), ("critical", "e"), ("critical", "Z"), ("critical", "Phi_dev"),
          ("peak", "D_p"), ("probe", "G_0"))  # fmt: skip
QUANTILES = (0.05, 0.95)


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
    """Mean, standard deviation and 5 and 95 % quantiles of every state from the points and from 2^power samples.

    The samples go through the response surface, without noise; all in shown units.
    """
    results = read_results(results)
    rows = []
    for mu_iso, state, symbol, surface, samples, _ in _surfaces(results, power):
        factor = QUANTITIES[symbol].shown_factor
        values, weight = factor * results.state(state, symbol, mu_iso), results.weights(mu_iso)
        drawn = factor * surface.predict(samples)[0]
        pairs = [(weighted.mean(values, weight), drawn.mean()), (weighted.std(values, weight), drawn.std())]
        pairs += [(weighted.quantile(values, weight, q), np.quantile(drawn, q)) for q in QUANTILES]
        rows.append((mu_iso, state, symbol, *(float(value) for pair in pairs for value in pair)))
    names = ("mean", "sd", *(f"{q:.0%}" for q in QUANTILES))
    columns = [column for name in names for column in (name, f"{name}, Monte Carlo")]
    return pd.DataFrame(rows, columns=["mu_iso", "state", "quantity", *columns])


def _surfaces(results, power):
    """Every pooled state of every density that has runs enough: its surface, samples of the inputs, and its spread."""
    results = read_results(results)
    if not results.inputs["joint"]:
        return
    samples = Joint.from_dict(results.inputs["joint"]).inverse_rosenblatt(qmc.Sobol(2, seed=1).random_base2(power))
    points = results.family_points()[["mu_s", "G_p"]].to_numpy()
    for mu_iso in results.family_densities():
        for state, symbol in POOLED:
            if symbol not in results.state_symbols(state, mu_iso):
                continue
            values = results.state(state, symbol, mu_iso)
            spread = float(weighted.std(values, results.weights(mu_iso)))
            if np.isfinite(values).sum() >= LEAST and spread > 0:
                yield mu_iso, state, symbol, surrogate.fit(points, values), samples, spread
