"""Tables of measurements as people have them: what is read, what is said of it, and what is refused as doubtful."""

from __future__ import annotations

import itertools
import sys

import numpy as np
import pytest
from paths import ROOT
from table_files import CASES, PAIRS, outcome, table, workbook

from analysis.inputs.cell_numbers import why_no_number
from analysis.inputs.checks import InputError
from analysis.inputs.column_names import COLUMN_NAMES, UNITS
from analysis.inputs.table import read_input_table
from analysis.inputs.variables import VARIABLES

ROWS = [list(pair) for pair in PAIRS]
HEADER = ["mu_s", "G_p_GPa"]


def read(folder, data, columns=None, nu=0.2, name="mine.csv"):
    path = folder / name
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return read_input_table(path, nu, columns)


def refused(folder, data, columns=None, name="mine.csv"):
    """The text of the refusal of a file, in one line and with the file's name, without its folder."""
    with pytest.raises(InputError) as error:
        read(folder, data, columns, name=name)
    text = str(error.value)
    assert text.startswith(f"{folder}/{name}") and "\n" not in text and len(text) < 700
    return text.removeprefix(f"{folder}/")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.what)
def test_a_file_is_read_or_refused_as_stated(case, tmp_path):
    assert outcome(case, tmp_path) == (case.read, case.said)
    if case.read:
        found = read(tmp_path, case.data, case.columns)
        assert found.names == ("mu_s", "G_p") and len(found.lines) == len(PAIRS)
        assert found.values == pytest.approx(np.array(PAIRS) * (1.0, 1e9), rel=1e-12)


ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1")


@pytest.mark.parametrize("separator, decimal", [(",", "."), *itertools.product(";\t", ".,")])
def test_separators_decimals_encodings_and_units_in_all_combinations(separator, decimal, tmp_path):
    for encoding, unit, units in itertools.product(ENCODINGS, ("GPa", "MPa", "Pa"), (False, True)):
        scale, form = {"GPa": (1.0, "{:g}"), "MPa": (1e3, "{:g}"), "Pa": (1e9, "{:.0f}")}[unit]
        header = separator.join(["mu_s", "G_p" if units else f"G_p_{unit}", "Größe"])
        text = table(header, separator, decimal, scale, form, separator.join(["-", unit, "mm"]) if units else "")
        found = read(tmp_path, text.encode(encoding))
        assert found.values == pytest.approx(np.array(PAIRS) * (1.0, 1e9), rel=1e-12)
        assert found.lines[0] == (3 if units else 2) and f"units {unit}" in found.understood


def test_the_files_that_users_brought_are_read(tmp_path):
    export = "\ufeffReibung;E_p_GPa;Korn;;\n-;GPa;;;\n" + "".join(
        f"{mu_s};{E:.1f};Q{k:02d};;\n".replace(".", ",") for k, (mu_s, E) in enumerate(PAIRS, 1)
    )
    text = refused(tmp_path, export + ";;;;\n")
    assert text.endswith("'Reibung' may be mu_s: say so with [inputs.columns] mu_s = \"Reibung\"")
    found = read(tmp_path, export + ";;;;\n", {"mu_s": "Reibung"})
    assert found.values[0] == pytest.approx([0.21, 26.1e9 / 2.4]) and found.lines == list(range(3, 15))
    assert found.understood == (
        "mine.csv: 12 pairs, ';' between cells, decimal comma, units GPa, units in line 2, mu_s from 'Reibung', "
        "G_p from E_p with nu = 0.2, not used: Korn"
    )


def test_the_default_pairs_are_read_to_the_bit():
    path = ROOT / "data" / "pairs_reconstructed.csv"
    rows = [line.split(",") for line in path.read_text().splitlines() if line[0].isdigit()]
    found = read_input_table(path)
    assert np.array_equal(found.values, np.array(rows, float) * (1.0, 1e9))
    assert found.understood == "pairs_reconstructed.csv: 94 pairs, ',' between cells, decimal point, units GPa"


