"""Builds a hand: from a hand model to an armature that an animator can pose.

The joints' limits are constraints that the hand's property *Limit Joints* turns on and off.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.hand.bones import bone_name
from ...backend.hand.joint_axes import euler_rad
from ...backend.hand.joint_limits import WRIST_RANGE, usual_limits_deg
from ...backend.hand.model import HandModel
from .armature import build_armature, drive_joints
from .controls import add_controls
from .drivers import drive_by_sliders
from .fingertips import add_fingertip_targets
from .hand_mesh import build_mesh
from .shapes import set_bone_shapes
from .sliders import add_sliders

_LIMIT_CONSTRAINT = "Joint Limits"


def add_hand(
    context: bpy.types.Context, model: HandModel, model_path: str = "", name: str = "LiveHand"
) -> bpy.types.Object:
    """Build a hand at the world's origin, in object mode, and return its armature, selected and active.

    Args:
        context: the objects are linked to its collection, which must be in its view layer.
        model: the hand, already of the wanted side (`HandModel.for_side`).
        model_path: the file it came from, saved for the renderer; empty for the built-in hand.
        name: of the armature; the mesh gets the same name followed by " Mesh".

    Raises:
        LiveHandError: the context's collection is not in its view layer.
    """
    if context.object is not None and context.object.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    armature = build_armature(context, model, name)
    add_sliders(armature)
    drive_joints(armature, model)
    add_controls(armature, model)
    _add_limits(armature, model)
    add_fingertip_targets(armature, model.side)
    set_bone_shapes(armature, model.side)
    properties = armature.livehand
    properties.mesh = build_mesh(model, armature, f"{name} Mesh")
    properties.is_hand, properties.side = True, model.side
    properties.model_path, properties.model_sha256 = model_path, model.sha256
    return armature


def _add_limits(armature: bpy.types.Object, model: HandModel) -> None:
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
    constraint.name = _LIMIT_CONSTRAINT
    constraint.owner_space = "LOCAL"
    constraint.euler_order = "YZX"
    drive_by_sliders(constraint, "influence", -1, {"limit_joints": 1.0}, armature)
    for axis, name in enumerate("xyz"):
        setattr(constraint, f"use_limit_{name}", True)
        setattr(constraint, f"min_{name}", low[axis])
        setattr(constraint, f"max_{name}", high[axis])


def joint_limits_rad(model: HandModel) -> np.ndarray:
    """Compute smallest and largest rotation [15, 2, 3] about X, Y and Z of joints 1..15, in Blender's order YZX."""
    return np.sort(euler_rad(usual_limits_deg(model), model.side), axis=1)
