"""Pages of small campaigns: every quoted quantity has one value, and no heading is the name of a column."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import partial

import pytest
import report_pages
import synthetic_results as synthetic

from analysis.figures import FIGURES
from analysis.report import sections
from analysis.results import models
from analysis.results.build import build_results
from analysis.results.reader import read_results
from analysis.tables import evaluate, registry
from campaign.config_keys import SECTIONS

#: Tables that take long and give no quoted quantity: they are empty here, as with few runs.
SLOW = ("claims", "stopping_replay")


def built(folder, n, densities, **options):
    """Results of a campaign of n points with scatter, as if made with the default settings."""
    points = synthetic.representative_points(n)
    plan = synthetic.plan_rows(folder, points, densities=densities, **options)
    for row in plan.itertuples():
        synthetic.write_run(row, 0.02, windows=40)
    results = read_results(build_results(folder, plan, points, synthetic.campaign_info()))
    return replace(results, attrs=results.attrs | {"settings": {k: asdict(kind()) for k, kind in SECTIONS.items()}})


@pytest.fixture
def fast(monkeypatch):
    """Fewer draws and refits, and no slow table."""
    monkeypatch.setattr(models, "REFITS", 3)
    monkeypatch.setattr(models, "moments_and_quantiles", partial(models.moments_and_quantiles, n=20))
    empty = {name: synthetic.frames(0.02)[name].head(0) for name in SLOW}
    for name, frame in empty.items():
        monkeypatch.setitem(registry.TABLES, name, lambda results, frame=frame: frame)


def made(results, folder):
    """The page and the numbers to quote; the pictures are stand-ins."""
    picture = folder / "picture.png"
    picture.write_bytes(b"\x89PNG\r\n" + bytes(30))
    content = sections.Content(results, evaluate(results), dict.fromkeys(FIGURES, picture))
    return sections.whole_page(content, "x"), content.frames["quote"]


@pytest.mark.parametrize("n, densities, packings", [(9, (0.2,), (1, 2, 3)), (12, (0.001, 0.1), (1,))])
def test_every_quoted_quantity_has_one_value(n, densities, packings, tmp_path, fast):
    source, quote = made(built(tmp_path, n, densities, packings=packings), tmp_path)
    assert (quote["basis"] == "model of all runs").all() and len(quote) == 10 * len(densities)
    assert report_pages.problems(source, quote) == []
    page = report_pages.ReportPage(source)
    assert len(page.quoted) == 4 * len(quote)
    # the scan sees what it is for
    changed = quote.assign(mean=quote["mean"] * 1.1)
    assert len(report_pages.problems(source, changed)) >= len(quote)
    spoilt = source.replace("</h3>", "</h3><p>Critical eta: 0.64 ± 0.07</p>", 1)
    assert [p.split(":")[0] for p in report_pages.problems(spoilt, quote)] == ["± in a paragraph", "raw name 'eta'"]


def test_five_points_and_three_densities(tmp_path):
    picture = tmp_path / "picture.png"
    picture.write_bytes(b"\x89PNG\r\n" + bytes(30))
    content = sections.Content(read_results(synthetic.example(noise=0.02)), synthetic.frames(0.02),
                               dict.fromkeys(FIGURES, picture))  # fmt: skip
    assert report_pages.problems(sections.whole_page(content, "x"), content.frames["quote"]) == []
