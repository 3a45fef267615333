"""Sieve curves: characteristic sizes in closed form, spheres that have the curve, and files that are refused."""

from __future__ import annotations

import numpy as np
import pytest
from paths import DATA

from analysis.inputs.sieve_curve import (
    SHARES,
    TOLERANCE,
    SieveCurve,
    SieveError,
    errors,
    read_sieve,
    shortfall,
    size_at,
)
from analysis.micromechanics import grading

SIEVES = DATA / "sieve"
UNIFORM, WIDE, WIDER = (read_sieve(SIEVES / f"{name}.csv") for name in ("toyoura", "taylor_cu3", "taylor_cu4"))
GAP = SieveCurve((1e-4, 2e-4, 4e-4, 8e-4), (0.0, 0.35, 0.35, 1.0))


def straight(ratio: float) -> SieveCurve:
    """A straight line over ln d: D_p = d_min ratio^p."""
    return SieveCurve((1e-4, 1e-4 * ratio), (0.0, 1.0))


@pytest.mark.parametrize("ratio", [1.5, 9.0, 64.0])
def test_sizes_of_a_straight_line_are_powers_of_the_size_ratio(ratio):
    curve = straight(ratio)
    assert curve.sizes == pytest.approx({name: 1e-4 * ratio**share for name, share in SHARES.items()})
    assert (curve.uniformity, curve.curvature) == pytest.approx((ratio**0.5, ratio**-0.1))


@pytest.mark.parametrize("N", [64, 1000, 20_000])
def test_spheres_of_a_straight_line_have_the_mean_mass_of_its_grains(N):
    """Mass per grain: 3 ln r / (1 - r^-3) d_min^3, the inverse of the mean of d^-3 by mass."""
    d = straight(4.0).diameters(N)
    assert np.mean(d**3) == pytest.approx(1e-12 * 3.0 * np.log(4.0) / (1.0 - 4.0**-3), rel=1e-9)
    assert np.all(np.diff(d) > 0.0) and d[0] > 1e-4 and d[-1] < 4e-4


@pytest.mark.parametrize("curve", [UNIFORM, WIDE, WIDER, GAP, straight(6.0)])
@pytest.mark.parametrize("N", [500, 1000, 5000])
def test_between_two_spheres_the_mass_that_passes_is_that_of_the_curve(curve, N):
    """The limit of two groups lies between their spheres; the curve is met there, and a sieve to one sphere."""
    d = curve.diameters(N)
    mass = d**3 / np.sum(d**3)
    finer = np.cumsum(mass)[:-1]
    at = curve.passing_at(d)
    assert np.all(at[:-1] <= finer + 1e-9) and np.all(finer <= at[1:] + 1e-9)
    sieved = np.array([mass[d <= size].sum() for size in curve.size])
    assert np.abs(sieved - curve.passing).max() <= mass.max()


@pytest.mark.parametrize("curve", [UNIFORM, WIDE])
def test_published_curves_are_reproduced_by_a_thousand_spheres(curve):
    d = curve.diameters(1000)
    found = errors(curve, d)
    assert set(found) == {"D10", "D30", "D50", "D60", "Cu", "Cc"}
    assert max(map(abs, found.values())) < 1e-3 < TOLERANCE and shortfall(curve, d) == ""


def test_errors_are_those_of_sizes_measured_by_mass():
    d = UNIFORM.diameters(300) * 1.05
    assert [size_at(d, s) for s in SHARES.values()] == pytest.approx([grading.size_at(d, s) for s in SHARES.values()])
    found = errors(UNIFORM, d)
    assert [found[name] for name in SHARES] == pytest.approx([0.05] * 4, abs=1e-3)
    assert (found["Cu"], found["Cc"]) == pytest.approx((0.0, 0.0), abs=1e-3)
    assert shortfall(UNIFORM, d).endswith("the limit is 2%")


def test_too_few_spheres_for_a_wide_curve_are_found_out():
    assert "13.7% of the mass into one sphere" in shortfall(WIDER, WIDER.diameters(1000))
    assert shortfall(WIDER, WIDER.diameters(2000)) == ""
    assert "miss C" in shortfall(straight(64.0), straight(64.0).diameters(1000))


READ = {
    "comma": "size_mm,passing_percent\n0.1,0\n0.2,40.5\n0.4,100\n",
    "coarse to fine": "size_mm,passing_percent\n0.4,100\n0.2,40.5\n0.1,0\n",
    "other order and another column": "sieve,passing_percent,size_mm\na,0,0.1\nb,40.5,0.2\nc,100,0.4\n",
    "decimal comma": "# Excel\r\nsize_mm;passing_percent\r\n0,1;0\r\n0,2;40,5\r\n\r\n0,4;100\r\n",
    "tab": "\ufeffsize_mm\tpassing_percent\n0.1\t0\n0.2\t40,5\n0.4\t100\n",
    "spaces": "size_mm , passing_percent\n 0.1 , 0\n0.2, 40.5\n0.4, 1e2\n",
    "sieves that hold nothing": "size_mm,passing_percent\n0.05,0\n0.1,0\n0.2,40.5\n0.4,100\n1,100\n2,100\n",
}


