"""The TOML file of a campaign as one validated, frozen value.

Every key is one line below: its default, its type, its limits and what it means.  An unknown key, a wrong type or a
value out of range ends in one line that names file, key, value and limit.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from dataclasses import dataclass, field, fields
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


class ConfigError(ValueError):
    """A campaign file that cannot be used; the text names the file, the key, the value and the limit."""


def key(default, kind, low=None, high=None, *, choices=None, doc=""):
    """One key of the file: default, kind (a type, or [type] for a list), inclusive limits and choices of each value."""
    metadata = {"kind": kind, "low": low, "high": high, "choices": choices, "doc": doc}
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Inputs:
    pairs: str = key("data/pairs_reconstructed.csv", str, doc="CSV with the measured pairs (mu_s, G_p_GPa or E_p_GPa)")
    marginals: tuple = key((), [str], doc="families to choose from by AIC; empty: all")
    copulas: tuple = key(("gaussian", "student", "frank", "plackett"), [str], doc="copulas to choose from; empty: all")
    seed: int = key(1, int, 0, 2**31 - 1, doc="of the goodness-of-fit samples, and of per-grain properties")
    bootstrap: int = key(200, int, 19, 100_000, doc="simulated samples of the goodness-of-fit test")


@dataclass(frozen=True)
class Points:
    n: int = key(100, int, 2, 10_000, doc="representative points; fewer than 8 cannot carry the moments")
    method: str = key("gf", str, doc="gf: points with the smallest GF-discrepancy; see analysis/points.py")
    seed: int = key(1, int, 0, 2**31 - 1, doc="of the search for them")
    nested: bool = key(False, bool, doc="order the points so that every beginning of the list represents the whole")


@dataclass(frozen=True)
class Assembly:
    N: int = key(1000, int, 64, 1_000_000, doc="spheres")
    d50_mm: float = key(0.248, float, 1e-4, 1e3, doc="diameter that splits the mass in halves")
    sigma_ln: float = key(0.174, float, 0.0, 1.0, doc="standard deviation of ln d by mass")
    distribution: str = key(
        "lognormal", str, choices=("lognormal", "loguniform", "well_graded", "gap_graded"), doc="grading, by mass"
    )
    packings: tuple = key((1,), [int], 0, 2**31 - 1, doc="seeds; the first serves all points, the others level it")
    replicate_points: int = key(-1, int, -1, 10_000, doc="points that the replicate packings serve; -1: all")


@dataclass(frozen=True)
class Material:
    nu: float = key(0.2, float, 0.0, 0.49, doc="Poisson's ratio of the grains")
    rho: float = key(2670.0, float, 1.0, 1e5, doc="density of the grains, kg/m3")
    heterogeneity: str = key(
        "specimen", str, choices=("specimen", "grain"), doc="a pair (mu_s, G_p) a specimen, or one a grain"
    )


@dataclass(frozen=True)
class Consolidation:
    mu_iso: tuple = key(
        (0.001, 0.04, 0.1), [float], 0.0, 1.2, doc="friction while consolidating; it sets the density, lower is denser"
    )
    sigma_3_kPa: float = key(100.0, float, 1.0, 1e4, doc="confining stress, of consolidation and of drained shear")
    per_point: bool = key(False, bool, doc="consolidate once per point, not once per density")
    G_ref_GPa: float = key(25.7, float, 0.01, 1000.0, doc="G_p of the shared consolidation")


@dataclass(frozen=True)
class Shear:
    strain_end: float = key(0.40, float, 0.001, 1.0, doc="axial strain, logarithmic: 0.40 is 33 % of the height")
    inertial_number: float = key(
        1e-3, float, 1e-6, 2.5e-3, doc="strain rate times d50 sqrt(rho / p'); lower above mu_s = 0.3, see rve.py"
    )
    windows: int = key(0, int, 0, 10_000, doc="output windows; 0: by the scripts, finer where curves are steep")
    energy_strain: float = key(0.0, float, 0.0, 1.0, doc="energies are summed up to it; 0: by the scripts, 5 %")
    stop_when_steady: bool = key(False, bool, doc="end before strain_end once the critical state is proven steady")
    snapshots: tuple = key((), [float], 0.0, 1.0, doc="strains at which all grains and contacts are kept")


@dataclass(frozen=True)
class Probe:
    strain: float = key(1e-6, float, 1e-8, 1e-3, doc="size of the increments that measure G_0 and K_0")


@dataclass(frozen=True)
class Dem:
    accuracy: str = key("", str, choices=("", "10%", "5%", "2%", "1%"), doc="picks the keys listed in accuracy.toml")
    timestep_factor: float = key(1.0, float, 0.01, 3.0, doc="share of the contact-stiffness time step")
    damping: float = key(0.0, float, 0.0, 0.9, doc="local damping during shear")
    stiffness_scale: float = key(1.0, float, 1e-4, 1.0, doc="share of G_p that shear runs use; probes use all")
    density_scaling: bool = key(True, bool, doc="balance the inertia of large and small grains; their sum stays")


@dataclass(frozen=True)
class Families:
    G_p_only: bool = key(False, bool, doc="a second family with mu_s fixed beside that with both as measured")
    mu_s_fixed: float = key(0.25, float, 1e-3, 1.5, doc="friction of the second family")
    G_p_points: int = key(-1, int, -1, 10_000, doc="points of the second family; -1: all")


@dataclass(frozen=True)
class Failures:
    max_lost_probability: float = key(
        0.05, float, 0.0, 0.5, doc="share of a density's probability that failed runs may take; more is refused"
    )
    retry: bool = key(True, bool, doc="once, with half the time step, where that can help")


@dataclass(frozen=True)
class Pdem:
    method: str = key(
        "exact", str, choices=("exact", "tvd"), doc="translated kernels, or the paper's flux-limited scheme"
    )
    cells: int = key(400, int, 64, 20_000, doc="cells of the grid of a density")
    stop_when: str = key("", str, doc="claimed error of the densities at which no more points are run; empty: run all")


@dataclass(frozen=True)
class Slurm:
    partition: str = key("", str, doc="empty: the cluster's default")
    time: str = key("24:00:00", str, doc="limit of one array task")
    memory: str = key("1G", str, doc="per task")
    throttle: int = key(0, int, 0, 100_000, doc="most tasks at once; 0: no limit")
    pack: float = key(30.0, float, 0.0, 10_000.0, doc="minutes of predicted work to pack into one task")
    options: tuple = key((), [str], doc="further lines for #SBATCH")


@dataclass(frozen=True)
class Run:
    engine: str = key("local", str, choices=("local", "slurm"), doc="this machine, or a cluster's queue")
    jobs: int = key(0, int, 0, 4096, doc="runs at once; 0: one per core")
    cpu_limit: float = key(20.0, float, 1.0, 1e6, doc="a run is stopped after this many times its predicted CPU time")
    hang_minutes: float = key(10.0, float, 0.01, 1e5, doc="a run that uses no CPU for so long is stopped")
    slurm: Slurm = key(Slurm(), Slurm)


@dataclass(frozen=True)
class Config:
    """A campaign's settings; `text` is the TOML it came from, `source` the file."""

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
    text: str = ""
    source: Path = Path()

    @property
    def pairs_path(self) -> Path:
        """The pairs file: beside the campaign file, else under the current folder, else under the repository's root."""
        places = [self.source.parent, Path.cwd(), ROOT]
        found = [p / self.inputs.pairs for p in places if (p / self.inputs.pairs).is_file()]
        if not found:
            raise ConfigError(f"{self.source.name}: inputs.pairs = {self.inputs.pairs!r} is no file")
        return found[0]


