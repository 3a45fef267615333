"""The record of a shear run from its samples and lists of contacts: means of strain windows, as in YADE.

LAMMPS does not count the work of friction.  `E_friction` is therefore not given, and `E_residual` is what the balance
leaves for it: boundary work less the change of elastic and kinetic energy.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from types import SimpleNamespace

import numpy as np

from analysis.micromechanics.metrics import sliding_fraction, sphere_volume
from campaign.lammps.outputs import centred, fabric, mean_stress, stress

#: Symbols of the record without values, and the reason.
NOT_GIVEN = {"E_friction": "LAMMPS does not count the work of friction; E_residual is what the balance leaves for it"}


def energies(contacts: np.ndarray, radius: np.ndarray, p: SimpleNamespace, G: float) -> float:
    """Energy (J) in the springs of contacts (C, 4) between grains of radius (N,) m and shear modulus G (Pa).

    Hertz' law gives the overlap from the normal force,
    f_n = 4/3 G / (1 - nu) sqrt(r_1 r_2 / (r_1 + r_2)) overlap^(3/2).
    """
    contacts = contacts[contacts[:, 2] > 0.0]
    ids = contacts[:, :2].astype(int) - 1
    f_n, f_t = contacts[:, 2:].T
    root = np.sqrt(radius[ids].prod(axis=1) / radius[ids].sum(axis=1))
    overlap = (0.75 * f_n * (1.0 - p.nu) / (G * root)) ** (2.0 / 3.0)
    k_t = 4.0 * G / (2.0 - p.nu) * root * np.sqrt(overlap)
    return float((0.4 * f_n * overlap + f_t**2 / (2.0 * k_t)).sum())


def along_contacts(
    lists: Iterable[tuple[int, np.ndarray]], radius: np.ndarray, p: SimpleNamespace, G: float
) -> dict[str, np.ndarray]:
    """step, elastic energy (J), share of sliding contacts, mean normal force (N) and number of each list, each (L,)."""
    rows = []
    for step, contacts in lists:
        sliding = sliding_fraction(contacts[:, 2:3], contacts[:, 3:4], p.mu_s)
        rows.append((step, energies(contacts, radius, p, G), sliding, contacts[:, 2].mean(), len(contacts)))
    return dict(zip(("step", "E_elastic", "f_sliding", "mean_f_n", "count"), np.array(rows, float).T, strict=True))


def windows_of(strain: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Window (T,) of each sample: 0 is the state before shear; a window closes with the first sample at its edge."""
    window, k = np.zeros(len(strain), int), 0
    for i in range(1, len(strain)):
        window[i] = k + 1
        if k < len(edges) - 1 and strain[i] >= edges[k]:
            k += 1
    return window


def record(
    p: SimpleNamespace, samples: dict, contacts: dict, radius: np.ndarray, edges: np.ndarray
) -> dict[str, np.ndarray]:
    """Every quantity of the record (W, ...), and `E_residual`; samples (T,), contacts (L,), radius (N,) m."""
    every = _sampled(p, samples, radius)
    window = windows_of(every["eps_a"], edges)
    count = np.bincount(window)
    last = np.cumsum(count) - 1
    out = {symbol: _means(values, window, count) for symbol, values in every.items()}
    step = samples["step"]
    out["servo_mean"] = out.pop("servo")
    single = 0.5 * (samples["sigma_xx"] + samples["sigma_yy"]) / p.sigma_3 - 1.0
    out["servo_max"] = np.maximum.reduceat(np.abs(single), np.cumsum(count) - count)
    middle = _means(step, window, count)
    mean_f_n, out["f_sliding"] = (np.interp(middle, contacts["step"], contacts[k]) for k in ("mean_f_n", "f_sliding"))
    out["F_unb"] = _means(samples["resultant"], window, count) / mean_f_n
    elastic = np.interp(step, contacts["step"], contacts["E_elastic"])
    work = _work(samples, mean_stress(samples))
    kinetic = every["E_kinetic"]
    out["E_elastic"], out["W_boundary"] = elastic[last], work[last]
    out["E_damping"] = np.zeros(len(count))
    out["E_friction"] = np.full(len(count), math.nan)
    out["E_residual"] = (work - (elastic - elastic[0]) - (kinetic - kinetic[0]))[last]
    return out


