"""All results as tidy tables, one row per value, for other programs: points, runs, states, responses and PDFs.

Values are in SI units and have all their digits (probability densities have ten). The table `columns` describes every
column with its unit, and the table `quantities` every symbol. Means and standard deviations follow from `value` and
`probability`,

    mean = sum(P v), sd = sqrt(sum(P (v - mean)^2)),

over the rows of one family, density, state (or strain) and quantity that have a value; their probabilities sum to 1.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..errors_and_files import atomic_write
from ..quantities import EARLY_ENDS, QUANTITIES
from ..results.reader import Results, ResultsError
from .registry import without_formulas

#: Rows of a sheet of Excel, its heading included.
SHEET_ROWS = 2**20
#: Column -> unit and meaning; "" stands for the unit of the row's quantity.
COLUMNS = {
    "id": ("1", "number of the representative point"),
    "point": ("1", "number of the representative point, as `id` in points; -1: shared by the points"),
    "family": ("", "family of runs: coupled (all inputs vary) or G_p (mu_s is fixed)"),
    "mu_iso": ("1", "interparticle friction during consolidation; it stands for the density"),
    "state": ("", "initial, peak or critical state of the shear run, or probe; undrained: transformation, strength"),
    "standing": ("", "standing of the state: proven, not proven at this size, or not reached"),
    "quantity": ("", "symbol, see quantities"),
    "strain": ("1", "axial strain, logarithmic; positive in extension, too"),
    "end": ("", "how an undrained test ended early: liquefied, stiff, or empty"),
    "value": ("unit of the quantity, see quantities",
              "value of the point; empty: no run, state not reached, or the test has ended"),
    "probability": ("1", "probability of the point; points without a value have zero, and their sum is 1"),
    "filled": ("1", "1: no run, the value comes from a model over the inputs"),
    "continued": ("1", "1: the run stopped early in the steady state, the value continues it"),
    "x": ("unit of the quantity, see quantities", "centre of a cell of the PDF"),
    "pdf": ("1 / unit of the quantity", "probability density, the average over the cell"),
    "packing": ("1", "random seed of the packing"),
    "mu_s": ("1", "interparticle friction"),
    "G_p": ("Pa", "particle shear modulus"),
}  # fmt: skip
#: Columns of the table of runs that are no quantity of analysis/quantities.py -> unit and meaning.
RUN_COLUMNS = {
    "run_id": ("", "stage, main values and hash of all that the run uses"),
    "stage": ("", "consolidate, probe or shear"),
    "status": ("", "done, failed, or spared (not needed)"),
    "reason": ("", "why the run ended or failed"),
    "steps": ("1", "time steps"),
    "cpu_seconds": ("s", "CPU time"),
    "wall_seconds": ("s", "elapsed time since the last start"),
    "particle_steps_per_cpu_second": ("1/s", "spheres times steps over CPU time"),
    "max_inertial_number": ("1", "largest inertial number"),
    "servo_mean_error": ("1", "largest error of a window mean of what is held: lateral stress, p' or volume"),
    "servo_max_error": ("1", "largest error of a single sample of what is held"),
    "path": ("", "what the test holds: drained (sigma_3), constant_p, undrained (volume)"),
    "direction": ("", "compression or extension"),
    "end_strain": ("1", "axial strain at which an undrained test liquefied or became stiff"),
    "energy_error": ("1", "error of the energy balance over the boundary work"),
    "inertial_number": ("1", "inertial number that was set"),
    "strain_end": ("1", "final axial strain that was set"),
    "timestep_factor": ("1", "time step over the contact-stiffness time step, as set"),
    "step_factor": ("1", "the same, as used"),
    "stiffness_scale": ("1", "factor on G_p"),
    "damping": ("1", "local damping coefficient"),
    "probe_asymmetry": ("1", "relative difference of G_0 in two opposite directions"),
    "probe_pushed": ("1", "contacts that the probe opened or closed"),
    "probe_off": ("1", "relative difference of G_0 between probe and static network"),
    "critical_from": ("1", "axial strain at which the critical part begins"),
    "critical_drift_eta": ("1", "relative change of the stress ratio over the critical part"),
    "critical_drift_p": ("1", "relative change of p' over the critical part"),
    "critical_drift_e": ("1", "relative change of the void ratio over the critical part"),
    "created": ("", "when the product was written (UTC)"),
    "yade_version": ("", "version of YADE; of LAMMPS where it begins with LAMMPS"),
    "script_digest": ("", "sha256 of the scripts in yade_scripts/ or campaign/lammps/"),
    "unsteady": ("", "why the critical state is not proven to be steady; empty if it is"),
    "resumed": ("1", "how often the run was continued from a checkpoint"),
    "axes_off_diagonal": ("1", "largest off-diagonal stress over sigma_1"),
    "axes_eta_windows": ("1", "eta of the principal stresses over eta of the axes, minus one, mean over the windows"),
    "axes_eta_mean": ("1", "the same for the mean stress tensor"),
    "measured_by": ("", "version of the analysis code that measured an archived run; empty: the present one"),
}
#: Digits of a PDF; all other numbers have all their digits.
PDF_DIGITS = "%.10g"


def export_tables(results: Results) -> dict[str, Callable[[], pd.DataFrame]]:
    """Table name -> function that makes it, so that only one of the long tables is in memory at a time."""
    tables: dict[str, Callable[[], pd.DataFrame]] = {
        "points": lambda: _points(results),
        "runs": lambda: results.runs,
        "states": lambda: pd.concat(_states(results), ignore_index=True),
        "responses": lambda: pd.concat(_responses(results), ignore_index=True),
        "pdfs": lambda: pd.concat(_pdfs(results), ignore_index=True),
        **({"ends": lambda: pd.concat(_ends(results), ignore_index=True)} if results.loading.is_undrained else {}),
        "pairs": lambda: pd.DataFrame(results.pairs, columns=_inputs(results)[: results.pairs.shape[1]]),
        "quantities": lambda: _quantities(results),
    }
    return tables | {"columns": lambda: _columns(tables)}


def write_csv_export(results: Results, folder: str | Path) -> list[Path]:
    """Write every table of the export as <folder>/<name>.csv, with all digits; returns the paths."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, make in export_tables(results).items():
        paths.append(folder / f"{name}.csv")
        with atomic_write(paths[-1]) as part:
            _write_csv(name, make(), part)
    return paths


