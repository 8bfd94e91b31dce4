"""How far a hand's joints bend: which angles are free, and their limits, wide enough for any hand."""

from __future__ import annotations

import numpy as np

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
