#!/usr/bin/python3
"""Stands before `yade` in the kill test: the row it is given saves a checkpoint every CHECKPOINT_SECONDS seconds."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from campaign.run_one import read_task

table, line = os.environ["YADE_BATCH"].rsplit(":", 1)
cells = read_task(Path(table), int(line)).cells | {"checkpoint_seconds": os.environ["CHECKPOINT_SECONDS"]}
often = Path("batch", f"often_{cells['description']}.table")
often.write_text("  ".join(cells) + "\n" + "  ".join(cells.values()) + "\n")
os.environ["YADE_BATCH"] = f"{often}:2"
os.execvp("yade", ["yade", *sys.argv[1:]])
