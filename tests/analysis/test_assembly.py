"""First positions and sizes: no contacts, the grading asked for, the file written whole or not at all."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from analysis import assembly
from analysis.assembly import (
    DISTRIBUTIONS,
    Assembly,
    AssemblyError,
    densest_fraction,
    diameters,
    make_assembly,
    mass_median,
    read_assembly,
    write_assembly,
)

D50, SIGMA = 0.248e-3, 0.174
#: N, sigma_ln, distribution and seed -> edge and first position, m.
KNOWN = {
    (100, 0.174, "lognormal", 1): (
        1.1038458746156776e-3, [6.46672140671242e-4, 9.83177245757203e-4, 4.59745032317576e-4],
    ),
    (200, 0.5, "lognormal", 1): (
        1.0305078202893635e-3, [8.39214659022033e-4, 7.84860065584815e-4, 7.21469462857559e-4],
    ),
    (300, 0.174, "gap_graded", 5): (
        6.68681467781602e-4, [4.88748927932696e-4, 5.66269009465785e-4, 3.11462641968888e-4],
    ),
    (400, 0.174, "well_graded", 2): (
        1.406793579087649e-3, [1.13630232301636e-3, 9.53471195203436e-4, 5.341760292654e-4],
    ),
}  # fmt: skip


def grading_index(d):
    w = d**3 / np.sum(d**3)
    mean = np.sum(w * np.log(d))
    return np.exp(np.sqrt(np.sum(w * (np.log(d) - mean) ** 2)))


def smallest_gap(assembly):
    """Least surface distance over the sum of radii, all pairs by their nearest images, one by one."""
    d = assembly.position[:, None] - assembly.position[None]
    d -= assembly.cell * np.round(d / assembly.cell)
    ratio = np.linalg.norm(d, axis=2) / (assembly.radius[:, None] + assembly.radius[None]) - 1.0
    return ratio[np.triu_indices(len(ratio), 1)].min()


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_no_pair_touches_and_the_solid_fraction_is_met(distribution):
    a = make_assembly(400, D50, SIGMA, seed=3, distribution=distribution)
    assert 0.0 < smallest_gap(a) < 0.1
    assert np.all((a.position >= 0.0) & (a.position < a.cell))
    assert np.sum(4 / 3 * np.pi * a.radius**3) / np.prod(a.cell) == pytest.approx(0.52, rel=1e-12)


@pytest.mark.parametrize("N", [400, 1000, 23312])
def test_grading_is_the_one_asked_for_even_for_few_spheres(N):
    d = diameters(N, D50, SIGMA)
    assert grading_index(d) == pytest.approx(1.19, abs=0.01)
    assert mass_median(d) == pytest.approx(D50, rel=1e-12)
    cumulative = np.cumsum(d**3) / np.sum(d**3)
    assert np.interp(0.5, cumulative, d) == pytest.approx(D50, rel=0.005)


def test_loguniform_has_the_same_width_and_the_range_of_its_closed_form():
    d = diameters(4000, D50, SIGMA, "loguniform")
    assert np.log(grading_index(d)) == pytest.approx(SIGMA, rel=1e-3)
    assert np.log(d.max() / d.min()) == pytest.approx(2 * np.sqrt(3) * SIGMA, rel=1e-2)


def test_well_graded_follows_fuller_and_gap_graded_has_its_share_of_fines():
    d = diameters(20000, D50, SIGMA, "well_graded", size_ratio=4.0)
    finer = np.cumsum(d**3) / np.sum(d**3)
    fuller = (np.sqrt(d) - np.sqrt(d[0])) / (np.sqrt(d[-1]) - np.sqrt(d[0]))
    assert np.max(np.abs(finer - fuller)) < 0.01
    d = diameters(4000, D50, 0.05, "gap_graded", size_ratio=5.0, fines=0.3)
    fine = d < np.sqrt(d.min() * d.max())
    assert np.sum(d[fine] ** 3) / np.sum(d**3) == pytest.approx(0.3, abs=0.01)
    assert mass_median(d[~fine]) / mass_median(d[fine]) == pytest.approx(5.0, rel=0.01)


def test_one_seed_one_assembly():
    a, b, c = (make_assembly(100, D50, SIGMA, seed=s) for s in (1, 1, 2))
    assert np.array_equal(a.position, b.position) and np.array_equal(a.radius, b.radius)
    assert not np.array_equal(a.radius, c.radius) and np.array_equal(np.sort(a.radius), np.sort(c.radius))


def test_the_assembly_of_a_seed_stays_what_it_was():
    """Runs and their ids hang on it: edge (m) and first positions as the first version of the project made them."""
    for (N, sigma_ln, distribution, seed), (edge, first) in KNOWN.items():
        a = make_assembly(N, D50, sigma_ln, seed, distribution)
        assert a.cell[0] == pytest.approx(edge, rel=1e-12)
        np.testing.assert_allclose(a.position[0], first, rtol=1e-9)


def careful(monkeypatch):
    """A list that gets an entry at every step of the careful kind."""
    steps, step = [], assembly._careful_step
    monkeypatch.setattr(assembly, "_careful_step", lambda *a: steps.append(1) or step(*a))
    return steps


def test_a_broad_grading_is_packed_in_few_steps_at_the_solid_fraction_asked_for(monkeypatch):
    """Its large grains overlap hundreds of small ones; moved as usual they never come to rest (sizes 1 to 34)."""
    steps, told = careful(monkeypatch), []
    monkeypatch.setattr(assembly, "REPORT_SECONDS", 0.0)
    a = make_assembly(5000, D50, 0.8, seed=1, progress=told.append)
    assert 10 < len(steps) < 100
    assert np.sum(4 / 3 * np.pi * a.radius**3) / np.prod(a.cell) == pytest.approx(0.52, rel=1e-12)
    assert smallest_gap(Assembly(a.position[:2000], a.radius[:2000], a.cell)) > 0.0
    assert told[0].startswith("5000 spheres, solid fraction 0.520: step ") and "pairs touch" in told[0]


def test_usual_gradings_are_packed_without_careful_steps(monkeypatch):
    steps = careful(monkeypatch)
    for distribution in DISTRIBUTIONS:
        make_assembly(400, D50, SIGMA, seed=3, distribution=distribution)
    make_assembly(1000, D50, 0.5, seed=1)
    assert not steps


def test_where_the_usual_steps_do_not_suffice_careful_ones_follow_and_then_a_looser_start(monkeypatch):
    steps = careful(monkeypatch)
    monkeypatch.setattr(assembly, "USUAL_STEPS", 10)
    a = make_assembly(200, D50, SIGMA, seed=3)
    assert steps and smallest_gap(a) > 0.0
    assert np.sum(4 / 3 * np.pi * a.radius**3) / np.prod(a.cell) == pytest.approx(0.52, rel=1e-12)
    monkeypatch.setattr(assembly, "CAREFUL_STEPS", 15)
    b = make_assembly(200, D50, SIGMA, seed=3)
    looser = (b.cell[0] / a.cell[0]) ** 3
    assert smallest_gap(b) > 0.0 and any(looser == pytest.approx(x, rel=1e-9) for x in assembly.LOOSER_STARTS[1:])
    monkeypatch.setattr(assembly, "CAREFUL_STEPS", 1)
    with pytest.raises(
        AssemblyError, match=r"200 spheres .*sizes 1 to 2\.45\) still touch at .*0\.173; use a narrower"
    ):
        make_assembly(200, D50, SIGMA, seed=3)


@pytest.mark.parametrize(
    ("N", "sigma_ln", "words"),
    [
        (1000, 0.8, r"sigma_ln = 0\.8, sizes 1 to 24\.1; at least N = 15\d\d is needed"),
        (5000, 1.0, r"sigma_ln = 1, sizes 1 to 48\.9; at least N = (79|80)\d\d is needed"),
    ],
)
def test_a_grading_that_so_few_spheres_cannot_represent_is_refused_with_the_number_it_needs(N, sigma_ln, words):
    with pytest.raises(AssemblyError, match=words) as caught:
        make_assembly(N, D50, sigma_ln, seed=1)
    enough = int(str(caught.value).split("N = ")[-1].split()[0])
    d = diameters(enough, D50, sigma_ln)
    edge = (np.sum(np.pi / 6 * d**3) / 0.52) ** (1 / 3)
    assert 1.0 <= edge / (2 * d[-1]) < 1.02


def test_the_densest_packing_of_equal_spheres_and_of_two_sizes():
    """0.634, and 0.656 for equal numbers of sizes 1 and 2, whose skewness is 0."""
    assert densest_fraction(np.ones(10)) == pytest.approx(0.634)
    assert densest_fraction(np.array([1.0, 2.0] * 50)) == pytest.approx(0.634 + 0.0658 / 3.0)


def test_neighbours_of_mixed_sizes_are_all_found():
    a = make_assembly(300, D50, SIGMA, seed=5, distribution="gap_graded")
    bare = cKDTree(a.position, boxsize=a.cell[0]).query_pairs(1.2 * a.radius.max(), output_type="ndarray")
    d = a.position[bare[:, 1]] - a.position[bare[:, 0]]
    d -= a.cell * np.round(d / a.cell)
    assert np.all(np.linalg.norm(d, axis=1) > a.radius[bare].sum(axis=1))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"N": 3}, "N = 3"),
        ({"d50": -1.0}, "d50 = -1.0"),
        ({"sigma_ln": np.nan}, "sigma_ln = nan"),
        ({"distribution": "sieved"}, "sieved"),
        ({"solid_fraction": 0.7}, "solid_fraction = 0.7"),
        ({"N": 10}, "N = 10 is too few"),
    ],
)
def test_arguments_out_of_range_are_named(change, words):
    with pytest.raises(AssemblyError, match=words):
        make_assembly(**{"N": 100, "d50": D50, "sigma_ln": SIGMA, "seed": 1, **change})


def test_file_round_trip_leaves_nothing_else_behind(tmp_path):
    a = make_assembly(100, D50, SIGMA, seed=1)
    b = read_assembly(write_assembly(tmp_path / "deep" / "a.h5", a, {"seed": 1}))
    assert isinstance(b, Assembly)
    assert all(np.array_equal(getattr(a, k), getattr(b, k)) for k in ("position", "radius", "cell"))
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["a.h5"]


def test_bad_files_are_named(tmp_path):
    with pytest.raises(AssemblyError, match="nowhere.h5: no such"):
        read_assembly(tmp_path / "nowhere.h5")
    path = write_assembly(tmp_path / "a.h5", make_assembly(100, D50, SIGMA, seed=1))
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(AssemblyError, match="a.h5: .*truncated"):
        read_assembly(path)


def test_a_start_squeezed_denser_than_loose_is_refused(tmp_path):
    """Grains blown up until they overlap cannot be consolidated: file, solid fraction and limit are named."""
    loose = make_assembly(100, 0.248e-3, 0.174, 1)
    write_assembly(tmp_path / "loose.h5", loose, {})
    assert len(read_assembly(tmp_path / "loose.h5").radius) == 100
    write_assembly(tmp_path / "squeezed.h5", Assembly(loose.position / 1.06, loose.radius, loose.cell / 1.06), {})
    with pytest.raises(AssemblyError, match=r"squeezed.h5: solid fraction 0\.619 > 0\.6"):
        read_assembly(tmp_path / "squeezed.h5")
