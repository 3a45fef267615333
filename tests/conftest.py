"""Makes the packages importable from the root, and skips nothing silently: a YADE test without YADE is an error by default."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
