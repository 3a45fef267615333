"""Published simple shear brought to triaxial compression: closed forms, and the table beside a campaign."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from analysis.report.friction import published_words
from analysis.tables.published import SIMPLE_SHEAR, SURFACES, beside_published, in_triaxial_compression


@pytest.mark.parametrize("ratio", [0.01, 0.1, 0.268, 0.382, 0.6])
def test_matsuoka_nakai_is_its_closed_form(ratio):
    """I1 I2 / I3 = 9 + 8 tan^2(phi) in triaxial compression, eta = 6 sin(phi) / (3 - sin(phi))."""
    invariant = 3 * (3 - ratio**2) / (1 - ratio**2)
    sine = np.sin(np.arctan(np.sqrt((invariant - 9) / 8)))
    assert in_triaxial_compression(ratio, "Matsuoka-Nakai") == pytest.approx(6 * sine / (3 - sine), rel=1e-9)


@pytest.mark.parametrize("ratio", [0.01, 0.1, 0.268, 0.382, 0.6])
def test_lade_duncan_is_its_closed_form(ratio):
    """With x = eta / 3 in triaxial compression (1 + 2x) (1 - x)^2 = 1 - ratio^2."""
    x = in_triaxial_compression(ratio, "Lade-Duncan") / 3
    assert x * np.sqrt(3 - 2 * x) == pytest.approx(ratio, rel=1e-9)


@pytest.mark.parametrize("surface", SURFACES)
def test_every_surface_is_von_mises_for_small_ratios_and_grows(surface):
    """Near the hydrostat q = sqrt(3) tau; triaxial compression is the strong side, below Mohr-Coulomb's."""
    assert in_triaxial_compression(1e-3, surface) == pytest.approx(np.sqrt(3) * 1e-3, rel=1e-3)
    values = [in_triaxial_compression(t, surface) for t in (0.1, 0.2, 0.3, 0.4)]
    assert all(v > np.sqrt(3) * t and v < 6 * t / (3 - t) for v, t in zip(values, (0.1, 0.2, 0.3, 0.4), strict=True))


def test_a_campaign_stands_beside_what_it_shares_with_the_publication():
    eta = {mu: in_triaxial_compression(t, "Lade-Duncan") for mu, t in SIMPLE_SHEAR.items()}
    rows = [("critical", "eta", 0.1, f * eta[0.1]) for f in (1.04, 1.08)] + [("critical", "eta", 0.25, 0.7)]
    rows += [("peak", "eta", 0.5, 1.0), ("critical", "e", 0.5, 0.6)]
    found = beside_published(pd.DataFrame(rows, columns=["state", "quantity", "mu_s", "value"]))
    assert found["mu_s"].tolist() == [0.1]
    assert found["Lade-Duncan_difference_pct"].to_numpy() == pytest.approx([6.0]) and found["here"][0] > eta[0.1]
    assert "(+6.0 %)" in published_words(found) and "at mu_s = 0.1." in published_words(found)
