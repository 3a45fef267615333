"""A campaign whose grading is a sieve curve: settings, run ids, assembly, and refusals with a number of grains."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest
from campaign_cases import make_small
from paths import DATA, ROOT

from analysis.assembly import read_assembly
from analysis.inputs.sieve_curve import SieveError, read_sieve
from analysis.points import RepresentativePoints
from campaign.__main__ import main
from campaign.cell import check_cell, predicted_hours
from campaign.config import ConfigError, parse_config
from campaign.evaluate import campaign_info
from campaign.files import write_json
from campaign.plan import make_rows, predicted_cost
from campaign.prepare import INPUTS

BASE = "[assembly]\nN = 400\npackings = 2\nsieve = 'data/sieve/toyoura.csv'\n[points]\nn = 8\n"
WIDER = BASE.replace("toyoura", "taylor_cu4").replace("400", "1000")
FRICTION, EQUAL = np.linspace(0.1, 0.3, 8), np.full(8, 0.125)
POINTS = RepresentativePoints(np.column_stack([FRICTION, np.full(8, 25.7e9)]), EQUAL)


def test_d50_is_that_of_the_curve():
    config = parse_config(BASE)
    curve = read_sieve(DATA / "sieve" / "toyoura.csv")
    assert config.curve == curve and config.assembly.d50_mm == pytest.approx(1e3 * curve.sizes["D50"], rel=1e-9)
    assert parse_config("[assembly]\nN = 400\n").curve is None


@pytest.mark.parametrize("key", ["d50_mm = 0.2", "sigma_ln = 0.174", "distribution = 'lognormal'"])
def test_a_key_that_the_curve_takes_the_place_of_is_refused(key):
    with pytest.raises(ConfigError, match=rf"assembly\.{key.split()[0]} = .* and assembly\.sieve are both given"):
        parse_config(f"[assembly]\nsieve = 'data/sieve/toyoura.csv'\n{key}\n")


def test_a_file_that_is_missing_or_no_curve_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"assembly\.sieve = 'none\.csv' is no file"):
        parse_config("[assembly]\nsieve = 'none.csv'\n")
    (tmp_path / "bad.csv").write_text("size_mm,passing_percent\n0.1,3\n0.2,100\n")
    with pytest.raises(SieveError, match=r"bad\.csv, line 2: 3 % passes"):
        parse_config("[assembly]\nsieve = 'bad.csv'\n", tmp_path / "c.toml")


def test_run_ids_depend_on_the_curve_and_not_on_the_name_of_its_file(tmp_path):
    def ids(text):
        return {row.run_id for row in make_rows(parse_config(text, tmp_path / "c.toml"), POINTS)}

    text = (DATA / "sieve" / "toyoura.csv").read_text()
    (tmp_path / "same.csv").write_text(text)
    (tmp_path / "other.csv").write_text(text.replace("0.2097,59.8", "0.2097,59.7"))
    first = ids(BASE)
    assert first == ids(BASE.replace("data/sieve/toyoura.csv", "same.csv"))
    assert not first & ids(BASE.replace("data/sieve/toyoura.csv", "other.csv"))
    plain = "[assembly]\nN = 400\npackings = 2\nd50_mm = 0.2\n[points]\nn = 8\n"
    rows = make_rows(parse_config(plain), POINTS)
    assert not first & {row.run_id for row in rows} and "sieve" not in rows[0].values


def test_the_spheres_of_every_packing_have_the_curve(tmp_path):
    shutil.copy(DATA / "sieve" / "toyoura.csv", tmp_path)
    small = make_small(tmp_path, more="[pdem]\ncells = 64\n")
    text = small.toml.read_text().replace("packings = [1]", "packings = [1, 2]\nsieve = 'toyoura.csv'")
    small.toml.write_text(text.replace("N = 64", "N = 150"))
    assert small.command("plan").returncode == 0
    curve = read_sieve(tmp_path / "toyoura.csv")
    packings = [read_assembly(small.folder / f"assembly_{seed}.h5") for seed in (1, 2)]
    for packing in packings:
        assert np.sort(2.0 * packing.radius) == pytest.approx(curve.diameters(150))
    assert not np.allclose(packings[0].radius, packings[1].radius)
    before = (small.folder / "assembly_1.h5").stat().st_mtime_ns
    assert small.command("plan").returncode == 0
    assert (small.folder / "assembly_1.h5").stat().st_mtime_ns == before
    write_json(small.folder / "inputs.json", {name: kind() for name, kind in INPUTS.items()} | {"pairs": [[1, 2]]})
    config = parse_config(small.toml.read_text(), small.toml)
    assert campaign_info(config, small.folder).settings["assembly"]["sieve_curve"]["size"] == curve.size


def test_a_curve_that_needs_more_spheres_is_refused_with_their_number_and_cost():
    with pytest.raises(ConfigError) as caught:
        check_cell(parse_config(WIDER, "c.toml"))
    line = str(caught.value)
    found = re.fullmatch(r"(.*); use N >= (\d+) \(about (\S+) core-hours\)", line)
    assert found, line
    assert found[1] == (
        "c.toml: assembly.N = 1000 spheres of data/sieve/taylor_cu4.csv (a sieve curve, D50 = 0.702 mm, sizes 1 to 13) "
        "put 13.7% of the mass into one sphere, the limit is 10%"
    )
    enough = WIDER.replace("N = 1000", f"N = {found[2]}")
    check_cell(parse_config(enough))
    assert float(found[3]) == pytest.approx(predicted_hours(parse_config(enough), int(found[2])), rel=0.05)
    with pytest.raises(ConfigError):
        check_cell(parse_config(WIDER.replace("N = 1000", f"N = {int(0.9 * int(found[2]))}")))


def test_a_curve_that_no_number_of_spheres_has_is_refused_as_such(tmp_path):
    (tmp_path / "s.csv").write_text("size_mm,passing_percent\n0.01,0\n0.1,50\n5,100\n")
    with pytest.raises(ConfigError, match=r"sizes 1 to 500\) miss .*; use a curve of a smaller size ratio$"):
        check_cell(parse_config(BASE.replace("data/sieve/toyoura.csv", "s.csv"), tmp_path / "c.toml"))


@pytest.mark.parametrize("text", [
    BASE, "[points]\nn = 8\n[families]\nG_p_only = true\nmu_s_fixed = 0.2\nG_p_points = 3\n",
    "[points]\nn = 8\n[consolidation]\nper_point = true\n",
])  # fmt: skip
def test_the_cost_without_points_is_that_of_the_plan_where_all_points_have_the_reference_modulus(text):
    config = parse_config(text)
    modulus = 25.7e9 * (1.0 + 1e-12 * np.arange(8))  # the runs stay different
    points = RepresentativePoints(np.column_stack([FRICTION, modulus]), EQUAL)
    planned = predicted_cost(make_rows(config, points))["total"]["core_hours"]
    assert predicted_hours(config, config.assembly.N) == pytest.approx(planned, rel=1e-6)


def test_plan_says_in_one_line_what_a_curve_lacks(tmp_path, capsys):
    path = tmp_path / "c.toml"
    path.write_text(WIDER)
    assert main(["plan", str(path), "--folder", str(tmp_path / "run")]) == 2
    assert capsys.readouterr().err.count("\n") == 1 and not (tmp_path / "run").exists()
    assert (ROOT / "data" / "sieve" / "taylor_cu4.csv").exists()
