"""Names and rest frames of the bones of a hand's rig.

A hand has 16 bones that an animator rotates, named after MANO's joints (`index1.R`), five fingertip targets
(`IK-index.R`), and 32 hidden helpers: a deforming bone per joint (`DEF-index1.R`), a root (`MCH-root.R`), and a bone
for the finger controls per finger joint (`MCH-index1.R`). A model with an arm also has `forearm.R`, which carries the
wrist, and `DEF-forearm.R`. docs/dev/rig.md gives the reasons. In a bone's rest frame, Y is
along the bone, X is the flexion axis (a positive angle closes the hand) and Z points towards the palm.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..records.side import Side
from .model import JOINT_NAMES, HandModel

FINGERS = ("thumb", "index", "middle", "ring", "pinky")  # in anatomical order, unlike MANO's

_INDEX1, _MIDDLE1, _PINKY1, _THUMB1 = 1, 4, 7, 13
_THUMB_PALMAR_SHARE = 0.5  # the thumb closes across the palm more than into it
_MIN_BEND = 0.09  # sine of the angle; a straighter finger does not show the plane it bends in
_MIN_AGREEMENT = 0.7  # of that plane's normal with the palm's, cosine


class RestBones(NamedTuple):
    """Heads [16, 3] m, tails [16, 3] m, and frames [16, 3, 3] whose columns are a bone's X, Y and Z."""

    heads: np.ndarray
    tails: np.ndarray
    frames: np.ndarray


class RestForearm(NamedTuple):
    """Head [3] m, tail [3] m, and the frame [3, 3] whose columns are the bone's X, Y and Z."""

    head: np.ndarray
    tail: np.ndarray
    frame: np.ndarray


def bone_name(joint: int, side: Side) -> str:
    """Name the bone that an animator rotates, as `index1.R`; Blender mirrors poses by the suffix."""
    return f"{JOINT_NAMES[joint]}.{side[0].upper()}"


def deform_name(joint: int, side: Side) -> str:
    """Name the hidden bone that moves the mesh, and the vertex group of the same name."""
    return f"DEF-{bone_name(joint, side)}"


def forearm_name(side: Side) -> str:
    """Name the bone from the elbow's end of an arm to the wrist, which carries the hand."""
    return f"forearm.{side[0].upper()}"


def forearm_deform_name(side: Side) -> str:
    """Name the hidden bone that moves the mesh of the forearm, and the vertex group of the same name."""
    return f"DEF-{forearm_name(side)}"


def root_name(side: Side) -> str:
    """Name the hidden bone that moves the wrist, or the forearm, by what the shape moves the wrist joint."""
    return f"MCH-root.{side[0].upper()}"


def control_name(joint: int, side: Side) -> str:
    """Name the hidden bone that the finger controls rotate; the finger's bone adds this rotation to its own."""
    return f"MCH-{bone_name(joint, side)}"


def master_name(finger: str, side: Side) -> str:
    """Name the bone that curls and spreads a whole finger."""
    return f"CTL-{finger}.{side[0].upper()}"


def target_name(finger: str, side: Side) -> str:
    """Name the bone that a fingertip reaches for."""
    return f"IK-{finger}.{side[0].upper()}"


def shown_target_name(finger: str, side: Side) -> str:
    """Name the hidden bone where a target is drawn: at the fingertip while the bones move the finger."""
    return f"MCH-{target_name(finger, side)}"


def finger_joints(finger: str) -> tuple[int, int, int]:
    """List the three joints of a finger, from the knuckle to the tip."""
    first = JOINT_NAMES.index(f"{finger}1")
    return first, first + 1, first + 2


def rest_bones(model: HandModel) -> RestBones:
    """Derive the bones of the mean shape from the model's geometry."""
    heads = model.joints
    lengths = _bone_lengths(model)
    along = _bone_directions(heads)
    flexion = _flexion_axes(along, heads, model.side)
    frames = np.stack([flexion, along, np.cross(flexion, along)], -1)
    return RestBones(heads, heads + along * lengths[:, None], frames)


