"""PDFs of the points that still have a value: those of the surviving subset with normalised probabilities."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.pdem import weighted
from analysis.pdem.conditional import evolve_known
from analysis.pdem.evolution import evolve

STRAIN = np.linspace(0.0, 0.3, 7)


def values(points=9):
    rng = np.random.default_rng(4)
    return np.linspace(0, 1, points) + STRAIN[:, None] * rng.normal(size=points), 0.5 + rng.random(points)


@pytest.mark.parametrize("method", ["exact", "tvd"])
def test_all_points_give_the_usual_pdf(method):
    h, probability = values()
    probability = probability / probability.sum()
    one, other = (f(h, probability, STRAIN, method=method) for f in (evolve_known, evolve))
    assert np.array_equal(one.p, other.p) and np.array_equal(one.x, other.x)


def test_after_an_end_the_pdf_is_that_of_the_others_with_normalised_probabilities():
    h, probability = values()
    probability = probability / probability.sum()
    h[3:, :4] = np.nan
    pdf = evolve_known(h, probability, STRAIN)
    rest = weighted.normalised(probability[4:])
    alone = evolve(h[:, 4:], rest, STRAIN)
    assert pdf.mean[3:] == pytest.approx(alone.mean[3:]) and pdf.std[3:] == pytest.approx(alone.std[3:])
    assert pdf.bandwidth[3:] == pytest.approx(alone.bandwidth[3:], abs=pdf.dx[0])
    assert pdf.lost_probability == pytest.approx(np.where(np.arange(7) < 3, 0.0, probability[:4].sum()))
    assert (pdf.p.sum(axis=1) * pdf.dx) == pytest.approx(1.0)
    for row in range(3, 7):  # on another grid: the distribution functions agree to a cell
        at = np.linspace(-1, 2, 50)
        gap = pdf.at(row).cdf(at)[0] - alone.at(row).cdf(at)[0]
        assert np.abs(gap).max() < 2 * pdf.dx[0] * pdf.p[row].max()


@pytest.mark.parametrize("last", [1, 3, 6])
def test_where_no_point_is_left_the_pdf_is_zero_and_its_moments_are_not_known(last):
    h, probability = values()
    h[last:] = np.nan
    h[last - 1, 1:] = np.nan  # one point is left before
    pdf = evolve_known(h, probability / probability.sum(), STRAIN)
    assert np.all(pdf.p[last:] == 0.0) and np.isnan(pdf.mean[last:]).all() and np.all(pdf.lost_probability[last:] == 1)
    assert pdf.mean[last - 1] == pytest.approx(h[last - 1, 0])
    assert (pdf.p[:last].sum(axis=1) * pdf.dx[:last]) == pytest.approx(1.0)
