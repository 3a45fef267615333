"""Checks of the runs in the report: axes of stress and Rowe's ratio, against closed forms."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from analysis.quantities import DRAINED
from analysis.runs.peak_critical import off_axis, principal_stress_ratio
from analysis.tables.run_quality import rowe


def rotated(sigma_1: float, sigma_3: float, angle: float) -> np.ndarray:
    """Axially symmetric stress whose major axis is inclined by `angle` against z, in the plane of y and z."""
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    return turn @ np.diag([sigma_3, sigma_3, sigma_1]) @ turn.T


def test_the_principal_stress_ratio_does_not_depend_on_the_axes():
    tensors = np.array([rotated(300e3, 100e3, angle) for angle in (0.0, 0.05, 0.3)])
    assert principal_stress_ratio(tensors) == pytest.approx(1.2, rel=1e-12)


def test_off_axis_is_that_of_an_inclined_stress():
    angle = 0.05
    found = off_axis(np.array([rotated(300e3, 100e3, angle)] * 3))
    q = 200e3 * (np.cos(angle) ** 2 - 0.5 * np.sin(angle) ** 2)  # sigma_zz less the mean of the lateral stresses
    assert found["off_diagonal"] == pytest.approx(200e3 * np.sin(angle) * np.cos(angle) / 300e3, rel=1e-9)
    assert found["eta_windows"] == pytest.approx(200e3 / q - 1.0, rel=1e-9)
    assert found["eta_mean"] == pytest.approx(200e3 / q - 1.0, rel=1e-9)


def test_fluctuating_axes_cancel_in_the_mean_tensor():
    found = off_axis(np.array([rotated(300e3, 100e3, angle) for angle in (-0.05, 0.05)]))
    assert found["eta_windows"] > 1e-3
    assert found["eta_mean"] == pytest.approx(0.0, abs=1e-12)


def test_rowes_ratio_is_the_one_that_the_states_were_made_with():
    wanted, D, critical = np.array([1.0, 0.9, 0.8]), np.array([0.1, 0.3, 0.5]), np.array([0.5, 0.6, 0.7])
    strength = wanted * (1 + D) * (3 + 2 * critical) / (3 - critical)  # (sigma_1 / sigma_3) at the peak
    states = {("peak", "eta"): 3 * (strength - 1) / (strength + 2), ("peak", "D_p"): D / (1 + D / 3)}
    states["critical", "eta"] = critical
    results = SimpleNamespace(
        family_densities=lambda: (0.04,),
        state_symbols=lambda state, mu_iso: ("eta", "D_p"),
        shown_state=lambda state, symbol, mu_iso: states[state, symbol],
        probability=lambda mu_iso: np.array([0.5, 0.25, 0.25]),
        loading=DRAINED,
    )
    row = rowe(results).iloc[0]
    assert row["ratio"] == pytest.approx(0.925) and row["dilatancy"] == pytest.approx(0.25)
    assert (row["lowest"], row["highest"], row["points"]) == pytest.approx((0.8, 1.0, 3))
