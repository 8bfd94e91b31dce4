"""A first guess of a pose from landmarks, in closed form: the palm as one rigid body, then bone after bone."""

from __future__ import annotations

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix, turn_between
from .articulation import LIMITS, all_angles, free_angles
from .skeleton import Skeleton

_PALM = (0, 1, 5, 9, 13)  # the wrist and the four knuckles among the nodes


def aligned_palm(points: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Wrist's rotation [T, 3, 3] and place [T, 3] m that bring the rest palm nearest to nodes [T, 21, 3] (Kabsch)."""
    seen, still = points[:, _PALM], rest[list(_PALM)]
    centre, still_centre = seen.mean(1), still.mean(0)
    rotation = turn_between(still - still_centre, seen - centre[:, None])
    return rotation, centre + rotation @ (rest[0] - still_centre)


def aligned_bones(points: np.ndarray, root: np.ndarray, skeleton: Skeleton, beta: np.ndarray) -> np.ndarray:
    """[T, 21] free angles that turn each bone towards the next node, from the knuckles on, within limits.

    The thumb's twist is left at zero.
    """
    fingers = points[:, 1:].reshape(len(points), 5, 4, 3)
    steps, offsets = np.diff(fingers, axis=2), skeleton.offsets(beta)
    lowest, highest = np.moveaxis(all_angles(LIMITS.T), 0, 0)  # each [5, 3, 3]
    angles = np.zeros((len(points), 5, 3, 3))
    for finger in range(5):
        above = root
        for joint in range(3):
            flexion, abduction, _ = skeleton.axes[finger, joint]
            wanted = np.einsum("tba,tb->ta", above, steps[:, finger, joint])
            bend = _bend(wanted, offsets[finger, joint + 1], flexion, abduction)
            bend = np.clip(bend, lowest[finger, joint, :2], highest[finger, joint, :2])
            angles[:, finger, joint, :2] = bend
            turn = axis_angle_to_matrix(bend[:, :1] * flexion) @ axis_angle_to_matrix(bend[:, 1:] * abduction)
            above = above @ turn
    return free_angles(angles)


def _bend(wanted: np.ndarray, bone: np.ndarray, flexion: np.ndarray, abduction: np.ndarray) -> np.ndarray:
    """[T, 2] flexion and abduction, rad, that turn a bone [3] along directions [T, 3].

    Flexion leaves the part along its own axis alone: that part gives the abduction, the rest then gives the flexion.
    """
    wanted = wanted / np.maximum(np.linalg.norm(wanted, axis=-1, keepdims=True), 1e-9)
    bone = bone / np.linalg.norm(bone)
    # Turned by a, the bone's part along the flexion axis is here * cos a + there * sin a, its part along the abduction
    # axis aside, which does not change.
    across = np.cross(abduction, bone)
    still = (bone @ abduction) * (abduction @ flexion)
    here, there = bone @ flexion - still, across @ flexion
    length = max(float(np.hypot(here, there)), 1e-9)
    share = np.clip((wanted @ flexion - still) / length, -1, 1)
    abducted = _nearer(np.arcsin(share) - np.arctan2(here, there))
    turned = np.einsum("tab,b->ta", axis_angle_to_matrix(abducted[:, None] * abduction), bone)
    flexed = np.arctan2(np.cross(turned, wanted) @ flexion, (_off(turned, flexion) * _off(wanted, flexion)).sum(-1))
    return np.stack([flexed, abducted], -1)


def _off(vectors: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """The part of vectors [T, 3] across an axis."""
    return vectors - (vectors @ axis)[:, None] * axis


def _nearer(angles: np.ndarray) -> np.ndarray:
    """Within half a turn of zero."""
    return (angles + np.pi) % (2 * np.pi) - np.pi
