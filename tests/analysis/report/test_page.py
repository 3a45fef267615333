"""The page's pieces: numbers of figures and tables, headings, symbols, plurals."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from analysis.quantities import QUANTITIES
from analysis.report import headings, page, picture
from analysis.report.headings import in_order, quantity_words, readable
from analysis.report.symbols import SYMBOLS, marked, plain
from analysis.results.densities import density_names

FRAME = pd.DataFrame({"density": ["dense", "loose"], "mean": [0.5, np.nan], "points": [1, 2000]})


def test_figures_and_tables_are_numbered_from_1_in_the_order_of_the_page(tmp_path):
    picture_file = tmp_path / "a.png"
    picture_file.write_bytes(b"\x89PNG" + bytes(30))
    source = page.paragraph("see @table:second@ and @figure:b@") + page.table(FRAME, "first", "One")
    source += page.figure(picture_file, "a", "Panels as in @figure:b@") + page.table(FRAME, "second", "Two")
    found = page.numbered(source + page.figure(picture_file, "b", "Last"))
    assert "see Table 2 and Figure 2" in found and "<b>Table 1.</b> One" in found and "<b>Table 2.</b> Two" in found
    assert 'alt="Figure 1. Panels as in Figure 2"' in found and "@" not in found


def test_a_second_caption_is_a_bug_and_an_unknown_reference_stays():
    with pytest.raises(ValueError, match="two captions for the table 'a'"):
        page.numbered("@@table:a@@ @@table:a@@")
    assert page.numbered("@figure:none@ user@host @@figure:b@@") == "@figure:none@ user@host Figure 1"


def test_a_column_without_words_is_a_bug_and_no_heading_is_a_column():
    with pytest.raises(KeyError, match="ks_new"):
        page.table(FRAME.assign(ks_new=1.0), "t", "words")
    assert "New words" in page.table(FRAME.assign(ks_new=1.0), "t", "words", headings={"ks_new": "New words"})
    for words in headings.HEADINGS.values():
        shown = marked(words)
        assert words[0].isupper() or words[0].isdigit(), words
        assert "_" not in shown, words


def test_cells_are_escaped_and_numbers_are_to_the_right():
    frame = pd.DataFrame({"name": ["<script>", "eta & mu_s"], "text": ["0.5 ± 0.1", "–"], "points": [1234, 5]})
    source = page.table(frame, "t", "x < y")
    assert "<script>" not in source and "&lt;script&gt;" in source and "x &lt; y" in source
    assert "η &amp; μ<sub>s</sub>" in source and ">1,234<" in source and 'data-name="Name"' in source
    assert '<td class="text first" data-name="Name">' in source and '<td class="" data-name="Value">0.5 ± 0.1' in source


def test_symbols_become_letters_and_names_of_files_and_runs_stay():
    assert marked("sigma_1/sigma_3, G_p (GPa), beta") == "σ<sub>1</sub>/σ<sub>3</sub>, G<sub>p</sub> (GPa), beta"
    assert plain("eta of G_p") == "η of G_p" and marked("a <= b") == "a ≤ b"
    for text in (
        "shear_mu0.214_G25.7_iso0.040_s1_3f9a1c2b",
        "only_mu_s",
        "tables/quote.csv",
        "assembly.nu",
        "mu_s.csv",
    ):
        assert marked(text) == text
    assert all(letter and not letter.isascii() or len(letter) == 1 for letter, _ in SYMBOLS.values())


def test_plurals_and_lists():
    assert [page.plural(n, "density", "densities") for n in (1, 2, 1200)] == [
        "1 density",
        "2 densities",
        "1,200 densities",
    ]
    assert [page.listed(words) for words in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == [
        "",
        "a",
        "a and b",
        "a, b and c",
    ]


def test_rows_are_readable_and_in_the_usual_order():
    frame = pd.DataFrame({"quantity": ["Z", "eta", "eta"], "unit": "1", "state": ["critical", "critical", "peak"],
                          "mu_iso": [0.1, 0.001, 0.001], "mean": [1.0, 2.0, 3.0]})  # fmt: skip
    shown = readable(in_order(frame), density_names((0.001, 0.1)))
    assert list(shown.columns) == ["quantity", "state", "density", "mean"] and list(shown["mean"]) == [3.0, 2.0, 1.0]
    assert list(shown["quantity"]) == ["stress ratio eta"] * 2 + ["coordination number Z"]
    assert list(shown["density"]) == ["dense", "dense", "loose"]
    assert (
        quantity_words("G_0") == "small-strain stiffness G_0 (MPa)"
        and quantity_words("phi") == "friction angle phi (°)"
    )
    assert all("None" not in quantity_words(symbol) for symbol in QUANTITIES)


def test_the_picture_shows_the_test():
    source = picture.test_picture(np.full(50, 2.5e-4), " = 200 kPa", "40 %")
    assert source.count("<circle") > 30 and source.count("<polygon") == 16 and "200 kPa" in source and "40 %" in source
    assert source == picture.test_picture(np.full(50, 2.5e-4), " = 200 kPa", "40 %")
