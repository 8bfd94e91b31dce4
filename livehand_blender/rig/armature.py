"""The armature: 16 bones to pose, fingertip targets, and hidden bones that make skinning exact for every beta.

A model with an arm also has a forearm: it carries the wrist, which bends against it.

MANO moves the joints with beta: J' = J + dJ. Bone j rotates about J'_j, but Blender binds the mesh to rest bones at
J_j. So drivers move each posed bone to J'_j, and its deforming child back by dJ_j. Together they are MANO's transform
for any pose and any animated beta, with drivers that are linear in beta.
"""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np

from ...backend.hand.bones import (
    FINGERS,
    RestBones,
    bone_name,
    control_name,
    deform_name,
    finger_joints,
    forearm_deform_name,
    forearm_name,
    master_name,
    rest_bones,
    rest_forearm,
    root_name,
    shown_target_name,
    target_name,
)
from ...backend.hand.joint_axes import joint_frames
from ...backend.hand.model import PARENTS, HandModel
from ...backend.records.errors import LiveHandError
from ...backend.records.side import Side
from .drivers import drive_by_beta

COLLECTIONS = ("FK", "IK", "Masters", "Mechanism")
_TARGET_M = 0.01  # length of a fingertip target's bone


def build_armature(context: bpy.types.Context, model: HandModel, name: str) -> bpy.types.Object:
    """Add a new armature object to the context's collection, left selected and active, in object mode.

    Raises:
        LiveHandError: the context's collection is hidden from the view layer, so bones cannot be added.
    """
    armature = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    armature.show_in_front = True
    context.collection.objects.link(armature)
    _make_active(context, armature)
    _add_bones(armature, model, joint_frames(model))
    _sort_into_collections(armature, model.side)
    _set_channels(armature, model.side)
    return armature


def rest_frames(armature: bpy.types.Object, side: Side) -> np.ndarray:
    """Compute the rest orientation B [16, 3, 3] of the posed bones as Blender stores it (columns: the bone's axes)."""
    bones = armature.data.bones
    return np.array([bones[bone_name(joint, side)].matrix_local.to_3x3() for joint in range(16)], np.float64)


def drive_joints(armature: bpy.types.Object, model: HandModel) -> None:
    """Drive the bones to the joints of the shaped hand."""
    frames = rest_frames(armature, model.side)
    offsets = np.einsum("jv,vck->jck", model.J_regressor, model.shapedirs)  # [16, 3, 10]: dJ per unit of beta
    _drive_location(armature, root_name(model.side), frames[0].T @ offsets[0])
    if model.has_arm:
        name = forearm_deform_name(model.side)
        frame = np.array(armature.data.bones[name].matrix_local.to_3x3(), np.float64)
        _drive_location(armature, name, -frame.T @ offsets[0])
    for joint in range(16):
        _drive_location(armature, deform_name(joint, model.side), -frames[joint].T @ offsets[joint])
    # The location of the wrist, or of the forearm that carries it, is the animator's: it is transl.
    for joint in range(1, 16):
        step = offsets[joint] - offsets[PARENTS[joint]]
        _drive_location(armature, bone_name(joint, model.side), frames[joint].T @ step)


def _drive_location(armature: bpy.types.Object, bone: str, weights: np.ndarray) -> None:
    for axis in range(3):
        drive_by_beta(armature.pose.bones[bone], "location", axis, weights[axis], armature)


def _make_active(context: bpy.types.Context, armature: bpy.types.Object) -> None:
    context.view_layer.update()  # only then does the view layer list objects just linked
    if armature.name not in context.view_layer.objects:
        bpy.data.armatures.remove(armature.data)
        raise LiveHandError("a hand needs a collection that is in the view layer; choose one that is not excluded")
    for other in context.selected_objects:
        other.select_set(False)
    context.view_layer.objects.active = armature
    armature.select_set(True)


