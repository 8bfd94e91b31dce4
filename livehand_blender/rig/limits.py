"""Ranges of the joints, as constraints that the hand's property *Limit Joints* turns on and off.

Figures in degrees from the straight finger. Fingers, thumb MCP and IP: American Academy of Orthopaedic Surgeons (AAOS),
"Joint Motion: Method of Measuring and Recording", 1965. The rest are our estimates: sideways motion beyond the
knuckles, and the thumb's saddle joint, whose clinical zero differs from the rest pose. The wrist bends about as
far as AAOS has it, and hardly twists: the forearm does.
"""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np

from ...backend.hand.bones import FINGERS, bone_name, finger_joints, rest_flexion_deg
from ...backend.hand.joint_axes import euler_rad
from ...backend.hand.model import HandModel
from .drivers import drive_by_sliders

LIMIT_CONSTRAINT = "Joint Limits"


class JointRange(NamedTuple):
    """Smallest and largest flexion, abduction towards the thumb, and twist, degrees."""

    flexion: tuple[float, float]
    abduction: tuple[float, float]
    twist: tuple[float, float]


FINGER_RANGES = (
    JointRange((-45, 90), (-20, 20), (-15, 15)),  # MCP
    JointRange((0, 100), (-5, 5), (-5, 5)),  # PIP
    JointRange((-10, 90), (-5, 5), (-5, 5)),  # DIP
)
THUMB_RANGES = (
    JointRange((-30, 45), (-40, 40), (-20, 45)),  # CMC, from the rest pose
    JointRange((-10, 50), (-20, 20), (-20, 20)),  # MCP; AAOS has no hyperextension here
    JointRange((-20, 80), (-25, 25), (-20, 20)),  # IP
)
WRIST_RANGE = JointRange((-70, 70), (-35, 20), (-10, 10))


def add_limits(armature: bpy.types.Object, model: HandModel) -> None:
    """Limit every finger bone's rotation, controls and IK included; no effect until `limit_joints` is set.

    The wrist of a hand with an arm is limited too.
    """
    if model.has_arm:
        wrist = np.sort(euler_rad(np.transpose(WRIST_RANGE), model.side), axis=0)
        _limit(armature, armature.pose.bones[bone_name(0, model.side)], *wrist)
    for joint, (low, high) in zip(range(1, 16), joint_limits_rad(model), strict=True):
        bone = armature.pose.bones[bone_name(joint, model.side)]
        _limit(armature, bone, low, high)
        for axis, name in enumerate("xyz"):
            # IK ignores constraints and has limits of its own.
            setattr(bone, f"ik_min_{name}", low[axis])
            setattr(bone, f"ik_max_{name}", high[axis])
            drive_by_sliders(bone, f"use_ik_limit_{name}", -1, {"limit_joints": 1.0}, armature)


def _limit(armature: bpy.types.Object, bone: bpy.types.PoseBone, low: np.ndarray, high: np.ndarray) -> None:
    """Limit a bone's rotations about X, Y and Z, rad, while `limit_joints` is set."""
    constraint = bone.constraints.new("LIMIT_ROTATION")
    constraint.name = LIMIT_CONSTRAINT
    constraint.owner_space = "LOCAL"
    constraint.euler_order = "YZX"
    drive_by_sliders(constraint, "influence", -1, {"limit_joints": 1.0}, armature)
    for axis, name in enumerate("xyz"):
        setattr(constraint, f"use_limit_{name}", True)
        setattr(constraint, f"min_{name}", low[axis])
        setattr(constraint, f"max_{name}", high[axis])


def joint_limits_rad(model: HandModel) -> np.ndarray:
    """Compute smallest and largest rotation [15, 2, 3] about X, Y and Z of joints 1..15, in Blender's order YZX."""
    ranges = np.empty((15, 2, 3))
    for finger in FINGERS:
        rows = [joint - 1 for joint in finger_joints(finger)]
        ranges[rows] = np.swapaxes(THUMB_RANGES if finger == "thumb" else FINGER_RANGES, 1, 2)
    ranges[..., 0] -= rest_flexion_deg(model)[:, None]
    return np.sort(euler_rad(ranges, model.side), axis=1)
