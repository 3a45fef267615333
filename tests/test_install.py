"""The installed package: a wheel in an environment of its own, used from another folder without the repository."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import synthetic_results
from paths import ROOT

import analysis

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
#: A campaign that is planned in little time.
CAMPAIGN = """
[inputs]
marginals = ["lognormal"]
copulas = ["gaussian"]
bootstrap = 19
[points]
n = 8
[assembly]
N = 200
packings = 1
[shear]
strain_end = 0.10
"""
needs_build = pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("pip", "setuptools", "wheel")),
    reason="pip, setuptools or wheel is not installed",
)


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """An environment with the wheel, and a folder elsewhere that holds a results file."""
    place = tmp_path_factory.mktemp("installed")
    source = place / "source"
    ignored = shutil.ignore_patterns("__pycache__", "laptop", "benchmarks", "example_runs")
    for folder in ("analysis", "campaign", "yade_scripts", "data", "grain_scatter"):
        shutil.copytree(ROOT / folder, source / folder, ignore=ignored)
    shutil.copy(ROOT / "pyproject.toml", source)
    build = "from setuptools import build_meta; build_meta.build_wheel('wheel')"
    _checked([sys.executable, "-c", build], source)
    (wheel,) = (source / "wheel").glob("*.whl")
    env = place / "env"
    _checked([sys.executable, "-m", "venv", "--system-site-packages", "--without-pip", str(env)], place)
    _checked([sys.executable, "-m", "pip", "--python", str(env / "bin" / "python"), "install", "--quiet", "--no-deps",
              "--no-index", str(wheel)], place)  # fmt: skip
    shutil.rmtree(source)
    shutil.copy(synthetic_results.small_example(), place / "results.h5")
    return place


def _checked(command, place):
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(command, cwd=place, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def command(place, *words, **env):
    """grain-scatter WORDS in the folder `place`, without a `yade` on the path."""
    line = [str(place / "env" / "bin" / "grain-scatter"), *words]
    env = {"PATH": str(place / "env" / "bin"), "HOME": str(place), "OPENBLAS_NUM_THREADS": "1"} | env
    return subprocess.run(line, cwd=place, env=env, capture_output=True, text=True)


def test_the_version_is_stated_once_and_the_same():
    assert PROJECT["project"]["version"] == analysis.__version__
    assert f"version: {analysis.__version__}" in (ROOT / "CITATION.cff").read_text()


def test_every_package_of_the_repository_is_installed():
    found = {"grain_scatter", "grain_scatter.data"}
    for folder in ("analysis", "campaign", "yade_scripts"):
        for init in (ROOT / folder).rglob("__init__.py"):
            found.add(".".join(["grain_scatter", *init.parent.relative_to(ROOT).parts]))
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == found


@needs_build
def test_it_takes_one_name_in_site_packages(installed):
    (packages,) = (installed / "env").glob("lib/python*/site-packages")
    names = {p.name for p in packages.iterdir() if not p.name.endswith(".dist-info")}
    assert names - {"__pycache__"} == {"grain_scatter"}


@needs_build
def test_version_and_help(installed):
    assert command(installed, "--version").stdout == f"grain-scatter {analysis.__version__}\n"
    assert "usage: grain-scatter" in command(installed, "--help").stdout


@needs_build
def test_it_exports_in_another_folder(installed):
    done = command(installed, "export", "results.h5", "--to", "csv")
    assert done.returncode == 0, done.stderr
    assert (installed / "csv" / "states.csv").exists()


@needs_build
def test_it_plans_the_default_campaign_and_says_in_one_line_that_yade_is_missing(installed):
    (installed / "mine.toml").write_text(CAMPAIGN)
    missing = command(installed, "status", "mine.toml")
    assert "run `grain-scatter plan CONFIG` first" in missing.stderr
    done = command(installed, "run", "mine.toml", "--quiet")
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith(
        "campaign: yade-batch: no such program; on Debian and Ubuntu `apt-get"
    )
    assert (installed / "runs" / "mine" / "points.csv").exists()
    assert "../env/" in (installed / "runs" / "mine" / "batch" / "shear.table").read_text().replace("../..", "..")


@needs_build
def test_a_name_of_a_campaign_file_of_the_project_will_do(installed):
    done = command(installed, "status", "demo.toml")
    assert "has no plan yet" in done.stderr


@needs_build
def test_the_analysis_has_the_name_of_the_package(installed):
    code = """
