"""The initial pose of a landmark fit, in closed form: the palm as a rigid body, then one bone after the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix, rotation_between
from ...hand.joint_limits import LIMITS
from ..gate import backwards_rad
from .articulation import all_angles, free_angles
from .skeleton import HandSkeleton

_BACKWARDS_RAD = np.deg2rad(20.0)  # fingers on average; flat ones seem to bend a little backwards
_PALM = (0, 1, 5, 9, 13)  # the wrist and the four knuckles among the nodes
_PALM_AND_THUMB = (0, 1, 5, 9, 18)  # the wrist, the knuckles of index, middle and little finger, the thumb's second
_BEHIND = 0.08  # a thumb's second joint lies .24 to .39 before the palm in any pose, flat hands included
_LEAST_LENGTH = 1e-9


class MirrorSigns(NamedTuple):
    """What shows that landmarks are those of a mirrored hand.

    Attributes:
        backwards_rad: how far the fingers bend backwards on average; 0: they do not.
        thumb_behind: how far the thumb lies behind the palm, in the middle of all frames, as a share of the palm's
            length; 0: it does not.
    """

    backwards_rad: float = 0.0
    thumb_behind: float = 0.0


def aligned_palm(points: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Align the rest palm best with nodes [T, 21, 3]: rotation [T, 3, 3] and position [T, 3] m of the wrist."""
    palm, rest_palm = points[:, _PALM], rest[list(_PALM)]
    centre, rest_centre = palm.mean(1), rest_palm.mean(0)
    rotation = rotation_between(rest_palm - rest_centre, palm - centre[:, None])
    return rotation, centre + rotation @ (rest[0] - rest_centre)


def aligned_bones(
    points: np.ndarray, root: np.ndarray, skeleton: HandSkeleton, beta: np.ndarray, is_limited: bool = True
) -> np.ndarray:
    """Point each bone at the next node by free angles [T, 21], within the limits; the thumb's twist stays zero."""
    fingers = points[:, 1:].reshape(len(points), 5, 4, 3)
    bones, offsets = np.diff(fingers, axis=2), skeleton.offsets(beta)
    lowest, highest = np.moveaxis(all_angles(LIMITS.T), 0, 0)  # each [5, 3, 3]
    angles = np.zeros((len(points), 5, 3, 3))
    for finger in range(5):
        parent = root
        for joint in range(3):
            flexion, abduction, _ = skeleton.axes[finger, joint]
            wanted = np.einsum("tba,tb->ta", parent, bones[:, finger, joint])
            bend = _bend(wanted, offsets[finger, joint + 1], flexion, abduction)
            if is_limited:
                bend = np.clip(bend, lowest[finger, joint, :2], highest[finger, joint, :2])
            angles[:, finger, joint, :2] = bend
            rotation = axis_angle_to_matrix(bend[:, :1] * flexion) @ axis_angle_to_matrix(bend[:, 1:] * abduction)
            parent = parent @ rotation
    return free_angles(angles)


def mirror_signs(points: np.ndarray, skeleton: HandSkeleton) -> MirrorSigns:
    """Measure what in a right hand's nodes [T, 21, 3] is as if mirrored.

    The thumb decides: a tracker's fingers seem to bend backwards in frames here and there of right takes, too.
    """
    behind = -float(np.median(_before_palm(points)))
    if behind <= _BEHIND:
        return MirrorSigns()
    root, _ = aligned_palm(points, skeleton.rest)
    free = aligned_bones(points, root, skeleton, np.zeros(10), is_limited=False)
    bend = backwards_rad(all_angles(free)[:, :4, :, 0].mean((1, 2)), _BACKWARDS_RAD)
    return MirrorSigns(bend, behind)


def _before_palm(points: np.ndarray) -> np.ndarray:
    """Measure how far before the palm a right hand's thumb lies in nodes [T, 21, 3], as a share [T] of its length."""
    wrist, index, middle, little, thumb = (points[:, node] for node in _PALM_AND_THUMB)
    inward = np.cross(index - wrist, little - wrist)
    inward /= np.maximum(np.linalg.norm(inward, axis=-1, keepdims=True), _LEAST_LENGTH)
    length = np.maximum(np.linalg.norm(middle - wrist, axis=-1), _LEAST_LENGTH)
    return ((thumb - wrist) * inward).sum(-1) / length


def _bend(wanted: np.ndarray, bone: np.ndarray, flexion: np.ndarray, abduction: np.ndarray) -> np.ndarray:
    """Return [T, 2] flexion and abduction, rad, that rotate a bone [3] onto directions [T, 3].

    Flexion does not change the component along its own axis, so that component gives the abduction, and the rest the
    flexion.
    """
    wanted = wanted / np.maximum(np.linalg.norm(wanted, axis=-1, keepdims=True), 1e-9)
    bone = bone / np.linalg.norm(bone)
    # After abduction by a, the bone's component along the flexion axis is constant + cosine * cos a + sine * sin a.
    constant = (bone @ abduction) * (abduction @ flexion)
    cosine, sine = bone @ flexion - constant, np.cross(abduction, bone) @ flexion
    amplitude = max(float(np.hypot(cosine, sine)), 1e-9)
    ratio = np.clip((wanted @ flexion - constant) / amplitude, -1, 1)
    abducted = _wrapped(np.arcsin(ratio) - np.arctan2(cosine, sine))
    rotated = np.einsum("tab,b->ta", axis_angle_to_matrix(abducted[:, None] * abduction), bone)
    dot = (_across(rotated, flexion) * _across(wanted, flexion)).sum(-1)
    return np.stack([np.arctan2(np.cross(rotated, wanted) @ flexion, dot), abducted], -1)


def _across(vectors: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Take the components of vectors [T, 3] perpendicular to an axis."""
    return vectors - (vectors @ axis)[:, None] * axis


def _wrapped(angles: np.ndarray) -> np.ndarray:
    """Wrap angles to [-pi, pi)."""
    return (angles + np.pi) % (2 * np.pi) - np.pi
