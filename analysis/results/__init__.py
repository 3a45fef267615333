"""results.h5: the reader, what it reads (`tables_of_file`) and returns (`values`), and the builder; pooled peaks, the
standing of states, the models of all runs of a density (`models`) and the numbers to quote (`quote`).

Rule: the reader stands on h5py, pandas, `pdem.weighted`, `pdem.pdf` and the points' value only, and imports the rest
when it is asked for; `models` and `quote` stand on `inputs` and `surrogates`, the builder on `runs`, `points` and
`surrogates`.  No table of the campaign, no figure.  Only the reader's names are re-exported, so that reading a
file loads nothing of the runs.
"""

from .reader import STATES, Response, Results, ResultsError, read_results

__all__ = ["STATES", "Response", "Results", "ResultsError", "read_results"]
