"""The sections [variables] and [dependence] of a campaign file: what is taken, what is refused; digests hold."""

import pytest

from campaign.config import ROOT, ConfigError, grains_file, inputs_settings, parse_config, read_config

FRICTION = '[variables.mu_s]\nfamily = "lognormal"\nmean = 0.25\ncov = 0.30\n'
MODULUS = '[variables.G_p_GPa]\nfamily = "lognormal"\nmedian = 29.0\nsigma_ln = 0.25\n'
DEPENDENCE = '[dependence]\ncopula = "gaussian"\nmeasure = "pearson"\nmu_s.G_p_GPa = -0.5\n'
STATED = FRICTION + MODULUS + DEPENDENCE


def test_stated_distributions_are_kept_as_they_stand_in_the_file():
    config = parse_config("[inputs]\npairs_behind = 40\n" + STATED)
    assert config.variables == {"mu_s": {"family": "lognormal", "mean": 0.25, "cov": 0.3},
                                "G_p_GPa": {"family": "lognormal", "median": 29.0, "sigma_ln": 0.25}}  # fmt: skip
    assert config.dependence == {"copula": "gaussian", "measure": "pearson", "mu_s": {"G_p_GPa": -0.5}}
    assert config.inputs.pairs_behind == 40


def test_a_file_without_them_keeps_the_default_pairs():
    config = parse_config("")
    assert config.variables == {} and config.dependence == {} and config.inputs.pairs_behind == 0
    assert config.pairs_path.name == "pairs_reconstructed.csv"


def test_digests_of_files_without_them_hold():
    config = read_config(ROOT / "campaign" / "laptop.toml")
    assert "pairs_behind" not in inputs_settings(config) and "variables" not in inputs_settings(config)
    assert grains_file(config, 3) == "grains_3_cb6422e2.h5"


def test_digests_depend_on_the_distributions():
    one, other = parse_config(STATED), parse_config(STATED.replace("0.30", "0.31"))
    assert grains_file(one, 0) != grains_file(other, 0) != grains_file(parse_config(""), 0)


@pytest.mark.parametrize("text, words", [
    (FRICTION, "variables.G_p_GPa is missing; state a distribution or a value"),
    (STATED.replace("cov = 0.30", "cov = -0.3"), "variables.mu_s: cov = -0.3 must be positive"),
    (STATED.replace("-0.5", "-0.95"), r"dependence.mu_s.G_p_GPa = -0.95 \(pearson\) is outside \[-0.9288, 0.9995\]"),
    (DEPENDENCE, r"\[dependence\] needs the section \[variables\]"),
    ("variables = 3", r"variables = 3 must be a section, \[variables\]"),
    ("dependence = 3\n" + FRICTION + MODULUS, r"dependence = 3 must be a section"),
    ('[inputs]\npairs = "mine.csv"\n' + STATED, r"inputs.pairs is for measured pairs, and \[variables\] takes"),
    ('[inputs]\ncopulas = ["frank"]\n' + STATED, "inputs.copulas is for measured pairs"),
    ('[inputs]\nmarginals = ["gamma"]\n' + STATED, "inputs.marginals is for measured pairs"),
    ("[inputs]\nbootstrap = 300\n" + STATED, "inputs.bootstrap is for measured pairs"),
    ("[inputs]\npairs_behind = 5\n" + STATED, r"inputs.pairs_behind = 5 must be 0 \(not known\) or at least 10"),
    ("[inputs]\npairs_behind = 40\n", r"inputs.pairs_behind = 40 is for \[variables\]; measured pairs are counted"),
    (STATED + "[variables.nu]\nvalue = 0.3\n[material]\nnu = 0.2\n", r"material.nu and \[variables\] both state nu"),
    (STATED + "[variables.d50_mm]\nvalue = 0.3\n[assembly]\nd50_mm = 0.2\n", "assembly.d50_mm and"),
    (STATED + "[variables.sigma_3_kPa]\nvalue = 50\n[consolidation]\nsigma_3_kPa = 100\n", "consolidation.sigma_3_kPa"),
    (STATED + "[variable.nu]\nvalue = 0.2\n", "did you mean 'variables'"),
    (STATED.replace("lognormal", "log\\u2028normal"), "unknown family"),
])  # fmt: skip
def test_what_cannot_be_used_is_refused_in_one_line_with_the_file(text, words):
    with pytest.raises(ConfigError, match=words) as refused:
        parse_config(text, "mine.toml")
    assert str(refused.value).startswith("mine.toml: ") and "\n" not in str(refused.value)


def test_youngs_modulus_takes_poissons_ratio_of_the_file():
    text = FRICTION + '[variables.E_p_GPa]\nfamily = "lognormal"\nmedian = 70.0\nsigma_ln = 0.25\n'
    assert parse_config(text + "[material]\nnu = 0.3\n").material.nu == 0.3
