"""Any armature -> `SourceSkeleton`."""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.rigs.source_skeleton import SourceSkeleton


def read_skeleton(armature: bpy.types.Object) -> SourceSkeleton:
    """The rest pose of an armature's bones in the world, by the object's present transform with its scale."""
    bones = _parents_first(armature.data.bones)
    index = {bone.name: number for number, bone in enumerate(bones)}
    world = np.array(armature.matrix_world, np.float64)
    rest = world @ np.array([bone.matrix_local for bone in bones], np.float64).reshape(-1, 4, 4)
    tails = np.array([bone.tail_local for bone in bones], np.float64).reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]
    return SourceSkeleton(
        names=tuple(index),
        parents=tuple(index[bone.parent.name] if bone.parent else -1 for bone in bones),
        heads=rest[:, :3, 3],
        tails=tails,
        frames=rest[:, :3, :3] / np.linalg.norm(rest[:, :3, :3], axis=1, keepdims=True),
    )


def _parents_first(bones: bpy.types.ArmatureBones) -> list[bpy.types.Bone]:
    roots = [bone for bone in bones if bone.parent is None]
    return [bone for root in roots for bone in (root, *root.children_recursive)]
