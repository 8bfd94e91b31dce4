"""How far a hand's joints bend: which angles are free, limits wide enough for any hand, and the usual ranges.

Figures of the usual ranges in degrees from the straight finger. Fingers, thumb MCP and IP: American Academy of
Orthopaedic Surgeons (AAOS), "Joint Motion: Method of Measuring and Recording", 1965. The rest are our estimates:
sideways motion beyond the knuckles, and the thumb's saddle joint, whose clinical zero differs from the rest pose. The
wrist bends about as far as AAOS has it, and hardly twists: the forearm does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .bones import FINGERS, finger_joints, rest_flexion_deg
from .model import HandModel

# Free are two of flexion, abduction and twist in a knuckle, all in the thumb's base; the other joints are hinges.
_FINGER = ((1, 1, 0), (1, 0, 0), (1, 0, 0))
_THUMB = ((1, 1, 1), (1, 0, 0), (1, 0, 0))
FREE = np.flatnonzero(np.array([_FINGER] * 4 + [_THUMB]).ravel())
"""[21] indices of the free angles among all 45 ([5, 3, 3] flattened)."""

# Degrees from the rest pose, in which the fingers are slightly bent; hence the negative limits.
_FINGER_DEG = ((-40, 100), (-30, 30), (-25, 115), (-25, 90))
_THUMB_DEG = ((-40, 60), (-45, 45), (-40, 50), (-30, 75), (-40, 95))
LIMITS = np.deg2rad(np.array(list(_FINGER_DEG) * 4 + list(_THUMB_DEG), float))
"""[21, 2] rad, smallest and largest."""


class JointRange(NamedTuple):
    """Smallest and largest flexion, abduction towards the thumb, and twist, degrees."""

    flexion: tuple[float, float]
    abduction: tuple[float, float]
    twist: tuple[float, float]


FINGER_RANGES = (
    JointRange((-45, 90), (-20, 20), (-15, 15)),  # MCP
    JointRange((0, 100), (-5, 5), (-5, 5)),  # PIP
    JointRange((-10, 90), (-5, 5), (-5, 5)),  # DIP
)
THUMB_RANGES = (
    JointRange((-30, 45), (-40, 40), (-20, 45)),  # CMC, from the rest pose
    JointRange((-10, 50), (-20, 20), (-20, 20)),  # MCP; AAOS has no hyperextension here
    JointRange((-20, 80), (-25, 25), (-20, 20)),  # IP
)
WRIST_RANGE = JointRange((-70, 70), (-35, 20), (-10, 10))


def usual_limits_deg(model: HandModel) -> np.ndarray:
    """Compute smallest and largest flexion, abduction and twist [15, 2, 3] of joints 1..15, degrees from rest."""
    ranges = np.empty((15, 2, 3))
    for finger in FINGERS:
        rows = [joint - 1 for joint in finger_joints(finger)]
        ranges[rows] = np.swapaxes(THUMB_RANGES if finger == "thumb" else FINGER_RANGES, 1, 2)
    ranges[..., 0] -= rest_flexion_deg(model)[:, None]
    return ranges
