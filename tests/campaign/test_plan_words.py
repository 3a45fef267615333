"""What `plan` says of the inputs: fits with their verdicts, the range of the points, and warnings that are kept."""

import inspect
import json
import re
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import synthetic_results
import synthetic_runs
from paths import ROOT

from analysis.quantities import DRAINED
from analysis.report import numbers, wording
from analysis.results.build import CampaignInfo, _write_head
from campaign.__main__ import main
from campaign.config import parse_config, read_config
from campaign.evaluate import campaign_info
from campaign.prepare import inputs_digest, read_points

#: 32 pairs, two of them gross errors of typing: mu_s = 3.1 in line 23 and G_p = 410 GPa in line 27.
OUTLIERS = """# 32 pairs
mu_s,G_p_GPa
0.21,26.1 0.18,29.4 0.33,19.8 0.27,23.0 0.15,33.1 0.24,25.2 0.41,16.9 0.19,27.7 0.29,22.0 0.22,24.6 0.36,18.4
0.17,31.0 0.31,21.2 0.26,23.8 0.20,27.0 0.23,25.9 0.14,35.5 0.38,17.6 0.25,24.1 0.28,22.5 3.1,20.5 0.16,32.2
0.34,19.1 0.30,21.7 0.21,410 0.45,15.8 0.13,37.0 0.32,20.3 0.24,24.8 0.19,28.9 0.27,23.3 0.22,26.6
"""


def planned(folder, capsys, pairs, code=0):
    """Output of `plan` for these pairs, 8 points."""
    path = synthetic_runs.write_config(folder, n=8)
    if pairs is not None:
        (folder / "pairs.csv").write_text(pairs)
    assert main(["plan", str(path), "--folder", str(folder / "run")]) == code
    return capsys.readouterr()


def test_plan_states_fits_verdicts_and_points(tmp_path, capsys):
    lines = planned(tmp_path, capsys, None).out.splitlines()
    assert lines[0] == "inputs: pairs.csv: 20 pairs, ',' between cells, decimal point, units GPa"
    test = r"KS D = 0\.\d{3}, p [=<] [\d.]+, AD = \d\.\d\d, p [=<] [\d.]+: (accepted|rejected)"
    assert re.fullmatch(
        rf"  mu_s: \w+ \(\w+ = [\d.]+, \w+ = [\d.]+\); AIC [\d.]+ below the next, \w+; {test}.*", lines[1]
    )
    assert re.fullmatch(rf"  G_p: \w+ \(\w+ = [\d.]+( GPa)?, \w+ = [\d.]+( GPa)?\); AIC .*; {test}.*", lines[2])
    assert " GPa" in lines[2]
    assert re.fullmatch(
        r"  copula: \w+ \(.*\), Kendall's tau -0\.\d+; AIC [\d.]+ (below|above) the next, \w+( \(rejected\))?; "
        r"Cramer-von Mises S = [\d.]+, p = [\d.]+: (accepted|rejected)",
        lines[3],
    )
    dependence = (
        r"  dependence: Kendall's tau = -0\.\d\d \(95 %: -0\.\d\d to -0\.\d\d\) of the pairs; independence rejected, "
        r"p < 0\.001"
    )
    assert re.fullmatch(dependence, lines[4])
    points = read_points(tmp_path / "run")
    assert lines[5] == (
        f"points: mu_s {points.mu_s.min():.3g} to {points.mu_s.max():.3g}, G_p {points.G_p.min() * 1e-9:.3g} to "
        f"{points.G_p.max() * 1e-9:.3g} GPa, probabilities {points.probability.min():.2g} to "
        f"{points.probability.max():.2g}"
    )