def test_more_properties_are_random_if_they_have_a_name_of_the_project(tmp_path):
    rows = "".join(f"a;{200 + k};{G};{0.1 + 0.02 * k:.2f};{mu_s};{50 + k}\n" for k, (mu_s, G) in enumerate(PAIRS))
    found = read(tmp_path, "sand;d50_um;E_p_GPa;nu;mu_s;p\n" + rows, {"sigma_3_kPa": "p"})
    assert found.names == ("mu_s", "G_p", "nu", "sigma_3", "d50") == tuple(s for s in VARIABLES if s in found.names)
    assert found.values[2] == pytest.approx([0.33, 19.8e9 / 2 / 1.14, 0.14, 52e3, 202e-6])
    assert "12 lines of 5 properties (mu_s, G_p, nu, sigma_3, d50)" in found.understood
    assert "units GPa, kPa, um" in found.understood and "G_p from E_p with nu of the same line" in found.understood
    text = "mu_s;G_p_GPa;nu\n" + "".join(f"{mu_s};{G};0.2\n" for mu_s, G in PAIRS)
    assert "every nu is 0.2, so it is not random" in refused(tmp_path, text)
    assert "line 2: nu = 0.5 exceeds 0.49" in refused(tmp_path, text.replace("0.2\n", "0.5\n", 1))
    sizes = "mu_s;G_p_GPa;d50_um\n" + "".join(f"{mu_s};{G};{k * 1e5}\n" for k, (mu_s, G) in enumerate(PAIRS, 1))
    assert "line 3: d50_um = 200000.0 exceeds 100000 um" in refused(tmp_path, sizes)


def test_the_registry_of_columns_agrees_with_that_of_variables():
    for variable in VARIABLES.values():
        assert variable.column in COLUMN_NAMES
        assert UNITS[variable.symbol][variable.unit] == variable.factor


@pytest.mark.parametrize("cell, words", [
    (">0.5", "a limit"), ("<0.1", "a limit"), ("≥ 0.5", "a limit"), ("0.5+", "a limit"), ("~0.3", "an approximate"),
    ("ca. 0.3", "an approximate"), ("0.3*", "a value with a mark"), ("n.d.", "no measured value"),
    ("N/A", "no measured value"), ("#N/A", "no measured value"), ("-", "no measured value"),
    ("<LOQ", "no measured value"), ("0.2±0.05", "a value with its error"), ("0.2 +/- 0.05", "a value with its error"),
    ("0.25 (0.03)", "a value with its error"), ("0.1-0.3", "an interval"), ("0.1–0.3", "an interval"),
    ("0.1 to 0.3", "an interval"), ("[0.1; 0.3]", "an interval"),
])  # fmt: skip
def test_limits_and_intervals_are_no_values(cell, words, tmp_path):
    text = refused(tmp_path, table("mu_s\tG_p_GPa", "\t", below=f"{cell}\t20"))
    assert f"line 14: mu_s = {cell!r} is not a number: it is {words}" in text
    assert text.endswith("and no truncated, censored or interval values")


@pytest.mark.parametrize("cell, words", [
    ("0.25 GPa", "a unit belongs in the header or in a row below it"), ("25%", "a unit belongs"),
    ("2023-02-01", "it is a date"), ("01. Feb", "it is a date"), ("1.2.2023", "it is a date"),
    ("=A2/2", "a formula without a stored value"),
])  # fmt: skip
def test_other_cells_are_explained(cell, words, tmp_path):
    text = refused(tmp_path, table("mu_s\tG_p_GPa", "\t", below=f"{cell}\t20"))
    assert f"line 14: mu_s = {cell!r} is not a number: " in text and words in text


@pytest.mark.parametrize("cell", ["0.2.1", "1,2,3", "½", "0.2 0.3", "abc", "1,23,456", "0.1_5", "٠.٢", "29 100", ""])
def test_a_cell_that_is_no_number_is_refused(cell, tmp_path):
    text = refused(tmp_path, table("mu_s;G_p_GPa", ";", below=f"{cell};20"))
    assert f"line 14: mu_s = {cell!r} is not a number" in text and why_no_number(cell) == ""


