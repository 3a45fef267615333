"""Probability density evolution (PDEM): the PDF of a response from its values at points that carry probabilities.

`evolve` gives the PDF along strain, `state_pdf` that of a single state, `joint_pdf.joint_pdf` that of two responses;
`weighted` holds the statistics of the points themselves, `tails` their exceedance probabilities and quantiles with
intervals, `bands` the bands of PDFs that come from the number of pairs.
Rule: numpy, scipy, `quantities` and `errors_and_files` only; no file and no pandas.  `weighted`, `tails` and `pdf` need
numpy alone; what needs scipy is imported on first use, so that a reader of results does not load it.
"""

import importlib
import warnings
from typing import Any

from ..errors_and_files import lazy_names
from . import weighted
from .pdf import PDF

_HOMES = {
    "JointPDF": ".joint_pdf",
    "PdemError": ".pdf",
    "evolve": ".evolution",
    "kernel_width": ".widths",
    "state_pdf": ".evolution",
}
#: Names of the version before, for one version: old name -> module and new name.
_DEPRECATED = {"state_density": (".evolution", "state_pdf")}
__all__ = ["PDF", "JointPDF", "PdemError", "evolve", "kernel_width", "state_pdf", "weighted"]

_load, __dir__ = lazy_names(__name__, _HOMES)


def __getattr__(name: str) -> Any:
    if name not in _DEPRECATED:
        return _load(name)
    module, new_name = _DEPRECATED[name]
    warnings.warn(f"{__name__}.{name} is now {__name__}{module}.{new_name}", DeprecationWarning, stacklevel=2)
    return getattr(importlib.import_module(module, __name__), new_name)
