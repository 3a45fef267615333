"""Refits of the inputs: what the number of measurements behind them leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .joint import Joint, bootstrap_joints
from .pairs import FEWEST_PAIRS
from .refits import Candidates
from .specified import SpecifiedInputs, bootstrap_specified


def measurements_behind(inputs: Mapping[str, Any], pairs: np.ndarray) -> int:
    """Number of measurements behind the inputs: the pairs (n, d), or those stated for distributions; 0: not known.

    `inputs` is the dictionary of inputs.json or of results.h5.
    """
    if inputs.get("specified"):
        return int(inputs.get("pairs_behind") or 0)
    return len(pairs) if len(pairs) >= FEWEST_PAIRS else 0


def refitted_joints(inputs: Mapping[str, Any], pairs: np.ndarray, n_boot: int, seed: int = 1) -> list[Joint]:
    """Joint distributions refitted to n_boot samples: of resampled pairs (n, d), or drawn from stated distributions.

    Each resample of pairs chooses among the families that were fitted; stated families stay.  Empty if the number of
    measurements behind the inputs is not known (`measurements_behind`), or if `inputs` has no joint distribution.
    """
    count, rng = measurements_behind(inputs, pairs), np.random.default_rng(seed)
    if not count or not inputs.get("joint"):
        return []
    if given := inputs.get("specified"):
        return bootstrap_specified(SpecifiedInputs.from_dict(given), count, n_boot, rng)
    candidates = Candidates.tried(inputs.get("marginals") or {}, inputs.get("copulas") or ())
    return bootstrap_joints(pairs, n_boot, rng, Joint.from_dict(dict(inputs["joint"])), candidates)
