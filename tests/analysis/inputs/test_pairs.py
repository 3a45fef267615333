"""Measured pairs: a right answer, or one clear line that names file, row and value."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from paths import PAIRS_FILE

from analysis.inputs.pairs import InputError, check_pairs, read_pairs

RECONSTRUCTED = PAIRS_FILE
GOOD = [f"{0.1 + 0.01 * k:.2f},{20 + k}" for k in range(12)]


def written(folder: Path, header: str, rows: list[str]) -> Path:
    path = folder / "pairs.csv"
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def test_shear_modulus_is_read_in_pascal(tmp_path):
    rows = [f"a{k},{row}" for k, row in enumerate(GOOD)]
    pairs = read_pairs(written(tmp_path, "# a comment\nsample,mu_s,G_p_GPa", rows))
    assert pairs.shape == (12, 2)
    assert pairs[3] == pytest.approx([0.13, 23e9])


def test_youngs_modulus_becomes_a_shear_modulus(tmp_path):
    pairs = read_pairs(written(tmp_path, "mu_s, E_p_GPa", GOOD))
    assert pairs[0, 1] == pytest.approx(20e9 / 2.4)
    assert read_pairs(tmp_path / "pairs.csv", nu=0.1)[0, 1] == pytest.approx(20e9 / 2.2)


def test_byte_order_mark_and_blank_lines_do_no_harm(tmp_path):
    path = tmp_path / "pairs.csv"
    path.write_bytes(("\ufeffmu_s,G_p_GPa\r\n\r\n" + "\r\n".join(GOOD)).encode())
    assert len(read_pairs(path)) == 12


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("0.2,abc", "line 14: G_p_GPa = 'abc' is not a number"),
        ("0.2", "line 14: G_p_GPa = '' is not a number"),
        ("nan,20", "line 14: mu_s = nan is not finite"),
        ("0.2,inf", "line 14: G_p_GPa = inf is not finite"),
        ("-0.2,20", "line 14: mu_s = -0.2 must be positive"),
        ("0.2,0", "line 14: G_p_GPa = 0 must be positive"),
        ("0.2,2.5e10", "line 14: G_p_GPa = 2.5e10 exceeds 1000 GPa"),
        ("25,20", "line 14: mu_s = 25 exceeds 5"),
    ],
)
def test_a_bad_value_is_named_with_its_line(tmp_path, row, words):
    path = written(tmp_path, "mu_s,G_p_GPa", [*GOOD, row])
    with pytest.raises(InputError) as error:
        read_pairs(path)
    assert words in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("header", "rows", "words"),
    [
        ("mu_s,K", GOOD, "needs the columns mu_s and G_p_GPa"),
        ("friction,G_p_GPa", GOOD, "needs the columns mu_s and G_p_GPa"),
        ("mu_s,G_p_GPa,E_p_GPa", [f"{row},50" for row in GOOD], "both G_p_GPa and E_p_GPa"),
        ("mu_s,mu_s,G_p_GPa", [f"0.1,{row}" for row in GOOD], "mu_s appears more than once"),
        ("mu_s,G_p_GPa", GOOD[:9], "9 pairs, need at least 10"),
        ("mu_s,G_p_GPa", [], "0 pairs, need at least 10"),
        ("mu_s,G_p_GPa", [f"0.2,{20 + k}" for k in range(12)], "every mu_s is the same"),
    ],
)
def test_a_bad_table_is_refused(tmp_path, header, rows, words):
    with pytest.raises(InputError, match=words):
        read_pairs(written(tmp_path, header, rows))


def test_a_missing_empty_or_binary_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_pairs(tmp_path / "nowhere.csv")
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(InputError, match="is empty"):
        read_pairs(tmp_path / "empty.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(InputError, match="UTF-8"):
        read_pairs(tmp_path / "binary.csv")


def test_arrays_are_checked_like_files():
    good = np.abs(np.random.default_rng(1).normal(1.0, 0.1, (12, 2)))
    assert np.array_equal(check_pairs(good), good)
    for value in (np.nan, np.inf, -1.0):
        bad = good.copy()
        bad[4, 1] = value
        with pytest.raises(InputError, match="pair 5, column 2"):
            check_pairs(bad)
    with pytest.raises(InputError, match="array"):
        check_pairs(good[:, 0])


def test_the_reconstructed_pairs_are_there():
    pairs = read_pairs(RECONSTRUCTED)
    assert pairs.shape == (94, 2)
    assert pairs[:, 1].min() > 1e9 and pairs[:, 1].max() < 1e11
