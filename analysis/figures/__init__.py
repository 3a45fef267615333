"""All figures of a campaign, from its results and frames; 2 to 15 are named after the paper's, 17 to 19 are those of
undrained tests.

Rule: `Results` and frames to matplotlib figures, without pyplot; no table is computed here.  `panels` are parts that
figures share, `plots` the single plots for a script or a notebook.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ..results.reader import Results, read_results
from . import (
    critical_line,
    friction,
    input_grid,
    inputs,
    joint,
    stiffness,
    stress_ratio,
    style,
    undrained,
    void_ratio_fabric,
)

Frames = Mapping[str, pd.DataFrame]
Draw = Callable[[Results, Frames], Figure]


def _of_results(draw: Callable[[Results], Figure]) -> Draw:
    return lambda results, frames: draw(results)


def _of_pairs(pairs: Callable[[Results], Figure], other: Callable[[Results], Figure]) -> Draw:
    """The first figure for measured pairs of mu_s and G_p, the second for other inputs."""
    usual = inputs.PAIR
    return lambda results, frames: (pairs if results.points.names == usual and len(results.pairs) else other)(results)


#: File name without ending -> drawing function of the open results and the frames.
FIGURES: dict[str, Draw] = {
    "fig02_data_marginals": _of_pairs(inputs.data_marginals, input_grid.marginals_and_pairs),
    "fig03_joint_points": _of_pairs(inputs.joint_points, input_grid.points),
    "fig04_grading": _of_results(inputs.grading_curve),
    "fig05_stress_ratio": _of_results(stress_ratio.stress_ratio),
    "fig06_stress_ratio_surfaces": _of_results(stress_ratio.surfaces),
    "fig07_peak_critical": _of_results(stress_ratio.peak_and_critical),
    "fig08_void_ratio": _of_results(void_ratio_fabric.void_ratio),
    "fig09_mechanical_void_ratio": _of_results(void_ratio_fabric.mechanical_void_ratio),
    "fig10_coordination": _of_results(void_ratio_fabric.coordination),
    "fig11_mechanical_coordination": _of_results(void_ratio_fabric.mechanical_coordination),
    "fig12_fabric": _of_results(void_ratio_fabric.fabric),
    "fig13_stiffness_dilatancy": _of_results(stiffness.stiffness_dilatancy),
    "fig14_joint_eta_e": _of_results(joint.eta_void_ratios),
    "fig15_joint_eta_Z": _of_results(joint.eta_coordination),
    "fig16_friction": lambda results, frames: friction.along(results, frames["friction_curves"]),
    "fig17_stress_path": _of_results(undrained.stress_path),
    "fig18_pore_pressure": _of_results(undrained.pore_pressure),
    "fig19_critical_line": lambda results, frames: critical_line.critical_line(
        frames["critical_points"], frames["critical_lines"]
    ),
}
#: Figures of undrained tests only, and figures that these do not have, because the volume is held.
UNDRAINED, NOT_UNDRAINED = ("fig17_stress_path", "fig18_pore_pressure", "fig19_critical_line"), ("fig08_void_ratio",)


def drawn(results: Results) -> list[str]:
    """Names of the figures of a campaign: those of its test that have something to show.

    The one along friction needs random friction, and the joint PDFs need critical states that are not withheld.
    """
    left_out = {*(NOT_UNDRAINED if results.loading.is_undrained else UNDRAINED)}
    probability = results.pooled("critical", ("eta", "e"), results.family_densities())[-1]
    if np.count_nonzero(probability > 0) < 2:
        left_out |= {"fig14_joint_eta_e", "fig15_joint_eta_Z"}
    if "mu_s" not in results.points.names:
        left_out.add("fig16_friction")
    return [name for name in FIGURES if name not in left_out]


def write_figures(
    results: str | Path | Results, frames: Frames, folder: str | Path, names: Iterable[str] | None = None
) -> list[Path]:
    """Draw the named figures (by default those of `drawn`) into a folder; returns the PNG paths.

    frames: as `evaluate` returns them.  A PNG stays below 300 kB, and its text chunk "Source" names the results it was
    drawn from.  Raises KeyError for a name that is no figure, ResultsError for results that lack it.
    """
    results = read_results(results)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return [style.save(FIGURES[name](results, frames), folder / f"{name}.png", _source(results))
            for name in names or drawn(results)]  # fmt: skip


def write_print_figures(
    results: str | Path | Results,
    frames: Frames,
    folder: str | Path,
    file_format: str = "pdf",
    columns: int = 2,
    dpi: int = 600,
    names: Iterable[str] | None = None,
) -> list[Path]:
    """Draw the named figures (by default those of `drawn`) for print into a folder; returns the paths.

    file_format: "pdf", "svg" or "png".  columns: 1 or 2 columns of a journal, 88 or 180 mm.  dpi: dots per inch of a
    PNG, and of the surfaces in a PDF or an SVG.  Raises as `write_figures`.
    """
    results = read_results(results)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name in names or drawn(results):
        with style.one_column(columns == 1):
            figure = FIGURES[name](results, frames)
        paths.append(style.save_print(figure, folder / f"{name}.{file_format}", columns, dpi, _source(results)))
    return paths


def _source(results: Results) -> str:
    return f"{results.attrs['campaign']}: results.h5 of {results.attrs['created']}, {len(results.runs)} runs"
