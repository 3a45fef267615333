"""Product files and whole small campaigns with known answers, in the files' own format.

The responses follow closed forms (`eta`, `void_ratio`, ...) of (mu_s, G_p, mu_iso), tuned to look like a granular soil,
so every number that the analysis draws from the files can be checked.  The snapshots are a simple cubic lattice whose
Love stress is exact: contact forces f_i = sigma_ii a^2.
"""

from __future__ import annotations

import atexit
import dataclasses
import functools
import json
import shutil
import tempfile
from pathlib import Path

import h5py
import numpy as np
import pandas as pd

from analysis import copulas
from analysis.inputs import joint, marginals
from analysis.points import RepresentativePoints
from analysis.quantities import RECORD
from analysis.results import build
from analysis.surrogates.rotation import deal
from analysis.tables import evaluate

DENSITIES = (0.001, 0.04, 0.1)
SIGMA_3 = 100e3
SPACING = 2.4e-4
E_0 = {0.001: 0.54, 0.04: 0.585, 0.1: 0.62, 0.2: 0.64}
Z_0 = {0.001: 5.8, 0.04: 5.35, 0.1: 4.95, 0.2: 4.7}
HUMP = {0.001: 1.0, 0.04: 0.55, 0.1: 0.2, 0.2: 0.1}
STIFF = {0.001: 1.12, 0.04: 1.0, 0.1: 0.88, 0.2: 0.82}


def critical_eta(mu_s):
    """Critical stress ratio at interparticle friction mu_s."""
    return 0.859 * mu_s / (mu_s + 0.0593)


def eta(eps_a, mu_s, mu_iso):
    """Stress ratio with a peak near 3 % strain that fades with density."""
    rise = critical_eta(mu_s) * (1 - np.exp(-eps_a / 0.006))
    return rise + HUMP[mu_iso] * 0.55 * mu_s**0.55 * (eps_a / 0.03) * np.exp(1 - eps_a / 0.03)


def _critical_log(mu_s):
    return np.log10(mu_s / 0.065)


def void_ratio(eps_a, mu_s, mu_iso):
    """Void ratio from its initial value to 0.586 + 0.12 log10(mu_s / 0.065)."""
    target = 0.586 + 0.12 * _critical_log(mu_s)
    return E_0[mu_iso] + (target - E_0[mu_iso]) * (1 - np.exp(-((eps_a / 0.07) ** 1.5)))


def coordination(eps_a, mu_s, mu_iso):
    """Coordination number from its initial value to 5.55 - 1.6 log10(mu_s / 0.065)."""
    target = 5.55 - 1.6 * _critical_log(mu_s)
    return Z_0[mu_iso] + (target - Z_0[mu_iso]) * (1 - np.exp(-eps_a / 0.02))


def fabric(eps_a, mu_s, mu_iso):
    """Fabric anisotropy rising to 0.059 + 0.05 log10(mu_s / 0.065), over a hump in dense samples."""
    rise = (0.059 + 0.05 * _critical_log(mu_s)) * (1 - np.exp(-eps_a / 0.01))
    return rise + 0.03 * HUMP[mu_iso] * (eps_a / 0.05) * np.exp(1 - eps_a / 0.05)


def stiffness(G_p, mu_iso):
    """Small-strain stiffness, proportional to G_p^(2/3)."""
    return 169e6 * STIFF[mu_iso] * (G_p / 25.7e9) ** (2 / 3)


def representative_points(n=8, seed=1):
    """Points of lognormal mu_s and G_p with correlation -0.738 and unequal probabilities."""
    rng = np.random.default_rng(seed)
    z = rng.standard_normal((n, 2))
    z = (z - z.mean(axis=0)) / z.std(axis=0)
    z[:, 1] = -0.738 * z[:, 0] + np.sqrt(1 - 0.738**2) * z[:, 1]
    weight = 0.5 + rng.random(n)
    x = np.column_stack([0.214 * np.exp(0.469 * z[:, 0]), 25.7e9 * np.exp(0.354 * z[:, 1])])
    return RepresentativePoints(x, weight / weight.sum())


