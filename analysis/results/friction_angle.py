"""The friction angle that a stress ratio mobilises in triaxial compression or extension."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def friction_angle(eta: ArrayLike, direction: str = "compression") -> np.ndarray:
    """Friction angle in degrees that is mobilised in triaxial compression, sin phi = 3 eta / (6 + eta).

    In extension, where eta is negative, sin phi = 3 |eta| / (6 - |eta|): the same formula with the other sign.  Stress
    ratios are limited to the range of possible stresses, -1.5 (extension) to 3.
    """
    ratio = np.clip(np.asarray(eta, float), -1.5, 3.0)
    angle = np.degrees(np.arcsin(3 * ratio / (6 + ratio)))
    return angle if direction == "compression" else -angle
