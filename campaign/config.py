"""The TOML file of a campaign as one checked, frozen value; `config_keys` has every key.

An unknown key, a wrong type or a value out of range raises ConfigError with one line that names the file, the key, the
value and the limit.
"""

from __future__ import annotations

import difflib
import json
import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.errors_and_files import decoded, digest, shown
from campaign.config_checks import ConfigError, check_together
from campaign.config_keys import COLUMNS, MOST_SEEDS, SECTIONS, SEEDS, Settings, Slurm
from campaign.config_variables import SECTIONS_STATED, VariablesError, read_variables
from campaign.scope import out_of_scope

if TYPE_CHECKING:
    from analysis.inputs.sieve_curve import SieveCurve

#: The folder that holds analysis/, campaign/, yade_scripts/ and data/: the repository, or the installed package.
ROOT = Path(__file__).resolve().parent.parent
INSTALLED = (ROOT / "__init__.py").exists()
#: How a person starts the command line, and where its campaigns are.
COMMAND = "grain-scatter" if INSTALLED else "python3 -m campaign"
RUNS = Path("runs") if INSTALLED else ROOT / "runs"
#: How to install YADE, in one sentence.
INSTALL_YADE = (
    "on Debian and Ubuntu `apt-get install yade` (or `make setup`) installs YADE; other systems have plan, analyse and "
    "report, and make their runs on a cluster or in a container (Dockerfile)"
)
#: How to install LAMMPS, in one sentence.
INSTALL_LAMMPS = "on Debian and Ubuntu `apt-get install lammps` (or `make lammps`) installs LAMMPS"
#: Keys of earlier versions, with what replaces them.
FORMER = {
    "assembly.replicate_points": "assembly.packings are dealt to the points in rotation, and no point has replicates"
}


@dataclass(frozen=True)
class Config(Settings):
    """The settings of a campaign; `text` is the TOML text, `source` the path of the file.

    `variables` and `dependence` are the sections of these names as they stand in the file (`config_variables`).
    `curve` is the grading curve of `assembly.sieve`, None without; with a curve, `assembly.d50_mm` is its D50.
    """

    variables: dict[str, Any] = field(default_factory=dict)
    dependence: dict[str, Any] = field(default_factory=dict)
    text: str = ""
    source: Path = Path()
    curve: SieveCurve | None = None

    @property
    def pairs_path(self) -> Path:
        """The pairs file; raises ConfigError if it is at none of the places of `find_file`."""
        return find_file(self.source, "inputs.pairs", self.inputs.pairs)


def find_file(source: Path, full: str, name: str) -> Path:
    """The file `name` of the key `full`: beside the campaign file, else in the current folder, else in the repository.

    Raises ConfigError if it is at none of these places.
    """
    for folder in (source.parent, Path.cwd(), ROOT):
        if (folder / name).is_file():
            return folder / name
    raise ConfigError(f"{source.name}: {full} = {name!r} is no file")


def read_config(path: str | Path) -> Config:
    """Read and check a campaign file. Raises ConfigError with one line that names the file, key, value and limit.

    A name without a folder that is no file here, such as "demo.toml", is that of a campaign file of the project.
    """
    path = Path(path)
    if path.parent == Path() and not path.exists() and (ROOT / "campaign" / path.name).is_file():
        path = ROOT / "campaign" / path.name
    try:
        text = decoded(path.read_bytes(), path, ConfigError)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    return parse_config(text, path)


def parse_config(text: str, source: str | Path = "campaign.toml") -> Config:
    """Check the text of a campaign file. Raises ConfigError; its text names the file `source`."""
    file = Path(source).name
    try:
        return _parsed(text, Path(source), file)
    except RecursionError:
        raise ConfigError(
            f"{file}: lists or sections are nested too deep; a campaign file has at most two levels"
        ) from None


