"""At least forty errors of use: each ends in one clear line and a non-zero exit code, and nothing is half-written."""

import subprocess
import sys
from pathlib import Path

import h5py
import pytest
import synthetic_runs
from paths import ROOT

from campaign.__main__ import main
from campaign.config import read_config
from campaign.plan import write_plan

#: Text of the campaign file -> what the line must name.
CONFIGS = {
    "[points]\nm = 8": "points.m",
    "[points]\nN = 8": "points.N",
    "[shear]\nstrain_ends = 0.3": "did you mean 'strain_end'",
    '[shear]\npath = "undraind"': "must be one of 'drained', 'constant_p', 'undrained'; did you mean 'undrained'?",
    '[shear]\ndirection = "up"': "must be one of 'compression', 'extension'",
    '[shear]\npath = "constant_p"\n[dem]\nstiffness_scale = 0.1': "dem.stiffness_scale = 0.1 with shear.path = "
    "'constant_p': only 1 is possible",
    '[shear]\npath = "undrained"\n[dem]\nstiffness_scale = 0.1': "only 1 is possible",
    '[shear]\npath = "undrained"\nstiff_cap_MPa = 0.05': "shear.stiff_cap_MPa = 0.05 must exceed "
    "consolidation.sigma_3_kPa = 100",
    "[shear]\nstiff_cap_MPa = 1e5": "is it kPa?",
    "[sheer]\nstrain_end = 0.3": "did you mean 'shear'",
    "colour = 3": "colour",
    "[points]\nn = 'ten'": "points.n = 'ten' must be a whole number",
    "[points]\nn = 8.5": "points.n = 8.5 must be a whole number",
    "[points]\nn = true": "points.n = True must be a whole number",
    "[points]\nn = 1": "points.n = 1 is outside [2, 10000]",
    "[points]\nnested = 1": "points.nested = 1 must be true or false",
    "[assembly]\nN = 10": "assembly.N = 10 is outside",
    "[assembly]\nd50_mm = -0.2": "assembly.d50_mm",
    "[assembly]\nd50_mm = nan": "assembly.d50_mm = nan",
    "[assembly]\nd50_mm = 248": "assembly.d50_mm = 248 is outside [0.001, 100]: is it micrometres",
    "[assembly]\nd50_mm = 0.000248": "assembly.d50_mm = 0.000248 is outside [0.001, 100]: is it metres?",
    "[material]\nrho = 2.67": "material.rho = 2.67 is outside [100, 100000]: kg/m3?",
    "[consolidation]\nsigma_3_kPa = 0.1": "consolidation.sigma_3_kPa = 0.1 is outside [1, 10000]: is it MPa?",
    "[consolidation]\nsigma_3_kPa = 1e5": "consolidation.sigma_3_kPa = 100000.0 is outside [1, 10000]: is it Pa?",
    "[shear]\nstrain_end = 40": "shear.strain_end = 40 is outside [0.001, 1]: is it per cent?",
    "n = 8": "unknown key n; did you mean points.n or assembly.N?",
    "N = 400": "unknown key N; did you mean points.n or assembly.N?",
    "memory = '2G'": "unknown key memory; did you mean run.slurm.memory?",
    "[material]\nrolling_friction = 0.1": "unknown key material.rolling_friction; the tool does not do rolling",
    "[material]\ncohesion = 1": "unknown key material.cohesion; the tool does not do cohesion, bonds or cementation",
    "[shear]\nn_cycles = 10": "unknown key shear.n_cycles; the tool does not do cyclic or repeated loading",
    "[assembly]\nshape = 'cube'": "unknown key assembly.shape; the tool does not do grains that are not spheres",
    "[assembly]\ndistribution = 'clumps'": "'gap_graded'; the tool does not do grains that are not spheres",
    "[cyclic]\nn = 3": "unknown key cyclic; the tool does not do cyclic or repeated loading",
    "[inputs.columns]\nG_p = 'G'": "inputs.columns: unknown key G_p; did you mean G_p_Pa or G_p_MPa or G_p_GPa?",
    "[inputs.columns]\nfriction = 'G'": "inputs.columns: unknown key friction; known: mu_s, G_p_GPa, G_p_MPa,",
    "[inputs.columns]\nmu_s = 3": "inputs.columns: mu_s = 3 must be the name of a column of the table, in quotes",
    "[inputs.columns]\nmu_s = ''": "inputs.columns: mu_s = '' must be the name of a column",
    "[inputs.columns]\nG_p_Pa = 'G'\nE_p_Pa = 'E'": "inputs.columns: G_p_Pa and E_p_Pa both name a column for G_p",
    "[inputs]\ncolumns = 3": "inputs.columns = 3 must be a section, [inputs.columns]",
    "[inputs.columns]\nmu_s = 'friction'": "line 3: has no column 'friction', which inputs.columns names for mu_s",
    "[shear]\nseed = 3": "unknown key shear.seed; did you mean inputs.seed or points.seed?",
    "[points]\nn = " + "9" * 5000: "bad.toml, line 2: a whole number has 5,000 digits, at most 4,300",
    "[points]\nn = 0x" + "f" * 5000: "points.n = a number of more than 4,300 digits is outside [2, 10000]",
    "[material]\nrho = 1" + "0" * 400: "(401 characters) is outside [100, 100000]: kg/m3?",
    "[material]\nrho = -1" + "0" * 400: "(402 characters) is outside [100, 100000]: kg/m3?",
    "[points]\nn = " + "[" * 2000 + "]" * 2000: "lists or sections are nested too deep",
    "[points]\nn" + ".a" * 3000 + " = 1": "lists or sections are nested too deep",
    "[points]\n'" + "n" * 100_000 + "' = 1": "(100,000 characters)",
    '[points]\n"n\\u001b[31m" = 1': "unknown key points.n\\x1b[31m",
    "[assembly]\npackings = []": "assembly.packings is empty",
    "[assembly]\npackings = [1, 1]": "names a value twice",
    "[assembly]\npackings = 0": "assembly.packings = 0 is outside [1, 10000]",
    "[assembly]\npackings = true": "assembly.packings = True must be a whole number or a list of whole numbers",
    "[assembly]\npackings = 2.0": "assembly.packings = 2.0 must be a whole number or a list of whole numbers",
    "[assembly]\nreplicate_points = 5": "assembly.replicate_points is no key any more: assembly.packings are dealt",
    "[assembly]\npackings = ['a']": "assembly.packings",
    "[assembly]\ndistribution = 'lognormall'": "did you mean 'lognormal'",
    "[consolidation]\nmu_iso = [0.1, -0.1]": "consolidation.mu_iso = -0.1 is outside",
    "[consolidation]\nmu_iso = [0.04, 0.04000001]": "names a value twice: 0.04 in the six digits",
    "[shear]\nsnapshots = [0.1, 0.10000001]": "must increase in their first six digits",
    "[consolidation]\nsigma_3_kPa = 0": "consolidation.sigma_3_kPa",
    "[material]\nnu = 0.5": "material.nu = 0.5 is outside",
    "[material]\nheterogeneity = 'grains'": "did you mean 'grain'",
    "[shear]\nstrain_end = inf": "shear.strain_end = inf is outside",
    "[shear]\ninertial_number = 0.01": "shear.inertial_number = 0.01 is outside [1e-06, 0.0025]",
    "[shear]\nsnapshots = [0.3, 0.1]": "must increase",
    "[shear]\nsnapshots = [0.9]": "beyond strain_end",
    "[dem]\naccuracy = '10%'": "dem.accuracy = '10%'",
    "[dem]\ntimestep_factor = 'big'": "dem.timestep_factor = 'big' must be a number",
    "[failures]\nmax_lost_probability = 2": "failures.max_lost_probability",
    "[pdem]\nmethod = 'exakt'": "did you mean 'exact'",
    "[run]\njobs = -1": "run.jobs = -1",
    "[run]\nengine = 'cloud'": "run.engine = 'cloud'",
    "[run.slurm]\ntime = 'a day'": "run.slurm.time = 'a day'",
    "[run.slurm]\nmemory = 'lots'": "run.slurm.memory",
    "[run.slurm]\nmemory = '٣G'": "run.slurm.memory",
    "[run.slurm]\ntime = '٣'": "run.slurm.time",
    '[run.slurm]\npartition = "fast\\ntouch /tmp/x"': "run.slurm.partition",
    "[run.slurm]\npartition = 'fast --uid=0'": "run.slurm.partition",
    '[run.slurm]\noptions = ["--qos=low\\ntouch /tmp/x"]': "run.slurm.options",
    '[run.slurm]\noptions = ["--qos=low\\u2028touch /tmp/x"]': "run.slurm.options",
    "[run.slurm]\noptions = ['rm -r x']": "run.slurm.options",
    "run = 3": "run = 3 must be a section",
    "[run]\nslurm = 3": "run.slurm = 3 must be a section",
    "name = 'a/b'": "name = 'a/b'",
    "name = ''": "name = ''",
    "[points\nn = 8": "not TOML",
    "[points]\nn = 8\nn = 9": "not TOML",
}

