"""What a run of LAMMPS leaves: samples, lists of contacts, snapshots, proofs, and why it ended."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from analysis.micromechanics.metrics import love_stress
from campaign.lammps.scene import CONTACTS, SAMPLES, SNAPSHOT

#: Relative difference of the stress from the contacts of a snapshot from LAMMPS' own that is refused.
STRESS_LIMIT = 1e-5


class LammpsError(RuntimeError):
    """A run that LAMMPS did not bring to its end, or whose output contradicts itself; the text is one line."""


def read_samples(path: Path, further: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Columns of the samples by name, each (T,), with `step`; raises LammpsError where a value is not finite.

    further: the columns that the script asked for beside SAMPLES.
    """
    rows = _table(path.name, path.read_text().splitlines())
    if rows.size == 0:
        raise LammpsError(f"{path.name} holds no sample")
    data = dict(zip(("step", *SAMPLES, *further), rows.T, strict=True))
    if not np.isfinite(data["sigma_zz"]).all():
        raise LammpsError("blow-up: the stress is not finite")
    return data


def stress(samples: dict[str, np.ndarray]) -> np.ndarray:
    """Stress tensors (T, 3, 3), Pa, compression positive."""
    return _tensors(samples, "sigma")


def mean_stress(samples: dict[str, np.ndarray]) -> np.ndarray:
    """Stress tensors (T, 3, 3), Pa, averaged over the steps since the sample before; the first is that of its step."""
    return np.concatenate([stress(samples)[:1], _tensors(samples, "mean")[1:]])


def centred(means: np.ndarray) -> np.ndarray:
    """Values (T, ...) at the samples from means over the intervals before them; the last is that of its interval.

    The mean over an interval is the value at its middle: alone, it would lag behind the strain by half an interval.
    """
    values = means.copy()
    values[1:-1] = 0.5 * (means[1:-1] + means[2:])
    return values


def fabric(samples: dict[str, np.ndarray]) -> np.ndarray:
    """Fabric tensors (T, 3, 3), the mean of n_i n_j; LAMMPS gives 15/2 times the deviatoric part."""
    return _tensors(samples, "C") * (2.0 / 15.0) + np.eye(3) / 3.0


def _tensors(samples: dict[str, np.ndarray], name: str) -> np.ndarray:
    return np.stack([np.stack([samples[f"{name}_{min(a + b, b + a)}"] for b in "xyz"], -1) for a in "xyz"], -2)


def _table(name: str, lines: list[str]) -> np.ndarray:
    """Numbers in the lines of a file (R, C); raises LammpsError where the file of that name was not written whole."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a file without lines
            return np.loadtxt(lines, ndmin=2)
    except ValueError as error:
        raise LammpsError(f"{name} is not whole: {' '.join(str(error).split())}") from None


def contact_lists(path: Path, columns: tuple[str, ...] = CONTACTS) -> Iterator[tuple[int, np.ndarray]]:
    """Step and contacts (C, columns) of every entry of a dump file.

    Raises LammpsError where the file was not written whole.
    """
    with open(path) as file:
        while line := file.readline():
            if line.startswith("ITEM: TIMESTEP"):
                step = int(file.readline())
            elif line.startswith("ITEM: NUMBER OF ENTRIES"):
                count = int(file.readline())
            elif line.startswith("ITEM: ENTRIES"):
                lines = [file.readline() for _ in range(count)]
                rows = _table(path.name, lines)
                if count and (rows.shape != (count, len(columns)) or not lines[-1].endswith("\n")):
                    raise LammpsError(f"{path.name} is not whole: it ends within the list of step {step}")
                yield step, rows.reshape(count, len(columns))


def read_snapshot(
    folder: Path, name: str, p: SimpleNamespace, G: float, eps_a: float, log: str
) -> tuple[dict, np.ndarray]:
    """Grains and contacts as a product holds them, and the masses (N,) kg; G: their shear modulus (Pa).

    Raises LammpsError unless the stress from the contacts is LAMMPS' own.
    """
    grains = (folder / f"{name}.grains").read_text().splitlines()
    bounds, table = (_table(f"{name}.grains", lines) for lines in (grains[5:8], grains[9:]))
    _, rows = next(contact_lists(folder / f"{name}.contacts", SNAPSHOT), (0, np.empty(0)))
    if len(table) != p.N or not len(rows):
        raise LammpsError(f"snapshot {name} is not whole: {len(table)} of {p.N} grains, {len(rows)} contacts")
    radius, cell = table[:, 1], np.diag(bounds[:, 1] - bounds[:, 0])
    ids = rows[:, :2].astype(np.int64) - 1
    swapped = ids[:, 0] > ids[:, 1]
    sign = np.where(swapped, -1.0, 1.0)[:, None]
    ids[swapped] = ids[swapped][:, ::-1]
    branch = -sign * rows[:, 2:5]  # LAMMPS: from the second to the first
    distance = np.linalg.norm(branch, axis=1)
    normal = branch / distance[:, None]
    overlap = radius[ids].sum(axis=1) - distance
    root = np.sqrt(radius[ids].prod(axis=1) / radius[ids].sum(axis=1))
    order = np.lexsort((ids[:, 1], ids[:, 0]))
    snapshot = {
        "label": name,
        "eps_a": float(eps_a),
        "position": table[:, 3:6] - bounds[:, 0],
        "radius": radius,
        "cell": cell,
        "contact_ids": ids[order],
        "normal": normal[order],
        "branch": branch[order],
        "overlap": overlap[order],
        "f_n": (rows[:, 5:6] * normal)[order],
        "f_t": (-sign * rows[:, 6:9])[order],
        "k_n": (2.0 * G / (1.0 - p.nu) * root * np.sqrt(overlap))[order],
        "k_t": (4.0 * G / (2.0 - p.nu) * root * np.sqrt(overlap))[order],
    }
    check_stress(snapshot, name, log)
    return snapshot, table[:, 2]


def check_stress(snapshot: dict, name: str, log: str) -> float:
    """Largest relative difference of the stress from the contacts from LAMMPS' own; LammpsError above STRESS_LIMIT."""
    found = re.findall(rf"^STRESS {name} (\S+) (\S+) (\S+) ", log, re.M)
    if not found:
        raise LammpsError(f"no stress of the snapshot {name} in the log")
    own = np.array(found[-1], float)
    force = snapshot["f_n"] + snapshot["f_t"]
    here = np.diag(love_stress(snapshot["branch"], force, float(np.linalg.det(snapshot["cell"]))))
    error = float(np.abs(here - own).max() / np.abs(own).max())
    if not error < STRESS_LIMIT:
        raise LammpsError(
            f"snapshot {name}: stress of the contacts is off LAMMPS' own by {error:.3g} > {STRESS_LIMIT:g}"
        )
    return error


def proofs(log: str, name: str) -> dict[str, float]:
    """Figures of the last proof of equilibrium printed under that name; empty without one."""
    found = re.findall(rf"^PROOF {name} (.*)$", log, re.M)
    words = found[-1].split() if found else []
    return {key: float(value) for key, value in zip(words[::2], words[1::2], strict=True)}
