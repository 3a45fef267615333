"""A small campaign in LAMMPS through the command line: every run done and right, and nothing done twice."""

from __future__ import annotations

import h5py
import pytest
from campaign_cases import make_real, needs_batch
from lammps_stages import needs_lmp
from synthetic_runs import planned

from campaign.config import read_config
from campaign.plan import write_plan

pytestmark = [needs_lmp, needs_batch]


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    case = make_real(tmp_path_factory.mktemp("lammps"), n=2)
    case.toml.write_text(case.toml.read_text().replace("[dem]\n", '[dem]\ncode = "lammps"\n'))
    case.config = read_config(case.toml)
    case.rows = planned(case.config, case.folder, 2)
    write_plan(case.rows, case.folder)
    return case


def test_a_campaign_runs_to_its_end_and_is_not_repeated(small):
    done = small.command("run", "--jobs", "1")
    assert done.returncode == 0, done.stdout + done.stderr
    status = small.status()
    assert status["counts"]["total"]["done"] == len(small.rows) == 5 and status["other_scripts"] == 0
    before = small.sums()
    assert small.command("run").returncode == 0 and small.sums() == before
    with h5py.File(small.product()) as file:
        assert file.attrs["code"] == "lammps" and file["parameters"].attrs["code"] == "lammps"


def test_scripts_of_pruned_runs_go_with_their_products(small):
    folder = small.product().with_suffix(".lammps")
    assert (folder / "in.lammps").exists()
    small.toml.write_text(small.toml.read_text().replace('code = "lammps"\n', ""))
    assert small.command("prune", "--yes").returncode == 0
    assert not folder.exists() and not small.product().exists()