def _parsed(text: str, source: Path, file: str) -> Config:
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{file}: not TOML: {shown(str(error), 200)}") from None
    except ValueError as error:
        long = re.search(r"[\d_]{4300,}", text)  # Python reads whole numbers of at most 4,300 digits
        if not long:
            raise ConfigError(f"{file}: not TOML: {shown(str(error), 200)}") from None
        line = text.count("\n", 0, long.start()) + 1
        raise ConfigError(f"{file}, line {line}: a whole number has {len(long[0]):,} digits, at most 4,300") from None
    _refuse_unknown(table, ["name", *SECTIONS, *SECTIONS_STATED], file, "")
    name = table.get("name", source.stem)
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,60}", name):
        raise ConfigError(f"{file}: name = {_shown(name)} must be letters, digits, '_', '-' or '.' (at most 61)")
    for section in SECTIONS:
        if not isinstance(table.get(section, {}), dict):
            raise ConfigError(f"{file}: {section} = {_shown(table[section])} must be a section, [{section}]")
    preset = _accuracy(table, file)
    parts = {
        section: _fill(kind, {**preset.get(section, {}), **table.get(section, {})}, file, section)
        for section, kind in SECTIONS.items()
    }
    try:
        stated = read_variables(table, parts["material"].nu, parts["inputs"].pairs_behind)
    except VariablesError as error:
        raise ConfigError(f"{file}: {shown(str(error), 400)}") from None
    variables, dependence, settled = stated
    parts |= {section: replace(parts[section], **keys) for section, keys in settled.items()}
    config = Config(name=name, text=text, source=source, variables=variables, dependence=dependence, **parts)
    check_together(config, file)
    return _with_curve(config, table.get("assembly", {})) if config.assembly.sieve else config


def _with_curve(config: Config, given: Mapping[str, Any]) -> Config:
    """The settings with the grading curve of `assembly.sieve`; raises ConfigError for a key that it takes the place of.

    given: the keys of [assembly] in the campaign file.
    """
    from analysis.inputs.sieve_curve import read_sieve

    for name in ("d50_mm", "sigma_ln", "distribution"):
        if name in given:
            raise ConfigError(
                f"{config.source.name}: assembly.{name} = {_shown(given[name])} and assembly.sieve are both given; "
                f"the sieve curve takes the place of assembly.{name}"
            )
    curve = read_sieve(find_file(config.source, "assembly.sieve", config.assembly.sieve))
    d50_mm = float(f"{curve.sizes['D50'] * 1e3:.12g}")
    return replace(config, curve=curve, assembly=replace(config.assembly, d50_mm=d50_mm))


def _accuracy(table: dict, file: str) -> dict:
    """The keys by section that `dem.accuracy` stands for; keys of the campaign file take precedence."""
    dem = _fill(SECTIONS["dem"], table.get("dem", {}), file, "dem")
    if not dem.accuracy:
        return {}
    return tomllib.loads((ROOT / "campaign" / "accuracy.toml").read_text(encoding="utf-8"))[dem.accuracy]


def _refuse_unknown(table: dict, known: list[str], file: str, section: str) -> None:
    for name in table:
        if name not in known:
            prefix = f"{section}." if section else ""
            if prefix + name in FORMER:
                raise ConfigError(f"{file}: {prefix}{name} is no key any more: {FORMER[prefix + name]}")
            places = [prefix + k for k in known if k.lower() == name.lower()] + _elsewhere(name, section)
            near = difflib.get_close_matches(name[:60], known, 1, 0.5)
            if places:
                hint = f"; did you mean {' or '.join(places)}?"
            elif answer := out_of_scope(name):
                hint = f"; {answer}"
            else:
                hint = f"; did you mean {near[0]!r}?" if near else f"; known: {', '.join(known)}"
            raise ConfigError(f"{file}: unknown key {prefix}{shown(name)}{hint}")


def _elsewhere(name: str, section: str) -> list[str]:
    """The full names of the keys of other sections that are called `name`, in capital letters or not."""
    sections = {**SECTIONS, "run.slurm": Slurm}
    return [f"{other}.{f.name}" for other, kind in sections.items() if other != section
            for f in fields(kind) if f.name.lower() == name.lower()]  # fmt: skip


def _fill(kind: type, table: dict, file: str, section: str) -> Any:
    _refuse_unknown(table, [f.name for f in fields(kind)], file, section)
    values = {}
    for f in fields(kind):
        meta = f.metadata
        full = f"{section}.{f.name}"
        if f.name not in table:
            values[f.name] = f.default
        elif meta["kind"] == SEEDS:
            values[f.name] = _seeds(table[f.name], meta, file, full)
        elif meta["kind"] == COLUMNS:
            values[f.name] = _columns(table[f.name], file, full)
        elif isinstance(meta["kind"], list):
            if not isinstance(table[f.name], list):
                raise ConfigError(f"{file}: {full} = {_shown(table[f.name])} must be a list")
            values[f.name] = tuple(_value(v, meta["kind"][0], meta, file, full) for v in table[f.name])
        elif isinstance(meta["kind"], type) and is_dataclass(meta["kind"]):
            if not isinstance(table[f.name], dict):
                raise ConfigError(f"{file}: {full} = {_shown(table[f.name])} must be a section, [{full}]")
            values[f.name] = _fill(meta["kind"], table[f.name], file, full)
        else:
            values[f.name] = _value(table[f.name], meta["kind"], meta, file, full)
    return kind(**values)


