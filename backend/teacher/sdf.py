"""The signed distance of the hand: a smooth union of palm, forearm, five rays, webs, pads, knuckles and tendons.

Points are [N, 3] in the anatomical frame, mm; distances [N] mm, negative inside. Distances are first-order: accurate on
and near the surface only.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .anatomy import FINGER_THICKNESS, FINGERS
from .dependencies import needs
from .details import detail_offset
from .forearm import STUMP_MM, cut_off, with_forearm
from .primitives import ball, capsule, ellipsoid, superellipsoid, triangle
from .rays import Ray, RayCoordinates
from .smooth import bump, smooth_min, smoothstep, unit

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


BOUNDS = (np.array([-40.0, -62.0, -56.0]), np.array([196.0, 36.0, 104.0]))
"""A bounding box of the hand without a forearm."""

Coordinates = dict[str, RayCoordinates]


def signed_distance(
    rays: dict[str, Ray], points: np.ndarray, with_details: bool = True, forearm_mm: float = STUMP_MM
) -> np.ndarray:
    """Compute signed distance of the hand.

    Args:
        rays: the digits.
        points: [N, 3].
        with_details: adds creases, folds and nails.
        forearm_mm: how far the hand goes on beyond the wrist joint; if that is more than the stump, into a forearm.
    """
    at = {digit: ray.coordinates(points) for digit, ray in rays.items()}
    palm = palm_distance(points)
    if forearm_mm > STUMP_MM:
        palm = with_forearm(palm, points)
    finger_radius = np.interp(points[:, 0], [0, 60, 90, 110], [10, 9, 7, 3])
    distance = smooth_min(palm, _fingers(rays, at, points), finger_radius)
    distance = _with_pads(distance, points)
    thumb_radius = np.interp(at["thumb"].along, [-46, -14, 0, 14], [12, 16, 12, 2])
    distance = smooth_min(distance, _thumb(rays, at, points), thumb_radius)
    for finger in FINGERS:
        distance = _with_knuckle(distance, rays[finger], at[finger], points)
    distance = smooth_min(distance, ball(points, np.array([-20, 9.0, -13.5]), 7.8), 9.0)  # ulnar styloid
    distance = cut_off(distance, points, forearm_mm)
    return distance + detail_offset(rays, at) if with_details else distance


def _fingers(rays: dict[str, Ray], at: Coordinates, points: np.ndarray) -> np.ndarray:
    """Join the four fingers and the webs between them; the blend is wide in the palm and narrow past the web."""
    radius = {finger: np.interp(at[finger].along, [-40, -8, 6, 16, 24], [9, 7, 6, 3.5, 1.0]) for finger in FINGERS}
    distance = at[FINGERS[0]].distance
    pairs = list(pairwise(FINGERS))
    for left, right in pairs:
        distance = smooth_min(distance, at[right].distance, np.minimum(radius[left], radius[right]))
    for left, right in pairs:
        distance = smooth_min(distance, _web(rays[left], rays[right], points), 4.0)
    return distance


def _web(radial: Ray, ulnar: Ray, points: np.ndarray) -> np.ndarray:
    """Measure distance to a capsule from between two MCP joints to between the two fingers, on their palmar side."""
    along = 9.5 if ulnar.digit == "pinky" else 11.5
    i = radial.nearest_sample(along)
    j = ulnar.nearest_sample(along if ulnar.digit == "middle" else along + 2)
    start = (radial.joints[0] + ulnar.joints[0]) / 2 - np.array([6, 2, 0])
    end = (radial.centre[i] + ulnar.centre[j]) / 2 - unit(radial.dorsal[i] + ulnar.dorsal[j]) * 3.2
    return capsule(points, start, end, 8.0, 4.2)


def _with_pads(distance: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Add the hypothenar eminence and the pad under the MCP joints."""
    up = np.array([0.0, 1.0, 0.0])
    hypothenar = ellipsoid(points, (np.array([0, -9, -15.0]), np.array([78, -7, -33.0])), up, 12.0, 12.5)
    pad = ellipsoid(points, (np.array([84, -10.5, 27]), np.array([72, -11.5, -34])), up, 10.0, 6.0)
    return smooth_min(smooth_min(distance, hypothenar, 9.0), pad, 8.0)


def _thumb(rays: dict[str, Ray], at: Coordinates, points: np.ndarray) -> np.ndarray:
    """Join the thumb's ray, the thenar eminence and the first web."""
    thumb, index = rays["thumb"], rays["index"]
    ends = (np.array([6, -13, 6.0]), np.array([61, -25, 38.0]))
    thenar = ellipsoid(points, ends, np.array([0, 1, 0.3]), 13.5, 13.5)
    i, j = thumb.nearest_sample(-9.0), index.nearest_sample(-27.0)
    corners = (
        np.array([30, -4, 14.0]),
        thumb.centre[i] - thumb.dorsal[i] * 3,
        index.centre[j] - index.dorsal[j] * 4,
    )
    web = triangle(points, corners) - 5.0
    return smooth_min(smooth_min(at["thumb"].distance, thenar, 8.0), web, 12.0)


def _with_knuckle(distance: np.ndarray, ray: Ray, at: RayCoordinates, points: np.ndarray) -> np.ndarray:
    """Add a finger's MCP knuckle and extensor tendon, and the valley between its metacarpal and the next."""
    height = 4.6 * FINGER_THICKNESS[ray.digit] + 0.4
    centre = ray.joints[0] + ray.dorsal[ray.nearest_sample(0.0)] * height - np.array([1.5, 0, 0])
    distance = smooth_min(distance, ball(points, centre, 6.0, np.array([1.25, 1, 1.05])), 5.0)
    on_back = smoothstep(at.dorsal, 2, 6)
    tendon = smoothstep(at.along, -ray.metacarpal - 4, -ray.metacarpal + 14) * smoothstep(at.along, 2, -12)
    valley = smoothstep(at.along, -48, -22) * smoothstep(at.along, 8, -6)
    distance = distance - bump(at.lateral, 2.1) * on_back * tendon * 0.75
    return distance + on_back * bump(np.abs(at.lateral) - 9.5, 3.2) * valley * 0.7
