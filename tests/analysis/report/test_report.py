"""The report: one self-contained page whose numbers are the tables', with every figure and every warning."""

from __future__ import annotations

import ast
import re
from dataclasses import asdict, replace
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import path_limits
import pytest
import synthetic_results as synthetic
from paths import ROOT

import analysis
from analysis.figures import FIGURES
from analysis.pdem import weighted
from analysis.quantities import Loading
from analysis.report import captions, conditions, page, reference, reliability, sections, wording
from analysis.results.build import build_results
from analysis.results.reader import ResultsError, read_results
from analysis.tables import evaluate, other_runs, run_quality
from campaign.config_keys import SECTIONS

#: The tables behind `wording.run_notes`.
NOTES = ("runs", "run_counts", "report_facts", "archived_runs")


class Page(HTMLParser):
    """Text, images and open tags of a page; fails on a tag closed out of order."""

    def __init__(self, source):
        super().__init__()
        self.text, self.images, self.open = [], [], []
        self.feed(source)

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.images.append(dict(attrs))
        elif tag not in ("meta", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_startendtag(self, tag, attrs):
        """A tag that closes itself holds nothing."""

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def results():
    return read_results(synthetic.example(noise=0.02))


@pytest.fixture(scope="module")
def html_page(results, tmp_path_factory):
    """The page drawn with stand-in pictures: drawing the figures is tested elsewhere."""
    picture = tmp_path_factory.mktemp("report") / "picture.png"
    picture.write_bytes(b"\x89PNG\r\n")
    content = sections.Content(results, synthetic.frames(0.02), dict.fromkeys(FIGURES, picture))
    source = sections.whole_page(content, "x")
    return source, Page(source)


def test_the_page_is_whole_and_needs_no_network(html_page):
    source, parsed = html_page
    assert parsed.open == []
    assert not re.search(r"(src|href)=\"(?!data:|#)", source) and "@import" not in source
    assert 'name="viewport"' in source and "@media print" in source


def test_every_figure_is_embedded_with_its_words(html_page):
    _, parsed = html_page
    assert len(parsed.images) == len(FIGURES)
    for number, image in enumerate(parsed.images, start=1):
        assert image["src"].startswith("data:image/png;base64,")
        assert image["alt"].startswith(f"Figure {number}. ") and len(image["alt"]) > 30
    assert set(captions.CAPTIONS) == {name[:5] for name in FIGURES}


def test_every_table_can_scroll_within_itself(html_page):
    source, _ = html_page
    assert source.count("<table") == source.count('<div class="scroll"><table') >= 11


def test_the_numbers_are_those_of_the_results(html_page, results):
    """Five points are too few for a model: the numbers are those of the points, without uncertainties."""
    source, text = html_page[0], " ".join(html_page[1].text)
    for state in ("peak", "critical"):
        values, weight = results.state(state, "eta", 0.001), results.probability(0.001)
        for name, value in (("mean", weighted.mean(values, weight)), ("sd", weighted.std(values, weight))):
            assert f'<td data-quote="0.001/{state}/eta/{name}">{page.number(value)}</td>' in source
    assert "fewer than 8 runs" in text and "0.540" in text
    for symbol, fits in results.inputs["marginals"].items():
        for name in ("aic", "bic", "ks", "ad"):
            assert page.number(fits[0][name]) in text, (symbol, name)
    for word in ("A single run is rough", "27 spheres", "5 chosen pairs", "Wasserstein", "inertial number",
                 "synthetic pairs", "interlock", f"Cite: grain-scatter {analysis.__version__}", "MIT"):  # fmt: skip
        assert word in text, word


def test_failures_and_early_stops_are_said_with_their_numbers(tmp_path):
    plan, points, info = synthetic.make_campaign(tmp_path, n=6, steady=(2,), failed=(3,))
    results = read_results(build_results(tmp_path, plan, points, info, max_lost_probability=0.5))
    notes = " ".join(wording.run_notes(results, evaluate(results, NOTES)))
    assert "3 of 39 runs failed." in notes and "servo error 0.08" in notes and "3 shear runs stopped early" in notes
    losses = run_quality.losses(results)
    lost = float(points.probability[points.id == 3][0])
    assert losses["lost_probability"].to_numpy() == pytest.approx(lost)
    counts = run_quality.run_counts(results).set_index("stage")
    names = ["planned", "done", "failed", "spared", "steady_early"]
    assert list(counts.loc["shear", names]) == [18, 15, 3, 0, 3] and list(counts.loc["all", names]) == [39, 36, 3, 0, 3]
    assert counts.loc["shear", "core_hours"] == pytest.approx(15 * 2.0 / 3600)


def test_runs_on_collapsed_packings_are_marked_and_counted(tmp_path):
    plan, points, info = synthetic.make_campaign(tmp_path, n=6)
    assert points.id[points.mu_s < 0.1].tolist() == [3] and points.mu_s.min() > 0.04
    results = read_results(build_results(tmp_path, plan, points, info))
    marked = run_quality.runs(results).query("collapsed")
    assert marked[["stage", "point", "mu_iso"]].to_numpy().tolist() == [["probe", 3, 0.1], ["shear", 3, 0.1]]
    assert "2 probes and shear runs start from a collapsed packing" in " ".join(
        wording.run_notes(results, evaluate(results, NOTES))
    )


def test_noise_and_widths_are_told(results):
    noise = run_quality.noise(results).set_index(["mu_iso", "quantity"])
    row = noise.loc[(0.04, "eta")]
    assert 0.001 < row["run_error"] < 0.02 < row["sd_of_points"]
    assert row["own_low"] < row["own"] < row["own_high"] and np.isnan(row["packing"])  # one packing
    widths = run_quality.pdf_widths(results).set_index(["mu_iso", "quantity"])
    assert 0 < widths.loc[(0.04, "eta"), "kernel_width"] < widths.loc[(0.04, "eta"), "sd_of_points"]


def with_settings(results, **changed):
    """The results as of a campaign with the default settings, changed by section__key."""
    asked = {name: asdict(kind()) for name, kind in SECTIONS.items()}
    for name, value in changed.items():
        section, key = name.split("__")
        asked[section][key] = value
    return replace(results, attrs=results.attrs | {"settings": asked})


def test_the_report_says_which_test_it_is_and_where_it_is_not_the_papers(results):
    frames = synthetic.frames(0.02)
    usual = with_settings(results)
    text = " ".join(conditions.tested(usual, frames))
    for words in (
        "5 chosen pairs, each with its probability", "27 spheres (median diameter 0.248 mm)", "stress of 100 kPa",
        "logarithmic", "mu_iso = 0.001 (dense), 0.04 (medium) and 0.1 (loose)",
    ):  # fmt: skip
        assert words in text, words
    assert conditions.paper_differences(usual) == []
    other = with_settings(results, consolidation__sigma_3_kPa=500.0, dem__stiffness_scale=0.01)
    assert conditions.paper_differences(other) == ["500 kPa instead of 100 kPa", "0.01 of the grains' stiffness"]
    graded = with_settings(results, assembly__sieve="mine.csv", assembly__d50_mm=0.2009)
    assert "27 spheres (sieve curve mine.csv, median diameter 0.201 mm)" in " ".join(conditions.tested(graded, frames))
    assert conditions.paper_differences(graded) == ["another grading"]


def test_other_densities_and_other_inputs_are_another_test(results, monkeypatch):
    marginals = results.inputs["marginals"]
    first = {"family": "lognormal", "params": {"median": 0.30, "sigma_ln": 0.469}}
    for changed in ({"mu_s": [first]}, {"mu_s": [marginals["G_p"][0]]}, {"nu": marginals["mu_s"]}, {"G_p": []}):
        inputs = results.inputs | {"marginals": marginals | changed}
        found = conditions.paper_differences(replace(results, inputs=inputs))
        assert found == ["another distribution of the grain properties"]
    independent = results.inputs | {"copulas": [results.inputs["copulas"][0] | {"tau": -0.1}]}
    assert len(conditions.paper_differences(replace(results, inputs=independent))) == 1
    monkeypatch.setattr(type(results), "family_densities", lambda self, family="coupled": (0.04, 0.2))
    assert conditions.paper_differences(results) == ["other densities (mu_iso = 0.2)"]


def test_claims_are_shown_for_the_papers_test_only_and_only_those_that_apply(results):
    frame = synthetic.frames(0.02)["claims"]
    told = frame["value"].notna()
    assert 0 < told.sum() < len(frame)
    source = page.numbered(reference.claims(frame, []))
    assert source.count("<tr") == 1 + told.sum() and f"{int(told.sum())} statements" in source
    other = reference.claims(frame, ["500 kPa instead of 100 kPa", "another grading"])
    assert "<table" not in other and other.count("<p") == 1
    assert "This campaign has 500 kPa instead of 100 kPa and another grading" in other


def test_the_report_says_what_the_runs_used_and_which_setting_was_asked_for(results):
    frames = synthetic.frames(0.02)
    text = conditions.accuracy(results, frames)
    assert "no named setting" in text and "27 spheres" in text and "inertial number 0.001" in text and "0.8" in text
    named = replace(results, attrs=results.attrs | {"config": '[dem]\naccuracy = "5%"\n'})
    assert "the setting 5%" in conditions.accuracy(named, frames)


def beside(results):
    return {"fidelity": other_runs.fidelity(results), "beyond": other_runs.beyond(results)}


def test_tables_beside_the_results_are_shown(results, tmp_path):
    alone = replace(results, path=tmp_path / "results.h5")
    assert "<table" not in reliability.other_runs(beside(alone))
    ladder = {"against": ["N = 2000", "N = 8000"], "response": ["eta_peak"] * 2, "bias (%)": [0.5, 1.2345],
              "± (%)": [0.1, 0.2], "scatter, laptop (%)": [2.5, 2.5], "scatter, rung (%)": [1.75, None],
              "promised (%)": [2, 2], "bias within": ["yes", "yes"], "failed": [0, 1],
              "failed, laptop": [2, 2]}  # fmt: skip
    pd.DataFrame(ladder).to_csv(tmp_path / "fidelity.csv", index=False)
    rest = {"case": ["well graded", "gap graded", "own pair a grain"], "against": ["standard"] * 2 + ["one pair"],
            "response": ["eta"] * 3, "state": ["peak"] * 3, "difference (%)": [1.0, -3.25, 0.5],
            "scatter between draws (%)": [None, None, 1.25], "scatter between packings (%)": [2.25] * 3,
            "failed": [1, 0, 0], "failed of the other": [4, 4, 2]}  # fmt: skip
    pd.DataFrame(rest).to_csv(tmp_path / "beyond.csv", index=False)
    shown = reliability.other_runs(beside(alone))
    for text in ("+1.2 ± 0.2, within", ">2.5<", ">1.8<", "-3.2", "+0.5", ">1.2<", "stress ratio η, peak"):
        assert text in shown
    assert "(3 chains of runs failed)" in shown and "(7 chains of runs failed)" in shown
    assert Page(shown).open == [] and shown.count("<table") == 3


def test_the_proofs_name_their_worst_run(results):
    proofs = run_quality.proofs(results).set_index("proof")
    assert proofs.loc["largest inertial number", "largest"] == pytest.approx(1.1e-3)
    assert proofs.loc["largest inertial number", "run_of_the_largest"].startswith("shear_")


def test_runs_of_lammps_are_named_and_their_missing_balance_is_said(results):
    frames = synthetic.frames(0.02)
    notes = wording.proof_notes(frames)
    assert wording.NO_BALANCE not in notes and "Simulations by YADE" in reference.citation(results)
    lammps = frames["runs"].assign(energy_error=np.nan)
    assert wording.proof_notes({**frames, "runs": lammps})[0] == wording.NO_BALANCE
    other = replace(results, runs=results.runs.assign(yade_version="LAMMPS 29 Sep 2021", energy_error=np.nan))
    assert "Simulations by LAMMPS (lammps.org)" in reference.citation(other)
    assert ">LAMMPS<" in reference.settings(other) and ">29 Sep 2021<" in reference.settings(other)
    assert "error of the energy balance" not in set(run_quality.proofs(other)["proof"])


def test_the_limits_shown_are_those_of_the_scripts():
    tree = ast.parse((ROOT / "yade_scripts" / "proofs.py").read_text())
    limits = {}
    for node in tree.body:
        if isinstance(node, ast.Assign):
            names, values = node.targets[0], ast.literal_eval(node.value)
            pairs = zip(names.elts, values, strict=True) if isinstance(names, ast.Tuple) else [(names, values)]
            limits |= {name.id: value for name, value in pairs}
    shown = {name: limit for name, (_, limit) in run_quality.PROOFS.items() if np.isfinite(limit)}
    held = path_limits.held_limits()
    names = ("servo_mean_error", "servo_max_error", "energy_error")
    assert shown == {"max_inertial_number": limits["I_LIMIT"], **dict(zip(names, held["drained"], strict=True))}
    for path, of_path in held.items():
        shown = run_quality.proofs_of(Loading(path))
        assert tuple(shown[name][1] for name in names) == of_path


@pytest.mark.parametrize("value, text", [(0.0, "0"), (float("nan"), "–"), (1234.5, "1234"), (0.012345, "0.0123"),
                                         (-0.5, "-0.500"), (2.5e9, "2.50e+09"), (1e-16, "0")])  # fmt: skip
def test_numbers_read_well(value, text):
    assert page.number(value) == text


def test_write_report_leaves_one_file_and_the_figures(results, tmp_path, monkeypatch):
    def draw(results, frames, folder, names=None):
        folder.mkdir()
        paths = [folder / f"{name}.png" for name in FIGURES]
        for path in paths:
            path.write_bytes(b"\x89PNG")
        return paths

    monkeypatch.setattr(sections, "write_figures", draw)
    monkeypatch.setattr(sections, "whole_page", lambda content, name: f"Campaign {name} {len(content.figures)}")
    with pytest.raises(ResultsError, match="the report needs all tables; missing: archived_runs"):
        sections.write_report(results, {}, tmp_path)
    path = sections.write_report(results, dict.fromkeys(sections.NEEDED), tmp_path)
    assert path == tmp_path / "report.html" and {p.name for p in tmp_path.iterdir()} == {"figures", "report.html"}
    source = path.read_text(encoding="utf-8")
    assert source == f"Campaign synthetic {len(FIGURES)}"


def test_the_page_allows_nothing_from_outside(html_page):
    source, _ = html_page
    policy = re.search(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">', source)
    assert policy and source.index(policy[0]) < source.index("<style>")
    assert policy[1].split("; ")[:3] == ["default-src 'none'", "img-src data:", "style-src 'unsafe-inline'"]
    assert not re.search(r"<script|<link|@import|url\(|\ssrc=\"(?!data:)", source)
