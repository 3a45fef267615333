"""A sweep: one campaign per value of a key, in one folder; each run that several of them plan is made once.

Further values, and other keys of the same campaign file, may be swept in the same folder later.

<folder>/<key>=<value>/           the campaign of one value: a folder like that of any other campaign
<folder>/<key>.csv, <key>.png     mean and standard deviation of the states against the key
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.errors_and_files import GrainScatterError, atomic_write
from campaign import pace
from campaign.cell import check_cell
from campaign.config import Config
from campaign.folder import folder_lock
from campaign.plan import PlannedRun, predicted_cost
from campaign.products import run_statuses
from campaign.sweep_values import Variant

if TYPE_CHECKING:
    import pandas as pd


def run_sweep(
    key: str,
    campaigns: Sequence[Variant],
    folder: Path,
    plan: Callable[[Config, Path], Sequence[PlannedRun]],
    everything: Callable[[Config, Path], int],
) -> int:
    """Plan, run, analyse and report the campaigns, write table and figure of the states, and return the exit code.

    plan: plans a campaign in a folder. everything: runs, analyses and reports it, and returns its exit code. All values
    are planned before the first run. A campaign that ends with an error is named, and the others go on. The exit code
    is the largest of the campaigns'; an error counts as 2. Raises the errors of `plan`, and RunError if another process
    works in the folder; a cell that is too thin for one of the values is found before anything is written.
    """
    for one in campaigns:
        check_cell(one.config)
    with folder_lock(folder):
        planned = [(folder / one.folder, plan(one.config, folder / one.folder)) for one in campaigns]
        rows = {row.run_id: row for _, rows_of_one in planned for row in rows_of_one}
        hours = predicted_cost(list(rows.values()))["total"]["core_hours"]
        print(f"{key}: {len(campaigns)} values, {len(rows)} different runs, {hours:.2f} core-hours (predicted)")
        print(pace.sentence(list(rows.values()), folder), end="")
        code, analysed = 0, []
        for one, (place, rows_of_one) in zip(campaigns, planned, strict=True):
            print(f"\n{key} = {one.value}")
            others = sorted(path.parent for path in folder.glob("*/products"))
            if shared := share_products(place, rows_of_one, others):
                print(f"{one.config.name}: {shared} runs are there already, in the folder of another value")
            try:
                ended = everything(one.config, place)
            except GrainScatterError as error:
                print(f"campaign: {key} = {one.value}: {' '.join(str(error).split())}", file=sys.stderr)
                ended = 2
            code = max(code, ended)
            if not ended:
                analysed.append((one.value, place))
        if analysed:
            print("\n".join(["", *write_results(key, analysed, folder)]))
        if missing := len(campaigns) - len(analysed):
            print(f"campaign: the table lacks {missing} of {len(campaigns)} values of {key}; "
                  "the same command goes on from here", file=sys.stderr)  # fmt: skip
    return code


def share_products(folder: Path, rows: Sequence[PlannedRun], others: Sequence[Path]) -> int:
    """Give a campaign the products that the folders of others have of its runs, by run id; return their number.

    A product gets a second name (a hard link), or is copied where the file system has none. Only a product that can be
    used is taken. Raises OSError if a folder cannot be read or written.
    """
    count = 0
    with folder_lock(folder, "products"):
        for other in others:
            common = [row for row in rows if (other / row.product).exists() and not (folder / row.product).exists()]
            statuses = run_statuses(other, common) if common else {}
            for row in common:
                if statuses[row.run_id].status == "done":
                    _link(other / row.product, folder / row.product)
                    count += 1
    return count


def _link(source: Path, target: Path) -> None:
    with atomic_write(target) as part:
        part.unlink(missing_ok=True)
        try:
            os.link(source, part)
        except OSError:
            shutil.copy2(source, part)


def write_results(key: str, campaigns: Sequence[tuple[str, Path]], folder: Path) -> list[str]:
    """Write the table and the figure of the states against the key; return lines on what was written.

    campaigns: value in words and folder of each campaign that has been analysed. Raises OSError if a file cannot be
    read or written.
    """
    import pandas as pd

    from analysis.figures.style import save
    from analysis.figures.sweep import along_key
    from analysis.tables.registry import write_table
    from analysis.tables.sweep import sweep_table

    frames: list[tuple[str, pd.DataFrame]] = []
    for value, place in campaigns:
        frames.append((value, pd.read_csv(place / "tables" / "moments.csv")))
    table = sweep_table(key, frames)
    path = folder / f"{key}.csv"
    write_table(table, path)
    lines = [f"{path}: {len(table)} rows"]
    if table.empty:
        return [*lines, "no figure: a campaign has moments with at least 8 points per density"]
    picture = folder / f"{key}.png"
    save(along_key(table), picture, f"sweep of {key}, {len(frames)} values")
    return [*lines, str(picture)]
