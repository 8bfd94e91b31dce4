"""Pose bones <-> theta and transl, exactly.

Frames: theta and transl are in armature space, which is the hand model's own frame. The armature object's matrix_world
is not part of them: apply it to the vertices to get the hand in the world (as `hands.shot` does).
Per joint, R = B basis B^T with B the bone's rest orientation; transl = B_wrist location_wrist. In a hand with an arm,
the forearm carries the hand (`carrier`): it has the rotation R_0 R_forearm, and the wrist the rest.

Reading uses evaluated bones, so constraints, drivers and all rotation modes count. Writing only sets channels.
"""

from __future__ import annotations

import bpy
import mathutils
import numpy as np

from ...backend.geometry.rotation import (
    axis_angle_to_matrix,
    axis_angle_to_quaternion,
    matrix_to_axis_angle,
    quaternion_to_axis_angle,
)
from ...backend.hand.bones import root_name
from ...backend.hand.model import PARENTS
from ...backend.records.errors import LiveHandError
from ...backend.records.shot import HandPose
from .armature import rest_frames
from .carrier import Carrier
from .controls import clear_controls
from .hand import RiggedHand
from .sliders import read_beta, write_slider


def read_hand_pose(armature: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> HandPose:
    """Read the pose of the hand that an armature is, see `read_pose`.

    Raises:
        LiveHandError: the object is not a hand, a bone is missing, or a channel holds NaN.
    """
    return read_pose(RiggedHand.of(armature), depsgraph)


def read_pose(hand: RiggedHand, depsgraph: bpy.types.Depsgraph) -> HandPose:
    """Read a hand's parameters as evaluated in the depsgraph's frame.

    Raises:
        LiveHandError: a channel holds NaN.
    """
    evaluated = hand.evaluated(depsgraph)
    rotations = _rotations(evaluated)
    forearm = matrix_to_axis_angle(rotations[0].T @ rotations[16]) if evaluated.forearm else np.zeros(3)
    root = evaluated.armature.pose.bones[root_name(evaluated.side)]
    transl = np.array(evaluated.bone(0).head - root.head, np.float64)
    return HandPose(_theta(rotations), read_beta(evaluated.armature), transl, hand.side, forearm)


def read_theta(evaluated: RiggedHand) -> np.ndarray:
    """Read [16, 3] axis-angle per joint, rad, of an evaluated hand. Scale of bones is ignored."""
    return _theta(_rotations(evaluated))


def _rotations(evaluated: RiggedHand) -> np.ndarray:
    """Read [16 or 17, 3, 3] in armature space, of an evaluated hand's `bones`."""
    posed = np.array([bone.matrix.to_3x3() for bone in evaluated.bones], np.float64)
    lengths = np.linalg.norm(posed, axis=1, keepdims=True)
    # Constraints turn a channel's NaN into zeros, which must not be taken for a pose.
    posed = np.divide(posed, lengths, out=np.full_like(posed, np.nan), where=lengths > 0)
    return posed @ _frames(evaluated).swapaxes(1, 2)


def _frames(hand: RiggedHand) -> np.ndarray:
    """Read rest orientations [16 or 17, 3, 3] of a hand's `bones`."""
    frames = rest_frames(hand.armature, hand.side)
    return frames if hand.forearm is None else np.concatenate([frames, Carrier.of(hand).frame[None]])


def _theta(rotations: np.ndarray) -> np.ndarray:
    rotations = rotations[:16]
    of_parents = np.concatenate([np.eye(3)[None], rotations[list(PARENTS[1:])]])
    return matrix_to_axis_angle(of_parents.swapaxes(1, 2) @ rotations)


def write_hand_pose(hand: RiggedHand, pose: HandPose) -> None:
    """Pose a hand: bones, shape and translation.

    Raises:
        LiveHandError: the pose is for the other side.
    """
    if pose.side != hand.side:
        raise LiveHandError(f"{hand.armature.name} is a {hand.side} hand, the pose a {pose.side} one; mirror it first")
    write_slider(hand.armature, "beta", pose.beta)
    write_theta(hand, pose.theta, pose.forearm)
    write_transl(hand, pose.transl)


def write_theta(hand: RiggedHand, theta: np.ndarray, forearm: np.ndarray | None = None) -> None:
    """Set the bones to theta [16, 3], rad, each in its own rotation mode; finger controls and IK go to zero.

    The forearm, if there is one, is set to `HandPose.forearm` [3], rad, or straight; the wrist stays in its place.
    """
    clear_controls(hand)
    transl = Carrier.of(hand).transl
    for bone, quaternion in zip(hand.bones, bone_quaternions(hand, theta, forearm), strict=True):
        set_rotation(bone, quaternion)
    if hand.forearm is not None:
        write_transl(hand, transl)


def write_transl(hand: RiggedHand, transl: np.ndarray) -> None:
    """Set the location of the bone that carries the hand so that it is moved by transl [3] m, in armature space."""
    carrier = Carrier.of(hand)
    carrier.bone.location = carrier.locations(transl, carrier.rotation)


def mirror_pose(hand: RiggedHand, other: RiggedHand, depsgraph: bpy.types.Depsgraph, turns_wrist: bool) -> None:
    """Give a hand of the other side the mirror image of this hand's pose.

    Args:
        hand: whose pose is read, constraints, controls and IK included.
        other: to be posed.
        depsgraph: of the frame.
        turns_wrist: whether wrist and forearm turn as well, in the armature's own space.
    """
    pose = read_pose(hand, depsgraph).mirrored()
    theta, forearm = pose.theta, pose.forearm
    if not turns_wrist:
        present = read_pose(other, depsgraph)
        theta[0], forearm = present.theta[0], present.forearm
    write_theta(other, theta, forearm)


def apply_sliders(hand: RiggedHand, depsgraph: bpy.types.Depsgraph) -> None:
    """Turn the bones as sliders, master bones and IK turn them, and set these to zero; the pose is unchanged."""
    pose = read_pose(hand, depsgraph)
    write_theta(hand, pose.theta, pose.forearm)


def bone_quaternions(hand: RiggedHand, theta: np.ndarray, forearm: np.ndarray | None = None) -> np.ndarray:
    """Compute own rotations (wxyz) [..., 16 or 17, 4] of the hand's `bones`: basis = B^T R B.

    Args:
        hand: whose bones are turned.
        theta: [..., 16, 3] rad.
        forearm: [..., 3] rad, as `HandPose` has it; None: straight. A hand without an arm does not use it.
    """
    turns = np.asarray(theta, np.float64)
    if hand.forearm is not None:
        bend = np.zeros_like(turns[..., 0, :]) if forearm is None else np.asarray(forearm, np.float64)
        arm = matrix_to_axis_angle(axis_angle_to_matrix(turns[..., 0, :]) @ axis_angle_to_matrix(bend))
        turns = np.concatenate([-bend[..., None, :], turns[..., 1:, :], arm[..., None, :]], -2)
    return axis_angle_to_quaternion(np.einsum("jab,...ja->...jb", _frames(hand), turns))


def set_rotation(bone: bpy.types.PoseBone, quaternion: np.ndarray) -> None:
    """Set a bone's own rotation [4] (wxyz), in the rotation mode it has."""
    match bone.rotation_mode:
        case "QUATERNION":
            bone.rotation_quaternion = quaternion
        case "AXIS_ANGLE":
            # mathutils' own to_axis_angle loses 2e-5 rad at small angles.
            vector = quaternion_to_axis_angle(quaternion)
            bone.rotation_axis_angle = (np.linalg.norm(vector), *vector)
        case order:
            bone.rotation_euler = mathutils.Quaternion(quaternion).to_euler(order, bone.rotation_euler)