def _add_bones(armature: bpy.types.Object, model: HandModel, anatomical: np.ndarray) -> None:
    side, rest = model.side, rest_bones(model)
    bpy.ops.object.mode_set(mode="EDIT")
    _add_bone(armature, root_name(side), None, _along(rest, 0))
    carrier = _add_forearm(armature, model) if model.has_arm else root_name(side)
    for joint, parent in enumerate(PARENTS):
        above = bone_name(parent, side) if parent >= 0 else carrier
        _add_bone(armature, bone_name(joint, side), above, _along(rest, joint))
        _add_bone(armature, deform_name(joint, side), bone_name(joint, side), _along(rest, joint))
    for joint in range(1, 16):
        placement = _along(rest, joint)._replace(frame=anatomical[joint])
        # Not a child of the finger's bones: they depend on it, and IK solves them all at once.
        _add_bone(armature, control_name(joint, side), root_name(side), placement)
    for finger in FINGERS:
        first = finger_joints(finger)[0]
        placement = _along(rest, first)._replace(frame=anatomical[first])
        # A master is seen, and follows the hand; a target stays where it is put.
        _add_bone(armature, master_name(finger, side), bone_name(0, side), placement)
        last = _along(rest, finger_joints(finger)[-1])
        tip = last._replace(head=last.head + last.length * last.frame[:, 1], length=_TARGET_M)
        _add_bone(armature, target_name(finger, side), root_name(side), tip)
        _add_bone(armature, shown_target_name(finger, side), bone_name(finger_joints(finger)[-1], side), tip)
    bpy.ops.object.mode_set(mode="OBJECT")


def _add_forearm(armature: bpy.types.Object, model: HandModel) -> str:
    """Add the forearm and the bone that deforms it; returns the forearm's name."""
    head, tail, frame = rest_forearm(model)
    placement = _BonePlacement(head, frame, float(np.linalg.norm(tail - head)))
    name = forearm_name(model.side)
    _add_bone(armature, name, root_name(model.side), placement)
    _add_bone(armature, forearm_deform_name(model.side), name, placement)
    return name


class _BonePlacement(NamedTuple):
    """Rest position of a bone: head [3] m, frame [3, 3] with columns X, Y, Z, and length in m along Y."""

    head: np.ndarray
    frame: np.ndarray
    length: float


def _along(rest: RestBones, joint: int) -> _BonePlacement:
    length = float(np.linalg.norm(rest.tails[joint] - rest.heads[joint]))
    return _BonePlacement(rest.heads[joint], rest.frames[joint], length)


def _add_bone(armature: bpy.types.Object, name: str, parent: str | None, placement: _BonePlacement) -> None:
    bone = armature.data.edit_bones.new(name)
    bone.head, bone.tail = placement.head, placement.head + placement.length * placement.frame[:, 1]
    bone.align_roll(placement.frame[:, 2])
    bone.parent = armature.data.edit_bones[parent] if parent else None
    # A connected bone could not be moved to the shaped hand's joint.
    bone.use_connect = False


def _sort_into_collections(armature: bpy.types.Object, side: Side) -> None:
    """Sort bones into collections: FK, IK and Masters for the animator, Mechanism hidden."""
    fk, ik, masters, hidden = (armature.data.collections.new(name) for name in COLLECTIONS)
    hidden.is_visible = False
    collection_of = {bone_name(joint, side): fk for joint in range(16)} | {forearm_name(side): fk}
    collection_of |= {target_name(finger, side): ik for finger in FINGERS}
    collection_of |= {master_name(finger, side): masters for finger in FINGERS}
    for bone in armature.data.bones:
        collection_of.get(bone.name, hidden).assign(bone)
        bone.use_deform = bone.name.startswith("DEF-")


def _set_channels(armature: bpy.types.Object, side: Side) -> None:
    carrier = forearm_name(side) if forearm_name(side) in armature.pose.bones else bone_name(0, side)
    movable = {carrier, *(target_name(finger, side) for finger in FINGERS)}
    for bone in armature.pose.bones:
        bone.rotation_mode = "QUATERNION"
        bone.lock_location = (bone.name not in movable,) * 3
        bone.lock_scale = (True,) * 3
    for finger in FINGERS:
        master = armature.pose.bones[master_name(finger, side)]
        master.rotation_mode, master.lock_rotation = "XYZ", (False, True, False)
