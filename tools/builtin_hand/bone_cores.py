"""Labels the parts of the surface that follow one bone only; skinning weights are interpolated between them.

The parts are the middles of the phalanges, with an oblique cut at the MCP joints (the palmar side follows the palm
further out), and the palm up to the knuckles. Points in the anatomical frame, mm.
"""

from __future__ import annotations

import numpy as np

from ...backend.teacher.anatomy import DIGITS, FINGER_THICKNESS, FINGERS
from ...backend.teacher.primitives import triangle
from ...backend.teacher.rays import Ray, RayCoordinates
from ...backend.teacher.smooth import smoothstep

UNLABELLED = -1


def bone_cores(rays: dict[str, Ray], points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Find the joint [N] of each surface point [N, 3] of unit normal [N, 3] (build frame); UNLABELLED between cores."""
    at = {digit: rays[digit].coordinates(points) for digit in DIGITS}
    labels = np.full(len(points), UNLABELLED)
    for finger in (digit for digit in DIGITS if digit in FINGERS):
        _label_finger(labels, rays[finger], at)
    _label_thumb(labels, rays["thumb"], at)
    labels[_is_palm(rays, at, points, normals) & (labels == UNLABELLED)] = 0
    return labels


def _label_finger(labels: np.ndarray, ray: Ray, at: dict[str, RayCoordinates]) -> None:
    own = at[ray.digit]
    nearest = np.argmin(np.stack([at[digit].distance for digit in DIGITS if digit in FINGERS], 1), 1)
    mine = (nearest == DIGITS.index(ray.digit)) & (own.distance < 3.0)
    thickness, along = FINGER_THICKNESS[ray.digit], own.along
    _, pip, dip = ray.joints_along
    half = 0.5 * ray.bones.proximal
    # The proximal core begins 11 mm past the joint on the back and at mid-phalanx on the palm.
    side = np.clip(own.dorsal / (9 * thickness), -1, 1)
    start = np.interp(side, [-1, 0, 1], [half + 3, half, 11 * thickness])
    first = 1 + 3 * DIGITS.index(ray.digit)
    labels[mine & (along > start) & (along < pip - 5.0 * thickness)] = first
    labels[mine & (along > pip + 5.0 * thickness) & (along < dip - 3.8 * thickness)] = first + 1
    labels[mine & (along > dip + 3.8 * thickness)] = first + 2


def _label_thumb(labels: np.ndarray, ray: Ray, at: dict[str, RayCoordinates]) -> None:
    own = at["thumb"]
    mine = np.argmin(np.stack([at[digit].distance for digit in DIGITS], 1), 1) == DIGITS.index("thumb")
    along, interphalangeal = own.along, ray.bones.proximal
    near = own.distance < 3
    labels[mine & near & (along > 6) & (along < interphalangeal - 5)] = 14
    labels[mine & near & (along > interphalangeal + 5)] = 15
    round_bone = (np.hypot(own.lateral, own.dorsal) < 15) & (own.dorsal > -3)
    labels[(own.distance < 4) & (along < -6) & (along > -33) & round_bone] = 13


def _is_palm(
    rays: dict[str, Ray], at: dict[str, RayCoordinates], points: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Mark what lies short of the knuckles (of the palmar crease), away from the thumb and its web; and the wrist."""
    d, _, r = points.T
    past_knuckles = np.max([np.where(at[finger].distance < 9, at[finger].along, -99) for finger in FINGERS], 0)
    on_back = smoothstep(normals[:, 1], -0.3, 0.3)
    limit = -9 * on_back + -3 * (1 - on_back)
    thumb = at["thumb"]
    palm = (past_knuckles < limit) & (d < 90) & ((thumb.distance > 13) | (thumb.along < -52))
    is_web = (_web_distance(rays, points) < 11) & (r > 20) & (normals[:, 1] < 0.55)
    return (palm & ~is_web) | (d < 2)


def _web_distance(rays: dict[str, Ray], points: np.ndarray) -> np.ndarray:
    """Measure distance to the triangle of skin between thumb and index finger."""
    thumb, index = rays["thumb"], rays["index"]
    corners = (
        np.array([34.0, -4.0, 16.0]),
        thumb.centre[thumb.nearest_sample(-2.0)],
        index.centre[index.nearest_sample(-20.0)] - np.array([0, 6, 0]),
    )
    return triangle(points, corners)