def plan_rows(folder, points, densities=DENSITIES, families=("coupled",), packings=(1,)):
    """The table of runs as the campaign writes it: one consolidation per density and packing."""
    rows = []
    dealt = [packings[r] for r in deal(points.x, len(packings))]

    def add(stage, family, point, packing, mu_iso, mu_s, G_p, start=""):
        run_id = f"{stage}_{family}_{point}_iso{mu_iso:g}_s{packing}"
        product = str(Path(folder) / "products" / f"{run_id}.h5")
        rows.append((run_id, stage, family, point, packing, mu_iso, mu_s, G_p, product, start))
        return run_id

    for mu_iso in densities:
        for packing in packings:
            first = add("consolidate", "shared", -1, packing, mu_iso, np.nan, 25.7e9)
            for family in families:
                for point in (p for p, own in zip(points, dealt, strict=True) if own == packing):
                    given = (family, point.id, packing, mu_iso, 0.25 if family == "G_p" else point.mu_s, point.G_p)
                    add("shear", *given, start=add("probe", *given, start=first))
    names = ["run_id", "stage", "family", "point", "packing", "mu_iso", "mu_s", "G_p", "product", "start"]
    return pd.DataFrame(rows, columns=names)


def snapshot(sigma_axial, sigma_lateral=SIGMA_3, cells=3):
    """A simple cubic lattice of `cells`^3 spheres carrying diag(lateral, lateral, axial) exactly, as a dict."""
    grid = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(grid)).reshape([cells] * 3)
    ids, normal = [], []
    for axis in range(3):
        ids.append(np.column_stack([number.ravel(), np.roll(number, -1, axis=axis).ravel()]))
        normal.append(np.tile(np.eye(3)[axis], (len(grid), 1)))
    normal = np.concatenate(normal)
    radius = 0.5 * SPACING * np.exp(0.174 * np.linspace(-1.7, 1.7, len(grid)))
    force = np.array([sigma_lateral, sigma_lateral, sigma_axial]) * SPACING**2
    count = len(normal)
    return {
        "position": (grid + 0.5) * SPACING, "radius": radius, "cell": np.eye(3) * cells * SPACING,
        "contact_ids": np.concatenate(ids), "normal": normal, "branch": normal * SPACING,
        "overlap": np.full(count, 1e-4 * SPACING), "f_n": normal * (normal @ force)[:, None],
        "f_t": np.zeros((count, 3)), "k_n": np.full(count, 1e6), "k_t": np.full(count, 0.9e6),
    }  # fmt: skip


def _write_product(path, row, record, snapshots, probe=None, exit_reason="strain_end"):
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        file.attrs.update(format="dem-run", format_version=1, stage=row.stage, run_id=row.run_id, complete=True,
                          exit_reason=exit_reason, failure="", resumed=0, created="2024-01-01T00:00:00",
                          yade_version="synthetic", script_digest="0" * 64)  # fmt: skip
        parameters = {name: getattr(row, name) for name in ("mu_s", "G_p", "mu_iso", "start")}
        parameters |= {"nu": getattr(row, "nu", 0.2), "rho": 2670.0, "sigma_3": SIGMA_3, "N": 27, "d50": SPACING,
                       "sigma_ln": 0.174, "seed": row.packing,
                           "inertial_number": 1e-3, "damping": 0.0, "timestep_factor": 0.8, "stiffness_scale": 1.0,
                           "density_scaling": 0.0, "strain_end": 0.4, "windows": 80}  # fmt: skip
        if exit_reason == "strain_end" and "eps_a" in record:
            parameters["strain_end"] = record["eps_a"][-1]
        file.create_group("parameters").attrs.update(parameters)
        file.create_group("timing").attrs.update(steps=1000, cpu_seconds=2.0, wall_seconds=2.5, dt_mean=1e-7,
                                                 particle_steps_per_cpu_second=1.35e4)  # fmt: skip
        file.create_group("proofs").attrs.update(max_inertial_number=1.1e-3, servo_mean_error=1e-3, F_unb=5e-4,
                                                 servo_max_error=8e-3, energy_error=2e-3,
                                                 stress_error=1e-4)  # fmt: skip
        for symbol, values in record.items():
            dataset = file.create_dataset(f"record/{symbol}", data=values)
            if symbol in RECORD:
                dataset.attrs.update(unit=RECORD[symbol].unit, name=RECORD[symbol].name)
        for k, (eps_a, label, content) in enumerate(snapshots):
            group = file.create_group(f"snapshots/{k:02d}")
            group.attrs.update(eps_a=eps_a, label=label)
            for name, values in content.items():
                group.create_dataset(name, data=values)
        if probe:
            file.create_group("probe").attrs.update(strain=1e-9, **{k: v for k, v in probe.items() if np.ndim(v) == 0})
            for name in ("d_sigma", "d_eps"):
                file["probe"].create_dataset(name, data=probe[name])


