"""Fingertip IK: a target bone per finger, a slider per finger, and poses carried from bones to targets and back.

The solver starts at the pose of the finger's own bones and moves it only as far as the fingertip is off its target. So
a target put at the fingertip changes nothing, and the bones go on to say how the finger bends.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import numpy as np

from ...backend.geometry.rotation import axis_angle_to_matrix, matrix_to_quaternion
from ...backend.hand.bones import FINGERS, bone_name, control_name, finger_joints, root_name, target_name
from ...backend.records.shot import Side
from .armature import rest_frames
from .drivers import drive_by_properties
from .pose import hand_side, read_theta, set_rotation

REACH = "Fingertip IK"
# How much more a finger's joint resists turning sideways and about itself than bending (Blender's IK stiffness, 0..1).
_SIDEWAYS, _TWIST = 0.6, 0.95
_HINGE_SIDEWAYS = 0.95


def add_fingertip_targets(armature: bpy.types.Object, side: Side) -> None:
    """Let each fingertip reach for its target by as much as its slider `ik` says."""
    for finger in FINGERS:
        joints = finger_joints(finger)
        for joint in joints:
            bone = armature.pose.bones[bone_name(joint, side)]
            bone.ik_stiffness_y = _TWIST
            bone.ik_stiffness_z = _SIDEWAYS if joint == joints[0] else _HINGE_SIDEWAYS
        constraint = armature.pose.bones[bone_name(joints[-1], side)].constraints.new("IK")
        constraint.name = REACH
        constraint.target, constraint.subtarget = armature, target_name(finger, side)
        constraint.chain_count = len(joints)
        constraint.use_stretch = False
        drive_by_properties(constraint, "influence", -1, {f"{finger}.ik": 1.0}, armature)


def has_fingertip_targets(armature: bpy.types.Object) -> bool:
    """False for hands made before LiveHand had finger controls."""
    side = hand_side(armature)
    return all(target_name(finger, side) in armature.pose.bones for finger in FINGERS)


def move_targets_to_fingertips(context: bpy.types.Context, armature: bpy.types.Object, fingers: Iterable[str]) -> None:
    """Put the fingers' targets where their fingertips are by the bones alone, and set the sliders to IK."""
    fingers = tuple(fingers)
    _set_sliders(context, armature, fingers, 0.0)
    side = hand_side(armature)
    evaluated = armature.evaluated_get(context.evaluated_depsgraph_get())
    root = evaluated.pose.bones[root_name(side)]
    carried = np.array(root.head - root.bone.head_local)
    for finger in fingers:
        target = armature.pose.bones[target_name(finger, side)]
        tip = np.array(evaluated.pose.bones[bone_name(finger_joints(finger)[-1], side)].tail)
        frame = np.array(target.bone.matrix_local.to_3x3())
        target.location = (tip - carried - np.array(target.bone.head_local)) @ frame
    _set_sliders(context, armature, fingers, 1.0)


def move_bones_to_ik(context: bpy.types.Context, armature: bpy.types.Object, fingers: Iterable[str]) -> None:
    """Turn the fingers' bones as IK has them, less what the controls add, and set the sliders to FK."""
    fingers, side = tuple(fingers), hand_side(armature)
    evaluated = armature.evaluated_get(context.evaluated_depsgraph_get())
    frames = rest_frames(armature, side).swapaxes(1, 2)
    wanted = axis_angle_to_matrix(read_theta(evaluated))
    for joint in (joint for finger in fingers for joint in finger_joints(finger)):
        own = frames[joint] @ _added_rotation(evaluated, joint, side).T @ wanted[joint] @ frames[joint].T
        set_rotation(armature.pose.bones[bone_name(joint, side)], matrix_to_quaternion(own))
    _set_sliders(context, armature, fingers, 0.0)


def _added_rotation(evaluated: bpy.types.Object, joint: int, side: Side) -> np.ndarray:
    """[3, 3] what the finger controls turn a joint by, in armature space."""
    control = evaluated.pose.bones[control_name(joint, side)]
    frame = np.array(control.bone.matrix_local.to_3x3(), np.float64)
    return frame @ np.array(control.matrix_basis.to_3x3(), np.float64) @ frame.T


def _set_sliders(context: bpy.types.Context, armature: bpy.types.Object, fingers: Iterable[str], share: float) -> None:
    for finger in fingers:
        getattr(armature.livehand, finger).ik = share
    armature.update_tag()
    context.view_layer.update()
