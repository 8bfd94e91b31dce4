"""Positions and axes of the joints, from the rays. Build frame; directions are the same in the template's frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...backend.teacher.frames import swap_distal
from ...backend.teacher.rays import Ray

_PAST_JOINT = 8.0  # mm along the bone, where the rounded centreline has the bone's direction


class JointFrames(NamedTuple):
    """Rows in MANO's joint order; [16, 3] each. The directions of joint 0 are zero.

    `position` mm, wrist at the origin; `bone` and `dorsal` unit directions; `flexion` axis = bone x -dorsal, so that a
    positive angle turns the bone to the palm; `lateral` = bone x dorsal.
    """

    position: np.ndarray
    bone: np.ndarray
    dorsal: np.ndarray
    flexion: np.ndarray
    lateral: np.ndarray


def joint_frames(rays: dict[str, Ray]) -> JointFrames:
    """Place the 16 joints on the rays."""
    position, bone, dorsal = np.zeros((3, 16, 3))
    for order, ray in enumerate(rays.values()):
        first = 1 + 3 * order
        samples = [ray.nearest_sample(place + _PAST_JOINT) for place in ray.joints_along]
        position[first : first + 3] = swap_distal(ray.joints)
        bone[first : first + 3] = swap_distal(ray.tangent[samples])
        dorsal[first : first + 3] = swap_distal(ray.dorsal[samples])
    return JointFrames(position, bone, dorsal, np.cross(bone, -dorsal), np.cross(bone, dorsal))
