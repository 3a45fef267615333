"""Points of one, three and more variables: their columns, their cells and what they carry."""

from __future__ import annotations

import json

import numpy as np
import pytest
from other_inputs import MARGINALS, joint_of, points_of
from scipy import stats

from analysis.copulas.multivariate import GaussianCopula
from analysis.inputs.joint import Joint
from analysis.points import selection, voronoi
from analysis.points.representative_points import PointsError, RepresentativePoints
from analysis.points.unit_cube import kernel_discrepancy, lattice_generator, uniform_set

THREE = ("mu_s", "G_p", "nu")


def test_cells_on_a_line_end_half_way_to_their_neighbours():
    z = np.array([[0.5], [-1.0], [2.0], [0.5]])
    cells = voronoi.cell_probabilities(z)
    edges = stats.norm.cdf([-0.25, 1.25])
    assert cells == pytest.approx([0.5 * (edges[1] - edges[0]), edges[0], 1 - edges[1], 0.5 * (edges[1] - edges[0])])
    assert voronoi.sampled_cell_probabilities(z[:3], 2**14) == pytest.approx(
        voronoi.cell_probabilities(z[:3]), abs=1e-3
    )


@pytest.mark.parametrize("n", [8, 9, 25])
def test_points_of_one_variable_carry_its_moments(n):
    chosen = points_of(("mu_s",), n)
    assert chosen.x.shape == (n, 1) and chosen.names == ("mu_s",) and chosen.constants == {"G_p": 29e9}
    assert chosen.probability @ chosen.mu_s == pytest.approx(MARGINALS["mu_s"].mean, rel=1e-12)
    assert np.sqrt(chosen.probability @ (chosen.mu_s - MARGINALS["mu_s"].mean) ** 2) == pytest.approx(
        MARGINALS["mu_s"].std, rel=1e-12
    )
    assert chosen.discrepancy[0] < 1.0 / n and chosen.moment_warnings() == []
    assert np.array_equal(chosen.G_p, np.full(n, 29e9))


def test_points_of_three_variables_carry_means_variances_and_covariances():
    chosen = points_of(THREE, 40)
    assert np.abs(chosen.moment_errors).max() < 1e-9 and max(chosen.discrepancy) < 0.05
    assert [p.further["nu"] for p in chosen] == chosen["nu"].tolist()
    moved = selection.reweight(chosen, joint_of(THREE), 2**12)
    assert moved.names == THREE and np.abs(moved.moment_errors).max() < 1e-9


def test_few_points_give_up_covariances_first_and_say_which():
    chosen = points_of(THREE, 8)
    assert np.abs(chosen.moment_errors[:6]).max() < 1e-9 < np.abs(chosen.moment_errors[6:]).max()
    [line] = chosen.moment_warnings()
    assert "correlation of" in line and "nu" in line and "x1" not in line and "mean of" not in line


def test_a_warning_lists_six_moments_at_most():
    chosen = RepresentativePoints(np.eye(4), np.full(4, 0.25), names=(*THREE, "sigma_3"), moment_errors=(0.5,) * 14)
    [line] = chosen.moment_warnings()
    assert line.count("limit") == 6 and line.endswith("and 8 more") and "mean of nu" in line


@pytest.mark.parametrize("names", [("mu_s",), ("G_p",), THREE, ("mu_s", "G_p")])
def test_points_go_to_a_file_and_back(names):
    chosen = points_of(names, 8)
    header, *rows = chosen.to_csv().splitlines()
    further = ["nu"] if "nu" in names else []
    assert header.split(",") == ["id", "mu_s", "G_p", "G_p_GPa", *further, "probability"] and len(rows) == 8
    back = RepresentativePoints.from_csv(chosen.to_csv(), chosen.names, chosen.constants)
    again = RepresentativePoints.from_dict(json.loads(json.dumps(chosen.to_dict())))
    for other in (back, again):
        assert np.array_equal(other.x, chosen.x) and np.array_equal(other.probability, chosen.probability)
        assert (other.names, other.constants) == (chosen.names, chosen.constants)
        assert other.to_frame().equals(chosen.to_frame())
    with pytest.raises(PointsError, match="not a table of id, mu_s, G_p, G_p_GPa"):
        RepresentativePoints.from_csv("id,mu_s\n0,1\n", chosen.names, chosen.constants)


def test_columns_that_are_not_there_are_named():
    chosen = points_of(("mu_s",), 8)
    with pytest.raises(KeyError, match="no column 'nu', only id, mu_s, G_p, probability"):
        chosen["nu"]
    with pytest.raises(PointsError, match="the columns mu_s and the constants"):
        RepresentativePoints(chosen.x, chosen.probability, names=("mu_s",), constants={"mu_s": 0.1})


@pytest.mark.parametrize("n", [12, 25, 50])
def test_few_points_do_not_start_from_a_lattice_with_equal_coordinates(n):
    vector = np.array(lattice_generator(n, 3))
    assert len({tuple(sorted((v % n, -v % n))) for v in vector}) == (2 if n == 12 else 3)  # 12 has no third number
    fair = [kernel_discrepancy(uniform_set("fairest", n, 3, seed)) for seed in range(3)]
    assert max(fair) < np.median([kernel_discrepancy(uniform_set("sobol", n, 3, seed)) for seed in range(9)])


def test_moments_of_any_two_of_four_lognormals_have_their_closed_form():
    sigma = np.array([0.3, 0.25, 0.2, 0.4])
    matrix = np.eye(4)
    for i, j, value in ((0, 1, -0.5), (0, 2, 0.2), (1, 3, 0.4), (2, 3, -0.3)):
        matrix[i, j] = matrix[j, i] = value
    one = MARGINALS["mu_s"]
    four = tuple(type(one)("lognormal", {"median": 1.0, "sigma_ln": s}) for s in sigma)
    mean, covariance = Joint(four, GaussianCopula(tuple(map(tuple, matrix.tolist())))).moments()
    assert mean == pytest.approx(np.exp(sigma**2 / 2))
    assert covariance == pytest.approx(np.outer(mean, mean) * np.expm1(matrix * np.outer(sigma, sigma)), abs=1e-7)
