"""Benchmarks that lie beside a results.h5: the same points at other sizes and rates, and with other grains."""

from __future__ import annotations

import pandas as pd

from ..results.reader import Results


def fidelity(results: Results) -> pd.DataFrame:
    """Bias and scatter of the campaign's setting against each rung of the fidelity ladder; empty without the file."""
    return _beside(results, "fidelity")


def beyond(results: Results) -> pd.DataFrame:
    """Differences of other gradings and of grains with properties of their own; empty without the file."""
    return _beside(results, "beyond")


def _beside(results: Results, name: str) -> pd.DataFrame:
    path = results.path.parent / f"{name}.csv"
    return pd.read_csv(path) if path.exists() else pd.DataFrame()
