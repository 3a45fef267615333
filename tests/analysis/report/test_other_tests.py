"""The report of every test says which one it was, and nothing of another one."""

from __future__ import annotations

import json

import numpy as np
import pytest
import report_pages
import synthetic_paths

from analysis.figures import drawn
from analysis.quantities import DRAINED, Loading
from analysis.report import loading_words, picture, reference, sections
from analysis.results.build import build_results
from analysis.results.reader import read_results
from analysis.tables import evaluate
from analysis.tables.explore import explore_data

CASES = {
    ("undrained", "compression"): {"liquefied": {0.1: (0, 1)}, "stiff": {0.1: (2,)}},
    ("undrained", "extension"): {"liquefied": {0.1: range(6)}},
    ("constant_p", "compression"): {},
    ("drained", "extension"): {},
}


@pytest.fixture(scope="module", params=CASES, ids=" ".join)
def case(request, tmp_path_factory):
    """Results, frames and page of a small campaign, with stand-in pictures."""
    folder = tmp_path_factory.mktemp("report")
    made = synthetic_paths.make_campaign(folder, *request.param, n=6, densities=(0.1,), packings=(1, 2, 3), noise=0.02,
                                         **CASES[request.param])  # fmt: skip
    results = read_results(build_results(folder, *made, cells=64))
    stand_in = folder / "picture.png"
    stand_in.write_bytes(b"\x89PNG\r\n" + bytes(30))
    frames = evaluate(results)
    content = sections.Content(results, frames, dict.fromkeys(drawn(results), stand_in))
    return results, frames, sections.whole_page(content, "x")


def text_of(source):
    return " ".join(" ".join(report_pages.ReportPage(source).text).split())


def test_the_page_is_consistent_and_names_its_test(case):
    results, frames, source = case
    assert report_pages.problems(source, frames["quote"]) == []
    words, page = results.loading.words, text_of(source)
    name = words if results.loading.path != "constant_p" else "triaxial compression at a constant mean effective stress"
    assert name in page and "@" not in source.split("<pre>")[0].replace("@media", "").replace("@page", "")
    assert ("Lode angle is −30°" in page) == (results.loading.sign < 0)
    assert "Statements of the paper" not in page and "of the paper" not in page


def test_no_sentence_of_another_test_is_there(case):
    results, _, source = case
    page, loading = text_of(source).replace("undrained", "").replace("Undrained", ""), results.loading
    if loading.path != "drained":
        for word in ("drained", "confining stress", "servo"):
            assert word not in page, word
    if loading.is_undrained:
        for word in ("dilatan", "Volumetric", "Rowe"):
            assert word not in page, word
    if loading.sign < 0:
        assert "3 η / (6 + η)" not in page and "3 |η| / (6 - |η|)" in page


def test_ends_are_on_the_first_screen_and_in_a_table(case):
    results, frames, source = case
    page = text_of(source)
    if not results.loading.is_undrained:
        assert "liquefied" not in page and len(frames["ends"].columns) == 0
        return
    share = frames["ends"].set_index("end")["probability"]
    if share["none"] > 0:
        head = f"holds for {loading_words.percent(share['none'])} of the probability"
        assert f"{head}: {loading_words.percent(share['liquefied'])} liquefied" in page
    else:
        assert "no test reached it: 100 % liquefied before" in page
    assert "Tests that ended before their strain" in page and "Korn and Graubard" in page


def test_the_page_to_explore_has_the_responses_of_the_test(case):
    results, _, _ = case
    data = explore_data(results)
    json.dumps(data, allow_nan=False)
    assert data["axial"] == ("Axial strain" if results.loading.sign > 0 else "Axial extension")
    assert ("r_u" in data["responses"]) == results.loading.is_undrained == ("eps_v" not in data["responses"])


def test_the_picture_and_the_glossary_follow_the_test():

    usual = picture.test_picture(np.full(50, 2.5e-4), " = 200 kPa", "40 %")
    assert "Drained triaxial compression" in usual and ">constant<" in usual
    pulled = picture.test_picture(np.full(50, 2.5e-4), "", "40 %", Loading("drained", "extension"))
    assert "axial extension" in pulled and "Drained triaxial extension" in pulled and pulled != usual
    closed = picture.test_picture(np.full(50, 2.5e-4), "", "40 %", Loading("undrained"))
    assert "volume constant" in closed and "confining" not in closed
    assert reference.glossary() == reference.glossary(DRAINED) != reference.glossary(Loading("undrained"))


@pytest.mark.parametrize("share, words", [(0.0, "0 %"), (1.0, "100 %"), (0.004, "less than 1 %"), (0.28, "28 %"),
                                          (0.998, "more than 99 %")])  # fmt: skip
def test_a_probability_is_zero_or_one_only_if_it_is(share, words):
    assert loading_words.percent(share) == words
