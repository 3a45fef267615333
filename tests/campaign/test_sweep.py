"""A sweep: values of any key, products shared by run id, one table and one figure, and exit codes of all campaigns."""

from __future__ import annotations

import os
import tomllib

import pandas as pd
import pytest
import synthetic_runs
from campaign_cases import make_small
from paths import ROOT
from PIL import Image

from analysis.tables.sweep import COLUMNS
from campaign.__main__ import main
from campaign.config import ConfigError, parse_config, read_config
from campaign.prepare import PlanError
from campaign.products import run_statuses
from campaign.sweep import share_products, write_results
from campaign.sweep_values import toml_text, variants

DEMO = read_config(ROOT / "campaign" / "demo.toml")
SIGMA_3 = "consolidation.sigma_3_kPa"
#: Option -> values in words.
READ = {
    f"{SIGMA_3}=50,100,200": ["50", "100", "200"],
    f" {SIGMA_3} = 50 , 1e2": ["50", "100"],
    "consolidation.mu_iso=[0.001, 0.04],[0.1]": ["[0.001, 0.04]", "[0.1]"],
    "assembly.packings=4,[1, 7]": ["4", "[1, 7]"],
    "pdem.method=exact,'tvd'": ["exact", "tvd"],
    "dem.accuracy='',\"5%\"": ["", "5%"],
    "families.G_p_only=false,true": ["false", "true"],
    "inputs.pairs=a.csv,'b,c.csv'": ["a.csv", "b,c.csv"],
    "shear.snapshots=[],[0.1]": ["[]", "[0.1]"],
}


@pytest.mark.parametrize("option", READ)
def test_values_of_every_kind_are_those_of_a_campaign_file(option):
    key, found = variants(DEMO, [option])
    assert [one.value for one in found] == READ[option]
    section, name = key.split(".")
    for one in found:
        written = tomllib.loads(one.config.text)
        assert parse_config(toml_text(written), DEMO.source).inputs == one.config.inputs
        shown = getattr(getattr(one.config, section), name)
        given = written[section][name]
        assert shown == (tuple(given) if isinstance(given, list) else shown if name == "packings" else given)
        assert {**written, "name": 0, section: 0} == {**tomllib.loads(DEMO.text), "name": 0, section: 0}
    assert len({one.folder for one in found} | {one.config.name for one in found}) == 2 * len(found)
    assert all(one.folder.startswith(f"{key}=") and "/" not in one.folder for one in found)


#: Options --set and --with -> the refusal.
REFUSED = {
    (): "a sweep needs --set and a key with its values",
    (f"{SIGMA_3}=1,2", "points.n=8,16"): "--set is given 2 times: a sweep has one key, no grid",
    (SIGMA_3,): "must be a key and its values, such as",
    ("a b=1,2",): "must be a key and its values",
    (f"{SIGMA_3}=",): "a value is empty",
    (f"{SIGMA_3}=50,",): "a value is empty",
    (f"{SIGMA_3}=50",): "only 50 is given, a sweep needs at least two values",
    (f"{SIGMA_3}=50,60,50.0",): "the value 50 is given twice",
    ("consolidation.sigma3=50,60",): "demo.toml: unknown key consolidation.sigma3; did you mean 'sigma_3_kPa'?",
    ("sigma_3_kPa=50,60",): "unknown key sigma_3_kPa; did you mean consolidation.sigma_3_kPa?",
    ("points.n.x=50,60",): "points.n",
    (f"{SIGMA_3}=50,1e9",): "consolidation.sigma_3_kPa = 1000000000.0 is outside [1, 10000]",
    ("points.n=8,8.5",): "points.n = 8.5 must be a whole number",
    ("consolidation.mu_iso=0.1,0.2",): "consolidation.mu_iso = 0.1 must be a list",
    ("consolidation.mu_iso=[0.1,[0.2]",): "has a bracket without its partner",
    ("consolidation.mu_iso=0.1],[0.2",): "has a bracket without its partner",
    ("inputs.pairs=a.csv,'b.csv",): "'b.csv is no value of a campaign file",
    ("points.n=8,9\nseed=7",): "is no value of a campaign file",
    ("run.jobs=1,2",): "--set run.jobs: this key does not change a result",
    ("name=a,b",): "--set name: this key does not change a result",
    ("points.n=" + ",".join(map(str, range(1001))),): "has 1,001 values, at most 1,000",
}


