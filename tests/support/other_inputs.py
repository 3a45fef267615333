"""Synthetic campaigns whose random inputs are not measured pairs of mu_s and G_p: one input, three, stated ones."""

from __future__ import annotations

import atexit
import functools
import shutil
import tempfile
from pathlib import Path

import numpy as np
import synthetic_results

from analysis.copulas.multivariate import GaussianCopula
from analysis.inputs.joint import Joint
from analysis.inputs.marginals import Marginal
from analysis.points.selection import select_points
from analysis.results import build

MARGINALS = {
    "mu_s": Marginal("lognormal", {"median": 0.24, "sigma_ln": 0.29}),
    "G_p": Marginal("lognormal", {"median": 28e9, "sigma_ln": 0.25}),
    "nu": Marginal("normal", {"mean": 0.22, "sd": 0.03}),
}
CORRELATION = np.array([[1.0, -0.5, 0.2], [-0.5, 1.0, 0.0], [0.2, 0.0, 1.0]])
CONSTANTS = {"mu_s": 0.25, "G_p": 29e9}


def joint_of(names):
    """The joint distribution of some of the three inputs."""
    place = [list(MARGINALS).index(name) for name in names]
    matrix = CORRELATION[np.ix_(place, place)]
    return Joint(tuple(MARGINALS[name] for name in names), GaussianCopula(tuple(map(tuple, matrix.tolist()))))


def points_of(names, n):
    """Points of these inputs; a needed one that is not among them is a constant."""
    constants = {name: value for name, value in CONSTANTS.items() if name not in names}
    return select_points(joint_of(names), n, names=names, constants=constants)


def campaign_info(names, measured=0, pairs_behind=0):
    """What the campaign hands over beside its runs: a table of `measured` rows, or stated distributions."""
    joint = joint_of(names)
    stated = {} if measured else {"specified": {"variables": {name: {} for name in names}, "dependence": {}}}
    return build.CampaignInfo(
        name="other inputs",
        config='name = "other"\n',
        pairs=joint.sample(measured, np.random.default_rng(3)) if measured else np.empty((0, len(names))),
        source="rows.csv" if measured else "[variables]",
        marginals={name: [marginal] for name, marginal in zip(names, joint.marginals, strict=True)},
        copulas=[{"family": "gaussian", "parameters": [0.1], "names": ["rho"]}] if len(names) > 1 else [],
        joint=joint,
        pairs_behind=pairs_behind,
        **stated,
    )


def make(folder, names, n=8, densities=(0.04,), noise=0.02, measured=0, pairs_behind=0, end=0.4, **options):
    """Write every product of a campaign of these inputs to the strain `end` and build its results.h5; the path."""
    points = points_of(names, n)
    plan = synthetic_results.plan_rows(folder, points, densities=densities, packings=(1, 2, 3, 4))
    of_point = dict(zip(points.id.tolist(), points, strict=True))
    for name in (name for name in names if name not in CONSTANTS):
        plan[name] = [of_point[k].further[name] if k >= 0 else np.nan for k in plan["point"]]
    for row in plan.itertuples():
        synthetic_results.write_run(row, noise, end, round(end / 0.005))
    return build.build_results(folder, plan, points, campaign_info(names, measured, pairs_behind), **options)


@functools.lru_cache
def example(names, n=8, densities=(0.04,)):
    """Path of the results of `make`, made once a session."""
    folder = Path(tempfile.mkdtemp(prefix="other-inputs-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return make(folder, names, n, densities)
