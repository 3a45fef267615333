"""Tables: `Results` to `DataFrame`, one function per table; `evaluate` computes all of them once.

Rule: anything of `analysis` except figures and report; no HTML, no matplotlib.
"""

from .registry import REPORT_TABLES, TABLES, evaluate, write_tables

__all__ = ["REPORT_TABLES", "TABLES", "evaluate", "write_tables"]
