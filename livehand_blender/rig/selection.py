"""Which bones of an armature are selected."""

from __future__ import annotations

from collections.abc import Container

import bpy


def selected_bones(armature: bpy.types.Object) -> set[str]:
    """Return the names of the selected bones."""
    return {bone.name for bone in armature.pose.bones if _owner(bone).select}


def select_bones(armature: bpy.types.Object, names: Container[str]) -> None:
    """Select the bones of these names and no others."""
    for bone in armature.pose.bones:
        _owner(bone).select = bone.name in names


def _owner(bone: bpy.types.PoseBone) -> bpy.types.PoseBone | bpy.types.Bone:
    """Return what holds a bone's selection, which Blender 5 moved to the pose."""
    return bone if hasattr(bone, "select") else bone.bone
