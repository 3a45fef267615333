"""All figures of a campaign, each drawn from results.h5 alone; 2 to 15 are named after the paper's."""

from __future__ import annotations

from pathlib import Path

from analysis.figures import behaviour, friction, inputs, joint, stiffness, stress_ratio, style
from analysis.results import read_results

#: File name without ending -> drawing function of the open results.
FIGURES = {
    "fig02_data_marginals": inputs.data_marginals,
    "fig03_joint_points": inputs.joint_points,
    "fig04_grading": inputs.grading_curve,
    "fig05_stress_ratio": stress_ratio.stress_ratio,
    "fig06_stress_ratio_surfaces": stress_ratio.surfaces,
    "fig07_peak_critical": stress_ratio.peak_and_critical,
    "fig08_void_ratio": behaviour.void_ratio,
    "fig09_mechanical_void_ratio": behaviour.mechanical_void_ratio,
    "fig10_coordination": behaviour.coordination,
    "fig11_mechanical_coordination": behaviour.mechanical_coordination,
    "fig12_fabric": behaviour.fabric,
    "fig13_stiffness_dilatancy": stiffness.stiffness_dilatancy,
    "fig14_joint_eta_e": joint.eta_void_ratios,
    "fig15_joint_eta_Z": joint.eta_coordination,
    "fig16_friction": friction.along,
}


def write_figures(results, folder, names=None) -> list[Path]:
    """Draw the named figures (all by default) from results (a path or open) into a folder; returns the PNG paths.

    A PNG stays below 300 kB, and its text chunk "Source" names the results it was drawn from.  Raises KeyError for a
    name that is no figure, ResultsError for results that lack it.
    """
    results = read_results(results)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    source = f"{results.attrs['campaign']}: results.h5 of {results.attrs['created']}, {len(results.runs)} runs"
    return [style.save(FIGURES[name](results), folder / f"{name}.png", source) for name in names or FIGURES]
