"""The palm and the stump of the forearm, a super-elliptic sweep along the hand. Anatomical frame, mm."""

from __future__ import annotations

import numpy as np

from .dependencies import needs
from .primitives import superellipsoid
from .smooth import smoothstep

with needs("scipy"):
    from scipy.interpolate import PchipInterpolator

# Sections, tuned by eye: position along d; centre in r; half breadth; centre in h; half depth dorsal and palmar.
_SECTIONS = np.array(
    [
        (-60, -1.0, 29.5, 0.0, 19.5, 19.5),
        (-30, -0.5, 28.0, 0.0, 18.5, 18.5),
        (-12, 0.0, 27.5, 0.0, 18.0, 18.5),
        (4, 0.0, 28.0, 0.0, 17.5, 18.5),
        (18, -0.5, 29.0, 0.5, 16.0, 17.5),
        (35, -2.0, 31.0, 1.0, 13.5, 14.5),
        (55, -3.0, 34.5, 1.5, 11.5, 12.0),
        (75, -3.0, 37.5, 1.0, 10.5, 12.0),
        (90, -3.0, 38.5, 0.0, 10.0, 12.0),
        (110, -3.0, 38.5, -1.0, 9.0, 11.0),
    ]
)
# The slanted distal end: offset of d at each r.
_SLANT = np.array([(-45, -22), (-31, -16), (-14.5, -5), (4.5, 2), (25.5, 0), (45, -6)], dtype=float)
_CAP_START, _CAP_LENGTH = 80.0, 13.0
_EXPONENT = 2.5


def palm_distance(points: np.ndarray) -> np.ndarray:
    """Compute signed distance [N] of points [N, 3] to the palm and an endless forearm, without digits."""
    d, h, r = points.T
    slant = PchipInterpolator(_SLANT[:, 0], _SLANT[:, 1])(np.clip(r, -45, 45))
    along = d - slant * smoothstep(d, 20, 80)
    place = np.clip(along, -60, 110)
    centre_r, breadth, centre_h, dorsal, palmar = (
        PchipInterpolator(_SECTIONS[:, 0], column)(place) for column in _SECTIONS[:, 1:].T
    )
    transverse_arch = ((r - centre_r) / 40) ** 2 * 3.0 * smoothstep(d, 30, 80)
    height = h - (centre_h - transverse_arch)
    depth = np.where(height > 0, dorsal, palmar)
    past_end = np.where(along > _CAP_START, (along - _CAP_START) / _CAP_LENGTH, 0)
    scaled = ((r - centre_r) / breadth, height / depth, past_end)
    return superellipsoid(scaled, (breadth, depth, _CAP_LENGTH), _EXPONENT)
