"""compare.html: its files, its words, and a page without a single comparison."""

import pandas as pd
import pytest
import synthetic_results

from analysis.report.comparison import write_comparison
from analysis.results import models
from analysis.tables import comparison as module
from analysis.tables import pooled_states


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(module, "POWER", 6)
    monkeypatch.setattr(models, "REFITS", 10)
    monkeypatch.setattr(models, "POWER", 6)
    monkeypatch.setattr(pooled_states, "POOLED", (("critical", "eta"),))


def test_the_page_has_its_tables_and_figures_beside_it(tmp_path):
    paths = [synthetic_results.small_example((1, 2, 3)), synthetic_results.small_example((5, 6, 7))]
    text = write_comparison(paths, tmp_path).read_text()
    names = {p.name for p in (tmp_path / "tables").iterdir()}
    assert names == {f"{n}.csv" for n in ("settings", "differences", "moments", "responses", "not_compared")}
    assert (tmp_path / "figures" / "compare_eta.png").exists()
    rows = pd.read_csv(tmp_path / "tables" / "differences.csv")
    outside = int(rows["excludes_zero"].sum())
    assert f"synthetic (2): {outside} of {len(rows)} intervals of differences exclude zero" in text
    assert "All settings agree." in text and "http:" not in text and ">excludes_zero<" not in text


def test_campaigns_without_a_common_density_are_stated_as_such(tmp_path):
    paths = [synthetic_results.small_example((1, 2, 3)), synthetic_results.small_example((1,), (0.1,))]
    text = write_comparison(paths, tmp_path).read_text()
    assert "No state of two campaigns can be compared" in text and "no density and response in common" in text
    assert text.count("This campaign has no such density.") == 2
