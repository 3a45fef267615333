"""Products that no planned run uses: stale ones, of earlier settings, and refused ones, which cannot be used."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from campaign.files import write_text
from campaign.folder import SCRIPTS, SUMS, folder_lock
from campaign.plan import PlannedRun
from campaign.products import run_statuses, stale

#: Files of a run in the folder of products.
ENDINGS = (".h5", ".failed.json", ".checkpoint")


def prune_products(folder: Path, rows: Sequence[PlannedRun], *, remove: bool) -> str:
    """Return a line on every product that is stale or refused; with `remove` the files are removed.

    Runs that only the archive (runs.h5) holds are not listed: the archive is kept. Raises RunError if another process
    runs in the folder, OSError if a file cannot be removed, and the errors of `run_statuses`.
    """
    if not remove:
        files = prunable(folder, rows)
        return _listed(folder, files) + ("\n`prune --yes` removes them" if files else "")
    with folder_lock(folder):
        files = prunable(folder, rows)
        text = _listed(folder, files)
        for path in files:
            if path.suffix == SCRIPTS:
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink()
        _forget_sums(folder / "products")
    return text + ("\nremoved" if files else "")


def prunable(folder: Path, rows: Sequence[PlannedRun]) -> dict[Path, str]:
    """Return the files of stale and refused products with the reason, stale ones first."""
    products = folder / "products"
    found = {}
    for run_id in stale(folder, rows):
        for ending in ENDINGS:
            if (path := products / f"{run_id}{ending}").is_file():
                found[path] = "stale: a product of earlier settings"
    planned = {row.run_id for row in rows}
    for ending in ENDINGS[1:]:  # failures and checkpoints of earlier settings have no product
        for path in sorted(products.glob(f"[!.]*{ending}")):
            if path.name.removesuffix(ending) not in planned:
                found.setdefault(path, "stale: left by a run of earlier settings")
    for path in sorted(products.glob(f"[!.]*{SCRIPTS}")):
        if path.name.removesuffix(SCRIPTS) not in planned and path.is_dir() and not path.is_symlink():
            found[path] = "stale: the scripts of a run of earlier settings"
    for status in run_statuses(folder, rows).values():
        if status.status == "refused":
            found[products / f"{status.run_id}.h5"] = f"refused: {status.reason}"
    for path in sorted((products / "refused").glob("*.h5")):
        found[path] = "refused before, and its run was repeated or is missing"
    return found


def _listed(folder: Path, files: dict[Path, str]) -> str:
    lines = [f"{os.path.relpath(path, folder)}: {reason}" for path, reason in files.items()]
    every = [file for path in files for file in (path.iterdir() if path.suffix == SCRIPTS else [path])]
    size = sum(path.stat().st_size for path in every) / 2**20
    return "\n".join([*lines, f"{folder.name}: {len(every)} files, {size:.1f} MiB"])


def _forget_sums(products: Path) -> None:
    """Leave out the checksums of products that are gone, so that `sha256sum --check` finds every file."""
    path = products / SUMS
    if not path.exists():
        return
    kept, note = [], ""
    for line in path.read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith("#"):
            note = line
            continue
        part = line.split()
        if len(part) != 2 or (products / part[1]).exists():
            kept += [text for text in (note, line) if text]
        note = ""
    write_text(path, "".join(f"{line}\n" for line in kept))
