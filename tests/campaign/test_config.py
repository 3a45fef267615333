"""The campaign file: what is read, what `dem.accuracy` stands for, and that the files in the repository are valid."""

from dataclasses import fields

import pytest

from campaign.config import ROOT, ConfigError, parse_config, read_config
from campaign.config_checks import settings_warnings
from campaign.config_keys import SECTIONS, Slurm


@pytest.mark.parametrize("name", ["demo", "laptop", "paper"])
def test_shipped_files_are_valid(name):
    config = read_config(ROOT / "campaign" / f"{name}.toml")
    assert config.name == name
    assert config.consolidation.mu_iso == (0.001, 0.04, 0.1)


def test_paper_is_the_papers_own_size():
    config = read_config(ROOT / "campaign" / "paper.toml")
    assert (config.assembly.N, config.points.n, config.shear.inertial_number) == (23312, 100, 1e-4)
    assert config.consolidation.sigma_3_kPa == 100.0 and config.shear.strain_end == 0.40 and config.dem.damping == 0.0


def test_demo_is_at_least_what_the_default_campaign_promises():
    config = read_config(ROOT / "campaign" / "demo.toml")
    assert config.points.n >= 8 and config.assembly.N >= 400 and config.shear.strain_end >= 0.30


def test_accuracy_fills_in_and_own_keys_win():
    coarse = parse_config('[dem]\naccuracy = "5%"')
    fine = parse_config('[dem]\naccuracy = "2%"')
    assert fine.assembly.N > coarse.assembly.N
    assert fine.shear.inertial_number < coarse.shear.inertial_number
    mixed = parse_config('[assembly]\nN = 777\n[dem]\naccuracy = "2%"\ntimestep_factor = 0.5')
    assert mixed.assembly.N == 777 and mixed.dem.timestep_factor == 0.5
    assert mixed.shear.inertial_number == fine.shear.inertial_number


def test_whole_numbers_serve_as_numbers():
    assert parse_config("[shear]\nstrain_end = 1").shear.strain_end == 1.0


def test_config_cannot_be_changed():
    config = parse_config("")
    with pytest.raises(AttributeError):
        config.points.n = 3


def test_name_comes_from_the_file_where_none_is_given(tmp_path):
    path = tmp_path / "sand_2.toml"
    path.write_text("")
    assert read_config(path).name == "sand_2"


def test_pairs_beside_the_campaign_file_come_first(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("")
    assert read_config(path).pairs_path == ROOT / "data" / "pairs_reconstructed.csv"
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "pairs_reconstructed.csv").write_text("mu_s,G_p_GPa\n")
    assert read_config(path).pairs_path == tmp_path / "data" / "pairs_reconstructed.csv"


def test_missing_pairs_name_the_key(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('[inputs]\npairs = "nowhere.csv"\n')
    with pytest.raises(ConfigError, match=r"mine.toml: inputs.pairs = 'nowhere.csv' is no file"):
        _ = read_config(path).pairs_path


def test_every_key_is_explained():
    keys = [(name, key) for name, section in SECTIONS.items() for key in fields(section)]
    keys += [("run.slurm", key) for key in fields(Slurm)]
    assert len(keys) > 40
    assert [f"{name}.{key.name}" for name, key in keys if not key.metadata["doc"]] == []


def test_a_byte_order_mark_does_no_harm(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbf[points]\r\nn = 12\r\n")
    assert read_config(path).points.n == 12
    assert not read_config(path).text.startswith("\ufeff")


def test_values_at_the_limits_of_a_unit_are_taken():
    assert parse_config("[material]\nrho = 1050").material.rho == 1050.0
    assert parse_config("[assembly]\nd50_mm = 40").assembly.d50_mm == 40.0


def test_undrained_tests_of_few_spheres_are_warned_of_with_their_scatter():
    few, enough = (parse_config(f'[assembly]\nN = {N}\n[shear]\npath = "undrained"') for N in (400, 1000))
    assert settings_warnings(enough) == [] and settings_warnings(parse_config("[assembly]\nN = 400")) == []
    (line,) = settings_warnings(few)
    assert 'assembly.N = 400 with shear.path = "undrained"' in line and "scatters by a factor of about 6;" in line
    assert line.endswith("use N >= 1000")
