"""Pose bones <-> theta and transl, exactly.

Frames: theta and transl live in armature space, which is the hand model's own frame. The armature object's matrix_world
is not part of them: whoever needs the hand in the world applies it to the vertices (`scene.shot` does).
Per joint, R = B basis B^T with B the bone's rest orientation; transl = B_wrist location_wrist.

Reading looks at evaluated bones, so constraints, drivers and every rotation mode count. Writing sets channels only.
"""

from __future__ import annotations

import bpy
import mathutils
import numpy as np

from ...backend.geometry.rotation import axis_angle_to_quaternion, matrix_to_axis_angle, quaternion_to_axis_angle
from ...backend.hand.bones import bone_name, root_name
from ...backend.hand.model import PARENTS
from ...backend.records.errors import LiveHandError
from ...backend.records.shot import HandPose, Side
from .armature import rest_frames
from .controls import clear_controls


def read_hand_pose(armature: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> HandPose:
    """A hand's parameters as evaluated in the depsgraph's frame.

    Raises:
        LiveHandError: the object is no hand, a bone is missing, or a channel holds NaN.
    """
    evaluated = armature.evaluated_get(depsgraph)
    side = hand_side(evaluated)
    return HandPose(read_theta(evaluated), np.array(evaluated.livehand.beta), read_transl(evaluated), side)


def hand_side(armature: bpy.types.Object) -> Side:
    """Which hand an armature is.

    Raises:
        LiveHandError: the object is no hand of ours, or lacks one of its bones.
    """
    if armature.type != "ARMATURE" or not armature.livehand.is_hand:
        raise LiveHandError(f"{armature.name} is no LiveHand hand; add one with Add > Armature > LiveHand Hand")
    side: Side = armature.livehand.side
    wanted = [bone_name(joint, side) for joint in range(16)] + [root_name(side)]
    missing = [name for name in wanted if name not in armature.pose.bones]
    if missing:
        raise LiveHandError(f"{armature.name} must keep its bones' names, missing: {', '.join(missing)}")
    return side


def read_theta(armature: bpy.types.Object) -> np.ndarray:
    """[16, 3] axis-angle per joint, rad, of an evaluated armature. Scale of bones is ignored."""
    side = hand_side(armature)
    posed = np.array([armature.pose.bones[bone_name(j, side)].matrix.to_3x3() for j in range(16)], np.float64)
    lengths = np.linalg.norm(posed, axis=1, keepdims=True)
    # Constraints make zeros of a channel's NaN, which must not pass for a pose.
    posed = np.divide(posed, lengths, out=np.full_like(posed, np.nan), where=lengths > 0)
    turned = posed @ rest_frames(armature, side).swapaxes(1, 2)  # [16, 3, 3] each joint's rotation in armature space
    above = np.concatenate([np.eye(3)[None], turned[list(PARENTS[1:])]])
    return matrix_to_axis_angle(above.swapaxes(1, 2) @ turned)


def read_transl(armature: bpy.types.Object) -> np.ndarray:
    """[3] m, of an evaluated armature."""
    side = hand_side(armature)
    bones = armature.pose.bones
    return np.array(bones[bone_name(0, side)].head - bones[root_name(side)].head, np.float64)


def write_hand_pose(armature: bpy.types.Object, pose: HandPose) -> None:
    """Pose a hand: bones, shape and translation.

    Raises:
        LiveHandError: the armature is the other hand; mirror the pose first.
    """
    if pose.side != hand_side(armature):
        raise LiveHandError(
            f"{armature.name} is a {armature.livehand.side} hand, the pose a {pose.side} one; mirror it first"
        )
    armature.livehand.beta = pose.beta
    armature.update_tag()
    write_theta(armature, pose.theta)
    write_transl(armature, pose.transl)


def write_theta(armature: bpy.types.Object, theta: np.ndarray) -> None:
    """Set the 16 bones to theta [16, 3], rad, each in its own rotation mode; finger controls and IK go to zero."""
    side = hand_side(armature)
    clear_controls(armature)
    for joint, quaternion in enumerate(bone_quaternions(armature, theta)):
        set_rotation(armature.pose.bones[bone_name(joint, side)], quaternion)


def write_transl(armature: bpy.types.Object, transl: np.ndarray) -> None:
    """Set the wrist's location so that the hand is moved by transl [3], m, in armature space."""
    wrist = armature.pose.bones[bone_name(0, hand_side(armature))]
    wrist.location = wrist_locations(armature, transl)


def bone_quaternions(armature: bpy.types.Object, theta: np.ndarray) -> np.ndarray:
    """[..., 16, 4] each bone's own rotation (wxyz) of theta [..., 16, 3]: basis = B^T R B."""
    frames = rest_frames(armature, hand_side(armature))
    return axis_angle_to_quaternion(np.einsum("jab,...ja->...jb", frames, theta))


def wrist_locations(armature: bpy.types.Object, transl: np.ndarray) -> np.ndarray:
    """[..., 3] the wrist bone's location channels of transl [..., 3] m."""
    return np.asarray(transl, np.float64) @ rest_frames(armature, hand_side(armature))[0]


def set_rotation(bone: bpy.types.PoseBone, quaternion: np.ndarray) -> None:
    """Turn a bone by its own rotation [4] (wxyz), whatever rotation mode it is in."""
    match bone.rotation_mode:
        case "QUATERNION":
            bone.rotation_quaternion = quaternion
        case "AXIS_ANGLE":
            # mathutils' own to_axis_angle loses 2e-5 rad at small angles.
            vector = quaternion_to_axis_angle(quaternion)
            bone.rotation_axis_angle = (np.linalg.norm(vector), *vector)
        case order:
            bone.rotation_euler = mathutils.Quaternion(quaternion).to_euler(order, bone.rotation_euler)