SECTIONS = {
    "inputs": Inputs, "points": Points, "assembly": Assembly, "material": Material, "consolidation": Consolidation,
    "shear": Shear, "probe": Probe, "dem": Dem, "families": Families, "failures": Failures, "pdem": Pdem, "run": Run,
}  # fmt: skip


def read_config(path: str | Path) -> Config:
    """Read and check a campaign file.  Raises ConfigError with one line that names file, key, value and limit."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file in UTF-8") from None
    return parse_config(text, path)


def parse_config(text: str, source: str | Path = "campaign.toml") -> Config:
    """Check a campaign file's text; errors name `source`."""
    where = Path(source).name
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{where}: not TOML: {error}") from None
    _refuse_unknown(table, ["name", *SECTIONS], where, "")
    name = table.get("name", Path(source).stem)
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,60}", name):
        raise ConfigError(f"{where}: name = {name!r} must be letters, digits, '_', '-' or '.' (at most 61)")
    for section in SECTIONS:
        if not isinstance(table.get(section, {}), dict):
            raise ConfigError(f"{where}: {section} = {table[section]!r} must be a section, [{section}]")
    chosen = _accuracy(table, where)
    parts = {
        section: _fill(kind, {**chosen.get(section, {}), **table.get(section, {})}, where, section)
        for section, kind in SECTIONS.items()
    }
    config = Config(name=name, text=text, source=Path(source), **parts)
    _check_together(config, where)
    return config