@pytest.mark.parametrize("decimal, cells, values", [
    (".", ["29'100.5", "29’100", "1e4"], [29100.5, 29100, 1e4]),
    (",", ["29\u00a0100", "29\u202f100,5", "1,5E4", "+2,5e4"], [29100, 29100.5, 15000, 25000]),
    (",", ["29.100", "29.100,5", "0,029"], [29100, 29100.5, 0.029]),
    (".", ["29,100.5", "29,100", "29100"], [29100.5, 29100, 29100]),
])  # fmt: skip
def test_marks_between_thousands_are_read_where_they_are_certain(decimal, cells, values, tmp_path):
    below = "\n".join(f"0{decimal}5;{cell}" for cell in cells)
    found = read(tmp_path, table("mu_s;G_p_MPa", ";", decimal, 1e3, below=below))
    assert found.values[12:, 1] == pytest.approx(np.array(values) * 1e6)


@pytest.mark.parametrize("text, words", [
    (table("mu_s;G_p_MPa", ";", scale=1e3, below="0.5;29,100"),
     "line 14: G_p_MPa = '29,100' can be read in two ways: as 29100 (a comma between thousands) or as 29.100"),
    ("mu_s;G_p_MPa\n" + "1.210;26100\n" * 12, "line 2: mu_s = '1.210' can be read in two ways: as 1210 (a point"),
    (table("mu_s;G_p_GPa", ";", ",", below="0.5;20,1"),
     "line 2: mu_s = '0,21' has a decimal comma, but line 14: mu_s = '0.5' has a decimal point"),
    (table("mu_s;G_p_MPa", ";", ",", below="0,5;1,000,000"), "has a comma between thousands; write all numbers in one"),
    (table("mu_s,G_p_GPa,sand", ",", ","), "as 4 cells (0 | 21 | 26 | 1), of which the header names 3"),
    (table("mu_s,G_p_GPa,sand,test", ",", ","),
     "line 2: mu_s = 0 must be positive; if a comma is the decimal mark, put ';' between the cells"),
    (table("mu_s,G_p_GPa", ";", ","), "seems to have ';' between cells, and the header has ','"),
    (table("mu_s;G_p_GPa", ";", below="0.2;20;30"), "line 14: has 3 cells (0.2 | 20 | 30), but the header names 2"),
    (table("mu_s;G_p_GPa;G_p_MPa", ";"), "has both G_p_GPa and G_p_MPa; keep one"),
    (table("mu_s;G_p [GPa];G_p [GPa]", ";"), "column G_p [GPa] appears more than once"),
    (table("mu_s;G_p", ";"), "column G_p has no unit; call it G_p_GPa or G_p_MPa or G_p_Pa"),
    (table("mu_s;G_p", ";", units="-;psi"), "line 2: G_p has the unit 'psi' in this line; use one of GPa, MPa, Pa"),
    (table("mu_s;G_p_GPa", ";", units="%;GPa"), "line 2: mu_s has no unit, but this line says %"),
    (table("mu_s;G_p_GPa", ";", units="-;gigapascal"),
     "line 2: G_p_GPa = 'gigapascal' is not a number, nor a unit that is known (GPa, MPa, Pa)"),
    (table("mu_s (%);G_p_GPa", ";"), "line 1: mu_s (column 'mu_s (%)') has no unit, but its header says %"),
    (table("mu_s;G_p_GPa", ";", above="1;2"), "line 1: has numbers above the header in line 2"),
    (table("n;mu_s;G_p_GPa", ";").replace("\n0", "\n1;0") + "Mittelwert:;0.25;25\n",
     "line 14: 'Mittelwert:' labels a line that summarizes pairs; delete it"),
    (table("mu_s;G_p_Pa", ";"), "line 2: G_p_Pa = 26.1 is below 1000 Pa (is it in GPa or MPa?)"),
    (table("mu_s;G_p_MPa", ";", scale=1e9, form="{:.0f}"), "exceeds 1e+06 MPa (is it in Pa?)"),
    (table("mu_s,G_p_GPa", ",", below="#N/A,20"), "line 14: mu_s = '#N/A' is not a number"),
])  # fmt: skip
def test_doubts_are_refused(text, words, tmp_path):
    assert words in refused(tmp_path, text)


