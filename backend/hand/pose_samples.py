"""Random natural poses: mixes of gestures, and poses of the library."""

from __future__ import annotations

import numpy as np

from .gestures import sample_angles_deg
from .poses import POSES

LIBRARY_SHARE = 0.4
"""Of the poses that are the library's: fists, pinches and grasps, which mixes of gestures hardly reach."""
_NOISE_DEG = np.array([3.0, 1.5, 1.0])  # of flexion, abduction and twist


def sample_poses_deg(rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw [count, 15, 3] joint angles, degrees from the built-in hand's rest pose; parts may cross a little."""
    library = [pose.gesture.angles_deg() for pose in POSES.values()]
    angles = sample_angles_deg(rng, count)
    for k in np.flatnonzero(rng.random(count) < LIBRARY_SHARE):
        angles[k] = library[rng.integers(len(library))] + rng.normal(size=(15, 3)) * _NOISE_DEG
    return angles