_KINDS = {int: "a whole number", float: "a number", str: "text in quotes", bool: "true or false"}


def _value(value: Any, kind: type, meta: Mapping[str, Any], file: str, full: str) -> Any:
    """One value of the right type, within its limits."""
    given = value
    fits = isinstance(value, (int, float)) if kind is float else isinstance(value, kind)
    if not fits or (isinstance(value, bool) and kind is not bool):
        raise ConfigError(f"{file}: {full} = {_shown(value)} must be {_KINDS[kind]}")
    if kind is float:
        try:
            value = float(value)
        except OverflowError:
            value = float("inf") if value > 0 else float("-inf")
    low, high, choices = meta["low"], meta["high"], meta["choices"]
    if choices is not None and value not in choices:
        near = difflib.get_close_matches(str(value)[:60], [str(c) for c in choices], 1)
        answer = out_of_scope(str(value))
        hint = f"; {answer}" if answer else f"; did you mean {near[0]!r}?" if near else ""
        raise ConfigError(f"{file}: {full} = {_shown(value)} must be one of {', '.join(map(repr, choices))}{hint}")
    if low is not None and not low <= value <= high:
        ask = meta["asks"][0 if value < low else 1]
        said = f"{file}: {full} = {_shown(given)} is outside [{low:g}, {high:g}]"
        raise ConfigError(f"{said}: {ask}" if ask else said)
    return value


def _seeds(value: Any, meta: Mapping[str, Any], file: str, full: str) -> tuple[int, ...]:
    """A list of random seeds; a number n stands for the seeds 1 to n."""
    if isinstance(value, list):
        return tuple(_value(seed, int, meta, file, full) for seed in value)
    if not isinstance(value, int) or isinstance(value, bool):
        raise ConfigError(f"{file}: {full} = {_shown(value)} must be a whole number or a list of whole numbers")
    if not 1 <= value <= MOST_SEEDS:
        raise ConfigError(f"{file}: {full} = {_shown(value)} is outside [1, {MOST_SEEDS}]")
    return tuple(range(1, value + 1))


def _columns(value: Any, file: str, full: str) -> tuple[tuple[str, str], ...]:
    """The columns of the pairs file as (name of the project, name in the file)."""
    from analysis.inputs.checks import InputError
    from analysis.inputs.column_names import check_mapping

    if not isinstance(value, dict):
        raise ConfigError(f"{file}: {full} = {_shown(value)} must be a section, [{full}]")
    try:
        check_mapping(value)
    except InputError as error:
        raise ConfigError(f"{file}: {full}: {error}") from None
    return tuple(value.items())


def _shown(value: Any) -> str:
    """A value for one line of an error; long ones are cut."""
    try:
        return shown(repr(value), 80)
    except ValueError:  # a whole number of more than 4,300 digits
        return "a number of more than 4,300 digits"


def jobs(config: Config) -> int:
    """Return the number of runs at once: `run.jobs`, or one per core that this process may use."""
    return config.run.jobs or len(os.sched_getaffinity(0))


def places(config: Config) -> int:
    """Return the number of places for runs at once: each run takes as many cores as it has ranks."""
    return max(1, jobs(config) // config.run.ranks)


def inputs_settings(config: Config) -> dict[str, Any]:
    """Return what the joint distribution of the inputs depends on, apart from the pairs and Poisson's ratio.

    Sections that are absent, and keys that are newer than the first plans, are left out where they have their default,
    so that digests and run ids of these plans hold.
    """
    settings = asdict(config.inputs)
    del settings["pairs_behind"]
    if not config.inputs.columns:
        del settings["columns"]
    stated = {"variables": config.variables, "dependence": config.dependence} if config.variables else {}
    return settings | stated


def assembly_file(packing: int, point: int = -1) -> str:
    """Return the name of the file with the grains of a packing; with `point` of the one that this point has alone."""
    return f"assembly_{packing}.h5" if point < 0 else f"assembly_{packing}_point_{point}.h5"


def grains_file(config: Config, point: int) -> str:
    """Return the name of the file with the properties of a point's single grains.

    The name ends in the hash of the settings that the properties are drawn with, and run ids contain the name.
    """
    drawn_with = json.dumps([inputs_settings(config), config.material.nu, config.assembly.N], sort_keys=True)
    return f"grains_{point}_{digest(drawn_with.encode(), 8)}.h5"