def _accuracy(table: dict, where: str) -> dict:
    """What `dem.accuracy` stands for: a table of sections, to be overridden by the file's own keys."""
    dem = _fill(Dem, table.get("dem", {}), where, "dem")
    if not dem.accuracy:
        return {}
    return tomllib.loads((ROOT / "campaign" / "accuracy.toml").read_text(encoding="utf-8"))[dem.accuracy]


def _refuse_unknown(table: dict, known: list[str], where: str, section: str) -> None:
    for name in table:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1, 0.5)
            hint = f"; did you mean {near[0]!r}?" if near else f"; known: {', '.join(known)}"
            raise ConfigError(f"{where}: unknown key {section + '.' if section else ''}{name}{hint}")


def _fill(kind: type, table: dict, where: str, section: str):
    _refuse_unknown(table, [f.name for f in fields(kind)], where, section)
    values = {}
    for f in fields(kind):
        meta = f.metadata
        full = f"{section}.{f.name}"
        if f.name not in table:
            values[f.name] = f.default
        elif isinstance(meta["kind"], list):
            if not isinstance(table[f.name], list):
                raise ConfigError(f"{where}: {full} = {table[f.name]!r} must be a list")
            values[f.name] = tuple(_value(v, meta["kind"][0], meta, where, full) for v in table[f.name])
        elif isinstance(meta["kind"], type) and meta["kind"].__module__ == __name__:
            if not isinstance(table[f.name], dict):
                raise ConfigError(f"{where}: {full} = {table[f.name]!r} must be a section, [{full}]")
            values[f.name] = _fill(meta["kind"], table[f.name], where, full)
        else:
            values[f.name] = _value(table[f.name], meta["kind"], meta, where, full)
    return kind(**values)


_KINDS = {int: "a whole number", float: "a number", str: "text in quotes", bool: "true or false"}


def _value(value, kind: type, meta, where: str, full: str):
    """One value of the right type, within its limits."""
    fits = isinstance(value, (int, float)) if kind is float else isinstance(value, kind)
    if not fits or (isinstance(value, bool) and kind is not bool):
        raise ConfigError(f"{where}: {full} = {value!r} must be {_KINDS[kind]}")
    if kind is float:
        value = float(value)
    low, high, choices = meta["low"], meta["high"], meta["choices"]
    if choices is not None and value not in choices:
        near = difflib.get_close_matches(str(value), [str(c) for c in choices], 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ConfigError(f"{where}: {full} = {value!r} must be one of {', '.join(map(repr, choices))}{hint}")
    if low is not None and not low <= value <= high:
        raise ConfigError(f"{where}: {full} = {value!r} is outside [{low:g}, {high:g}]")
    return value


def _check_together(config: Config, where: str) -> None:
    """Limits that tie keys together."""
    lists = {
        "assembly.packings": config.assembly.packings,
        "consolidation.mu_iso": config.consolidation.mu_iso,
    }
    for full, values in lists.items():
        if not values:
            raise ConfigError(f"{where}: {full} is empty; at least one value is needed")
        if len(set(values)) < len(values):
            raise ConfigError(f"{where}: {full} = {list(values)} names a value twice")
    strains = config.shear.snapshots
    if any(b <= a for a, b in zip(strains, strains[1:], strict=False)):
        raise ConfigError(f"{where}: shear.snapshots = {list(strains)} must increase")
    if strains and strains[-1] > config.shear.strain_end:
        raise ConfigError(
            f"{where}: shear.snapshots has {strains[-1]:g}, beyond strain_end = {config.shear.strain_end:g}"
        )
    if config.pdem.stop_when and not _is_share(config.pdem.stop_when):
        raise ConfigError(f"{where}: pdem.stop_when = {config.pdem.stop_when!r} must be a share such as '5%' or '0.05'")
    if not re.fullmatch(r"(\d+-)?\d+(:\d\d){0,2}", config.run.slurm.time):
        raise ConfigError(f"{where}: run.slurm.time = {config.run.slurm.time!r} is no SLURM time such as '24:00:00'")
    if not re.fullmatch(r"\d+[KMGT]?", config.run.slurm.memory):
        raise ConfigError(f"{where}: run.slurm.memory = {config.run.slurm.memory!r} is no SLURM size such as '2G'")


def _is_share(text: str) -> bool:
    """Whether `analysis.stopping.parse_target` takes the text: a share between 0 and 1, also in per cent."""
    text = text.strip()
    try:
        return 0 < float(text.removesuffix("%")) / (100 if text.endswith("%") else 1) < 1
    except ValueError:
        return False
