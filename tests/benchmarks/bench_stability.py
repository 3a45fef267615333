"""The stability map: what the protocol does far from where it is used, cell by cell, with a verdict on each.

    python3 tests/benchmarks/bench_stability.py            all cells that are missing (two hours; resumable)
    python3 tests/benchmarks/bench_stability.py --axis A   only those of one axis
    python3 tests/benchmarks/bench_stability.py --table    only verdicts and counts of the rows there are

The cells of the axis "path x direction" are sheared on the paths and in the directions that the others are not; on
undrained paths p' at the end of the strain is compared, too, because e says nothing there.
The cells of the axis "full strain" go on to their own last strain, which is that of the record (`strain`), and are held
against their references over the first 4 % as all others are; those that `plan` refuses for a thin cell are *refused*.

A cell is one chain consolidate -> shear to 4 % strain with one or two parameters changed.  It is held against the same
physical case with the grains' own inertia and the standard servo: e and Z of the consolidated packing against those of
three other packings at half the step, and then, sheared at half the cell's step or less and a third of its rate or less
from the cell's own packing (so that two packings' difference is not taken for an error), eta over 0.5-4 % strain, e at
its end and Z over 2-4 %.  All within LIMITS: *right*.  A stage that ended with a stated reason: *refused*.

Where the shear is off, one run of small or slippery packings may have been chaos: cell and reference are run REPEATS
times more, and the means of those pairs in which neither was refused count (eta, e, Z; the row's other columns stay the
first run's).  The repeats differ in the ninth digit of mu_s, or, where mu_s is below mu_iso, in the packing: such a
packing collapses when its grains take on mu_s, and is a new one.  Off by more than the limit and by no more than
SIGMAS standard errors: *open*.  `plan` and the report say that the void ratio of a collapsed packing depends on
inertia: e off there by no more than SAID is *said*.  Everything else, a crash included, is *wrong*, and the script
exits with 1.  The verdict is given when the table is made, from the numbers kept.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
from bench_rows import append, finished
from dem_runs import BUILD, D50, ROOT, RunCrashed, RunFailed, RunStopped, assembly, row_digest, run

from analysis.assembly import Assembly, AssemblyError, make_assembly, write_assembly
from analysis.micromechanics import metrics
from analysis.quantities import effective_inertial_number
from analysis.runs.peak_critical import mean_stress, stress_ratio
from analysis.runs.run_file import read_run, read_snapshot
from campaign.cell import check_cell
from campaign.config import ConfigError, parse_config

ROWS = ROOT / "data" / "benchmarks" / "stability.csv"
INITIAL, SHEARED = ("e_0", "Z_0"), ("eta", "e", "Z", "p")
MEASURED = (*INITIAL, *SHEARED)
COLUMNS = ("scripts", "axis", "value", "second", "N", "outcome", "reason", "repeats", "pairs", *MEASURED,
           *(f"{k}_reference" for k in MEASURED), *(f"{k}_scatter" for k in INITIAL), *(f"{k}_error" for k in SHEARED),
           "energy_error", "servo_mean_error", "dt", "steps", "cpu_seconds", "strain", "end")  # fmt: skip
BASE = {
    "N": 200,
    "seed": 1,
    "mu_iso": 0.04,
    "mu_s": 0.25,
    "G_p": 25.7e9,
    "sigma_3": 100e3,
    "inertial_number": 2.4e-3,
    "timestep_factor": 1.0,
    "density_scaling": 1,
    "stiffness_scale": 1.0,
    "sigma_ln": 0.174,
    "distribution": "lognormal",
}
#: What the scripts take where a cell says nothing.
DEFAULT_SERVO = {"servo_mass": 5e-3, "servo_damping": 0.8}
#: Relative, for 200 spheres sheared from the same packing: three times what eta and e of such runs scatter by; of Z the
#: bias of the campaign's rate as well.  Fewer spheres scatter by more, as N^-1/2.  p' counts on undrained paths only.
LIMITS = {"eta": 0.05, "e": 0.006, "Z": 0.06, "p": 0.1}
#: e_0 and Z_0 are of another packing than the reference's: so many standard deviations, pooled over the whole map.
SIGMAS = 3.0
#: More pairs of runs of a cell and its reference where the first is off; with fewer than LEAST left, the first counts.
REPEATS, LEAST = 8, 3
#: What `plan` and the report say of e where a packing has collapsed, and a margin.
SAID = 0.02
#: Packings behind a reference's e_0 and Z_0; the cells have packing 1.
PACKINGS = (2, 3, 4)

STEP = (0.2, 0.3, 0.4, 0.6, 0.8, 0.9, 1.0, 1.05, 1.1, 1.15, 1.2, 1.3, 1.5, 2.0, 3.0)
STEP_OWN = (0.2, 0.5, 0.8, 1.0, 1.1, 1.2, 1.5, 3.0)
STIFFNESS = (1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0)
FRICTION = (0.001, 0.003, 0.01, 0.03, 0.06, 0.1, 0.15, 0.25, 0.4, 0.65, 0.9, 1.2)
STRESS = (1e3, 3e3, 1e4, 3e4, 1e5, 3e5, 1e6, 3e6, 1e7)
RATE = (5e-4, 1e-3, 1.5e-3, 2e-3, 2.4e-3, 3e-3, 0.1)
SIZE = (64, 80, 100, 150, 200, 300, 400, 500)
DENSITY = (0.0, 0.001, 0.01, 0.04, 0.1, 0.3, 0.6)
MODULUS = (1e8, 1e9, 1e10, 25.7e9, 1e11, 1e12)
WIDTH = (0.0, 0.1, 0.174, 0.25, 0.35, 0.5)
GAIN, DAMPING = (1e-4, 1e-3, 5e-3, 0.02, 0.05, 0.1, 0.5, 2.0), (0.0, 0.4, 0.8, 0.99)
SQUEEZE = (1.0, 1.02, 1.05, 1.1, 1.2, 1.5)
#: Every path in every direction but the drained compression of all other cells, each with these changes.
SHEAR_TESTS = [
    (path, direction)
    for path in ("drained", "constant_p", "undrained")
    for direction in ("compression", "extension")
    if (path, direction) != ("drained", "compression")
]
SHEAR_CHANGES = {"as usual": {}, "step 1.2": {"timestep_factor": 1.2}, "stiffness 0.1": {"stiffness_scale": 0.1},
                 "64 spheres": {"N": 64}, "mu_s 0.65": {"mu_s": 0.65}}  # fmt: skip
#: Last strains of the other cells, and of those that are sheared to the end: N, that strain and further changes.
STRAIN, WINDOWS = 0.04, 16
FULL_STRAIN = (
    (64, 0.13, {}), (80, 0.2, {}), (80, 0.4, {}), (100, 0.26, {}), (100, 0.4, {}), (160, 0.4, {}), (400, 0.67, {}),
    (400, 1.0, {}), (200, 0.11, {"sigma_ln": 0.35}), (1000, 0.4, {"sigma_ln": 0.5}),
    (300, 0.21, {"distribution": "well_graded"}), (1000, 0.4, {"distribution": "gap_graded"}),
)  # fmt: skip


def cells():
    """(axis, value, second, changes) of every cell; those that come to the same run as one before are left out."""
    seen = set()
    for cell in _named_cells():
        case = BASE | DEFAULT_SERVO | cell[-1]
        case["inertial_number"] = _rate(case)
        key = tuple(sorted(case.items()))
        if key not in seen:
            seen.add(key)
            yield cell


def _rate(case):
    """The rate that a case is sheared at: beyond what the scripts take it stays, to be refused."""
    return effective_inertial_number(case["inertial_number"], case["mu_s"])


def _named_cells():
    """One parameter at a time, then pairs of them."""
    for axis, values, name in (
        ("stiffness", STIFFNESS, "stiffness_scale"),
        ("friction", FRICTION, "mu_s"),
        ("stress", STRESS, "sigma_3"),
        ("size", SIZE, "N"),
        ("width", WIDTH, "sigma_ln"),
        ("step", STEP, "timestep_factor"),
        ("rate", RATE, "inertial_number"),
        ("density", DENSITY, "mu_iso"),
        ("modulus", MODULUS, "G_p"),
    ):
        for value in values:
            yield axis, value, "", {name: value}
    for value in STEP_OWN:
        yield "step, own inertia", value, "", {"timestep_factor": value, "density_scaling": 0}
    for name, shape in (("loguniform", {}), ("well_graded", {}), ("gap_graded", {"size_ratio": 2.2})):
        yield "grading", name, "", {"distribution": name, **shape}
    for squeeze in SQUEEZE:
        yield "overlapping start", squeeze, "", {"squeeze": squeeze}
    for gain in GAIN:
        for damping in DAMPING:
            yield "servo", gain, damping, {"servo_mass": gain, "servo_damping": damping}
    for step in (0.8, 1.0, 1.1, 1.3, 2.0):
        for mu_s in (0.01, 0.1, 0.65):
            yield "step x friction", step, mu_s, {"timestep_factor": step, "mu_s": mu_s}
        for sigma_3 in (1e4, 1e6, 1e7):
            yield "step x stress", step, sigma_3, {"timestep_factor": step, "sigma_3": sigma_3}
    for size in (64, 100):
        for sigma_3 in (1e4, 1e6):
            yield "size x stress", size, sigma_3, {"N": size, "sigma_3": sigma_3}
        for mu_s in (0.03, 0.65):
            yield "size x friction", size, mu_s, {"N": size, "mu_s": mu_s}
    for rate in (5e-4, 1e-3, 2.4e-3):
        for stiffness in (0.01, 0.1, 3.0):
            yield "rate x stiffness", rate, stiffness, {"inertial_number": rate, "stiffness_scale": stiffness}
        for mu_s in (0.03, 0.9):
            yield "rate x friction", rate, mu_s, {"inertial_number": rate, "mu_s": mu_s}
    for path, direction in SHEAR_TESTS:
        for words, changes in SHEAR_CHANGES.items():
            yield "path x direction", f"{path} {direction}", words, {"path": path, "direction": direction, **changes}
    for size, strain, changes in FULL_STRAIN:
        words = [f"strain {strain:g}", *(f"{v}" for v in changes.values())]
        yield "full strain", size, " ".join(words), {"N": size, "strain_end": strain, **changes}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", action="store_true", help="only count the rows there are")
    parser.add_argument("--axis", help="only this axis")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="runs at once")
    args = parser.parse_args()
    done = finished(ROWS, ("scripts", "axis", "value", "second"))

    def fill(cell) -> None:
        axis, *values, changes = cell
        if (row_digest(), axis, *map(_text, values)) not in done:
            append(ROWS, COLUMNS, measured(BASE | changes) | {"axis": axis, "value": values[0], "second": values[1]})

    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(fill, [c for c in cells() if not args.table and args.axis in (None, c[0])]))
    rows = pd.read_csv(ROWS, dtype={"scripts": str, "value": str, "second": str, "reason": str})
    old = rows.scripts != row_digest()
    if old.all():
        sys.exit(f"{ROWS}: no cell of this code ({row_digest()}); {old.sum()} are of other")
    others, rows = rows[old], judged(rows[~old])
    if not args.table:
        rows = judged(repeated(rows, args.jobs))
    part = ROWS.with_suffix(".part")
    pd.concat([others, rows]).to_csv(part, index=False, columns=COLUMNS, float_format="%.6g")
    part.replace(ROWS)
    print(rows.groupby(["axis", "outcome"]).size().unstack(fill_value=0).to_string())
    many = rows[rows["repeats"] > 1]
    off = pd.DataFrame({k: 100 * (many[k] / many[f"{k}_reference"] - 1) for k in SHEARED})
    shown = off.join(100 * many[[f"{k}_error" for k in SHEARED]])
    print("means of repeats, off by (%) and standard errors (%):")
    print(many[["axis", "value", "second", "outcome", "pairs"]].join(shown).to_string(index=False, float_format="%.2f"))
    verdicts = ("right", "refused", "said", "open", "wrong")
    counts = ", ".join(f"{np.sum(rows.outcome == word)} {word}" for word in verdicts)
    print(f"{len(rows)} cells: {counts}; {old.sum()} rows of other code left out")
    sys.exit(int(np.any(rows.outcome == "wrong")))


def finer(case: dict) -> dict:
    """The reference of a cell: the same physical case, slower, at a smaller step, with the grains' own inertia."""
    fine = {k: v for k, v in case.items() if not k.startswith("servo_") and k not in ("squeeze", "strain_end")}
    return fine | {"timestep_factor": min(0.5, case["timestep_factor"] / 2), "density_scaling": 0,
                   "inertial_number": min(8e-4, _rate(case) / 3)}  # fmt: skip


