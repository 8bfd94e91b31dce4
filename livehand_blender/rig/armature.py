"""The armature: 16 bones to turn, and hidden helpers that make skinning exact for every beta.

MANO moves the joints with beta: J' = J + dJ. Bone j turns about J'_j, Blender binds the mesh to rest bones at J_j.
So each turned bone is carried to J'_j by drivers on its location, and its deforming child steps back by dJ_j: together
they are MANO's transform for any pose and any animated beta, with drivers linear in beta only.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.errors import LiveHandError
from ...backend.hand.model import PARENTS, HandModel
from ...backend.shot import Side
from .bones import RestBones, bone_name, deform_name, rest_bones, root_name
from .drivers import drive_by_beta


def build_armature(context: bpy.types.Context, model: HandModel, name: str) -> bpy.types.Object:
    """A new armature object in the context's collection, left selected and active, in object mode.

    Raises:
        LiveHandError: the context's collection is hidden from the view layer, so that no bone can be made.
    """
    armature = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    armature.show_in_front = True
    context.collection.objects.link(armature)
    _make_active(context, armature)
    _add_bones(armature, rest_bones(model), model.side)
    _hide_helpers(armature, model.side)
    _set_channels(armature, model.side)
    return armature


def rest_frames(armature: bpy.types.Object, side: Side) -> np.ndarray:
    """[16, 3, 3] rest orientation B of the turned bones, as Blender holds it (columns are the bone's axes)."""
    bones = armature.data.bones
    return np.array([bones[bone_name(joint, side)].matrix_local.to_3x3() for joint in range(16)], np.float64)


def drive_joints(armature: bpy.types.Object, model: HandModel) -> None:
    """Carry the bones to the joints of the shaped hand."""
    frames = rest_frames(armature, model.side)
    offsets = np.einsum("jv,vck->jck", model.J_regressor, model.shapedirs)  # [16, 3, 10]: dJ per unit of beta
    _drive_location(armature, root_name(model.side), frames[0].T @ offsets[0])
    for joint in range(16):
        _drive_location(armature, deform_name(joint, model.side), -frames[joint].T @ offsets[joint])
    # The wrist's own location is left to the animator: it is transl.
    for joint in range(1, 16):
        step = offsets[joint] - offsets[PARENTS[joint]]
        _drive_location(armature, bone_name(joint, model.side), frames[joint].T @ step)


def _drive_location(armature: bpy.types.Object, bone: str, weights: np.ndarray) -> None:
    for axis in range(3):
        drive_by_beta(armature.pose.bones[bone], "location", axis, weights[axis], armature)


def _make_active(context: bpy.types.Context, armature: bpy.types.Object) -> None:
    context.view_layer.update()  # objects just linked are not in the view layer before
    if armature.name not in context.view_layer.objects:
        bpy.data.armatures.remove(armature.data)
        raise LiveHandError("a hand needs a collection that is in the view layer; choose one that is not excluded")
    for other in context.selected_objects:
        other.select_set(False)
    context.view_layer.objects.active = armature
    armature.select_set(True)


def _add_bones(armature: bpy.types.Object, rest: RestBones, side: Side) -> None:
    bpy.ops.object.mode_set(mode="EDIT")
    _add_bone(armature, root_name(side), None, rest, 0)
    for joint, parent in enumerate(PARENTS):
        above = bone_name(parent, side) if parent >= 0 else root_name(side)
        _add_bone(armature, bone_name(joint, side), above, rest, joint)
        _add_bone(armature, deform_name(joint, side), bone_name(joint, side), rest, joint)
    bpy.ops.object.mode_set(mode="OBJECT")


def _add_bone(armature: bpy.types.Object, name: str, parent: str | None, rest: RestBones, joint: int) -> None:
    bone = armature.data.edit_bones.new(name)
    bone.head, bone.tail = rest.heads[joint], rest.tails[joint]
    bone.align_roll(rest.frames[joint][:, 2])
    bone.parent = armature.data.edit_bones[parent] if parent else None
    # A connected bone cannot be carried to the shaped hand's joint.
    bone.use_connect = False


def _hide_helpers(armature: bpy.types.Object, side: Side) -> None:
    turned = armature.data.collections.new("Hand")
    helpers = armature.data.collections.new("Helpers")
    helpers.is_visible = False
    names = {bone_name(joint, side) for joint in range(16)}
    for bone in armature.data.bones:
        (turned if bone.name in names else helpers).assign(bone)
        bone.use_deform = bone.name.startswith("DEF-")


def _set_channels(armature: bpy.types.Object, side: Side) -> None:
    wrist = bone_name(0, side)
    for bone in armature.pose.bones:
        bone.rotation_mode = "QUATERNION"
        bone.lock_location = (bone.name != wrist,) * 3
        bone.lock_scale = (True,) * 3
