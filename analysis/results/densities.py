"""Names of the densities of the soil, in the order of the interparticle friction during consolidation."""

from __future__ import annotations

from collections.abc import Sequence

#: Number of densities -> their names, the densest first.
NAMES = {
    1: ("one density",),
    2: ("dense", "loose"),
    3: ("dense", "medium", "loose"),
    4: ("dense", "medium dense", "medium loose", "loose"),
    5: ("very dense", "dense", "medium", "loose", "very loose"),
}


def density_names(densities: Sequence[float]) -> dict[float, str]:
    """Name of each density mu_iso: the lowest friction gives the densest packing.

    With more than five densities they are numbered from the densest, "density 1".
    """
    numbered = tuple(f"density {k + 1}" for k in range(len(densities)))
    return dict(zip(sorted(densities), NAMES.get(len(densities), numbered), strict=True))