def repeated(rows: pd.DataFrame, jobs: int) -> pd.DataFrame:
    """Rows in which cells whose shear is off its reference have the means over REPEATS more runs of either.

    `eta_error`, `e_error` and `Z_error` are the standard errors of the mean difference over the size of the reference.
    """
    cases = _cases()
    words = rows["reason"].fillna("").str.split()
    unsure = rows["outcome"].isin(["wrong", "said", "open"]) & (rows["repeats"].fillna(1) < REPEATS)
    off = [k for k in rows.index[unsure] if words[k] and set(words[k]) <= set(SHEARED)]
    chosen, rows = [cases[_name(rows.loc[k])] for k in off], rows.copy()
    with ThreadPoolExecutor(jobs) as pool:
        for k, found in zip(off, pool.map(_repeats, chosen), strict=True):
            for name, value in found.items():
                rows.loc[k, name] = value
    return rows


def _repeats(case: dict) -> dict:
    """Means of cell and reference over the pairs of repeats in which neither was refused, and the errors of both.

    Nothing of the cell where a run crashed or was stopped, which is wrong; only the counts where LEAST pairs are not
    left.
    """
    mine, fine, case = [], [], {k: v for k, v in case.items() if k != "strain_end"}
    for n in range(1, REPEATS + 1):
        changed = {"seed": case["seed"] + n} if collapses(case) else {"mu_s": case["mu_s"] * (1 - 1e-9 * n)}
        try:
            start = consolidated(case | changed)
            pair = [sheared(start, c)[0] for c in (case | changed, finer(case | changed))]
        except (RunCrashed, RunStopped) as error:
            print(f"a repeat crashed or was stopped: {error}", flush=True)
            return dict.fromkeys(SHEARED, np.nan) | {"repeats": REPEATS}
        except RunFailed as error:
            print(f"a repeat was refused: {error}", flush=True)
            continue
        mine.append(pair[0])
        fine.append(pair[1])
    counts = {"repeats": REPEATS, "pairs": len(mine)}
    if len(mine) < LEAST:
        return counts
    mine, fine = pd.DataFrame(mine), pd.DataFrame(fine)
    error = (mine - fine).sem() / fine.mean().abs()
    return {**mine.mean(), **fine.mean().add_suffix("_reference"), **error.add_suffix("_error"), **counts}