@pytest.mark.parametrize("header, columns, words", [
    ("Mu_s;G_p_Gpa", {}, "'Mu_s' may be mu_s: say so with [inputs.columns] mu_s = \"Mu_s\"; 'G_p_Gpa' may be G_p_GPa"),
    ("Friction (dry);Friction (wet)", {}, "'Friction (dry)' (or 'Friction (wet)') may be mu_s"),
    ("Reibungswinkel °;E-Modul / MPa", {}, "'Reibungswinkel °' seems to be an angle; mu_s is its tangent; "
     "'E-Modul / MPa' may be E_p_MPa: say so with [inputs.columns] E_p_MPa = \"E-Modul / MPa\""),
    ("mu_s;stiffness in N/mm2", {}, "may be G_p_MPa or E_p_MPa"),
    ("mu_s;x", {}, "say which columns they are in the section [inputs.columns]"),
    ("mu_s G_p_GPa", {}, "put ',' or ';' or a tab between the cells"),
    ("0.2;20", {}, "this line has numbers; the first line must have the names of the columns"),
    ("Reibung;G_p_GPa", {"mu_s": "Reibun"},
     "has no column 'Reibun', which inputs.columns names for mu_s; found Reibung, G_p_GPa"),
    ("mu_s;G / MPa", {"G_p_GPa": "G / MPa"}, "G_p_GPa (column 'G / MPa') says GPa, but its header says MPa"),
    ("friction angle (deg);G_p_GPa", {"mu_s": "friction angle (deg)"}, "mu_s is a coefficient, the tangent"),
    ("mu_s;G_p_GPa", {"G_p": "G"}, "inputs.columns: unknown key G_p; did you mean G_p_Pa or G_p_MPa or G_p_GPa?"),
    ("mu_s;G_p_GPa", {"colour": "G"}, "unknown key colour; known: mu_s, G_p_GPa, G_p_MPa,"),
    ("mu_s;G_p_GPa", {"G_p_GPa": "G", "E_p_MPa": "E"}, "G_p_GPa and E_p_MPa both name a column for G_p; keep one"),
    ("mu_s;G_p_GPa", {"mu_s": "a", "nu": "a"}, "mu_s and nu name the same column, 'a'"),
    ("mu_s;G_p_GPa", {"mu_s": " "}, "mu_s = ' ' must be the name of a column of the table"),
])  # fmt: skip
def test_a_refused_header_names_the_columns_and_what_they_may_be(header, columns, words, tmp_path):
    assert words in refused(tmp_path, table(header, ";"), columns)


def test_a_mapping_decides_between_columns_and_names_with_separators(tmp_path):
    header = "Friction, 5 mm/min;G at 100 kPa in GPa;G_p_MPa"
    columns = {"mu_s": "Friction,  5 mm/min", "G_p_GPa": "G at 100 kPa in GPa"}
    found = read(tmp_path, table(header, ";"), columns)
    assert found.values[0] == pytest.approx([0.21, 26.1e9]) and found.understood.endswith("not used: G_p_MPa")


def test_lines_above_the_header_are_skipped_and_said(tmp_path):
    found = read(tmp_path, table("mu_s;G_p_GPa", ";", above="Results of 2019;;\nquartz"))
    assert found.lines[0] == 4 and "header in line 3" in found.understood


@pytest.mark.parametrize("data, words", [
    (b"", "is empty"), (b"\xef\xbb\xbf", "is empty"), (b"\xff\xfe", "is empty"), (b";;\n,,\n", "is empty"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + b"x" * 99, "is a workbook in .xls, or one with a password"),
    (b"<html><table>", "is HTML or XML"), (b"\x1f\x8b\x08", "is a compressed file"), (b"%PDF-1.7", "is a PDF file"),
    (b"PK\x03\x04" + b"x" * 99, "cannot be read as a workbook"), (b"mu_s,G\x00_p\n", "seems to be no text"),
    (table().encode("utf-32"), "seems to be no text"), (table().encode("utf-16")[:-1], "begins as a text in UTF-16"),
    ("摩擦系数,G_p_GPa\n0.2,20\n".encode("gbk"), "(read as Windows-1252)"),
])  # fmt: skip
def test_other_files_are_named(data, words, tmp_path):
    assert words in refused(tmp_path, data)