def write_excel_export(results: Results, path: str | Path) -> dict[str, Path]:
    """Write the tables of the export as sheets of one Excel file; a table that no sheet can hold becomes a CSV file.

    Returns table -> the CSV file beside the Excel file, for the tables that are too long. Raises ResultsError if
    openpyxl is missing.
    """
    path = Path(path)
    if importlib.util.find_spec("openpyxl") is None:
        raise ResultsError(
            f"{path}: an Excel file needs openpyxl, which is not installed (Debian: python3-openpyxl); "
            "`--to FOLDER` writes CSV files"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    too_long = {}
    with atomic_write(path) as part, pd.ExcelWriter(part, engine="openpyxl") as book:
        for name, make in export_tables(results).items():
            frame = make()
            if len(frame) < SHEET_ROWS:
                without_formulas(frame).to_excel(book, sheet_name=name, index=False)
                continue
            too_long[name] = path.with_name(f"{path.stem}_{name}.csv")
            with atomic_write(too_long[name]) as csv:
                _write_csv(name, frame, csv)
    return too_long


def _write_csv(name: str, frame: pd.DataFrame, path: Path) -> None:
    without_formulas(frame).to_csv(path, index=False, float_format=PDF_DIGITS if name == "pdfs" else None)


def _densities(results: Results) -> Iterator[tuple[str, float]]:
    for family in results.families:
        for mu_iso in results.family_densities(family):
            yield family, mu_iso


def _inputs(results: Results) -> list[str]:
    """Symbols of the inputs, in the order of the columns of the points."""
    return [name for name in results.points.columns() if name not in ("id", "probability")]


def _points(results: Results) -> pd.DataFrame:
    """Points of every family: those of the second one have other inputs."""
    parts = []
    for family in results.families:
        points = results.family_points(family)
        parts.append(pd.DataFrame({"family": family, **points.columns()}))
    return pd.concat(parts, ignore_index=True)


def _states(results: Results) -> Iterator[pd.DataFrame]:
    """Values of every state that was reached; `probability` is normalised over the points with a value."""
    for family, mu_iso in _densities(results):
        points, probability = results.family_points(family), results.probability(mu_iso, family)
        packing = results.packing(mu_iso, family)
        for state in results.states:
            symbols = results.state_symbols(state, mu_iso, family)
            filled = results.filled(mu_iso, family, state) if symbols else None
            for symbol in symbols:
                values = results.shown_state(state, symbol, mu_iso, family)
                of_points = {"point": points.id, "packing": packing, "value": values}
                of_points |= {"probability": _of_known(values, probability), "filled": np.asarray(filled, int)}
                standing = results.standing(state, mu_iso, family).status
                head = {"family": family, "mu_iso": mu_iso, "state": state, "standing": standing, "quantity": symbol}
                yield pd.DataFrame(head | of_points)


def _responses(results: Results) -> Iterator[pd.DataFrame]:
    for family, mu_iso in _densities(results):
        ids = results.family_points(family).id
        for symbol in results.symbols(mu_iso, family):
            response = results.response(symbol, mu_iso, family)
            count, width = response.values.shape
            probability = np.stack([_of_known(values, response.probability) for values in response.values])
            yield pd.DataFrame({
                "family": family, "mu_iso": mu_iso, "quantity": symbol, "strain": np.repeat(response.strain, width),
                "point": np.tile(ids, count), "value": response.values.ravel(), "probability": probability.ravel(),
                "continued": response.extended.astype(int).ravel(),
            })  # fmt: skip


def _ends(results: Results) -> Iterator[pd.DataFrame]:
    """Every point of an undrained campaign: how and at which strain its test ended early, if it did."""
    for family, mu_iso in _densities(results):
        ids, probability = results.family_points(family).id, results.probability(mu_iso, family)
        frame = pd.DataFrame({"family": family, "mu_iso": mu_iso, "point": ids, "probability": probability,
                              "packing": results.packing(mu_iso, family), "end": "", "strain": np.nan})  # fmt: skip
        for kind in EARLY_ENDS:
            ended = results.ended(kind, mu_iso, family)
            place = np.searchsorted(ids, ended.point)
            frame.loc[place, "end"], frame.loc[place, "strain"] = kind, ended.at
        yield frame


def _pdfs(results: Results) -> Iterator[pd.DataFrame]:
    for family, mu_iso in _densities(results):
        for symbol in results.symbols(mu_iso, family):
            pdf = results.response(symbol, mu_iso, family).pdf
            x = np.broadcast_to(pdf.x, pdf.p.shape)
            yield pd.DataFrame({
                "family": family, "mu_iso": mu_iso, "quantity": symbol, "strain": np.repeat(pdf.strain, x.shape[1]),
                "x": x.ravel(), "pdf": pdf.p.ravel(),
            })  # fmt: skip


def _of_known(values: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Probabilities (Q,) of the points that have a value, of sum 1; zero for the others."""
    known = np.where(np.isfinite(values), probability, 0.0)
    return known / known.sum() if known.sum() > 0 else known


def _quantities(results: Results) -> pd.DataFrame:
    """Every symbol of the other tables with its unit, and the unit in which figures and reports show it."""
    symbols: dict[str, None] = dict.fromkeys(_inputs(results))
    for family, mu_iso in _densities(results):
        symbols |= dict.fromkeys(results.symbols(mu_iso, family))
        symbols |= {s: None for state in results.states for s in results.state_symbols(state, mu_iso, family)}
    rows: list[dict[str, Any]] = []
    for symbol in symbols:
        of = QUANTITIES[symbol]
        rows.append({"quantity": symbol, "name": of.name, "unit": of.unit, "meaning": of.meaning,
                     "shown_unit": of.shown_unit or of.unit, "shown_value_over_value": of.shown_factor})  # fmt: skip
    return pd.DataFrame(rows)


def _columns(tables: dict[str, Callable[[], pd.DataFrame]]) -> pd.DataFrame:
    """Every column of the tables that have values, with its unit and meaning."""
    rows = []
    heads = {"states": ["family", "mu_iso", "state", "standing", "quantity", "point", "packing", "value", "probability",
                        "filled"],
             "responses": ["family", "mu_iso", "quantity", "strain", "point", "value", "probability", "continued"],
             "pdfs": ["family", "mu_iso", "quantity", "strain", "x", "pdf"],
             "ends": ["family", "mu_iso", "point", "probability", "packing", "end", "strain"]}  # fmt: skip
    heads = {name: columns for name, columns in heads.items() if name in tables}
    heads |= {name: tables[name]().columns.tolist() for name in ("points", "pairs", "runs")}
    for name, columns in heads.items():
        for column in columns:
            unit, meaning = COLUMNS.get(column) or _of_run(column)
            rows.append({"file": f"{name}.csv", "column": column, "unit": unit, "meaning": meaning})
    return pd.DataFrame(rows)


def _of_run(column: str) -> tuple[str, str]:
    """Unit and meaning of a column of the table of runs."""
    if column in QUANTITIES:
        return QUANTITIES[column].unit, QUANTITIES[column].meaning
    return RUN_COLUMNS.get(column, ("", "see data/README.md"))
