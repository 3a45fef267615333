"""The friction angle that a stress ratio mobilises in triaxial compression."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def friction_angle(eta: ArrayLike) -> np.ndarray:
    """Friction angle in degrees that is mobilised in triaxial compression, sin phi = 3 eta / (6 + eta).

    Stress ratios are limited to the range of possible stresses, -1.5 (extension) to 3.
    """
    ratio = np.clip(np.asarray(eta, float), -1.5, 3.0)
    return np.degrees(np.arcsin(3 * ratio / (6 + ratio)))
