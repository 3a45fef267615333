"""The published measurements: every line a number with its source, and where it lies among the reconstructed pairs."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from paths import DATA

from analysis.inputs import marginals
from analysis.inputs.pairs import read_pairs
from analysis.inputs.variables import VARIABLES

TABLE = pd.read_csv(DATA / "published_measurements.csv", comment="#")


def test_every_line_is_a_number_with_its_source():
    assert list(TABLE.columns) == ["material", "quantity", "value", "spread", "n", "source"] and len(TABLE) > 0
    assert not TABLE.duplicated(["material", "quantity", "source"]).any()
    assert TABLE[["material", "quantity", "value", "source"]].notna().all().all()
    assert np.all((TABLE["value"] > 0) & (TABLE["value"] < VARIABLES["mu_s"].high))
    assert TABLE["source"].str.contains(r"\(\d{4}\).*doi:10\.\d{4,}/\S+").all()
    for name in ("spread", "n"):
        assert (TABLE[name].dropna() > 0).all()


def test_where_they_lie_among_the_reconstructed_pairs():
    """The percentages that data/README.md gives."""
    friction = marginals.fit(read_pairs(DATA / "pairs_reconstructed.csv")[:, 0], "lognormal", n_sim=0)
    share = 100 * pd.Series(friction.cdf(TABLE["value"]), index=TABLE["material"] + TABLE["quantity"].str[-4:])
    massive = ["rose quartz", "microcline feldspar", "calcite"]
    assert [share[f"{name} dry"] for name in massive] == pytest.approx([14, 11, 18], abs=1)
    assert [share[f"{name} wet"] for name in massive] == pytest.approx([94, 99.7, 99.3], abs=0.6)