def collapses(case: dict) -> bool:
    """True where the grains take on less friction than the packing was consolidated with, as `plan` says."""
    return case["mu_s"] < case["mu_iso"]


def _cases() -> dict:
    """Name of a cell, as its row has it -> its case."""
    return {(axis, *(_text(v) for v in values)): BASE | changes for axis, *values, changes in cells()}


def _name(row) -> tuple:
    return tuple("" if pd.isna(row.get(k)) else row[k] for k in ("axis", "value", "second"))


def _text(value) -> str:
    """A cell's value as its row has it."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def measured(case: dict) -> dict:
    """The row of one cell: what it and its reference give, or how it ended; the verdict comes later."""
    row, fine = {"scripts": row_digest(), "N": case["N"], "repeats": 1, "pairs": 1}, finer(case)
    try:
        if "strain_end" in case:
            check_cell(_campaign(case))
        start = consolidated(case)
        mine, told = sheared(start, case)
    except (RunCrashed, RunStopped) as error:
        return row | {"outcome": "wrong", "reason": f"crashed or stopped: {error}"}
    except (RunFailed, AssemblyError, ConfigError) as error:
        return row | {"outcome": "refused", "reason": str(error).replace(f"{BUILD}/", "")}
    row |= mine | told | initial(start)
    try:
        reference = sheared(start, fine)[0]
        calm = fine | {"timestep_factor": 0.5}
        others = pd.DataFrame([initial(consolidated(calm | {"seed": seed})) for seed in PACKINGS])
    except (RunFailed, RunCrashed) as error:
        return row | {"outcome": "wrong", "reason": f"its reference failed: {error}"}
    row |= {f"{k}_reference": v for k, v in (reference | others.mean().to_dict()).items()}
    return row | {f"{k}_scatter": v for k, v in (others.std() / others.mean()).items()}


def judged(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows with a verdict for every cell that has a reference, and the numbers that are off.

    The scatter of packings (of the relative e_0 and Z_0, as N^-1/2) is pooled over the references of the map.
    """
    rows, cases = rows.copy(), _cases()
    compared = rows["eta_reference"].notna()
    size = np.sqrt(200 / rows["N"])
    off, known = pd.DataFrame(index=rows.index), pd.DataFrame(index=rows.index)
    for name in MEASURED:
        if f"{name}_reference" not in rows:
            continue
        limit = LIMITS.get(name)
        if name in INITIAL:
            pooled = (rows[f"{name}_scatter"] / size)[compared & ~rows.duplicated(f"{name}_reference")]
            limit = SIGMAS * np.sqrt((pooled**2).mean() * (1 + 1 / len(PACKINGS)))
        grown = size if name in INITIAL else np.maximum(size, 1.0)
        far = (rows[name] / rows[f"{name}_reference"] - 1).abs().fillna(np.inf)
        error = rows[f"{name}_error"].fillna(0.0) if f"{name}_error" in rows else 0.0
        off[name] = (far > grown * limit) & (rows[f"{name}_reference"].notna() | (name != "p"))
        known[name] = off[name] & (far > SIGMAS * error)
        if name == "e":
            near = far <= SAID
    words = off.apply(lambda row: " ".join(row.index[row]), axis=1)
    fallen = pd.Series([collapses(cases.get(_name(row), BASE)) for _, row in rows.iterrows()], rows.index)
    said = fallen & near & ~known.drop(columns="e").any(axis=1)
    verdict = np.select([words == "", ~known.any(axis=1), said], ["right", "open", "said"], "wrong")
    rows[["reason", "outcome"]] = rows[["reason", "outcome"]].astype(object)  # an empty column is one of numbers
    rows.loc[compared, "reason"] = words[compared]
    rows.loc[compared, "outcome"] = verdict[compared]
    return rows


