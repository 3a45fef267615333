"""Thin cells are refused in `plan`, with a number of grains and a strain that do."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
import yade_runs
from paths import ROOT

from analysis.assembly import make_assembly, write_assembly
from analysis.runs.run_file import read_run
from campaign.cell import LOOSER, MEASURED, check_cell, reach_of
from campaign.config import ConfigError, parse_config

#: Campaign file and the strain at which its cell stops: that of a run for N = 80, the others by the rule with a solid
#: fraction of 0.62 to 0.65.
THIN = {
    "[assembly]\nN = 80": 0.244,
    "[assembly]\nN = 100": 0.31,
    "[assembly]\nN = 64": 0.21,
    "[assembly]\ndistribution = 'gap_graded'": 0.19,
    "[assembly]\nN = 2000\ndistribution = 'gap_graded'": 0.38,
    "[assembly]\nsigma_ln = 0.5": 0.24,
    "[assembly]\nN = 400\n[shear]\nstrain_end = 1.0": 0.73,
}


def refusal(text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        check_cell(parse_config(text, "thin.toml"))
    return str(caught.value)


@pytest.mark.parametrize("text", THIN)
def test_a_thin_cell_is_refused_before_the_strain_at_which_it_stands_still(text):
    """Not later, and at most 0.08 of strain earlier: the densest packing is assumed."""
    line, config = refusal(text), parse_config(text)
    reach = reach_of(config, config.assembly.N)
    assert THIN[text] - 0.08 < reach.safe < reach.stops < THIN[text]
    grains = config.assembly
    assert f"N = {grains.N} ({grains.distribution}, sigma_ln = {grains.sigma_ln:g}, sizes 1 to " in line
    assert f"about {reach.stops:.3g}" in line and "\n" not in line
    assert f"shear.strain_end = {config.shear.strain_end:g}" in line


@pytest.mark.parametrize("text", THIN)
def test_what_the_refusal_offers_is_accepted(text):
    number, strain = re.search(
        r"use N >= (\d+) \(about \S+ core-hours\) or shear.strain_end <= ([\d.]+)$", refusal(text)
    ).groups()
    shear = "" if "[shear]" in text else "\n[shear]"
    base = re.sub(r"\nN = \d+", "", text)
    check_cell(parse_config(base.replace("[assembly]", f"[assembly]\nN = {number}")))
    without = re.sub(r"\nstrain_end = [\d.]+", "", text)
    check_cell(parse_config(f"{without}{shear}\nstrain_end = {strain}"))
    fewer = base.replace("[assembly]", f"[assembly]\nN = {int(int(number) * 0.9)}")
    assert "thin a cell" in refusal(fewer)


@pytest.mark.long
@pytest.mark.yade
@pytest.mark.parametrize("distribution", MEASURED)
def test_the_densest_packing_of_a_grading_is_as_measured(tmp_path, distribution):
    write_assembly(tmp_path / "assembly.h5", make_assembly(1000, 0.248e-3, 0.174, 1, distribution))
    row = {"assembly": "assembly.h5", "mu_iso": LOOSER[0][0], "G_p": 25.7e9}
    done = yade_runs.stage("consolidate", tmp_path, description="densest", **row)
    assert done.returncode == 0, done.stderr
    solid = 1.0 / (1.0 + read_run(tmp_path / "densest.h5").record["e"][-1])
    assert solid == pytest.approx(MEASURED[distribution], rel=0.005)


def test_campaigns_in_use_are_accepted():
    for name in ("demo", "laptop", "paper"):
        check_cell(parse_config((ROOT / "campaign" / f"{name}.toml").read_text(), name))
    for preset in ("5%", "3%", "2%"):
        check_cell(parse_config(f'[dem]\naccuracy = "{preset}"'))
    check_cell(parse_config("[assembly]\nN = 64\n[shear]\nstrain_end = 0.1"))


def test_a_grading_too_broad_for_its_grains_is_refused_with_the_number_it_needs():
    line = refusal("[assembly]\nN = 5000\nsigma_ln = 0.8")
    assert "before shear begins" in line and "sizes 1 to 33.8" in line
    assert 70_000 < int(re.search(r"use N >= (\d+) \(about \S+ core-hours\)$", line)[1]) < 90_000
    assert refusal("[assembly]\nN = 5000\nsigma_ln = 1.0\n[shear]\nstrain_end = 1.0").endswith("or larger grains")


def test_minute_grains_are_refused_since_the_controller_compares_metres_with_a_strain():
    """At d50 = 10 um the strain of one step is a tenth of what is left of the edge."""
    few, usual = (parse_config(f"[assembly]\nN = 200\nd50_mm = {d50}") for d50 in (0.01, 0.248))
    assert reach_of(few, 200).stops < reach_of(usual, 200).stops - 0.1


def test_plan_refuses_it_before_anything_is_fitted_or_written(tmp_path):
    (tmp_path / "thin.toml").write_text("[assembly]\nN = 80\n")
    command = [sys.executable, "-m", "campaign", "plan", str(tmp_path / "thin.toml"), "--folder", str(tmp_path / "run")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.startswith("campaign: thin.toml: assembly.N = 80")
    assert len(done.stderr.splitlines()) == 1 and not (tmp_path / "run").exists()
