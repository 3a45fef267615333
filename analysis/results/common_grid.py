"""What the runs of a campaign share: the test that they make, and the strains of their responses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..errors_and_files import GrainScatterError
from ..quantities import Loading
from ..runs.states import RunStates


class ResponsesError(GrainScatterError):
    """A plan that cannot be turned into results; one line names the run or the density and the value that failed."""


def loading_of_runs(by_run: list[Any]) -> Loading:
    """The test that all shear runs made.  Raises ResponsesError where one made another test than the first."""
    shears = [(row, states) for row, states in by_run if states and row.stage == "shear"]
    first, of_first = shears[0]
    for row, states in shears:
        if states.loading != of_first.loading:
            raise ResponsesError(
                f"run {row.run_id}: is {states.loading.words}, run {first.run_id} is {of_first.loading.words}"
            )
    return of_first.loading


def strain_grid(shears: list[RunStates], runs: pd.DataFrame) -> np.ndarray:
    """The strains of the fullest run: the longest of those that have the most windows.

    Where all tests ended early, the strain that was planned is the last one: it then has no values.
    """
    if not shears:
        raise ResponsesError("no shear run has a product: there is no response to collect")
    best = max(shears, key=lambda states: (len(states.eps_a), states.eps_a[-1]))
    end = max(float(states.eps_a[-1]) for states in shears)
    if best.eps_a[-1] < end:
        best = max((s for s in shears if s.eps_a[-1] == end), key=lambda states: len(states.eps_a))
    strain = np.asarray(best.eps_a, float)
    if all(states.end for states in shears) and (planned := float(runs["strain_end"].max())) > strain[-1]:
        strain = np.append(strain, planned)
    return strain


def on_grid_of(states: RunStates, symbol: str, strain: np.ndarray, run_id: str) -> tuple[np.ndarray, np.ndarray]:
    """A run's response on the common grid, and where it is continued by its critical-state average.

    NaN from the strain on at which an undrained test liquefied or became stiff.
    """
    end = states.eps_a[-1]
    if states.end:
        before = (strain <= states.end_strain) if states.end == "stiff" else (strain < states.end_strain)
        before[0] = True
        known = np.interp(strain, states.eps_a, states.responses[symbol])
        return np.where(before, known, np.nan), np.zeros(len(strain), bool)
    beyond = strain > end + 0.5 * np.median(np.diff(states.eps_a))
    values = np.interp(strain, states.eps_a, states.responses[symbol])
    if beyond.any():
        if not states.steady_end:
            raise ResponsesError(
                f"run {run_id}: ends at eps_a = {end:.4g} before the campaign's {strain[-1]:.4g} and is not steady"
            )
        values[beyond] = states.states["critical"][symbol]
    return values, beyond