def consolidated(case: dict, yade: str = "yade"):
    """The product of a cell's consolidation."""
    start = _assembly(case)
    values = {k: case[k] for k in ("mu_iso", "G_p", "sigma_3", "seed", "timestep_factor", "density_scaling")}
    servo = {k: v for k, v in case.items() if k.startswith("servo_")}
    return run("consolidate", yade, assembly=start, **values, **servo)


def initial(product) -> dict:
    """e and Z of a consolidated packing at rest."""
    found = metrics.snapshot_metrics(read_snapshot(read_run(product), -1))
    return {"e_0": float(found["e"]), "Z_0": float(found["Z"])}


def sheared(start, case: dict, yade: str = "yade") -> tuple[dict, dict]:
    """eta over 0.5-4 % strain, e at its end, Z over 2-4 %, and what the run says of itself.  Raises RunFailed."""
    left_out = ("N", "sigma_ln", "distribution", "size_ratio", "squeeze", "strain_end")
    values = {k: v for k, v in case.items() if k not in left_out}
    end = case.get("strain_end", STRAIN)
    windows = round(WINDOWS * end / STRAIN)
    shear = read_run(run("shear", yade, start=start, strain_end=end, windows=windows, snapshots="", **values))
    strain, sigma, e, Z = (shear.record[k][: WINDOWS + 1] for k in ("eps_a", "sigma", "e", "Z"))
    strain = np.abs(strain)
    mine = {"eta": float(stress_ratio(sigma)[strain > 0.005].mean()), "e": float(e[-1])}
    mine["Z"] = float(Z[strain > 0.02].mean())
    mine["p"] = float(mean_stress(sigma)[-1]) if case.get("path") == "undrained" else np.nan
    told = {k: float(shear.proofs[k]) for k in ("energy_error", "servo_mean_error")}
    told |= {"strain": float(shear.record["eps_a"][-1]), "end": shear.attrs["exit_reason"]}
    return mine, told | {"dt": shear.timing["dt_mean"], **{k: shear.timing[k] for k in ("steps", "cpu_seconds")}}


