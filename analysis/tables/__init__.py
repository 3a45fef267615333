"""Tables: `Results` to `DataFrame`, one function per table; `evaluate` computes all of them once.

Rule: anything of `analysis` except figures and report; no HTML, no matplotlib.
"""

from .registry import DERIVED_TABLES, REPORT_TABLES, TABLES, evaluate, write_tables

__all__ = ["DERIVED_TABLES", "REPORT_TABLES", "TABLES", "evaluate", "write_tables"]
