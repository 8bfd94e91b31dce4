"""How far the hand's surface lies from the cut end of its arm, or of its wrist, and what a fade leaves of it there."""

from __future__ import annotations

import numpy as np

from .bones import rest_bones, rest_forearm
from .model import HandModel


def distance_from_end_m(model: HandModel) -> np.ndarray:
    """Compute the distance [V], m, of the mean shape at rest from the plane across the end of the arm, or the wrist."""
    elbow = -(rest_forearm(model).frame if model.has_arm else rest_bones(model).frames[0])[:, 1]
    along = model.v_template @ elbow
    return along.max() - along


def opaque_share(distance_m: np.ndarray, fade_m: float) -> np.ndarray:
    """Compute what a fade of this length leaves at these distances from the end: 0 to 1, smoothly; 1 without a fade."""
    x = np.clip(distance_m / fade_m, 0, 1) if fade_m > 0 else np.ones_like(distance_m)
    return x * x * (3 - 2 * x)