@pytest.mark.parametrize("options", REFUSED, ids=range(len(REFUSED)))
def test_an_option_that_cannot_be_used_is_refused_in_one_line(options):
    with pytest.raises(ConfigError) as caught:
        variants(DEMO, list(options))
    assert REFUSED[options] in str(caught.value) and len(str(caught.value)) < 300


def test_a_second_key_changes_together_with_the_first():
    _, found = variants(DEMO, [f"{SIGMA_3}=50,100"], ["consolidation.G_ref_GPa=10,20", "points.seed=3,4"])
    values = [
        (c.consolidation.sigma_3_kPa, c.consolidation.G_ref_GPa, c.points.seed) for c in (v.config for v in found)
    ]
    assert values == [(50.0, 10.0, 3), (100.0, 20.0, 4)]
    for along, words in ((["points.seed=3"], "number of values: 1, and 2 of --set"), ([f"{SIGMA_3}=1,2"], "twice")):
        with pytest.raises(ConfigError, match=words):
            variants(DEMO, [f"{SIGMA_3}=50,100"], along)


def test_slurm_is_refused():
    with pytest.raises(ConfigError, match="a sweep runs on this machine"):
        variants(parse_config("[run]\nengine = 'slurm'\n"), [f"{SIGMA_3}=50,100"])


@pytest.mark.parametrize("table", [
    {"name": "a", "run": {"jobs": 2, "slurm": {"options": ["--qos=\"low\"", "a\\b"]}}}, {"a": {}, "b": 1e-7, "c": True},
    {"inputs": {"pairs": "Körnung \u007f 😀\t.csv"}, "variables": {"mu_s": {"mean": 0.25}}},
    {"x": {"a b.c": [[1], []]}},
])  # fmt: skip
def test_a_campaign_file_written_and_read_is_the_same(table):
    assert tomllib.loads(toml_text(table)) == table


def test_only_sound_products_of_the_same_run_are_shared(tmp_path):
    small = make_small(tmp_path)
    _, found = variants(small.config, ["shear.strain_end=0.1,0.08"])
    folders = [tmp_path / "sweep" / one.folder for one in found]
    planned = [
        (folder, synthetic_runs.planned(one.config, folder, 2)) for one, folder in zip(found, folders, strict=True)
    ]
    (first, rows), (second, others) = planned
    common = {row.run_id for row in rows} & {row.run_id for row in others}
    assert {row.stage for row in rows if row.run_id in common} == {"consolidate", "probe"} and len(common) == 6
    for row in rows:
        synthetic_runs.write_product(first, row, tmp_path / "ready" / f"{row.stage}.h5")
    run_statuses(first, rows)  # records the checksums
    damaged = next(row for row in rows if row.run_id in common and row.stage == "probe")
    (first / damaged.product).write_bytes(b"damaged")
    assert share_products(second, others, folders) == 5 and share_products(second, others, folders) == 0
    statuses = run_statuses(second, others)
    assert {k for k, status in statuses.items() if status.status == "done"} == common - {damaged.run_id}
    one = next(row for row in others if statuses[row.run_id].status == "done")
    assert os.path.samefile(first / one.product, second / one.product)


def moments_of(mean):
    """A table of moments with one state, in the columns of tables/moments.csv."""
    row = {"mu_iso": 0.04, "state": "peak", "quantity": "eta", "unit": "1", "kind": "denoised", "mean": mean,
           "mean_low": mean - 0.1, "mean_high": mean + 0.1, "sd": 0.2, "sd_low": 0.1, "sd_high": 0.3, "q05": 0.0,
           "packings": 4}  # fmt: skip
    return pd.DataFrame([row, row | {"kind": "as simulated", "sd": 0.25}])


