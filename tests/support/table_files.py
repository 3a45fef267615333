"""Files of measured pairs as people have them: separators, decimal marks, encodings and rows of units.

python3 tests/support/table_files.py        prints which of the files are read, and how, as a table
"""

from __future__ import annotations

import io
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape

#: mu_s and G_p (GPa) of the pairs in every file.
PAIRS = [(0.21, 26.1), (0.18, 29.4), (0.33, 19.8), (0.27, 23.0), (0.15, 33.1), (0.24, 25.2), (0.41, 16.9),
         (0.19, 27.7), (0.29, 22.0), (0.22, 24.6), (0.36, 18.4), (0.17, 31.0)]  # fmt: skip


def table(header="mu_s,G_p_GPa", separator=",", decimal=".", scale=1.0, form="{:g}", units="", below="", above="",
          quoted=False) -> str:  # fmt: skip
    """The text of a table of the pairs.

    `scale` and `form` are those of the modulus; `above` is what stands over the header, `units` a line under it, and
    `below` a line under the pairs.
    """
    cells = [[f"{mu_s:g}".replace(".", decimal), form.format(G_p * scale).replace(".", decimal)] for mu_s, G_p in PAIRS]
    rows = [separator.join(f'"{cell}"' if quoted else cell for cell in row) for row in cells]
    return "\n".join([*filter(None, [above, header, units]), *rows, *filter(None, [below])]) + "\n"


def workbook(sheets: dict[str, list[list]], hidden: int = 0) -> bytes:
    """A minimal workbook in .xlsx, written without openpyxl; a text that starts with "=" is a formula without value."""
    space = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    links = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    kind = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    numbers = range(1, len(sheets) + 1)
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{package}/content-types"><Default Extension="rels" ContentType='
        '"application/vnd.openxmlformats-package.relationships+xml"/>'
        f'<Override PartName="/xl/workbook.xml" ContentType="{kind}.sheet.main+xml"/>'
        + "".join(f'<Override PartName="/xl/worksheets/sheet{k}.xml" ContentType="{kind}.worksheet+xml"/>'
                  for k in numbers) + "</Types>",
        "_rels/.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="rId1" '
        f'Type="{links}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook {space} xmlns:r="{links}"><sheets>'
        + "".join(f'<sheet name="{name}" sheetId="{k}" r:id="rId{k}"/>' for k, name in enumerate(sheets, 1))
        + "</sheets></workbook>",
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}/relationships">'
        + "".join(f'<Relationship Id="rId{k}" Type="{links}/worksheet" Target="worksheets/sheet{k}.xml"/>'
                  for k in numbers) + "</Relationships>",
    }  # fmt: skip
    for k, rows in enumerate(sheets.values(), 1):
        lines = "".join(
            f'<row r="{n}"{" hidden=" + chr(34) + "1" + chr(34) if n == hidden else ""}>'
            + "".join(_cell(f"{chr(65 + column)}{n}", value) for column, value in enumerate(row))
            + "</row>"
            for n, row in enumerate(rows, 1)
        )
        parts[f"xl/worksheets/sheet{k}.xml"] = f"<worksheet {space}><sheetData>{lines}</sheetData></worksheet>"
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in parts.items():
            archive.writestr(name, '<?xml version="1.0" encoding="UTF-8"?>' + text)
    return file.getvalue()


def _cell(place: str, value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, str) and value.startswith("="):
        return f'<c r="{place}"><f>{escape(value[1:])}</f></c>'
    if isinstance(value, str):
        return f'<c r="{place}" t="inlineStr"><is><t>{escape(value)}</t></is></c>'
    return f'<c r="{place}"><v>{value}</v></c>'


class Case(NamedTuple):
    """A file: what it is, its bytes, the mapping of columns, what is said of it, and whether it is read."""

    what: str
    data: bytes
    columns: dict[str, str]
    said: str
    read: bool = True


