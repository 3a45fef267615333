"""`dem.code`: ids that never mix, what LAMMPS cannot do, its cost, its places, and one line where it is missing."""

from __future__ import annotations

import hashlib
import os

import h5py
import laptop_plan
import pytest
from campaign_cases import finish, make_small
from lammps_stages import needs_lmp
from paths import ROOT

from analysis.points import RepresentativePoints
from campaign.config import ConfigError, parse_config, places
from campaign.engine_slurm import job_script
from campaign.folder import record_sum
from campaign.plan import make_rows, predicted_seconds, predicted_steps
from campaign.products import run_statuses

LAMMPS = '[dem]\ncode = "lammps"\n'
POINTS = RepresentativePoints([(0.1 + 0.05 * k, (50 - 5 * k) * 1e9) for k in range(6)], [1 / 6] * 6)


def rows_of(text=""):
    return make_rows(parse_config(text), POINTS)


def test_ids_of_runs_in_yade_are_those_from_before_there_was_a_choice():
    """The runs of the laptop campaign, whose archive goes by these ids."""
    ids = sorted(row.run_id for row in laptop_plan.rows())
    assert hashlib.sha256("\n".join(ids).encode()).hexdigest()[:16] == "3e5022a188285211"
    assert {row.run_id for row in rows_of('[dem]\ncode = "yade"')} == {row.run_id for row in rows_of()}


def test_no_run_has_the_same_id_in_both_codes():
    yade, lammps = rows_of(), rows_of(LAMMPS)
    assert len(lammps) == len(yade) and not {row.run_id for row in yade} & {row.run_id for row in lammps}
    assert all("code" not in row.values for row in yade) and {row.values["code"] for row in lammps} == {"lammps"}


def test_the_number_of_ranks_changes_no_id():
    assert {r.run_id for r in rows_of(LAMMPS)} == {r.run_id for r in rows_of(LAMMPS + "[run]\nranks = 4")}


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ('[shear]\npath = "undrained"', 'path = "undrained" with dem.code = "lammps": only "drained" is possible'),
        ('[shear]\ndirection = "extension"', 'only "compression" is possible'),
        ("[shear]\nstop_when_steady = true", "shear.stop_when_steady = true with dem.code"),
        ('[material]\nheterogeneity = "grain"', 'material.heterogeneity = "grain" with dem.code'),
    ],
)
def test_what_lammps_cannot_do_is_refused_in_one_line(keys, words):
    with pytest.raises(ConfigError) as error:
        parse_config(f"{LAMMPS}{keys}", "mine.toml")
    assert words in str(error.value) and str(error.value).endswith('use dem.code = "yade"')
    assert "\n" not in str(error.value)


def test_damping_and_ranks_belong_to_one_code():
    with pytest.raises(ConfigError, match="dem.damping = 0.2 with dem.code"):
        parse_config(LAMMPS + "damping = 0.2")
    with pytest.raises(ConfigError, match="run.ranks = 2 needs dem.code"):
        parse_config("[run]\nranks = 2")


def test_a_run_takes_as_many_places_as_it_has_ranks():
    def of(ranks):
        return places(parse_config(f"{LAMMPS}[run]\njobs = 8\nranks = {ranks}"))

    assert [of(1), of(3), of(8), of(16)] == [8, 2, 1, 1]


def test_slurm_gives_a_task_as_many_processes_as_ranks(tmp_path):
    text = job_script(parse_config(f"{LAMMPS}[run]\nranks = 4"), tmp_path, "shear", "batch/x", 2, [])
    assert "#SBATCH --ntasks=4\n" in text and "export CAMPAIGN_RANKS=4\n" in text


def test_cost_is_that_of_the_code():
    yade = {"G_p": 25.7e9, "sigma_3": 1e5, "stiffness_scale": 1.0, "timestep_factor": 1.0, "strain_end": 0.4,
            "inertial_number": 2.4e-3, "density_scaling": 1, "mu_s": 0.25}  # fmt: skip
    # measured at these settings, N = 400 (data/benchmarks/engines.csv): 34,100 steps in YADE, 48,800 in LAMMPS
    assert predicted_steps("shear", yade | {"code": "lammps"}) == pytest.approx(48_800, rel=0.1)
    for stage in ("consolidate", "probe", "shear"):
        assert predicted_seconds(stage, 1e9, "lammps") < 0.35 * predicted_seconds(stage, 1e9)


def test_tables_say_how_to_run_a_line_by_hand(tmp_path):
    small = make_small(tmp_path, more=LAMMPS)
    assert (
        f"YADE_BATCH=batch/shear.table:LINE PYTHONPATH={os.path.relpath(ROOT, small.folder)} python3 -m "
        "campaign.lammps shear" in (small.folder / "batch" / "shear.table").read_text()
    )


def test_products_of_the_other_code_are_stale_and_not_used(tmp_path):
    small = finish(make_small(tmp_path))
    small.toml.write_text(small.toml.read_text() + LAMMPS)
    status = small.status()
    assert status["counts"]["total"]["missing"] == len(small.rows) == len(status["stale"])


def test_a_product_that_the_other_code_made_under_an_id_is_refused(tmp_path):
    """By hand, on a row of the table: ids alone cannot keep that from happening."""
    small = finish(make_small(tmp_path))
    with h5py.File(small.product(), "r+") as file:
        file.attrs["code"] = "lammps"
    record_sum(small.product())
    status = run_statuses(small.folder, small.rows, rehash=True)[small.rows[-1].run_id]
    assert status.status == "refused" and "code = 'lammps', planned 'yade'" in status.reason


def test_more_ranks_than_cores_are_refused_before_a_run(tmp_path):
    small = make_small(tmp_path, more=LAMMPS + "[run]\nranks = 1000\n")
    done = small.command("run", CAMPAIGN_YADE_BATCH="/bin/true", CAMPAIGN_LMP="/bin/true", CAMPAIGN_MPIRUN="/bin/true")
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "run.ranks = 1000 exceeds the" in done.stderr


def test_what_killed_runs_in_lammps_leave_is_removed_and_their_scripts_stay(tmp_path):
    small = finish(make_small(tmp_path), *make_small(tmp_path / "other").rows[-1:])
    small.product().unlink(missing_ok=True)
    left = small.product().with_suffix(".lammps")
    left.mkdir()
    for name in ("contacts.txt", "samples.txt", "in.lammps", "in.log", "start.restart"):
        (left / name).write_text("x")
    assert small.command("run").returncode == 0
    assert {path.name for path in left.iterdir()} == {"in.lammps", "in.log", "start.restart"}


def test_without_lammps_a_run_says_what_to_install(tmp_path):
    small = make_small(tmp_path, more=LAMMPS)
    done = small.command("run", CAMPAIGN_YADE_BATCH="/bin/true", CAMPAIGN_LMP="/no/such/lmp")
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "/no/such/lmp: no such program" in done.stderr and "apt-get install lammps" in done.stderr


@needs_lmp
def test_without_mpi_a_run_over_ranks_says_so(tmp_path):
    small = make_small(tmp_path, more=LAMMPS + "[run]\nranks = 2\n")
    done = small.command("run", CAMPAIGN_YADE_BATCH="/bin/true", CAMPAIGN_MPIRUN="/no/such/mpirun")
    assert done.returncode == 2 and "/no/such/mpirun: no such program" in done.stderr
