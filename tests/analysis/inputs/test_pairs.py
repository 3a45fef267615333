"""Measured pairs: a right answer, or one clear line that names file, row and value."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from paths import PAIRS_FILE

from analysis.inputs.pairs import InputError, check_pairs, read_numbered_pairs, read_pairs

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
        ("0.2_14,20", "line 14: mu_s = '0.2_14' is not a number"),
        ("0_3,20", "line 14: mu_s = '0_3' is not a number"),
        ("٠.٢,20", "line 14: mu_s = '٠.٢' is not a number"),
        ("0.２,20", "line 14: mu_s = '0.２' is not a number"),
        ("0.2,0x14", "line 14: G_p_GPa = '0x14' is not a number"),
        ("5e-324,20", "line 14: mu_s = 5e-324 is below 0.0001"),
        ("0.2,1e-9", "line 14: G_p_GPa = 1e-9 is below 1e-06 GPa"),
        ("0.2," + "2" * 140_000, "line 14: a cell has more than 131,072 characters"),
        ("0.2," + "2" * 400, "line 14: G_p_GPa = " + "2" * 60 + "... (400 characters) is not finite"),
        ("0.2,20\x1b[31m", "line 14: G_p_GPa = '20\\x1b[31m' is not a number"),
    ],
    ids=lambda text: text[:60],
)
def test_a_bad_value_is_named_with_its_line(tmp_path, row, words):
    path = written(tmp_path, "mu_s,G_p_GPa", [*GOOD, row])
    with pytest.raises(InputError) as error:
        read_pairs(path)
    assert words in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value) and len(str(error.value)) < 400


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (['"first', 'second",0.2,20'], "line 3: a quoted cell does not end in this line"),
        (["a,0.2,20\x0c", "a,0.2,20\x0b", "a,0.2\u2028,20", '"b', '",0.2,20'], "line 6: a quoted cell"),
        (["a,0.2,20", '"b"c,0.2,20'], "line 4: a quoted cell"),
        (["a,0.2,20", "b,0.2,x"], "line 4: G_p_GPa = 'x'"),
    ],
)
def test_a_fault_is_reported_at_its_own_line(tmp_path, rows, words):
    path = written(tmp_path, "sample,mu_s,G_p_GPa", ["good,0.3,30", *rows])
    with pytest.raises(InputError, match=words):
        read_pairs(path)


def test_quoted_cells_and_all_ends_of_lines_are_read(tmp_path):
    path = tmp_path / "pairs.csv"
    rows = [f'"a, b ""c""","{row.split(",")[0]}",{row.split(",")[1]}' for row in GOOD]
    for end in ("\n", "\r\n", "\r"):
        path.write_bytes(end.join(["sample,mu_s,G_p_GPa", *rows]).encode())
        pairs, lines = read_numbered_pairs(path)
        assert pairs[3] == pytest.approx([0.13, 23e9]) and lines == list(range(2, 14))


def test_bytes_of_no_known_encoding_are_named_with_their_line(tmp_path):
    path = tmp_path / "pairs.csv"
    path.write_bytes(b"mu_s,G_p_GPa\n\x81\xff,20\n")
    with pytest.raises(InputError, match="line 2: byte 0x81 is not UTF-8; is it a text file"):
        read_pairs(path)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (
            [f"0.{1 + k % 4},{20 + k}" for k in range(12)],
            "mu_s has 4 distinct values in 12 pairs; a fit needs at least 5",
        ),
        ([f"0.{10 + k},{20 + k % 2}" for k in range(12)], "G_p_GPa has 2 distinct values in 12 pairs"),
    ],
)
def test_too_few_distinct_values_are_refused(tmp_path, rows, words):
    with pytest.raises(InputError, match=words):
        read_pairs(written(tmp_path, "mu_s,G_p_GPa", rows))


def test_numbers_of_all_usual_forms_are_read(tmp_path):
    rows = [*GOOD[:8], "+2.5e-1, 20.", ".2,2E1", " 0.3 ,20.5", "0.31\u00a0,21"]
    pairs = read_pairs(written(tmp_path, "mu_s,G_p_GPa", rows))
    assert pairs[8:] == pytest.approx(np.array([[0.25, 20e9], [0.2, 20e9], [0.3, 20.5e9], [0.31, 21e9]]))


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
