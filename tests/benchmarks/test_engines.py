"""The comparison of the two DEM codes: which chains there are, and what the summary makes of their rows."""

from __future__ import annotations

import pandas as pd
import pytest
from bench_engines import COSTS, CURVES, STATES, cases, summary


def test_chains_are_three_packings_at_three_densities_and_three_points():
    assert len(cases("chains")) == len(set(cases("chains"))) == 27
    assert len(cases("oracle")) == 3 and len(cases("cost")) == 1


def rows(code: str, values: list[float]) -> list[dict]:
    names = dict.fromkeys((*STATES, *CURVES, *COSTS[:3]), 1.0)
    return [
        {"kind": "oracle", "code": code, "N": 400, "packing": k, "mu_iso": 0.04, "mu_s": 0.2, **names, "G_0": v}
        for k, v in enumerate(values)
    ]


def test_a_difference_is_judged_by_the_scatter_of_packings():
    table = pd.DataFrame(rows("yade", [9.0, 10.0, 11.0]) + rows("lammps", [9.5, 10.5, 11.5]))
    found = summary(table).set_index("quantity").loc["G_0"]
    assert found.difference_percent == pytest.approx(5.0) and found.within
    # Student's t of four degrees of freedom at 97.5 %, times sqrt(2 / 3) of the scatter, which is 1
    assert found.limit_percent == pytest.approx(100.0 * 2.776445 * (2.0 / 3.0) ** 0.5 / 10.0, rel=1e-6)
    apart = pd.DataFrame(rows("yade", [9.0, 10.0, 11.0]) + rows("lammps", [19.0, 20.0, 21.0]))
    assert not summary(apart).set_index("quantity").loc["G_0"].within


def test_a_failed_chain_leaves_its_packing_out():
    table = pd.DataFrame(rows("yade", [9.0, 10.0, 11.0]) + rows("lammps", [9.0, 10.0]))
    assert set(summary(table).packings) == {2}