def test_outliers_are_named_by_line_and_kept_for_the_report(tmp_path, capsys):
    text = planned(tmp_path, capsys, OUTLIERS.replace(" ", "\n").replace("#\n32\n", "# 32 ")).out
    assert "warning: mu_s: 1 of 32 values lies far from all others: 3.1 (line 23)" in text
    assert "warning: G_p: 1 of 32 values lies far from all others: 410 GPa (line 27)" in text
    stored = json.loads((tmp_path / "run" / "inputs.json").read_text())["warnings"]
    of_inputs = [line for line in text.splitlines() if re.match("warning: (mu_s|G_p|copula|[0-9]+ of)", line)]
    assert [f"warning: {one}" for one in stored] == of_inputs
    info = campaign_info(read_config(tmp_path / "campaign.toml"), tmp_path / "run")
    assert list(info.warnings) == stored
    again = planned(tmp_path, capsys, (tmp_path / "pairs.csv").read_text()).out
    assert again == text.replace("points chosen", "points kept")


def test_inputs_of_an_earlier_version_are_warned_of_and_stay_as_they_are(tmp_path, capsys):
    text = planned(tmp_path, capsys, OUTLIERS.replace(" ", "\n").replace("#\n32\n", "# 32 ")).out
    path = tmp_path / "run" / "inputs.json"
    inputs = json.loads(path.read_text())
    del inputs["warnings"]
    path.write_text(json.dumps(inputs))
    before = path.read_bytes()
    again = planned(tmp_path, capsys, (tmp_path / "pairs.csv").read_text()).out
    assert again == text.replace("line 23", "pair 21").replace("line 27", "pair 25").replace("chosen,", "kept,")
    assert path.read_bytes() == before


@pytest.mark.parametrize("damage", [
    {"marginals": {"mu_s": [{"family": "lognormal"}]}}, {"marginals": [1]}, {"copulas": [3]}, {"copulas": {"a": 1}},
    {"warnings": 3}, {"pairs": 3, "warnings": []},
])  # fmt: skip
def test_damaged_fits_end_in_one_line(damage, tmp_path, capsys):
    planned(tmp_path, capsys, None)
    path = tmp_path / "run" / "inputs.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | damage))
    output = planned(tmp_path, capsys, None, code=2)
    assert (
        re.search("inputs.json: (is damaged|its fits cannot be read)", output.err) and len(output.err.splitlines()) == 1
    )


def test_warnings_reach_the_results_and_the_report(tmp_path):
    said = ["mu_s: 1 of 32 values lies far from all others"]
    none = SimpleNamespace(strain=np.zeros(2), densities=(), diameters=np.ones(3), grading={}, loading=DRAINED)
    for warnings, paragraphs in ((said, [f"Warning: {said[0]}."]), ([], [])):
        with h5py.File(tmp_path / "head.h5", "w") as file:
            info = CampaignInfo(warnings=warnings)
            _write_head(file, synthetic_results.representative_points(2), info, none)
            inputs = {name: json.loads(text) for name, text in file["inputs"].attrs.items() if name != "source"}
        assert wording.input_warnings(SimpleNamespace(inputs=inputs)) == paragraphs
    assert "input_warnings" in inspect.getsource(numbers.inputs)


def test_plan_warns_of_moments_that_the_points_do_not_carry(tmp_path, capsys, monkeypatch):
    assert "points: the" not in planned(tmp_path / "a", capsys, None).out
    monkeypatch.setattr("analysis.points.representative_points.MEAN_LIMIT", -1.0)
    text = planned(tmp_path / "b", capsys, None).out
    assert "warning: points: the 8 points do not carry all moments of the inputs; errors: mean of mu_s" in text
    attrs = json.loads((tmp_path / "b" / "run" / "inputs.json").read_text())["point_attrs"]
    assert len(attrs["moment_errors"]) == 5 and max(map(abs, attrs["moment_errors"])) < 0.01


def test_warnings_change_neither_points_nor_runs(tmp_path, capsys, monkeypatch):
    planned(tmp_path / "a", capsys, None)
    monkeypatch.setattr("analysis.inputs.plausibility.input_warnings", lambda *_: ["one", "two"])
    text = planned(tmp_path / "b", capsys, None).out
    assert "warning: one\nwarning: two\n" in text
    for name in ("points.csv", "tables/plan.csv"):
        assert (tmp_path / "a" / "run" / name).read_bytes() == (tmp_path / "b" / "run" / name).read_bytes()
    probability = read_points(tmp_path / "b" / "run").probability
    assert np.sum(probability) == pytest.approx(1.0)


