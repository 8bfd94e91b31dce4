"""The reverse of `retarget`: where another rig's bones must be, so that the rig does what our hand does."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix
from ..hand.model import PARENTS
from ..motion.motion import HandMotion
from ..motion.spaces import rest_wrists
from .rest_alignment import RestAlignment
from .source_skeleton import unit

_SHORTEST = 1e-9


class SentMotion(NamedTuple):
    """T poses that another rig's bones shall have, in the world.

    Attributes:
        frames: [T, 16, 3, 3] of the bones that the joints move with, as `SourceMotion` has them.
        wrists: [T, 3] m, heads of the wrist's bone.
        forearms: [T, 3, 3] of the forearm's bone; None: the rig has none.
        elbows: [T, 3] unit vectors from the wrist towards the elbow; None likewise.
    """

    frames: np.ndarray
    wrists: np.ndarray
    forearms: np.ndarray | None
    elbows: np.ndarray | None


def sent_motion(motion: HandMotion, alignment: RestAlignment) -> SentMotion:
    """Compute what `retarget` would turn into this motion, which is in Blender's world and of the alignment's side.

    Its shape is not used: the alignment's tells what a rest pose is.
    """
    local = axis_angle_to_matrix(motion.theta)
    turns = local.copy()
    for joint in range(1, 16):
        turns[:, joint] = turns[:, PARENTS[joint]] @ local[:, joint]
    since_rest = turns @ alignment.rotations.swapaxes(-1, -2)
    ours = rest_wrists(alignment.model, motion.betas) + motion.transl
    wrists = ours - since_rest[:, 0] @ (alignment.wrist - alignment.heads[0])
    frames, arm = since_rest @ alignment.frames, alignment.forearm
    if arm is None:
        return SentMotion(frames, wrists, None, None)
    arms = turns[:, 0] @ axis_angle_to_matrix(motion.forearms) @ arm.rotation.T
    return SentMotion(frames, wrists, arms @ arm.frame, arms @ arm.elbow)


class BentArm(NamedTuple):
    """An arm that reaches for a wrist: elbow [3] m, and how far the wrist stays away, m."""

    elbow: np.ndarray
    missed_m: float


def bend_arm(shoulder: np.ndarray, wrist: np.ndarray, lengths: tuple[float, float], towards: np.ndarray) -> BentArm:
    """Bend an arm of two bones so that it ends at the wrist, its elbow as near as it can to where it should be.

    Args:
        shoulder: [3] m.
        wrist: [3] m.
        lengths: of the upper arm and the forearm, m.
        towards: [3] unit vector from the wrist to where the elbow should be.
    """
    upper, lower = lengths
    reach = float(np.linalg.norm(wrist - shoulder))
    along = (wrist - shoulder) / max(reach, _SHORTEST)
    span = float(np.clip(reach, abs(upper - lower), upper + lower))
    forward = (upper**2 - lower**2 + span**2) / (2 * max(span, _SHORTEST))
    radius = np.sqrt(max(upper**2 - forward**2, 0.0))
    wanted = wrist + lower * towards - shoulder
    across = wanted - (wanted @ along) * along
    if np.linalg.norm(across) < _SHORTEST:
        across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    return BentArm(shoulder + forward * along + radius * unit(across), abs(reach - span))