def _record(row, strain, noise, rng):
    e = void_ratio(strain, row.mu_s, row.mu_iso)
    z = coordination(strain, row.mu_s, row.mu_iso)
    scatter = 1 + noise * rng.standard_normal((3, len(strain))) + 0.5 * noise * rng.standard_normal((3, 1))
    ratio = eta(strain, row.mu_s, row.mu_iso) * scatter[0]
    anisotropy = fabric(strain, row.mu_s, row.mu_iso) * scatter[2]
    q = ratio * SIGMA_3 / (1 - ratio / 3)
    sigma = np.zeros((len(strain), 3, 3))
    sigma[:, [0, 1, 2], [0, 1, 2]] = SIGMA_3
    sigma[:, 2, 2] += q
    phi = np.zeros_like(sigma)
    phi[:, [0, 1], [0, 1]] = ((1 - anisotropy) / 3)[:, None]
    phi[:, 2, 2] = (1 + 2 * anisotropy) / 3
    z = z * (1 + 0.2 * (scatter[1] - 1))
    flat = dict.fromkeys(("f_sliding", "I", "F_unb", "E_elastic", "E_kinetic", "E_friction", "E_damping", "W_boundary",
                          "servo_mean", "servo_max"), 1e-4)  # fmt: skip
    columns = {name: np.full(len(strain), value) for name, value in flat.items()}
    volume = (1 + e) / (1 + e[0])
    edge = 3 * SPACING * np.exp(-strain)
    lateral = np.sqrt((3 * SPACING) ** 3 * volume / edge)
    return columns | {
        "eps_a": strain, "eps_v": -np.log(volume), "sigma": sigma, "cell": np.column_stack([lateral, lateral, edge]),
        "e": e, "e_m": 1.02 * e + 0.035, "Z": z, "Z_m": 0.8 * z + 1.4, "Phi": phi,
    }  # fmt: skip


def write_run(row, noise=0.0, end=0.4, windows=80, exit_reason="strain_end"):
    """Write the product of one row of the plan, with noise (relative, repeatable) on what scatters."""
    rng = np.random.default_rng([int(row.point) + 1, int(row.packing), int(1000 * row.mu_iso), len(row.family)])
    path = Path(row.product)
    if row.stage == "probe":
        g_0 = stiffness(row.G_p, row.mu_iso)
        d_eps = np.diag([-0.5e-9, -0.5e-9, 1e-9])[None]
        probe = {"G_0": g_0, "G_0_minus": g_0, "K_0": 1.03 * g_0, "d_sigma": 2 * g_0 * d_eps, "d_eps": d_eps}
        _write_product(path, row, {}, [(0.0, "start", snapshot(SIGMA_3))], probe)
    elif row.stage == "consolidate":
        e, z = E_0[row.mu_iso], Z_0[row.mu_iso]
        end = {"steps": 400.0, "e": e, "e_m": 1.02 * e + 0.035, "Z": z, "Z_m": 0.8 * z + 1.4}
        record = {symbol: np.linspace(0.9, 1.0, 5) * value for symbol, value in end.items()}
        _write_product(path, row, record, [(0.0, "end", snapshot(SIGMA_3))], exit_reason="equilibrium")
    else:
        record = _record(row, np.linspace(0, end, windows + 1), noise, rng)
        at = [0, int(np.argmin(abs(record["eps_a"] - 0.03))), windows]
        shots = [(record["eps_a"][k], label, snapshot(record["sigma"][k, 2, 2]))
                 for k, label in zip(at, ("start", "strain", "end"), strict=True)]  # fmt: skip
        _write_product(path, row, record, shots, exit_reason=exit_reason)