def test_columns_with_other_names_are_read_and_plan_says_how(tmp_path, capsys):
    """The same pairs as a European export give the same points; the line is kept, and an older file has none."""
    path = synthetic_runs.write_config(tmp_path, n=8)
    assert main(["plan", str(path), "--folder", str(tmp_path / "a")]) == 0
    capsys.readouterr()
    lines = synthetic_runs.PAIRS.replace(",", ";").replace(".", ",").splitlines()
    (tmp_path / "pairs.csv").write_bytes(("\n".join(["Reibung µ;G (GPa)", *lines[1:]]) + "\n").encode("cp1252"))
    path.write_text(path.read_text() + '[inputs.columns]\nmu_s = "Reibung µ"\nG_p_GPa = "G (GPa)"\n')
    assert main(["plan", str(path), "--folder", str(tmp_path / "b")]) == 0
    said = (
        "pairs.csv: 20 pairs, ';' between cells, decimal comma, units GPa, Windows-1252, mu_s from 'Reibung μ', "
        "G_p_GPa from 'G (GPa)'"
    )
    assert capsys.readouterr().out.splitlines()[0] == f"inputs: {said}"
    assert (tmp_path / "a" / "points.csv").read_bytes() == (tmp_path / "b" / "points.csv").read_bytes()
    kept = tmp_path / "b" / "inputs.json"
    inputs = json.loads(kept.read_text())
    assert inputs.pop("understood") == said
    kept.write_text(json.dumps(inputs))
    assert main(["plan", str(path), "--folder", str(tmp_path / "b")]) == 0
    output = capsys.readouterr().out.splitlines()
    assert output[0] == "inputs: 20 pairs, pairs.csv" and "8 points kept" in "\n".join(output)


def test_two_properties_of_which_one_repeats_the_other_are_refused_in_one_line(tmp_path, capsys):
    path = synthetic_runs.write_config(tmp_path, n=8)
    lines = synthetic_runs.PAIRS.splitlines()
    rows = [f"{lines[0]},nu", *(f"{line},{0.1 + 0.01 * k:.2f}" for k, line in enumerate(lines[1:]))]
    (tmp_path / "pairs.csv").write_text("\n".join(rows) + "\n")
    assert main(["plan", str(path), "--folder", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err
    assert "mu_s and nu have a correlation of 1.00000, limit ±0.999" in said and said.count("\n") == 1


def test_the_digest_of_inputs_without_columns_is_that_of_earlier_versions():
    kept = json.loads((ROOT / "data" / "laptop" / "inputs.json").read_text())
    assert inputs_digest(read_config(ROOT / "campaign" / "laptop.toml")) == kept["digest"]


@pytest.mark.parametrize("header, columns, depends", [
    ("mu_s,G_p_GPa", "", False), ("mu_s,E_p_GPa", "", True), ("mu_s,E_p_MPa", "", True), ("mu_s,E_p [GPa]", "", True),
    ("mu_s,E", "E_p_GPa = 'E'", True), ("mu_s,G", "G_p_GPa = 'G'", False),
])  # fmt: skip
def test_points_depend_on_nu_if_the_modulus_is_youngs(header, columns, depends, tmp_path):
    for encoding in ("utf-8", "utf-16"):
        (tmp_path / "pairs.csv").write_bytes(header.encode(encoding))
        text = f"[inputs]\npairs = 'pairs.csv'\n[inputs.columns]\n{columns}\n[material]\nnu = "
        found = {inputs_digest(parse_config(text + nu, tmp_path / "t.toml")) for nu in ("0.2", "0.3")}
        assert len(found) == (2 if depends else 1)
