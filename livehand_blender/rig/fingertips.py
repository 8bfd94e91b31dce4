"""Fingertip IK: a target bone and a slider per finger, and snapping of poses between bones and targets.

The solver starts from the pose of the finger's own bones and changes it only as far as the fingertip is from its
target. A target at the fingertip therefore changes nothing, and the bones still control how the finger bends.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import numpy as np

from ...backend.geometry.rotation import axis_angle_to_matrix, matrix_to_quaternion
from ...backend.hand.bones import (
    FINGERS,
    bone_name,
    control_name,
    finger_joints,
    root_name,
    shown_target_name,
    target_name,
)
from ...backend.records.side import Side
from .armature import rest_frames
from .drivers import drive_by_sliders
from .hand import RiggedHand
from .pose import read_theta, set_rotation
from .sliders import write_slider

IK_CONSTRAINT = "Fingertip IK"
# How much more a finger's joint resists turning sideways and about itself than bending (Blender's IK stiffness, 0..1).
_SIDEWAYS, _TWIST = 0.6, 0.95
_HINGE_SIDEWAYS = 0.95
_SAME_PLACE_M = 1e-6


def add_fingertip_targets(armature: bpy.types.Object, side: Side) -> None:
    """Add the IK constraint of each finger; the slider `ik` drives its influence."""
    for finger in FINGERS:
        joints = finger_joints(finger)
        for joint in joints:
            bone = armature.pose.bones[bone_name(joint, side)]
            bone.ik_stiffness_y = _TWIST
            bone.ik_stiffness_z = _SIDEWAYS if joint == joints[0] else _HINGE_SIDEWAYS
        constraint = armature.pose.bones[bone_name(joints[-1], side)].constraints.new("IK")
        constraint.name = IK_CONSTRAINT
        constraint.target, constraint.subtarget = armature, target_name(finger, side)
        constraint.chain_count = len(joints)
        constraint.use_stretch = False
        drive_by_sliders(constraint, "influence", -1, {f"{finger}.ik": 1.0}, armature)
        shown = armature.pose.bones[shown_target_name(finger, side)].constraints.new("COPY_LOCATION")
        shown.target, shown.subtarget = armature, target_name(finger, side)
        drive_by_sliders(shown, "influence", -1, {f"{finger}.ik": 1.0}, armature)


def has_fingertip_targets(armature: bpy.types.Object) -> bool:
    """Return whether a hand's armature has its IK targets, which a user may have deleted."""
    return all(target_name(finger, armature.livehand.side) in armature.pose.bones for finger in FINGERS)


def move_targets_to_fingertips(context: bpy.types.Context, hand: RiggedHand, fingers: Iterable[str]) -> None:
    """Move the fingers' targets to where the bones alone have the fingertips, and set the sliders to IK."""
    fingers = tuple(fingers)
    _set_sliders(context, hand, fingers, 0.0)
    put_targets_at_fingertips(context, hand, fingers)
    _set_sliders(context, hand, fingers, 1.0)


def put_targets_at_fingertips(context: bpy.types.Context, hand: RiggedHand, fingers: Iterable[str]) -> None:
    """Move the targets of fingers whose IK is off to where the fingertips are; those that are there are left alone."""
    evaluated = hand.evaluated(context.evaluated_depsgraph_get())
    root = evaluated.armature.pose.bones[root_name(hand.side)]
    root_offset = np.array(root.head - root.bone.head_local)
    for finger in fingers:
        target = hand.target(finger)
        tip = np.array(evaluated.bone(finger_joints(finger)[-1]).tail)
        frame = np.array(target.bone.matrix_local.to_3x3())
        location = (tip - root_offset - np.array(target.bone.head_local)) @ frame
        if np.abs(location - target.location).max() > _SAME_PLACE_M:
            target.location = location


def move_bones_to_ik(context: bpy.types.Context, hand: RiggedHand, fingers: Iterable[str]) -> None:
    """Rotate the fingers' bones to the IK pose, less what the controls add, and set the sliders to FK."""
    fingers = tuple(fingers)
    evaluated = hand.evaluated(context.evaluated_depsgraph_get())
    frames = rest_frames(hand.armature, hand.side).swapaxes(1, 2)
    rotations = axis_angle_to_matrix(read_theta(evaluated))
    for joint in (joint for finger in fingers for joint in finger_joints(finger)):
        own = frames[joint] @ _control_rotation(evaluated, joint).T @ rotations[joint] @ frames[joint].T
        set_rotation(hand.bone(joint), matrix_to_quaternion(own))
    _set_sliders(context, hand, fingers, 0.0)


def _control_rotation(evaluated: RiggedHand, joint: int) -> np.ndarray:
    """Compute the rotation [3, 3] that the finger controls add to a joint, in armature space."""
    control = evaluated.armature.pose.bones[control_name(joint, evaluated.side)]
    frame = np.array(control.bone.matrix_local.to_3x3(), np.float64)
    return frame @ np.array(control.matrix_basis.to_3x3(), np.float64) @ frame.T


def _set_sliders(context: bpy.types.Context, hand: RiggedHand, fingers: Iterable[str], ik: float) -> None:
    for finger in fingers:
        write_slider(hand.armature, f"{finger}.ik", ik)
    context.view_layer.update()