@pytest.fixture
def sweep(tmp_path, monkeypatch):
    """A function that sweeps strain_end over 0.1 and 0.08 from the command line; the runs end as `codes` state.

    In place of runs there are synthetic products, in place of the analysis a table of moments.
    """
    small, folder = make_small(tmp_path), tmp_path / "sweep"
    made = []

    def everything(config, place, options):
        assert options.failed and options.quiet and config.run.jobs == 2
        end = config.shear.strain_end
        for row in synthetic_runs.planned(config, place, 2):
            if not (place / row.product).exists():
                made.append(row.run_id)
                synthetic_runs.write_product(place, row, tmp_path / "ready" / f"{row.stage}.h5")
        if isinstance(code := codes.get(end, 0), Exception):
            raise code
        (place / "tables").mkdir(exist_ok=True)
        moments_of(end).to_csv(place / "tables" / "moments.csv", index=False)
        return code

    codes: dict = {}
    monkeypatch.setattr("campaign.commands.everything", everything)
    monkeypatch.setattr("campaign.commands._plan", lambda config, place: (synthetic_runs.planned(config, place, 2),))

    def run(**by_value):
        codes.clear()
        codes.update({float(name.replace("_", ".")): code for name, code in by_value.items()})
        made.clear()
        code = main(["sweep", str(small.toml), "--folder", str(folder), "--set", "shear.strain_end=0.1,0.08",
                     "--jobs", "2", "--quiet", "--failed"])  # fmt: skip
        path = folder / "shear.strain_end.csv"
        return code, list(made), pd.read_csv(path) if path.exists() else None

    run.folder = folder
    return run


def test_a_sweep_makes_every_run_once_and_writes_one_table_and_one_figure(sweep, capsys):
    code, made, table = sweep()
    assert code == 0 and len(made) == len(set(made)) == 14  # 2 + 4 + 4 for the first value, 4 shear runs for the second
    out = capsys.readouterr().out
    assert "2 values, 14 different runs" in out
    assert "small_strain_end_0.08: 6 runs are there already, in the folder of another value" in out
    assert table.columns.tolist() == ["key", "value", *COLUMNS]
    assert table.value.tolist() == [0.1, 0.08, 0.1, 0.08] and set(table.key) == {"shear.strain_end"}
    assert table["mean"].tolist() == [0.1, 0.08, 0.1, 0.08] and table.sd.tolist() == [0.2, 0.2, 0.25, 0.25]
    assert table.mean_low.tolist() == pytest.approx([0.0, -0.02, 0.0, -0.02])
    assert "2 values" in Image.open(sweep.folder / "shear.strain_end.png").text["Source"]
    assert sweep()[:2] == (0, [])  # nothing is made twice


@pytest.mark.parametrize("ended, code", [(1, 1), (3, 3), (PlanError("no space"), 2)])
def test_the_exit_code_is_the_worst_of_the_values_and_the_others_go_on(sweep, capsys, ended, code):
    found, _, table = sweep(**{"0_1": ended})
    assert found == code and table.value.unique().tolist() == [0.08]
    lines = capsys.readouterr().err.splitlines()
    assert (
        lines[-1] == "campaign: the table lacks 1 of 2 values of shear.strain_end; the same command goes on from here"
    )
    assert lines[:-1] == (["campaign: shear.strain_end = 0.1: no space"] if code == 2 else [])


def test_a_sweep_without_any_result_writes_no_table(sweep):
    assert sweep(**{"0_1": 3, "0_08": 1})[::2] == (3, None)


def test_a_table_without_moments_has_no_figure(tmp_path):
    for value in ("a", "b"):
        (tmp_path / value / "tables").mkdir(parents=True)
        moments_of(1.0)[:0].to_csv(tmp_path / value / "tables" / "moments.csv", index=False)
    lines = write_results("points.n", [(value, tmp_path / value) for value in "ab"], tmp_path)
    assert lines[-1].startswith("no figure") and not (tmp_path / "points.n.png").exists()


def test_nothing_is_made_where_one_value_cannot_be_planned(tmp_path):
    small = make_small(tmp_path)
    small.folder = tmp_path / "sweep"
    thin = small.command("sweep", "--set", "shear.strain_end=0.1,0.9")
    assert thin.returncode == 2 and thin.stderr.count("\n") == 1 and "gives too thin a cell" in thin.stderr
    assert not small.folder.exists()