@pytest.mark.parametrize("name", READ)
def test_files_that_mean_the_same_are_read_as_the_same(tmp_path, name):
    path = tmp_path / "sieve.csv"
    path.write_text(READ[name], encoding="utf-8")
    curve = read_sieve(path)
    assert (curve.size, curve.passing) == (pytest.approx((1e-4, 2e-4, 4e-4)), (0.0, 0.405, 1.0))


HEAD = "size_mm,passing_percent\n"
REFUSED = {
    "": "is empty",
    HEAD: "0 sizes; a sieve curve needs at least 2",
    HEAD + "0.1,0\n": "1 sizes",
    "d,p\n0.1,0\n": "needs the columns size_mm and passing_percent, each once (sizes in mm); found d, p",
    "size_um,passing_percent\n100,0\n200,100\n": "sizes in mm); found size_um, passing_percent",
    "size_mm,size_mm,passing_percent\n": "each once",
    HEAD + "0.1,0\n0.2,x\n": "line 3: passing_percent = 'x' is not a number",
    HEAD + "0.1,0\n0.2\n": "line 3: passing_percent = '' is not a number",
    HEAD + "0.1,0\n0,2,100\n0.4,100\n": "line 3: size_mm = 0 is outside",
    HEAD + "0.1,0\nnan,100\n": "line 3: size_mm = 'nan' is not a number",
    HEAD + "0.1,0\n1_0,100\n": "'1_0' is not a number",
    HEAD + "0.1,-1\n0.2,100\n": "line 2: passing_percent = -1 is outside [0, 100]",
    HEAD + "0.1,0\n0.2,100.1\n": "line 3: passing_percent = 100.1 is outside [0, 100]",
    HEAD + "100,0\n400,100\n": "line 3: size_mm = 400 is outside [0.001, 200] mm; is it in micrometres",
    HEAD + "0.0001,0\n0.0002,100\n": "line 2: size_mm = 0.0001 is outside [0.001, 200] mm; is it in metres?",
    HEAD + "0.1,0\n0.2,60\n0.3,50\n0.4,100\n": "line 4: passing_percent = 50 at 0.3 mm and 60 at 0.2 mm",
    HEAD + "0.4,100\n0.3,50\n0.2,60\n0.1,0\n": "line 4: passing_percent = 60 at 0.2 mm and 50 at 0.3 mm",
    HEAD + "0.1,0\n0.3,50\n0.2,60\n0.4,100\n": "line 4: size_mm = 0.2 follows 0.3; sizes must all increase or decrease",
    HEAD + "0.1,0\n0.1,100\n": "line 3: size_mm = 0.1 follows 0.1",
    HEAD + "0.1,2.5\n0.4,100\n": "line 2: 2.5 % passes the finest size, 0.1 mm; add a line with the size that 0 %",
    HEAD + "0.4,97\n0.1,0\n": "line 2: 97 % passes the coarsest size, 0.4 mm; add a line with the size that 100 %",
    HEAD + "0.1,0\n0.2,0.4\n0.4,1\n": "line 4: passing_percent ends at 1; is it a share? 100 stands for all",
    HEAD + "0.1,0\n0.2,0\n": "0 % passes the coarsest size",
    HEAD + "0.1,100\n0.2,100\n": "100 % passes the finest size",
    HEAD + "0.001,0\n200,100\n": "sizes run from 0.001 to 200 mm, a ratio above 1,000",
    HEAD + "0.1,0\n0.2,50\n0.3,50\n0.4,100\n": "50% passes every size from 0.2 to 0.3 mm, so D50 is not defined",
    HEAD + '0.1,"0\n0.2,100\n': "line 2: cannot be read as cells",
    HEAD + "1,0\n" * 10_001: "has 10,002 lines, at most 10,000",
}  # fmt: skip


@pytest.mark.parametrize("text", REFUSED, ids=range(len(REFUSED)))
def test_a_file_that_is_no_sieve_curve_is_refused_in_one_line(tmp_path, text):
    path = tmp_path / "sieve.csv"
    path.write_text(text)
    with pytest.raises(SieveError) as caught:
        read_sieve(path)
    assert (
        REFUSED[text] in str(caught.value) and str(caught.value).startswith(f"{path}") and "\n" not in str(caught.value)
    )


def test_a_missing_file_and_one_that_is_no_text_are_refused(tmp_path):
    with pytest.raises(SieveError, match="cannot be read"):
        read_sieve(tmp_path / "none.csv")
    (tmp_path / "a.csv").write_bytes(b"PK\x03\x04\x00\xff\xfe")
    with pytest.raises(SieveError, match="line 1"):
        read_sieve(tmp_path / "a.csv")