import grain_scatter, sys
from grain_scatter import read_results, evaluate
from grain_scatter.pdem import state_pdf
from grain_scatter.results.reader import Results
assert not {"analysis", "campaign", "numpy"} & ({*sys.modules} - {"numpy"})
results = read_results("results.h5")
assert isinstance(results, Results) and state_pdf.__module__ == "grain_scatter.pdem.evolution"
assert "read_results" in dir(grain_scatter)
print(grain_scatter.__version__, len(results.points))
"""
    done = _checked([str(installed / "env" / "bin" / "python"), "-c", code], installed)
    assert done.stdout.split()[0] == analysis.__version__


def test_the_dockerfile_is_one_and_installs_what_the_makefile_does():
    text = (ROOT / "Dockerfile").read_text().replace("\\\n", " ")
    steps = [line.split(None, 1) for line in text.splitlines() if line.strip() and not line.startswith("#")]
    assert {name for name, _ in steps} <= {"FROM", "RUN", "COPY", "WORKDIR", "ENTRYPOINT"} and steps[0][0] == "FROM"
    values = dict(steps)
    assert json.loads(values["ENTRYPOINT"]) == list(PROJECT["project"]["scripts"])
    copied, target = values["COPY"].split()
    assert (ROOT / copied).is_dir() and any(value.endswith(target) for name, value in steps if name == "RUN")
    (installed,) = re.findall(r"apt-get install -y --no-install-recommends (.*?)&&", text)
    makefile = (ROOT / "Makefile").read_text()
    (analysis_packages,) = re.findall(r"^ANALYSIS = (.*)$", makefile, re.MULTILINE)
    assert {"yade", "python3-pip", *analysis_packages.split()} <= set(installed.split())


def test_make_without_apt_says_in_one_sentence_what_to_do(tmp_path):
    for name in ("sh", "ls", "env"):
        (tmp_path / name).symlink_to(shutil.which(name))
    command = [shutil.which("make"), "setup", "INSTALLED=/nowhere"]
    done = subprocess.run(command, cwd=ROOT, env={"PATH": str(tmp_path)}, capture_output=True, text=True)
    assert done.returncode != 0 and done.stderr.startswith("This system has no apt-get. Debian 12 or newer and Ubuntu")
    assert (
        "`pip install .` gives plan, analyse, report, compare and export" in done.stderr
        and "apt-get:" not in done.stderr
    )


def test_in_the_repository_it_is_the_same_analysis(tmp_path):
    code = (
        "import grain_scatter, grain_scatter.pdem as p; print(p.__file__, grain_scatter.__doc__.count('read_results'))"
    )
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True, check=True
    )
    path, count = done.stdout.split()
    assert Path(path) == ROOT / "analysis" / "pdem" / "__init__.py" and int(count) > 2


def test_another_python_goes_on_with_the_systems_one_or_says_what_it_lacks(tmp_path):
    """A Python without packages: with `-S` it sees none of those that are installed."""
    code = "import runpy, sys; sys.path.insert(0, %r); sys.argv = ['campaign', '--version']; "
    code += "runpy.run_module('campaign', run_name='__main__', alter_sys=True)"
    bare = [sys.executable, "-S", "-c", code % str(ROOT)]
    here = os.environ | {"GRAIN_SCATTER_PYTHON": "already tried"}
    done = subprocess.run(bare, cwd=ROOT, env=here, capture_output=True, text=True)
    assert done.stdout == f"grain-scatter {analysis.__version__}\n"
    code = code.replace("'--version'", "'report', 'x.h5'")
    done = subprocess.run(
        [sys.executable, "-S", "-c", code % str(ROOT)], cwd=ROOT, env=here, capture_output=True, text=True
    )
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "is not installed for" in done.stderr and "-m pip install numpy scipy" in done.stderr
