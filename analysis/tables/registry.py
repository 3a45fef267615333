"""All tables of a campaign: computed once from the results, then written and shown.

    frames = evaluate(results)
    write_tables(frames, folder)
    write_report(results, frames, folder)

Numbers are in the units that a person reads; every average uses the points' probabilities.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from ..errors_and_files import atomic_write
from ..results.reader import Results, ResultsError, read_results
from .claims import claims_table
from .critical_line import lines_of_one, of_one
from .ends import ends, ends_along
from .friction import density_differences, friction_curves, friction_table
from .friction_angles import friction_angle_table
from .inputs import copulas, marginals, points
from .moments import moments
from .monte_carlo import monte_carlo_along, monte_carlo_check
from .other_runs import beyond, fidelity
from .published import beside_published
from .report_facts import report_facts
from .run_quality import (
    archived_runs,
    losses,
    noise,
    packing_collapse,
    packing_design,
    pdf_widths,
    peak_estimates,
    probe_checks,
    proofs,
    rowe,
    run_counts,
    runs,
    standings,
    stress_axes,
)
from .states import initial_state, peak_critical, responses_moments
from .stopping_replay import stopping_replay
from .strength import extension_strength
from .variance_sources import variance_sources

Table = Callable[[Results], pd.DataFrame]
#: First characters of a cell that a spreadsheet takes for a formula.
FORMULA_BEGINS = ("=", "+", "-", "@", "\t", "\r")

#: Name of the CSV file without its ending -> function of the open results that returns the frame; the last four are
#: without columns, and not written, where the test has no such thing.
TABLES: dict[str, Table] = {
    "quote": Results.quote,
    "marginals": marginals,
    "copulas": copulas,
    "points": points,
    "initial_state": initial_state,
    "responses_moments": responses_moments,
    "peak_critical": peak_critical,
    "moments": moments,
    "claims": claims_table,
    "design": friction_angle_table,
    "friction": friction_table,
    "variance_sources": variance_sources,
    "monte_carlo": monte_carlo_check,
    "monte_carlo_along_strain": monte_carlo_along,
    "stopping_replay": stopping_replay,
    "runs": runs,
    "ends": ends,
    "ends_along_strain": ends_along,
    "extension_strength": extension_strength,
    "critical_lines": lines_of_one,
}
#: Frames that only the report and the figures show.
REPORT_TABLES: dict[str, Table] = {
    "quote": Results.quote,
    "run_counts": run_counts,
    "proofs": proofs,
    "archived_runs": archived_runs,
    "report_facts": report_facts,
    "standings": standings,
    "stress_axes": stress_axes,
    "peak_estimates": peak_estimates,
    "rowe": rowe,
    "probe_checks": probe_checks,
    "packing_design": packing_design,
    "packing_collapse": packing_collapse,
    "noise": noise,
    "pdf_widths": pdf_widths,
    "losses": losses,
    "friction_curves": friction_curves,
    "critical_points": of_one,
    "fidelity": fidelity,
    "beyond": beyond,
}


#: Frames made of another frame: name -> that frame's name and the function.
DERIVED_TABLES: dict[str, tuple[str, Callable[[pd.DataFrame], pd.DataFrame]]] = {
    "published_shear": ("friction", beside_published),
    "density_differences": ("friction", density_differences),
}


def evaluate(results: str | Path | Results, only: Iterable[str] | None = None) -> dict[str, pd.DataFrame]:
    """Compute every table of a campaign once.

    Parameters
    ----------
    results : str, Path or Results
        results.h5, or results that are already open.
    only : iterable of str, optional
        Names of the tables that are wanted; all by default.

    Returns
    -------
    dict of str to pandas.DataFrame
        Table name -> frame, in the units that a person reads.

    Raises
    ------
    ResultsError
        If the file cannot be used, or a wanted table does not exist.

    Examples
    --------
    >>> frames = evaluate("runs/demo/results.h5")
    >>> frames["points"].columns.tolist()
    ['id', 'mu_s', 'G_p_GPa', 'probability']
    >>> sorted(set(frames["peak_critical"]["state"]))
    ['critical', 'initial', 'peak', 'probe']
    """
    results = read_results(results)
    tables, derived = TABLES | REPORT_TABLES, DERIVED_TABLES
    wanted = [*tables, *derived] if only is None else [only] if isinstance(only, str) else list(only)
    if unknown := sorted(set(wanted) - {*tables, *derived}):
        raise ResultsError(f"there is no table {', '.join(unknown)}, only {', '.join([*tables, *derived])}")
    needed = {derived[name][0] if name in derived else name for name in wanted}
    frames = {name: table(results) for name, table in tables.items() if name in needed}
    return frames | {name: derived[name][1](frames[derived[name][0]]) for name in wanted if name in derived}


def write_tables(frames: Mapping[str, pd.DataFrame], folder: str | Path) -> list[Path]:
    """Write the tables as CSV files; a text that a spreadsheet would take for a formula gets a leading apostrophe.

    Parameters
    ----------
    frames : mapping of str to pandas.DataFrame
        As `evaluate` returns them.
    folder : str or Path
        The files are <folder>/tables/<name>.csv; a frame without columns, such as copulas of one variable, has none.

    Returns
    -------
    list of Path
        The files written; each is written whole or not at all.

    Examples
    --------
    >>> import tempfile, pandas as pd
    >>> paths = write_tables({"points": pd.DataFrame({"id": [0], "mu_s": [0.25]})}, tempfile.mkdtemp())
    >>> paths[0].read_text()
    'id,mu_s\\n0,0.25\\n'
    """
    if not isinstance(frames, Mapping):
        raise TypeError(f"write_tables needs the frames of evaluate(results), not a {type(frames).__name__}")
    target = Path(folder) / "tables"
    target.mkdir(parents=True, exist_ok=True)
    paths = []
    for name in TABLES:
        if name in frames and len(frames[name].columns):
            paths.append(target / f"{name}.csv")
            write_table(frames[name], paths[-1])
    return paths


def write_table(frame: pd.DataFrame, path: Path) -> None:
    """Write one table as `write_tables` does, to a path of its own."""
    with atomic_write(path) as part:
        without_formulas(frame).to_csv(part, index=False, float_format="%.6g")


def without_formulas(frame: pd.DataFrame) -> pd.DataFrame:
    """The frame with an apostrophe before each text that a spreadsheet would take for a formula."""
    texts = [name for name in frame.columns if frame[name].dtype.kind not in "biufcmM"]
    return frame.assign(**{name: frame[name].map(_no_formula) for name in texts}).rename(columns=_no_formula)


def _no_formula(cell: Any) -> Any:
    if not isinstance(cell, str) or not cell.startswith(FORMULA_BEGINS):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell
