"""Random natural poses: mixes of gestures, and poses of the library, in which parts touch but do not cross."""

from __future__ import annotations

import numpy as np

from .gestures import FingerAxes, sample_angles_deg
from .model import HandModel
from .penetration import HandParts, relieved_angles
from .poses import POSES

LIBRARY_SHARE = 0.4
"""Of the poses that are the library's: fists, pinches and grasps, which mixes of gestures hardly reach."""
_NOISE_DEG = np.array([3.0, 1.5, 1.0])  # of flexion, abduction and twist


def sample_poses_deg(rng: np.random.Generator, count: int, model: HandModel, axes: FingerAxes) -> np.ndarray:
    """[count, 15, 3] joint angles, degrees from the rest pose, about `axes`, of a right hand.

    Fingers of the mean hand touch by half a millimetre at most, where that can be reached.
    """
    parts = HandParts(model)
    library = [pose.gesture.angles_deg() for pose in POSES.values()]
    angles = sample_angles_deg(rng, count)
    for k in np.flatnonzero(rng.random(count) < LIBRARY_SHARE):
        angles[k] = library[rng.integers(len(library))] + rng.normal(size=(15, 3)) * _NOISE_DEG
    return np.stack([relieved_angles(parts, model, one, axes) for one in angles])
