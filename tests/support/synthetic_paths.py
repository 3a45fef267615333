"""Synthetic products of the other tests: constant p', undrained, extension, and undrained tests that end early.

The closed forms are those of `synthetic_results`; in extension the stress ratio is minus that of Matsuoka and Nakai.
Undrained, e keeps its value and p' follows `pressure`: it falls to a phase transformation and ends on the critical line
e = void_ratio_c(mu_s) - SLOPE ln(p' / SIGMA_3).
"""

from __future__ import annotations

import atexit
import functools
import shutil
import tempfile
from pathlib import Path

import h5py
import numpy as np
import synthetic_results as synthetic
from synthetic_results import E_0, SIGMA_3

from analysis.quantities import Loading
from analysis.results import build

SLOPE, CAP = 0.05, 1e7
#: Strain at which a test that liquefies has p' = 0.05 of its start, and up to which its record goes.
LIQUEFIED_AT, LIQUEFIED_END = 0.1025, 0.12


def eta(strain, mu_s, mu_iso, loading):
    """Stress ratio: in extension that of Matsuoka and Nakai for the one in compression."""
    ratio = synthetic.eta(strain, mu_s, mu_iso)
    return ratio if loading.sign > 0 else -3.0 * ratio / (3.0 + ratio)


def critical_pressure(mu_s, mu_iso):
    """p' (Pa) at which the void ratio after consolidation is critical."""
    return SIGMA_3 * np.exp((0.586 + 0.12 * np.log10(mu_s / 0.065) - E_0[mu_iso]) / SLOPE)


def pressure(strain, mu_s, mu_iso, end=""):
    """p' (Pa) of an undrained test, or of one that becomes stiff or liquefies."""
    if end == "stiff":
        return SIGMA_3 * np.exp(8.0 * (1.0 - np.exp(-strain / 0.06)))
    if end == "liquefied":
        return SIGMA_3 * 0.05 ** ((strain / LIQUEFIED_AT) ** 2)
    rise = np.log(critical_pressure(mu_s, mu_iso) / SIGMA_3) * (1.0 - np.exp(-strain / 0.05))
    return SIGMA_3 * np.exp(rise - 0.5 * (strain / 0.02) ** 2 * np.exp(2.0 - strain / 0.01))


def write_shear(row, loading, noise=0.0, end="", strain_end=0.4, windows=80):
    """The product of one shear run of a test, with noise on what scatters; `end`: "", "liquefied" or "stiff"."""
    rng = np.random.default_rng([int(row.point) + 1, int(row.packing), int(1000 * row.mu_iso), len(row.family)])
    strain = np.linspace(0.0, strain_end, windows + 1)
    if end == "liquefied":
        strain = strain[strain <= LIQUEFIED_END + 1e-9]
    record = synthetic._record(row, strain, noise, rng)
    ratio = eta(strain, row.mu_s, row.mu_iso, loading) * (1 + noise * rng.standard_normal(len(strain)))
    if loading.is_undrained:
        p = pressure(strain, row.mu_s, row.mu_iso, end) * np.exp(noise * rng.standard_normal(len(strain)))
        p[0] = SIGMA_3
        if end == "stiff":
            last = int(np.argmax(p > CAP)) + 1
            strain, ratio, p = strain[:last], ratio[:last], p[:last]
            record = {name: values[:last] for name, values in record.items()}
        record |= {"e": np.full(len(strain), E_0[row.mu_iso]), "eps_v": np.zeros(len(strain)),
                   "servo_mean": np.full(len(strain), 1e-12), "servo_max": np.full(len(strain), 1e-11)}  # fmt: skip
    elif loading.path == "constant_p":
        p = np.full(len(strain), SIGMA_3)
    else:
        p = SIGMA_3 / (1.0 - ratio / 3.0)
    q = ratio * p
    sigma = np.zeros((len(strain), 3, 3))
    sigma[:, [0, 1], [0, 1]] = (p - q / 3.0)[:, None]
    sigma[:, 2, 2] = p + 2.0 * q / 3.0
    record |= {"sigma": sigma, "eps_a": loading.sign * strain}
    if end == "liquefied":
        gone = strain > LIQUEFIED_AT + 0.005
        record["sigma"][gone] = 0.0
        for name in ("e_m", "I", "F_unb"):
            record[name] = np.where(gone, np.inf, record[name])
        record["Z_m"] = np.where(gone, np.nan, record["Z_m"])
    at = [0, int(np.argmin(abs(strain - 0.03))), len(strain) - 1]
    shots = [(loading.sign * strain[k], label, synthetic.snapshot(float(sigma[k, 2, 2]), float(sigma[k, 0, 0])))
             for k, label in zip(at, ("start", "strain", "end"), strict=True)]  # fmt: skip
    path = Path(row.product)
    synthetic._write_product(path, row, record, shots, exit_reason=end or "strain_end")
    with h5py.File(path, "r+") as file:
        file["parameters"].attrs.update(path=loading.path, direction=loading.direction, strain_end=strain_end,
                                        stiff_cap=CAP)  # fmt: skip
        held = {"drained": (1e-3, 8e-3), "constant_p": (1e-3, 8e-3), "undrained": (1e-12, 1e-11)}[loading.path]
        file["proofs"].attrs.update(servo_mean_error=held[0], servo_max_error=held[1])
        if end == "liquefied":
            file.attrs["liquefied_from"] = LIQUEFIED_AT


def make_campaign(
    folder, path="undrained", direction="compression", n=8, noise=0.0, packings=(1,), densities=(0.001, 0.1),
    liquefied=None, stiff=None, strain_end=0.4,
):  # fmt: skip
    """Write every product of a campaign; liquefied and stiff: mu_iso -> ids of the points that end so.

    Returns (plan, points, info), the arguments of `build_results` after the folder.
    """
    loading = Loading(path, direction)
    points = synthetic.representative_points(n)
    plan = synthetic.plan_rows(folder, points, densities, packings=packings)
    for row in plan.itertuples():
        if row.stage != "shear":
            synthetic.write_run(row, noise)
            continue
        ends = {"liquefied": liquefied or {}, "stiff": stiff or {}}
        end = next((kind for kind, of in ends.items() if row.point in of.get(row.mu_iso, ())), "")
        write_shear(row, loading, noise, end, strain_end, round(200 * strain_end))
    return plan, points, synthetic.campaign_info()


@functools.lru_cache
def example(path="undrained", direction="compression", noise=0.02, ends=True):
    """Path of the results of a campaign of twelve points in three packings, made once a session.

    With `ends`, of undrained tests the dense points 0 to 2 become stiff, and the loose points 0, 1, 2 and 9 liquefy.
    """
    folder = Path(tempfile.mkdtemp(prefix="paths-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    early = {"stiff": {0.001: (0, 1, 2)}, "liquefied": {0.1: (0, 1, 2, 9)}} if path == "undrained" and ends else {}
    made = make_campaign(folder, path, direction, 12, noise, packings=(1, 2, 3), **early)
    return build.build_results(folder, *made, cells=128)
