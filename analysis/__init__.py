"""The scatter of grain properties and the behaviour of the soil: everything that needs no YADE.

    from analysis import read_results, plot_pdf_contours     # installed: from grain_scatter import ...

    results = read_results("data/laptop/results.h5")
    eta = results.response("eta", "dense")                   # eta.mean, eta.std, eta.pdf along eta.strain
    ax = plot_pdf_contours(eta)
    results.quote()                                          # the numbers to quote, with their uncertainties
    results.friction_angle("peak", "dense")                  # degrees, one per point
    results.state_pdf("critical", "eta", "dense").exceedance(0.7)
    results.joint("eta", "e", state="critical").correlation

The names below are imported when they are asked for, so that `import analysis` loads no other package:

read_results, evaluate, write_tables, write_report    a campaign's results.h5, its tables and its report
plot_pdf_contours, plot_pdf_surface, plot_mean_band, plot_state_pdfs    single plots, each with ax=None
read_run, read_snapshot, snapshot_metrics             the HDF5 file of one run
read_pairs, fit_joint, select_points, evolve          from measured pairs to points, and from values to PDFs

Packages, each with its rule in its docstring; a package uses those to its left only:
copulas, pdem, micromechanics < inputs, surrogates, runs < points < results < tables < figures < report.
`errors_and_files` (errors, files), `quantities` (names and units) and `assembly` are below all of them.
"""

from .errors_and_files import lazy_names

__version__ = "0.2.0"

_HOMES = {
    "read_results": ".results.reader",
    "evaluate": ".tables.registry",
    "write_tables": ".tables.registry",
    "write_report": ".report.sections",
    "plot_pdf_contours": ".figures.plots",
    "plot_pdf_surface": ".figures.plots",
    "plot_mean_band": ".figures.plots",
    "plot_state_pdfs": ".figures.plots",
    "read_run": ".runs.run_file",
    "read_snapshot": ".runs.run_file",
    "snapshot_metrics": ".micromechanics.metrics",
    "read_pairs": ".inputs.pairs",
    "fit_joint": ".inputs.joint",
    "select_points": ".points.selection",
    "evolve": ".pdem.evolution",
}

__all__ = [*_HOMES]

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
