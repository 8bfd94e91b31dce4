"""Pose bones <-> theta and transl, exactly.

Frames: theta and transl are in armature space, which is the hand model's own frame. The armature object's matrix_world
is not part of them: apply it to the vertices to get the hand in the world (as `scene.shot` does).
Per joint, R = B basis B^T with B the bone's rest orientation; transl = B_wrist location_wrist.

Reading uses evaluated bones, so constraints, drivers and all rotation modes count. Writing only sets channels.
"""

from __future__ import annotations

import bpy
import mathutils
import numpy as np

from ...backend.geometry.rotation import axis_angle_to_quaternion, matrix_to_axis_angle, quaternion_to_axis_angle
from ...backend.hand.bones import root_name
from ...backend.hand.model import PARENTS
from ...backend.records.errors import LiveHandError
from ...backend.records.shot import HandPose
from .armature import rest_frames
from .controls import clear_controls
from .hand import RiggedHand


def read_hand_pose(armature: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> HandPose:
    """The pose of the hand that an armature is, see `read_pose`.

    Raises:
        LiveHandError: the object is not a hand, a bone is missing, or a channel holds NaN.
    """
    return read_pose(RiggedHand.of(armature), depsgraph)


def read_pose(hand: RiggedHand, depsgraph: bpy.types.Depsgraph) -> HandPose:
    """A hand's parameters as evaluated in the depsgraph's frame.

    Raises:
        LiveHandError: a channel holds NaN.
    """
    evaluated = hand.evaluated(depsgraph)
    return HandPose(read_theta(evaluated), np.array(evaluated.properties.beta), _read_transl(evaluated), hand.side)


def read_theta(evaluated: RiggedHand) -> np.ndarray:
    """[16, 3] axis-angle per joint, rad, of an evaluated hand. Scale of bones is ignored."""
    posed = np.array([evaluated.bone(joint).matrix.to_3x3() for joint in range(16)], np.float64)
    lengths = np.linalg.norm(posed, axis=1, keepdims=True)
    # Constraints turn a channel's NaN into zeros, which must not be taken for a pose.
    posed = np.divide(posed, lengths, out=np.full_like(posed, np.nan), where=lengths > 0)
    rotations = posed @ rest_frames(evaluated.armature, evaluated.side).swapaxes(1, 2)  # [16, 3, 3] in armature space
    of_parents = np.concatenate([np.eye(3)[None], rotations[list(PARENTS[1:])]])
    return matrix_to_axis_angle(of_parents.swapaxes(1, 2) @ rotations)


def _read_transl(evaluated: RiggedHand) -> np.ndarray:
    """[3] m."""
    root = evaluated.armature.pose.bones[root_name(evaluated.side)]
    return np.array(evaluated.bone(0).head - root.head, np.float64)


def write_hand_pose(hand: RiggedHand, pose: HandPose) -> None:
    """Pose a hand: bones, shape and translation.

    Raises:
        LiveHandError: the pose is for the other side.
    """
    if pose.side != hand.side:
        raise LiveHandError(f"{hand.armature.name} is a {hand.side} hand, the pose a {pose.side} one; mirror it first")
    hand.properties.beta = pose.beta
    hand.armature.update_tag()
    write_theta(hand, pose.theta)
    write_transl(hand, pose.transl)


def write_theta(hand: RiggedHand, theta: np.ndarray) -> None:
    """Set the 16 bones to theta [16, 3], rad, each in its own rotation mode; finger controls and IK go to zero."""
    clear_controls(hand)
    for joint, quaternion in enumerate(bone_quaternions(hand, theta)):
        set_rotation(hand.bone(joint), quaternion)


def write_transl(hand: RiggedHand, transl: np.ndarray) -> None:
    """Set the wrist's location so that the hand is moved by transl [3], m, in armature space."""
    hand.bone(0).location = wrist_locations(hand, transl)


def mirror_pose(hand: RiggedHand, other: RiggedHand, depsgraph: bpy.types.Depsgraph, turns_wrist: bool) -> None:
    """Give a hand of the other side the mirror image of this hand's pose.

    Args:
        hand: whose pose is read, constraints, controls and IK included.
        other: to be posed.
        depsgraph: of the frame.
        turns_wrist: whether the wrist turns as well, in the armature's own space.
    """
    theta = read_pose(hand, depsgraph).mirrored().theta
    if not turns_wrist:
        theta[0] = read_pose(other, depsgraph).theta[0]
    write_theta(other, theta)


def bone_quaternions(hand: RiggedHand, theta: np.ndarray) -> np.ndarray:
    """[..., 16, 4] each bone's own rotation (wxyz) for theta [..., 16, 3]: basis = B^T R B."""
    frames = rest_frames(hand.armature, hand.side)
    return axis_angle_to_quaternion(np.einsum("jab,...ja->...jb", frames, theta))


def wrist_locations(hand: RiggedHand, transl: np.ndarray) -> np.ndarray:
    """[..., 3] the wrist bone's location channels for transl [..., 3] m."""
    return np.asarray(transl, np.float64) @ rest_frames(hand.armature, hand.side)[0]


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