def fail_run(row, reason="servo error 0.08 > 0.05 at eps_a = 0.01"):
    """Leave the file of a failed run in place of its product."""
    path = Path(row.product)
    path.unlink(missing_ok=True)
    content = {"run_id": row.run_id, "reason": reason, "time": "2024-01-01T00:00:00", "log": ""}
    path.with_name(f"{row.run_id}.failed.json").write_text(json.dumps(content))


def campaign_info(pairs=94, seed=2):
    """What the campaign hands over beside its runs: fitted inputs and names."""
    x = representative_points(pairs, seed).x
    fits = [[marginals.fit(column, family, n_sim=40) for family in ("lognormal", "gamma")] for column in x.T]
    copula = copulas.fit(x[:, 0], x[:, 1], "gaussian")
    return build.CampaignInfo(
        name="synthetic",
        config='name = "synthetic"\n',
        pairs=x,
        source="synthetic pairs",
        marginals=dict(zip(("mu_s", "G_p"), fits, strict=True)),
        copulas=[copula],
        joint=joint.Joint((fits[0][0], fits[1][0]), copula.copula),
        point_attrs={"method": "synthetic", "seed": 1},
    )


@functools.lru_cache
def example(noise=0.0):
    """Path of the results of a campaign of five points and both families, made once a session."""
    folder = Path(tempfile.mkdtemp(prefix="example-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return build.build_results(folder, *make_campaign(folder, n=5, noise=noise, families=("coupled", "G_p")))


@functools.lru_cache
def small_example(packings=(1, 2, 3), densities=(0.04,), n=8):
    """Path of the results of a campaign with one family, noise and narrow PDF grids, made once a session."""
    folder = Path(tempfile.mkdtemp(prefix="small-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    made = make_campaign(folder, n, 0.02, packings=packings, densities=densities)
    return build.build_results(folder, *made, cells=64)


@functools.lru_cache
def frames(noise=0.0):
    """All tables of `example(noise)`, computed once per session."""
    return evaluate(example(noise))


def consolidated_per_point(results, packings=(1,)):
    """The results as if every point had been consolidated by itself, the first in every packing, the rest in one.

    e is 0.5 + 0.01 point + 0.1 packing, whatever the density; nothing else of the results changes.
    """
    shear = results.runs[(results.runs["stage"] == "shear") & (results.runs["family"] == "coupled")]
    parts = [shear[shear["point"] == 0].assign(packing=packing) for packing in packings[1:]]
    own = pd.concat([shear, *parts]).assign(stage="consolidate", family="shared", Z=5.0, Z_m=5.2, e_m=0.6)
    own["e"] = 0.5 + 0.01 * own["point"] + 0.1 * own["packing"]
    runs = pd.concat([own, results.runs[results.runs["stage"] != "consolidate"]], ignore_index=True)
    return dataclasses.replace(results, runs=runs)


def make_campaign(
    folder, n=8, noise=0.0, families=("coupled",), packings=(1,), steady=(), failed=(), densities=DENSITIES
):
    """Write every product of a campaign; ids in `steady` stop at 30 % strain, ids in `failed` fail in shear.

    Returns (plan, points, info), the arguments of `build_results` after the folder.
    """
    points = representative_points(n)
    plan = plan_rows(folder, points, densities, families, packings)
    for row in plan.itertuples():
        if row.stage == "shear" and row.point in steady:
            write_run(row, noise, end=0.3, windows=60, exit_reason="steady")
        else:
            write_run(row, noise)
        if row.stage == "shear" and row.point in failed:
            fail_run(row)
    return plan, points, campaign_info()
