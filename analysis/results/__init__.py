"""results.h5: the reader, the builder, the peaks that are pooled over the points, and the standing of states.

Rule: the reader stands on h5py, pandas, `pdem.weighted`, `pdem.pdf` and the points' value only; the builder stands on
`runs`, `points` and `surrogates`.  No table, no figure.  Only the reader's names are re-exported, so that reading a
file loads nothing of the runs.
"""

from .reader import STATES, Response, Results, ResultsError, read_results

__all__ = ["STATES", "Response", "Results", "ResultsError", "read_results"]