#: Text of the pairs file -> what the line must name.
GOOD = synthetic_runs.PAIRS
PAIRS = {
    GOOD.replace("mu_s", "friction"): "mu_s",
    GOOD.replace("G_p_GPa", "stiffness"): "G_p_GPa",
    GOOD.replace("0.120", "soft"): "soft",
    GOOD.replace("0.120", "-0.120"): "-0.12",
    GOOD.replace("0.120", "nan"): "nan",
    "\n".join(GOOD.splitlines()[:9]) + "\n": "10",
    "": "empty",
    GOOD.replace("0.120", "0.1_20"): "pairs.csv, line 3: mu_s = '0.1_20' is not a number",
    GOOD.replace("0.120", "5e-324"): "pairs.csv, line 3: mu_s = 5e-324 is below 0.0001",
    GOOD.replace("0.120", "1" * 140_000): "pairs.csv, line 3: a cell has more than 131,072 characters",
    GOOD.replace("0.120", '"0.12\n0"'): "pairs.csv, line 3: a quoted cell does not end in this line",
    GOOD.splitlines()[0]
    + "\n"
    + "0.2,20\n0.3,30\n" * 10: "mu_s has 2 distinct values in 20 pairs; a fit needs at least 5",
}


#: Bytes of the campaign file -> what the line must name.
ENCODED = {
    "# µm\n[points]\nn = 1 # µ\n".encode("cp1252"): "line 1: byte 0xb5 is not UTF-8; in Windows-1252 it is 'µ'",
    "[points]\nn = 8\n".encode("utf-16"): "seems to be in UTF-16",
}