def test_damaged_files_are_refused_or_read_and_never_end_in_another_error(tmp_path):
    rng = np.random.default_rng(1)
    whole = [bytearray(case.data) for case in CASES] + [bytearray(workbook({"a": [HEADER, *ROWS]}))]
    for k in range(300):
        data = bytearray(whole[k % len(whole)])
        for _ in range(rng.integers(1, 4)):
            data[rng.integers(len(data))] = rng.choice(list(b'0123456789,.;\t"#\n\r\x00\xff<e'))
        try:
            found = read(tmp_path, bytes(data[: rng.integers(len(data) // 2, len(data) + 1)]))
        except InputError as error:
            assert "\n" not in str(error)
        else:
            assert np.all(found.values > 0.0) and np.all(np.isfinite(found.values))


class TestWorkbooks:
    """Files in .xlsx, built without openpyxl and read with it."""

    @pytest.fixture(autouse=True)
    def _openpyxl(self):
        pytest.importorskip("openpyxl")

    def test_the_sheet_with_the_pairs_is_read(self, tmp_path):
        sheets = {"notes": [["two sands"]], "empty": [], "tests": [[], [None, "of 2019"], ["sand", *HEADER]]}
        sheets["tests"] += [["a", *row] for row in ROWS] + [[], [None]]
        found = read(tmp_path, workbook(sheets, hidden=5), name="a.xlsx")
        assert found.values == pytest.approx(np.array(PAIRS) * (1.0, 1e9)) and found.lines == list(range(4, 16))
        assert found.understood == (
            "a.xlsx: 12 pairs, sheet 'tests', units GPa, header in row 3, hidden rows included: 1, not used: sand"
        )

    def test_texts_of_numbers_and_a_units_row_are_read(self, tmp_path):
        rows = [[str(value).replace(".", ",") for value in row] for row in ROWS]
        found = read(tmp_path, workbook({"a": [["mu_s", "G_p"], ["-", "GPa"], *rows]}), name="a.xlsx")
        assert found.values[3] == pytest.approx([0.27, 23e9])
        assert "decimal comma, units GPa, units in row 2" in found.understood

    @pytest.mark.parametrize("rows, words", [
        ([[None, 20]], "a.xlsx, row 14 of sheet 'a': mu_s = '' is not a number"),
        ([[">0.5", 20]], "row 14 of sheet 'a': mu_s = '>0.5' is not a number: it is a limit"),
        ([["=A2/2", 20]], "mu_s = '=A2/2' is not a number: it is a formula without a stored value"),
        ([["=A2", "=B2"]], "mu_s = '=A2' is not a number"), ([[0.2, 20, 3]], "has 3 cells (0.2 | 20 | 3)"),
        ([[-0.2, 20]], "mu_s = -0.2 must be positive"), ([["1,234", 20]], "can be read in two ways: as 1234"),
    ])  # fmt: skip
    def test_a_bad_cell_is_named_with_its_sheet_and_row(self, rows, words, tmp_path):
        assert words in refused(tmp_path, workbook({"a": [HEADER, *ROWS, *rows]}), name="a.xlsx")

    def test_two_sheets_with_pairs_are_refused(self, tmp_path):
        data = workbook({"dry": [HEADER, *ROWS], "wet": [HEADER, *ROWS]})
        assert "can be read in 2 ways, with sheet 'dry' and sheet 'wet'" in refused(tmp_path, data, name="a.xlsx")

    def test_an_empty_or_damaged_workbook_is_refused(self, tmp_path):
        assert "is empty" in refused(tmp_path, workbook({"a": []}), name="a.xlsx")
        data = workbook({"a": [HEADER, *ROWS]})
        assert "cannot be read as a workbook" in refused(tmp_path, data[:-100], name="a.xlsx")


def test_without_openpyxl_a_workbook_gets_a_clear_sentence(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    text = refused(tmp_path, workbook({"a": [HEADER, *ROWS]}), name="a.xlsx")
    assert text.endswith("install openpyxl (in Debian python3-openpyxl), or save the sheet as CSV in UTF-8")
    assert "is an archive" in refused(tmp_path, _archive("a.csv"), name="a.xlsx")
    assert "OpenDocument" in refused(tmp_path, _archive("mimetype"), name="a.ods")
    assert "a workbook in .xlsb" in refused(tmp_path, _archive("xl/workbook.bin"), name="a.xlsb")


def _archive(member):
    import io
    import zipfile

    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(member, "x")
    return file.getvalue()
