"""The forearm: a super-elliptic sweep from the wrist towards the elbow, with its muscles. Anatomical frame, mm."""

from __future__ import annotations

import numpy as np

from .dependencies import needs
from .primitives import capsule, ellipsoid, superellipsoid
from .smooth import smooth_max, smooth_min, smoothstep

with needs("scipy"):
    from scipy.interpolate import PchipInterpolator

STUMP_MM = 34.0
"""How far the hand without a forearm goes on beyond the wrist joint."""
FOREARM_MM = 175.0
"""How far the hand with a forearm goes on: to where an adult's is thickest."""
ARM_FROM_MM = 10.0
"""Where its surface begins to differ from the stump's, beyond the wrist joint."""

# Sections, tuned by eye within an adult's measures: position along d; centre in r; half breadth; centre in h; half
# depth dorsal and palmar; exponent. The flexors lie on the palmar and ulnar side.
_SECTIONS = np.array(
    [
        (-200, -2.5, 43.0, -3.5, 33.0, 40.0, 2.15),
        (-165, -2.5, 42.0, -3.5, 32.5, 40.0, 2.15),
        (-130, -2.0, 37.5, -2.5, 28.0, 35.0, 2.2),
        (-95, -1.0, 31.5, -1.0, 22.5, 27.0, 2.25),
        (-62, 0.0, 28.2, 0.0, 19.3, 21.3, 2.35),
        (-40, 0.3, 27.3, 0.0, 18.3, 19.2, 2.5),
        (-24, 0.2, 27.2, 0.0, 18.2, 18.7, 2.5),
        (-12, 0.0, 27.5, 0.0, 18.0, 18.5, 2.5),
        (4, 0.0, 28.0, 0.0, 17.5, 18.5, 2.5),
    ]
)
_BLEND_MM = 18.0  # over which the palm's sweep gives way
_BRACHIORADIALIS = (np.array([-66.0, -4.0, 21.0]), np.array([-228.0, 3.0, 34.0]))
_EXTENSORS = (np.array([-70.0, 14.0, 6.0]), np.array([-224.0, 21.0, 8.0]))
_ULNA = (np.array([-22.0, 9.5, -15.5]), np.array([-205.0, 15.0, -31.0]))
_DEEPEST_MM = 10.0  # under a muscle's surface; on its axis, a first-order distance is far too large for the round end
_SIDE_MM = 9.0  # to both sides of the centre, over which the dorsal depth becomes the palmar one
_BEND_MM = 25.0  # to both sides of the wrist joint
_ATLAS_SCALE, _ATLAS_BLEND_MM = 0.5, 60.0
_CUT_ROUNDING, _END_ROUNDING = 5.0, 40.0  # mm


def with_forearm(palm: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Join the distance [N] to the palm with an endless forearm beyond the wrist instead of the palm's own."""
    share = smoothstep(-points[:, 0], ARM_FROM_MM, ARM_FROM_MM + _BLEND_MM)
    near = share > 0
    joined = palm.copy()
    joined[near] += share[near] * (_forearm_distance(points[near]) - palm[near])
    return joined


def cut_off(distance: np.ndarray, points: np.ndarray, forearm_mm: float) -> np.ndarray:
    """Cut the distance [N] to what lies within `forearm_mm` of the wrist; a forearm ends rounder than the stump."""
    rounding = _CUT_ROUNDING if forearm_mm <= STUMP_MM else _END_ROUNDING
    return smooth_max(distance, -forearm_mm - points[:, 0], rounding)


def arm_weights(vertices: np.ndarray, wrist_weights: np.ndarray) -> np.ndarray:
    """Compute [V] as in `HandModel`, of vertices [V, 3] (build frame) with these weights [V] of joint 0."""
    return wrist_weights * smoothstep(vertices[:, 0], -_BEND_MM, _BEND_MM)


def squeezed_for_atlas(vertices: np.ndarray) -> np.ndarray:
    """Shrink the forearm of vertices [V, 3] (build frame) to half its size, so that the atlas gives it less room."""
    beyond = np.maximum(vertices[:, 0] - ARM_FROM_MM, 0)
    points = np.linspace(0, FOREARM_MM, 512)
    scale = 1 - (1 - _ATLAS_SCALE) * smoothstep(points, 0, _ATLAS_BLEND_MM)
    length = np.concatenate([[0], np.cumsum((scale[1:] + scale[:-1]) / 2 * np.diff(points))])
    along = vertices[:, 0] - beyond + np.interp(beyond, points, length)
    return np.column_stack([along, vertices[:, 1:] * np.interp(beyond, points, scale)[:, None]])


def _forearm_distance(points: np.ndarray) -> np.ndarray:
    d, h, r = points.T
    place = np.clip(d, _SECTIONS[0, 0], _SECTIONS[-1, 0])
    section = PchipInterpolator(_SECTIONS[:, 0], _SECTIONS[:, 1:])(place)
    centre_r, breadth, centre_h, dorsal, palmar, exponent = section.T
    height = h - centre_h
    depth = dorsal + (palmar - dorsal) * smoothstep(height, _SIDE_MM, -_SIDE_MM)
    distance = superellipsoid(((r - centre_r) / breadth, height / depth), (breadth, depth), exponent)
    up = np.array([0.0, 1.0, 0.0])
    brachioradialis = ellipsoid(points, _BRACHIORADIALIS, up, 15.0, 17.0)
    floor = np.full_like(d, -_DEEPEST_MM)
    extensors = ellipsoid(points, _EXTENSORS, up, 18.0, 11.0)
    distance = smooth_min(distance, smooth_max(brachioradialis, floor, 8.0), 12.0)
    distance = smooth_min(distance, smooth_max(extensors, floor, 8.0), 10.0)
    return smooth_min(distance, capsule(points, *_ULNA, 5.5, 8.0), 10.0)