def _one_line(capsys, code: int, named: str) -> None:
    output = capsys.readouterr()
    assert code == 2
    assert output.out == ""
    assert len(output.err.strip().splitlines()) == 1, output.err
    assert named in output.err and "Traceback" not in output.err


def test_there_are_forty():
    assert len(CONFIGS) + len(PAIRS) + len(COMMANDS) + len(PRODUCTS) >= 40


@pytest.mark.parametrize("text", CONFIGS, ids=lambda text: text[:60])
def test_campaign_file(text, tmp_path, capsys):
    path = tmp_path / "bad.toml"
    path.write_text(text + "\n")
    code = main(["plan", str(path), "--folder", str(tmp_path / "run")])
    _one_line(capsys, code, CONFIGS[text])
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("data", ENCODED)
def test_encoding_of_the_campaign_file(data, tmp_path, capsys):
    path = tmp_path / "bad.toml"
    path.write_bytes(data)
    _one_line(capsys, main(["plan", str(path), "--folder", str(tmp_path / "run")]), ENCODED[data])


@pytest.mark.parametrize("text", PAIRS, ids=lambda text: text[:60])
def test_pairs_file(text, tmp_path, capsys):
    path = synthetic_runs.write_config(tmp_path)
    (tmp_path / "pairs.csv").write_text(text)
    code = main(["plan", str(path), "--folder", str(tmp_path / "run")])
    _one_line(capsys, code, PAIRS[text])
    assert not (tmp_path / "run").exists()


