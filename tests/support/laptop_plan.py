"""What the plan predicts for the runs of the laptop campaign in the repository."""

from __future__ import annotations

from paths import ROOT

from analysis.points import RepresentativePoints
from campaign.config import read_config
from campaign.plan import PlannedRun, make_rows


def rows() -> list[PlannedRun]:
    """All runs of campaign/laptop.toml."""
    points = RepresentativePoints.from_csv((ROOT / "data" / "laptop" / "points.csv").read_text())
    return make_rows(read_config(ROOT / "campaign" / "laptop.toml"), points)


def planned() -> dict[tuple[str, str, float, int], PlannedRun]:
    """(stage, family, mu_iso, point) -> a run of campaign/laptop.toml; its cost does not depend on its packing."""
    return {(row.stage, row.family, row.mu_iso, row.point): row for row in rows()}