def _campaign(case: dict):
    """The campaign file of a cell, as far as `plan` looks at it for thin cells."""
    return parse_config(
        f"[assembly]\nN = {case['N']}\nsigma_ln = {case['sigma_ln']}\ndistribution = {case['distribution']!r}\n"
        f"[consolidation]\nmu_iso = [{case['mu_iso']}]\n"
        f"[shear]\nstrain_end = {case['strain_end']}\ninertial_number = {case['inertial_number']}\n", "plan",
    )  # fmt: skip


def _assembly(case: dict):
    """The usual assembly, one of a given shape, or one whose grains `squeeze` blows up so that they overlap."""
    N, seed, width, kind = (case[k] for k in ("N", "seed", "sigma_ln", "distribution"))
    shape = {k: case[k] for k in ("size_ratio",) if k in case}
    squeeze = case.get("squeeze")
    if squeeze is None and not shape:
        return assembly(N, seed, width, kind)
    words = "_".join([kind, *(f"{k}_{v:g}" for k, v in shape.items()), f"squeezed_{squeeze or 1:g}"])
    path = BUILD / f"assembly_{words}_{width:g}_{N}_{seed}.h5"
    if not path.exists():
        solid = {} if squeeze is None else {"solid_fraction": 0.56}
        loose = make_assembly(N, D50, width, seed, kind, **shape, **solid)
        squeezed = Assembly(loose.position / (squeeze or 1), loose.radius, loose.cell / (squeeze or 1))
        write_assembly(path, squeezed, {"N": N, "seed": seed, "sigma_ln": width})
    return path


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