#: Arguments after `python3 -m campaign` -> what the line must name.
COMMANDS = {
    "plan nowhere.toml": "nowhere.toml",
    "plan .": "Is a directory",
    "status good.toml": "has no plan yet",
    "missing good.toml": "has no plan yet",
    "analyse good.toml": "has no plan yet",
    "report good.toml": "has no results.h5",
    "run good.toml --jobs 0": "--jobs = 0",
    "status good.toml --jobs 5000": "--jobs = 5000 is outside [1, 4096]",
    "run good.toml --jobs 2 --engine slurm": "--jobs = 2 has no effect in SLURM",
    "plan binary.toml": "UTF-8",
}


@pytest.mark.parametrize("line", COMMANDS)
def test_command_line(line, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    synthetic_runs.write_config(tmp_path).rename("good.toml")
    Path("binary.toml").write_bytes(b"\xff\xfe\x00")
    code = main([*line.split(), "--folder", str(tmp_path / "run")])
    _one_line(capsys, code, COMMANDS[line])
    assert not (tmp_path / "run").exists()


USAGE = ["", "fly", "plan", "plan a.toml b.toml", "run a.toml --engine cloud", "plan a.toml --jobs 2",
         "run a.toml --json", "status a.toml --failed", "missing a.toml --quiet", "report a.toml --check"]  # fmt: skip


@pytest.mark.parametrize("line", USAGE)
def test_usage(line):
    done = subprocess.run([sys.executable, "-m", "campaign", *line.split()], capture_output=True, text=True,
                          cwd=ROOT)  # fmt: skip
    assert done.returncode == 2 and "Traceback" not in done.stderr and "usage:" in done.stderr


def _truncate(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _flip(path):
    data = bytearray(path.read_bytes())
    for k in range(len(data) // 3, len(data) // 3 + 64):
        data[k] ^= 0xFF
    path.write_bytes(data)


def _edit(path, change):
    with h5py.File(path, "r+") as file:
        change(file)


#: Name -> (what is done to one product, what the line must name).
PRODUCTS = {
    "gone": (lambda path: path.unlink(), "have no product yet"),
    "empty": (lambda path: path.write_bytes(b""), "cannot be read as a run file"),
    "truncated": (_truncate, "cannot be read as a run file"),
    "text": (lambda path: path.write_text("no HDF5"), "cannot be read as a run file"),
    "another format": (lambda path: _edit(path, lambda f: f.attrs.update(format="xyz")), "is no run file"),
    "not complete": (lambda path: _edit(path, lambda f: f.attrs.update(complete=False)), "is not complete"),
    "another run": (lambda path: _edit(path, lambda f: f.attrs.update(run_id="x")), "run_id = 'x'"),
    "another mu_s": (lambda path: _edit(path, lambda f: f["parameters"].attrs.update(mu_s=0.3)), "mu_s = 0.3"),
    "no parameters": (lambda path: _edit(path, lambda f: f.pop("parameters")), "cannot be read as a run file"),
}  # fmt: skip


@pytest.mark.parametrize("name", PRODUCTS)
def test_run_file(name, tmp_path, capsys):
    path = synthetic_runs.write_config(tmp_path, n=2)
    folder, config = tmp_path / "run", read_config(path)
    rows = synthetic_runs.planned(config, folder, 2)
    write_plan(rows, folder)
    for row in rows:
        synthetic_runs.write_product(folder, row)
    damage, named = PRODUCTS[name]
    damage(folder / rows[-1].product)
    code = main(["analyse", str(path), "--folder", str(folder)])
    _one_line(capsys, code, named)
    assert not (folder / "results.h5").exists()


def test_flipped_bytes_after_the_checksum(tmp_path, capsys):
    path = synthetic_runs.write_config(tmp_path, n=2)
    folder, config = tmp_path / "run", read_config(path)
    rows = synthetic_runs.planned(config, folder, 2)
    for row in rows:
        synthetic_runs.write_product(folder, row)
    assert main(["missing", str(path), "--folder", str(folder)]) == 0
    assert capsys.readouterr().out == ""
    _flip(folder / rows[-1].product)
    code = main(["analyse", str(path), "--folder", str(folder)])
    _one_line(capsys, code, "bytes have changed")