_EUROPEAN = {"mu_s": "Reibung", "E_p_GPa": "E-Modul"}
#: Files of 12 pairs; those that are read hold `PAIRS`, as E_p = 2.4 G_p where they have a Young's modulus.
CASES = [
    Case("',', point, UTF-8", table().encode(), {}, "12 pairs, ',' between cells, decimal point, units GPa"),
    Case("';', comma, UTF-8 with a byte-order mark, units row, empty rows and columns at the end",
         ("\ufeff" + table("Reibung;E-Modul;;", ";", ",", 2.4, units="-;GPa;;", below=";;;\n;;;")).encode(), _EUROPEAN,
         "12 pairs, ';' between cells, decimal comma, units GPa, units in line 2, mu_s from 'Reibung', E_p_GPa from "
         "'E-Modul', G_p from E_p with nu = 0.2"),
    Case("';', comma, Windows-1252, unit in the header",
         table("Reibung µ;G_p [MPa]", ";", ",", 1e3).encode("cp1252"), {"mu_s": "Reibung µ"},
         "12 pairs, ';' between cells, decimal comma, units MPa, Windows-1252, mu_s from 'Reibung μ', G_p_MPa from "
         "'G_p [MPa]'"),
    Case("tab, point, UTF-16 with a mark", table("mu_s\tG_p_GPa", "\t").encode("utf-16"), {},
         "12 pairs, a tab between cells, decimal point, units GPa, UTF-16"),
    Case("tab, comma, UTF-16 LE without a mark, units row",
         table("mu_s\tG_p", "\t", ",", 1e3, units="[-]\t[MPa]").encode("utf-16-le"), {},
         "12 pairs, a tab between cells, decimal comma, units MPa, units in line 2, UTF-16, G_p_MPa from 'G_p'"),
    Case("';', point, UTF-16 BE without a mark, E_p in MPa",
         table("mu_s;E_p_MPa", ";", scale=2400).encode("utf-16-be"), {},
         "12 pairs, ';' between cells, decimal point, units MPa, UTF-16, G_p from E_p with nu = 0.2"),
    Case("',', comma in quoted cells, a comment", table(decimal=",", quoted=True, above="# two sands").encode(), {},
         "12 pairs, ',' between cells, decimal comma, units GPa"),
    Case("';', point, commas between thousands of Pa, a first line sep=;",
         table("mu_s;G_p_Pa", ";", scale=1e9, form="{:,.0f}", above="sep=;").encode(), {},
         "12 pairs, ';' between cells, decimal point, a comma between thousands, units Pa"),
    Case("',', comma: four cells or two numbers", table(decimal=",").encode(), {},
         "line 2: '0,21,26,1' can be read in two ways: as 4 cells (0 | 21 | 26 | 1), of which the header names 2, or "
         "as numbers with a decimal comma (0,21 | 26,1); put ';' between cells, or write decimal points", False),
    Case("';', comma, 26.100 MPa: thousands or decimals",
         table("mu_s;G_p_MPa", ";", ",", 1e3).replace("26100", "26.100").encode(), {},
         "line 2: G_p_MPa = '26.100' can be read in two ways: as 26100 (a point between thousands) or as 26.100 "
         "(a decimal point); write the one that is meant", False),
    Case("';', comma, Windows-1252, units row against the header",
         table("mu_s;G_p_GPa;Größe", ";", ",", units="-;MPa;mm").encode("cp1252"), {},
         "line 2: G_p_GPa says GPa, but this line says MPa", False),
    Case("tab, point, UTF-16, two columns of moduli", table("mu_s\tG_p_GPa\tE_p_GPa", "\t").encode("utf-16"), {},
         "line 1: has both G_p_GPa and E_p_GPa; keep one, or name the one that is meant in [inputs.columns], so that "
         "the modulus is unambiguous", False),
    Case("';', comma, a limit of a measurement", table("mu_s;G_p_GPa", ";", ",", below=">0,5;20").encode(), {},
         "line 14: mu_s = '>0,5' is not a number: it is a limit; the tool uses single measured values, and no "
         "truncated, censored or interval values", False),
    Case("';', point, names of another language", table("Reibungsbeiwert;Schubmodul / GPa", ";").encode(), {},
         "line 1: needs the columns mu_s and G_p_GPa (or E_p_GPa); found Reibungsbeiwert, Schubmodul / GPa; "
         "'Reibungsbeiwert' may be mu_s: say so with [inputs.columns] mu_s = \"Reibungsbeiwert\"; 'Schubmodul / GPa' "
         "may be G_p_GPa: say so with [inputs.columns] G_p_GPa = \"Schubmodul / GPa\"", False),
]  # fmt: skip


def outcome(case: Case, folder: Path) -> tuple[bool, str]:
    """Whether the file of a case is read, and what is said of it, without the name of the file."""
    from analysis.inputs.checks import InputError
    from analysis.inputs.table import read_input_table

    path = folder / "mine.csv"
    path.write_bytes(case.data)
    try:
        return True, read_input_table(path, columns=case.columns).understood.removeprefix("mine.csv: ")
    except InputError as error:
        return False, str(error).removeprefix(f"{path}, ")


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    with tempfile.TemporaryDirectory() as folder:
        print("| file | outcome | what is said |\n|---|---|---|")
        for case in CASES:
            read, said = outcome(case, Path(folder))
            said = said.replace("|", "\\|")
            print(f"| {case.what} | {'read' if read else 'refused'} | {said} |")
