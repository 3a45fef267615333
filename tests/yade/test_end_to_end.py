"""A whole campaign in a real YADE, as small as one can be: pairs in, report out, and nothing done twice."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from paths import ROOT

from analysis.quantities import RESPONSES

pytestmark = pytest.mark.yade
CONFIG = """
name = "tiny"
[points]
n = 8
[inputs]
bootstrap = 19
[assembly]
N = 64
[consolidation]
mu_iso = [0.1]
[shear]
strain_end = 0.012
inertial_number = 2.4e-3
[dem]
timestep_factor = 0.9
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("campaign")
    (path / "tiny.toml").write_text(CONFIG)
    done = campaign(path)
    assert done.returncode == 0, done.stdout + done.stderr
    return path


def campaign(path: Path) -> subprocess.CompletedProcess:
    command = [
        sys.executable,
        "-m",
        "campaign",
        "all",
        str(path / "tiny.toml"),
        "--folder",
        str(path / "run"),
        "--quiet",
    ]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=os.environ | {"MPLBACKEND": "Agg"})


def test_promised_files_are_there(folder):
    run = folder / "run"
    for name in ("config.toml", "points.csv", "results.h5", "report.html"):
        assert (run / name).stat().st_size > 100, name
    for name in ("marginals", "copulas", "initial_state", "responses_moments", "peak_critical", "moments"):
        assert len(pd.read_csv(run / "tables" / f"{name}.csv")) > 0, name
    assert len(list((run / "figures").glob("fig*.png"))) >= 12
    points = pd.read_csv(run / "points.csv")
    assert list(points.columns[:3]) == ["id", "mu_s", "G_p"] and abs(points.probability.sum() - 1.0) < 1e-15


def test_every_density_integrates_to_one(folder):
    with h5py.File(folder / "run" / "results.h5") as file:
        responses = file["families/coupled/0.1/responses"]
        assert set(responses) == set(RESPONSES)
        for symbol, group in responses.items():
            x = group["x"][()]
            width = x[..., 1] - x[..., 0]
            np.testing.assert_allclose(group["pdf"][()].sum(axis=-1) * width, 1.0, atol=1e-8, err_msg=symbol)


def test_results_are_those_of_the_products(folder):
    """One point followed by hand from its product to results.h5."""
    plan = pd.read_csv(folder / "run" / "tables" / "plan.csv")
    row = plan[(plan.stage == "shear") & (plan.point == 3)].iloc[0]
    with h5py.File(folder / "run" / row["product"]) as product, h5py.File(folder / "run" / "results.h5") as results:
        sigma = product["record/sigma"][()]
        q, p = sigma[:, 2, 2] - 0.5 * (sigma[:, 0, 0] + sigma[:, 1, 1]), np.trace(sigma, axis1=1, axis2=2) / 3.0
        at = list(results["points/id"][()]).index(3)
        group = results["families/coupled/0.1/responses"]
        strain = results["strain"][()]
        eta = np.interp(strain, product["record/eps_a"][()], q / p)
        np.testing.assert_allclose(group["eta/values"][:, at], eta, atol=0.02)
        e = np.interp(strain, product["record/eps_a"][()], product["record/e"][()])
        np.testing.assert_allclose(group["e/values"][:, at], e, atol=1e-4)
    with h5py.File(folder / "run" / "results.h5") as results:
        states = results["families/coupled/0.1/states"]
        assert np.all(states["probe/G_0"][()] > 50e6) and np.all(states["peak/eta"][()] > 0.2)


def test_second_time_nothing_runs(folder):
    products = {p: p.stat().st_mtime_ns for p in (folder / "run" / "products").glob("*.h5")}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert campaign(folder).returncode == 0
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 5.0
    assert products == {p: p.stat().st_mtime_ns for p in (folder / "run" / "products").glob("*.h5")}