def _means(values: np.ndarray, window: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Means (W, ...) of values (T, ...) over the windows."""
    sums = np.zeros((len(count), *values.shape[1:]))
    np.add.at(sums, window, values)
    return sums / count.reshape(-1, *[1] * (values.ndim - 1))


def _sampled(p: SimpleNamespace, samples: dict, radius: np.ndarray) -> dict[str, np.ndarray]:
    """The sampled quantities (T, ...) of the record."""
    sigma, N = centred(mean_stress(samples)), len(radius)
    cell = np.stack([samples[f"length_{a}"] for a in "xyz"], axis=1)
    volume, solid = cell.prod(axis=1), float(sphere_volume(radius).sum())
    pressure = np.trace(sigma, axis1=1, axis2=2) / 3.0
    with np.errstate(divide="ignore", invalid="ignore"):
        mechanical = (samples["Z"] * N - samples["single"]) / samples["active"]
        e_m = volume / samples["solid"] - 1.0
    return {
        "eps_a": samples["eps_a"],
        "eps_v": np.log(volume[0] / volume),
        "sigma": sigma,
        "cell": cell,
        "e": volume / solid - 1.0,
        "e_m": e_m,
        "Z": samples["Z"],
        "Z_m": mechanical,
        "Phi": fabric(samples),
        "I": -samples["rate_z"] * p.d50 * np.sqrt(p.rho / pressure),
        "E_kinetic": samples["kinetic"] + samples["turning"],
        "servo": 0.5 * (sigma[:, 0, 0] + sigma[:, 1, 1]) / p.sigma_3 - 1.0,
    }


def _work(samples: dict, sigma: np.ndarray) -> np.ndarray:
    """Boundary work (T,), J, since the first sample: mean stress (T, 3, 3) of each interval times its strain."""
    length = np.stack([samples[f"length_{a}"] for a in "xyz"], axis=1)
    volume = length.prod(axis=1)
    along = np.diagonal(sigma, axis1=1, axis2=2)[1:] * 0.5 * (volume[1:] + volume[:-1])[:, None]
    steps = along * np.diff(np.log(length), axis=0)
    return np.concatenate([[0.0], -np.cumsum(steps.sum(axis=1))])


def history(samples: dict, radius: np.ndarray) -> dict[str, np.ndarray]:
    """A consolidation's own record: its samples with their step numbers."""
    length = np.stack([samples[f"length_{a}"] for a in "xyz"], axis=1)
    volume, N = length.prod(axis=1), len(radius)
    with np.errstate(divide="ignore", invalid="ignore"):
        return {
            "steps": samples["step"].astype(int),
            "sigma": stress(samples),
            "e": volume / float(sphere_volume(radius).sum()) - 1.0,
            "e_m": volume / samples["solid"] - 1.0,
            "Z": samples["Z"],
            "Z_m": (samples["Z"] * N - samples["single"]) / samples["active"],
            "F_unb": samples["resultant"] / samples["mean_f_n"],
        }


def check_contacts(samples: dict, contacts: dict, N: int) -> str:
    """What is wrong with the lists of contacts ("" if nothing): their number must be that of the samples, Z N / 2."""
    at = np.searchsorted(samples["step"], contacts["step"])
    there = at < len(samples["step"])
    expected = samples["Z"][at[there]] * N / 2.0
    wrong = np.abs(expected - contacts["count"][there]) > 0.5
    if not wrong.any():
        return ""
    k = int(np.argmax(wrong))
    step, found = (contacts[name][there][k] for name in ("step", "count"))
    return f"list of contacts at step {step:.0f} has {found:.0f}, not {expected[k]:.0f}"