def rest_forearm(model: HandModel) -> RestForearm:
    """Derive the forearm of the mean shape of a model with an arm: it ends at joint 0 and is as long as the arm."""
    wrist, hand = model.joints[0], rest_bones(model).frames[0]
    arm = (model.v_template - wrist)[model.arm_weights > 0]
    elbow = _unit(model.arm_weights[model.arm_weights > 0] @ arm)
    flexion = _unit(hand[:, 0] - (hand[:, 0] @ elbow) * elbow)
    frame = np.stack([flexion, -elbow, np.cross(flexion, -elbow)], -1)
    return RestForearm(wrist + (arm @ elbow).max() * elbow, wrist, frame)


def rest_flexion_deg(model: HandModel) -> np.ndarray:
    """Compute [15] flexion of joints 1..15 in the rest pose, from the straight finger.

    It is zero for a finger's last joint, whose bone continues the one before it, and for the thumb's saddle joint,
    which has no defined straight position.
    """
    rest = rest_bones(model)
    along = rest.frames[..., 1]
    above = np.roll(along, 1, 0)
    above[[1, 4, 7, 10]] = rest.heads[[1, 4, 7, 10]] - rest.heads[0]
    across = rest.frames[..., 0]
    bend = np.arctan2((np.cross(above, along) * across).sum(-1), (above * along).sum(-1))
    bend[13] = 0.0
    return np.rad2deg(bend[1:])


def _bone_directions(joints: np.ndarray) -> np.ndarray:
    """Compute unit directions [16, 3] towards the next joint; a finger's last bone continues the one before it."""
    along = np.empty((16, 3))
    along[0] = joints[_MIDDLE1] - joints[0]
    along[1:] = np.roll(joints[1:], -1, 0) - joints[1:]
    along[3::3] = along[2::3]
    return _unit(along)


def _bone_lengths(model: HandModel) -> np.ndarray:
    """Measure the bones [16], m; a finger's last bone reaches its tip."""
    joints, along = model.joints, _bone_directions(model.joints)
    lengths = np.linalg.norm(np.roll(joints[1:], -1, 0) - joints[1:], axis=-1)
    lengths = np.r_[np.linalg.norm(joints[_MIDDLE1] - joints[0]), lengths]
    for joint in range(3, 16, 3):
        own = model.v_template[np.argmax(model.lbs_weights, 1) == joint]
        lengths[joint] = ((own - joints[joint]) @ along[joint]).max(initial=lengths[joint - 1] / 2)
    return lengths


def _flexion_axes(along: np.ndarray, joints: np.ndarray, side: Side) -> np.ndarray:
    """Compute unit axes [16, 3] across the bones: a positive rotation about one moves the bone towards the palm."""
    palmar = _palmar(joints, side)
    across = _unit(joints[_PINKY1] - joints[_INDEX1])
    towards = np.tile(palmar, (16, 1))
    towards[_THUMB1:] = across + _THUMB_PALMAR_SHARE * palmar
    axes = _unit(np.cross(along, towards))
    for first in (1, 4, 7, 10):
        finger = slice(first, first + 3)
        axes[finger] = _bend_axis(along[finger], joints[finger], axes[first])
    return _unit(axes - (axes * along).sum(-1, keepdims=True) * along)


def _palmar(joints: np.ndarray, side: Side) -> np.ndarray:
    """Compute the unit vector [3] out of the palm, from the wrist and two knuckles."""
    normal = np.cross(joints[_INDEX1] - joints[0], joints[_PINKY1] - joints[0])
    return _unit(normal if side == "right" else -normal)


def _bend_axis(along: np.ndarray, joints: np.ndarray, guess: np.ndarray) -> np.ndarray:
    """Compute [3] normal of the plane of a finger's bend at rest; the guess if it is straight or bends sideways."""
    normal = np.cross(along[0], along[1])
    bend = np.linalg.norm(normal)
    axis = normal / max(bend, _MIN_BEND)
    return axis if bend > _MIN_BEND and axis @ guess > _MIN_AGREEMENT else guess


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
