"""Checks of a campaign file that concern several keys or a text with a format of its own, and warnings on settings."""

from __future__ import annotations

import math
import re

from analysis.errors_and_files import GrainScatterError
from analysis.quantities import CRITICAL_BLOCK, CRITICAL_FROM
from campaign.config_keys import Settings

#: Standard deviation of the critical void ratio of single packings of 1,000 spheres (the laptop campaign), and slope of
#: the critical state line, -de / d ln p' (tests/benchmarks/bench_paths.py, 0.13 to 5 MPa).
VOID_RATIO_SCATTER, CRITICAL_SLOPE = 0.004, 0.0035
#: Number of spheres below which p' of an undrained test scatters too widely.
FEW_UNDRAINED = 1000
#: Width of the last windows of a record in strain (yade_scripts/record.py), whose means are the last values.
LAST_WINDOW = 0.005


class ConfigError(GrainScatterError):
    """A campaign file cannot be used; the text names the file, the key, the value and the limit."""


def check_together(config: Settings, file: str) -> None:
    """Check limits that concern several keys, and texts with a format of their own."""
    lists = {"assembly.packings": config.assembly.packings, "consolidation.mu_iso": config.consolidation.mu_iso}
    for full, values in lists.items():
        if not values:
            raise ConfigError(f"{file}: {full} is empty; at least one value is needed")
        names = [f"{value:g}" if isinstance(value, float) else str(value) for value in values]  # groups in results.h5
        if twice := [name for name in names if names.count(name) > 1]:
            raise ConfigError(
                f"{file}: {full} = {list(values)} names a value twice: {twice[0]} in the six digits that name it"
            )
    strains = config.shear.snapshots
    written = [float(f"{strain:g}") for strain in strains]  # in the tables of runs
    if any(b <= a for a, b in zip(written, written[1:], strict=False)):
        raise ConfigError(f"{file}: shear.snapshots = {list(strains)} must increase in their first six digits")
    if strains and strains[-1] > config.shear.strain_end:
        raise ConfigError(
            f"{file}: shear.snapshots has {strains[-1]:g}, beyond strain_end = {config.shear.strain_end:g}"
        )
    shear, scale = config.shear, config.dem.stiffness_scale
    if shear.path != "drained" and scale != 1.0:
        raise ConfigError(
            f"{file}: dem.stiffness_scale = {scale:g} with shear.path = {shear.path!r}: only 1 is possible, because "
            "softer grains change the void ratio that belongs to a mean stress"
        )
    _check_code(config, file)
    if shear.stiff_cap_MPa * 1e3 <= config.consolidation.sigma_3_kPa:
        raise ConfigError(
            f"{file}: shear.stiff_cap_MPa = {shear.stiff_cap_MPa:g} must exceed consolidation.sigma_3_kPa = "
            f"{config.consolidation.sigma_3_kPa:g}"
        )
    if config.pdem.stop_when:
        try:
            parse_share(config.pdem.stop_when)
        except ConfigError as error:
            raise ConfigError(f"{file}: pdem.stop_when = {error}") from None
    slurm = config.run.slurm
    if not re.fullmatch(r"[\w.,@+-]*", slurm.partition):
        raise ConfigError(f"{file}: run.slurm.partition = {slurm.partition!r} is no name of a partition")
    for option in slurm.options:
        if not re.fullmatch(r"-[\w-].*", option) or not option.isprintable():
            raise ConfigError(
                f"{file}: run.slurm.options = {option!r} must be one option in one line, such as '--qos=low'"
            )
    if not re.fullmatch(r"([0-9]+-)?[0-9]+(:[0-9][0-9]){0,2}", config.run.slurm.time):
        raise ConfigError(f"{file}: run.slurm.time = {config.run.slurm.time!r} is no SLURM time such as '24:00:00'")
    if not re.fullmatch(r"[0-9]+[KMGT]?", config.run.slurm.memory):
        raise ConfigError(f"{file}: run.slurm.memory = {config.run.slurm.memory!r} is no SLURM size such as '2G'")


def _check_code(config: Settings, file: str) -> None:
    """Refuse what the DEM code cannot do; raises ConfigError."""
    if config.dem.code == "yade":
        if config.run.ranks > 1:
            raise ConfigError(
                f'{file}: run.ranks = {config.run.ranks} needs dem.code = "lammps": YADE runs on one thread'
            )
        return
    shear = config.shear
    for full, value, only in (
        ("shear.path", shear.path, "drained"),
        ("shear.direction", shear.direction, "compression"),
        ("shear.stop_when_steady", shear.stop_when_steady, False),
        ("dem.damping", config.dem.damping, 0.0),
        ("material.heterogeneity", config.material.heterogeneity, "specimen"),
    ):
        if value != only:
            raise ConfigError(
                f'{file}: {full} = {_toml(value)} with dem.code = "lammps": only {_toml(only)} is possible; '
                'use dem.code = "yade"'
            )


def _toml(value: object) -> str:
    """A value as a campaign file has it."""
    return str(value).lower() if isinstance(value, bool) else f'"{value}"' if isinstance(value, str) else f"{value:g}"


def parse_share(text: str) -> float:
    """Return 0.05 for "5%" or "0.05". Raises ConfigError if the text states no share between 0 and 1.

    The stopping rule of the analysis has a function of its own for this, so that neither side imports the other; a test
    compares the two.
    """
    number = text.strip()
    try:
        share = float(number.removesuffix("%")) / (100 if number.endswith("%") else 1)
    except ValueError:
        share = float("nan")
    if not 0 < share < 1:
        raise ConfigError(f"{text!r} must be a share such as '5%' or '0.05'")
    return share


def scatter_of_pressure(N: int) -> str:
    """Return what the scatter of packings of N spheres means for p' of an undrained test, in words."""
    factor = math.exp(VOID_RATIO_SCATTER * math.sqrt(1000.0 / N) / CRITICAL_SLOPE)
    return (
        f"at a given void ratio p' of single packings at the critical state scatters by a factor of about {factor:.0f}"
    )


def settings_warnings(config: Settings) -> list[str]:
    """Return warnings about settings that are possible but may not give what is expected."""
    shear, least, warnings = config.shear, CRITICAL_FROM + CRITICAL_BLOCK, []
    window = shear.strain_end / shear.windows if shear.windows else LAST_WINDOW
    if shear.strain_end - 0.5 * window < least:
        warnings.append(
            f"shear.strain_end = {shear.strain_end:g}: critical states are judged between strain {CRITICAL_FROM:g} and "
            f"the middle of the last window, which must be at {least:g} at least (strain_end = "
            f"{least + 0.5 * window:g}); none will be given"
        )
    if shear.path == "undrained" and (N := config.assembly.N) < FEW_UNDRAINED:
        warnings.append(
            f'assembly.N = {N} with shear.path = "undrained": {scatter_of_pressure(N)}; use N >= {FEW_UNDRAINED}'
        )
    return warnings
