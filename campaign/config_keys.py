"""The keys of a campaign file: one line for each, with its default, its type, its limits and its meaning."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from analysis.quantities import DIRECTIONS, PATHS

#: Largest number of runs at once, of the key run.jobs and of the option --jobs.
MOST_JOBS = 4096
#: Kind of a key that is a list of random seeds, or a number of them: n stands for the seeds 1 to n.
SEEDS = "seeds"
MOST_SEEDS = 10_000
#: Kind of the section that gives the columns of the pairs file: names of the project -> names in the file.
COLUMNS = "columns"


def key(
    default: Any,
    kind: Any,
    low: float | None = None,
    high: float | None = None,
    *,
    choices: tuple | None = None,
    doc: str = "",
    asks: tuple[str, str] = ("", ""),
) -> Any:
    """Declare one key: default, kind (a type, or [type] for a list), inclusive limits, choices, meaning.

    asks: questions about the unit of a value below and above the limits.
    """
    metadata = {"kind": kind, "low": low, "high": high, "choices": choices, "doc": doc, "asks": asks}
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Inputs:
    pairs: str = key(
        "data/pairs_reconstructed.csv", str, doc="CSV or .xlsx file with pairs mu_s, G_p_GPa (or E_p_GPa; MPa, Pa)"
    )
    marginals: tuple = key(
        (), [str], doc='marginal families to choose from by AIC; empty: all but "kernel", a kernel density of ln x'
    )
    copulas: tuple = key(("gaussian", "student", "frank", "plackett"), [str], doc="copulas to choose from; empty: all")
    seed: int = key(1, int, 0, 2**31 - 1, doc="random seed of the goodness-of-fit test and of per-grain properties")
    bootstrap: int = key(200, int, 19, 100_000, doc="number of simulated samples of the goodness-of-fit test")
    columns: tuple = key((), COLUMNS, doc='section [inputs.columns], such as G_p_MPa = "name of a column in the pairs"')
    pairs_behind: int = key(
        0, int, 0, 1_000_000, doc="number of measurements behind the figures of [variables]; 0: not known, no bands"
    )


@dataclass(frozen=True)
class Points:
    n: int = key(100, int, 2, 10_000, doc="number of representative points; below 8 the moments cannot be matched")
    method: str = key("gf", str, doc="gf: smallest GF-discrepancy; others: analysis/points/selection.py")
    seed: int = key(1, int, 0, 2**31 - 1, doc="random seed of the search for the points")
    nested: bool = key(False, bool, doc="the first half of the points is a representative set too, and so on to 40")


@dataclass(frozen=True)
class Assembly:
    N: int = key(1000, int, 64, 1_000_000, doc="number of spheres")
    d50_mm: float = key(
        0.248, float, 1e-3, 100.0, doc="median diameter by mass, mm", asks=("is it metres?", "is it micrometres (µm)?")
    )
    sigma_ln: float = key(0.174, float, 0.0, 1.0, doc="standard deviation of ln d by mass")
    distribution: str = key(
        "lognormal",
        str,
        choices=("lognormal", "loguniform", "well_graded", "gap_graded"),
        doc="type of the grading by mass",
    )
    sieve: str = key(
        "",
        str,
        doc="CSV file with a grading curve, in place of d50_mm, sigma_ln, distribution: size_mm, passing_percent",
    )
    packings: tuple = key(
        tuple(range(1, 21)), SEEDS, 0, 2**31 - 1,
        doc="packings that the points take in rotation, at most one per point: their number (seeds 1, 2, ...) or a "
        "list of random seeds",
    )  # fmt: skip


@dataclass(frozen=True)
class Material:
    nu: float = key(0.2, float, 0.0, 0.49, doc="Poisson's ratio of the grains")
    rho: float = key(
        2670.0, float, 100.0, 1e5, doc="mass density of the grains, kg/m3",
        asks=("kg/m3? 1 g/cm3 is 1000 kg/m3", "kg/m3?"),
    )  # fmt: skip
    heterogeneity: str = key(
        "specimen", str, choices=("specimen", "grain"), doc="one pair (mu_s, G_p) per specimen, or one per grain"
    )


@dataclass(frozen=True)
class Consolidation:
    mu_iso: tuple = key(
        (0.001, 0.04, 0.1), [float], 0.0, 1.2, doc="friction during consolidation; the lower, the denser the packing"
    )
    sigma_3_kPa: float = key(
        100.0, float, 1.0, 1e4, doc="confining stress of consolidation and of drained shear, kPa",
        asks=("is it MPa?", "is it Pa?"),
    )  # fmt: skip
    per_point: bool = key(False, bool, doc="consolidate once per point instead of once per density")
    G_ref_GPa: float = key(
        25.7, float, 0.01, 1000.0, doc="G_p of the consolidation that all points share, GPa",
        asks=("is it TPa?", "is it MPa or Pa?"),
    )  # fmt: skip


@dataclass(frozen=True)
class Shear:
    path: str = key(
        "drained", str, choices=PATHS,
        doc="what the test holds: drained: sigma_3; constant_p: p'; undrained: the volume",
    )  # fmt: skip
    direction: str = key("compression", str, choices=DIRECTIONS, doc="whether the z axis shortens or lengthens")
    stiff_cap_MPa: float = key(
        10.0, float, 0.01, 1e4, doc="p' at which an undrained test ends, MPa: real grains would crush",
        asks=("", "is it kPa?"),
    )  # fmt: skip
    strain_end: float = key(0.40, float, 0.001, 1.0, doc="final axial strain, logarithmic; 0.40 is 33 % of the height",
                            asks=("", "is it per cent?"))  # fmt: skip
    inertial_number: float = key(
        1e-3, float, 1e-6, 2.5e-3, doc="strain rate times d50 sqrt(rho / sigma_3); limited above mu_s = 0.3 (plan.py)"
    )
    windows: int = key(
        0, int, 0, 10_000, doc="number of output windows; 0: script default (finer where curves are steep)"
    )
    energy_strain: float = key(
        0.0, float, 0.0, 1.0, doc="strain up to which energies are summed; 0: script default (5 %)"
    )
    stop_when_steady: bool = key(False, bool, doc="end a run once its critical state is proven steady")
    snapshots: tuple = key((), [float], 0.0, 1.0, doc="axial strains at which all grains and contacts are saved")


@dataclass(frozen=True)
class Probe:
    strain: float = key(1e-6, float, 1e-8, 1e-3, doc="size of the strain increments that measure G_0 and K_0")


@dataclass(frozen=True)
class Dem:
    code: str = key("yade", str, choices=("yade", "lammps"), doc="the DEM code; lammps: drained compression only")
    accuracy: str = key("", str, choices=("", "5%", "3%", "2%"), doc="preset of accuracy.toml; empty: none")
    timestep_factor: float = key(1.0, float, 0.01, 3.0, doc="time step over the contact-stiffness time step")
    damping: float = key(0.0, float, 0.0, 0.9, doc="local damping coefficient during shear")
    stiffness_scale: float = key(1.0, float, 1e-4, 1.0, doc="factor on G_p in shear runs; probes use the full G_p")
    density_scaling: bool = key(True, bool, doc="balance the inertia of large and small grains; same total")


@dataclass(frozen=True)
class Families:
    G_p_only: bool = key(False, bool, doc="add a second family of points, with mu_s fixed and G_p as measured")
    mu_s_fixed: float = key(0.25, float, 1e-3, 1.5, doc="mu_s of the second family")
    G_p_points: int = key(-1, int, -1, 10_000, doc="number of points of the second family; -1: all")


@dataclass(frozen=True)
class Failures:
    max_lost_probability: float = key(
        0.05, float, 0.0, 0.5, doc="`analyse` stops if failed runs take more probability than this from a soil density"
    )
    retry: bool = key(True, bool, doc="repeat a failed run once with half the time step, if a smaller step can help")


@dataclass(frozen=True)
class Pdem:
    method: str = key(
        "exact", str, choices=("exact", "tvd"), doc="exact: translated kernels; tvd: the paper's flux-limited scheme"
    )
    cells: int = key(400, int, 64, 20_000, doc="number of grid cells of a PDF")
    stop_when: str = key("", str, doc="target error of the PDFs such as '5%'; empty: run all points")


@dataclass(frozen=True)
class Slurm:
    partition: str = key("", str, doc="name of the partition; empty: the cluster's default")
    time: str = key("24:00:00", str, doc="time limit of one array task")
    memory: str = key("1G", str, doc="memory of one array task")
    throttle: int = key(0, int, 0, 100_000, doc="largest number of tasks at once; 0: no limit")
    pack: float = key(30.0, float, 0.0, 10_000.0, doc="predicted work that is packed into one task, minutes")
    options: tuple = key((), [str], doc="further options, each a line #SBATCH")


@dataclass(frozen=True)
class Run:
    engine: str = key("local", str, choices=("local", "slurm"), doc="local: this machine; slurm: a cluster's queue")
    jobs: int = key(0, int, 0, MOST_JOBS, doc="number of runs at once (local engine); 0: one per core")
    ranks: int = key(1, int, 1, 1024, doc='MPI ranks of one run; more than 1 needs dem.code = "lammps"')
    cpu_limit: float = key(20.0, float, 1.0, 1e6, doc="a run is stopped after this many times its predicted CPU time")
    hang_minutes: float = key(10.0, float, 0.01, 1e5, doc="a run is stopped after this time without CPU use, minutes")
    slurm: Slurm = key(Slurm(), Slurm, doc="the section [run.slurm]")


#: The sections of a campaign file.
SECTIONS = {
    "inputs": Inputs, "points": Points, "assembly": Assembly, "material": Material, "consolidation": Consolidation,
    "shear": Shear, "probe": Probe, "dem": Dem, "families": Families, "failures": Failures, "pdem": Pdem, "run": Run,
}  # fmt: skip


@dataclass(frozen=True)
class Settings:
    """The name of a campaign and all sections of its file."""

    name: str
    inputs: Inputs
    points: Points
    assembly: Assembly
    material: Material
    consolidation: Consolidation
    shear: Shear
    probe: Probe
    dem: Dem
    families: Families
    failures: Failures
    pdem: Pdem
    run: Run
