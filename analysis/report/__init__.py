"""The report: one self-contained HTML page from results, frames and figures.

Rule: frames and words; nothing is computed here but the text of a number.
"""

from .sections import write_report

__all__ = ["write_report"]
