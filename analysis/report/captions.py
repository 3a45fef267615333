"""Captions of the figures, in the order of the page.  "@figure:fig05@" becomes the number of that figure there."""

from __future__ import annotations

from ..results.reader import Results
from . import input_words

CAPTIONS = {
    "fig05": "Stress ratio. Upper panels: PDFs along axial strain; a line is the mean. Lower panels: means with two "
    "standard deviations to either side, and PDFs at the peak and at the critical state. Ticks below an axis are the "
    "points. A thick line is the denoised PDF of a state, without the noise of packings and single runs; a thin line "
    "is the PDF as simulated, where the two differ visibly. PDFs along strain are as simulated.",
    "fig06": "PDF surfaces of the stress ratio; the densest one also in plan. A surface begins where the PDFs of "
    "neighbouring strains overlap. Values above the scale are cut off.",
    "fig07": "Peak (triangles) and critical state (circles, on the right) of every point: stress ratio and void ratio. "
    "The strain of a peak comes from curves that are pooled over all points of a density; its value is that of the "
    "point's own run. The strain jumps where the pooled curve has two maxima. Loose samples have hardly any peak.",
    "fig08": "Void ratio: PDFs along axial strain, at the peak and at the critical state, and as surfaces. Values "
    "above the scale of a surface are cut off.",
    "fig09": "Mechanical void ratio: grains with fewer than two contacts count as voids. Panels as in @figure:fig08@.",
    "fig10": "Coordination number. Panels as in @figure:fig08@.",
    "fig11": "Mechanical coordination number: grains with fewer than two contacts are not counted. Panels as in "
    "@figure:fig08@.",
    "fig12": "Fabric anisotropy: major minus minor principal value of the fabric tensor. Panels as in @figure:fig08@.",
    "fig13": "Small-strain stiffness and dilatancy at the peak: PDFs on the left, and every point against the grain "
    "property on which it depends most on the right. If the friction of a point is below that of its consolidation, "
    "the packing loses contacts and densifies before the probe; such points lie above the others.",
    "fig14": "Joint PDFs of the critical stress ratio with the void ratio and with the mechanical void ratio. Kernels "
    "make a joint PDF wider than its points; the correlation is that of the points.",
    "fig15": "Joint PDFs of the critical stress ratio with the coordination number and with the mechanical "
    "coordination number.",
    "fig16": "Peak and critical state against interparticle friction. Symbols are the points. Lines are the model of "
    "all runs with its 95 % band, at the shear modulus that goes with each friction.",
    "fig02": "(a) Pairs of interparticle friction and particle shear modulus; (b, c) their histograms with the fitted "
    "PDFs, smallest AIC first.",
    "fig03": "Joint PDF of the two grain properties, and the representative points. (a, b) Joint PDF as a surface and "
    "as contours with the pairs; (c) the points, with an area in proportion to their probability; (d) twice as many "
    "points; (e) the distribution functions of the points and the exact ones.",
    "fig04": "Grading of the assembly, the same in all runs.",
    "fig17": "Effective stress paths, on logarithmic axes. Thin lines are the points; the darker the contours, the "
    "more probability passes there, per decade of either stress. Triangles: phase transformation; circles: critical "
    "state; crosses and squares: last value of a test that liquefied or became stiff. Red lines: mean stress ratio at "
    "the critical state and at phase transformation.",
    "fig18": "(a) Excess pore pressure over the stress at the start: PDFs along strain. (b) Mean effective stress. "
    "Both are those of the tests that go on; a curve jumps where tests end. (c) Probability that a test has ended by "
    "then, with its 95 % interval.",
    "fig19": "Critical states of all points: void ratio against mean effective stress with the fitted line and its "
    "scatter, which contains the effect of the grain properties, and the stress ratio. A line is there where the mean "
    "effective stress varies enough.",
}
#: Captions of undrained tests that differ.
UNDRAINED = {
    "fig07": "Peak (triangles) and critical state (circles, on the right) of every point: stress ratio and mean "
    "effective stress. The strain of a peak comes from curves that are pooled over the points of a density, and in a "
    "test that ended early from its own curve. Lines are means of the tests that go on; they jump where tests end.",
    "fig09": "Mechanical void ratio: PDFs along axial strain of the tests that go on, PDFs at the peak and at the "
    "critical state, and surfaces. Grains with fewer than two contacts count as voids. Values above the scale of a "
    "surface are cut off.",
    "fig10": "Coordination number. Panels as in @figure:fig09@.",
    "fig11": "Mechanical coordination number: grains with fewer than two contacts are not counted. Panels as in "
    "@figure:fig09@.",
    "fig12": "Fabric anisotropy: major minus minor principal value of the fabric tensor. Panels as in @figure:fig09@.",
    "fig13": "Small-strain stiffness: PDFs on the left, and every point on the right.",
    "fig14": "Joint PDFs of the critical stress ratio with the mean effective stress and with the mechanical void "
    "ratio. Kernels make a joint PDF wider than its points; the correlation is that of the points.",
    "fig16": "Phase transformation, peak and critical state against interparticle friction. Symbols are the points "
    "that reached the state. Lines are the model of their runs with its 95 % band.",
}
GOING_ON = " PDFs along strain are those of the tests that go on."
#: Figures that the paper has, too, under the number in their name; the others are this project's.
IN_THE_PAPER = {f"fig{number:02d}" for number in range(2, 16)}
#: What the paper reads off its figure.
THE_PAPER = {
    "fig05": "Dense peaks range from 0.6 to 1.2 there, loose ones from 0.5 to 0.9, critical states from 0.5 to 0.8.",
    "fig08": "Densities differ at the peak and coincide at the critical state there.",
    "fig10": "All values lie between 3.3 and 5.5 there, and do not depend on the density.",
}
#: Figures that show the pairs.
WITH_PAIRS = ("fig02", "fig03")


def caption(results: Results, name: str, is_papers_test: bool) -> str:
    """The caption of a figure, with the source of the pairs, and the figure of the paper if its test was repeated."""
    undrained = results.loading.is_undrained
    text = (UNDRAINED.get(name) if undrained else "") or input_words.caption_of_inputs(results, name) or CAPTIONS[name]
    if name == "fig05":
        text += input_words.band_note(results) + GOING_ON * undrained
    if name in WITH_PAIRS and len(results.pairs):
        text += f" Pairs: {results.inputs.get('source') or 'without a name'}."
    if is_papers_test and name in IN_THE_PAPER:
        text += " ".join([f" (Figure {int(name[3:])} of the paper.)", *filter(None, [THE_PAPER.get(name)])])
    return text
