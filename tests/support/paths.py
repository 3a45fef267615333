"""Where things lie in the repository."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "data"
PAIRS_FILE = DATA / "pairs_reconstructed.csv"
SCENES = ROOT / "tests" / "yade" / "scenes"
