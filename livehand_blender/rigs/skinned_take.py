"""A take as an armature and a skinned mesh with an action, as Blender's exporters write them."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from ...backend.geometry.rotation import continuous, matrix_to_quaternion
from ...backend.motion.spaces import TO_BLENDER
from ...backend.motion.writers.skeleton import SkeletonMotion, skeleton_motion
from ...backend.motion.writers.take import Take, TakenHand
from ...backend.records.errors import LiveHandError
from ..rig.keyframes import key_channels
from .skinned_mesh import ExportedMesh, add_mesh

_UP = TO_BLENDER["y_up"]
_MOST_FPS = 32767  # Blender's


def add_take(
    context: bpy.types.Context, take: Take, surface_of: Callable[[TakenHand], ExportedMesh]
) -> list[bpy.types.Object]:
    """Add an armature and a mesh for each hand to the context's scene, selected; returns the armature, then meshes.

    The scene gets the take's frames, from 0, and its rate. `surface_of` makes a hand's mesh.

    Raises:
        LiveHandError: Blender cannot have the rate.
    """
    motion = skeleton_motion(take)
    _set_time(context.scene, take)
    armature = _add_armature(context, motion)
    _key(armature, motion)
    meshes = [add_mesh(context, hand, armature, surface_of(hand)) for hand in take.hands]
    things = [armature, *meshes]
    for thing in things:
        thing.select_set(True)
    context.view_layer.objects.active = armature
    context.view_layer.update()
    return things


def _set_time(scene: bpy.types.Scene, take: Take) -> None:
    rate = max(1, round(take.fps))
    if rate > _MOST_FPS or not 0.1 <= rate / take.fps <= 1e6:
        raise LiveHandError(f"the rate must be one that Blender has, up to {_MOST_FPS}, got {take.fps}; resample it")
    scene.render.fps, scene.render.fps_base = rate, rate / take.fps
    scene.frame_start, scene.frame_end = 0, take.count - 1


def _add_armature(context: bpy.types.Context, motion: SkeletonMotion) -> bpy.types.Object:
    armature = bpy.data.objects.new("LiveHand", bpy.data.armatures.new("LiveHand"))
    context.collection.objects.link(armature)
    context.view_layer.update()
    context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    bones = armature.data.edit_bones
    lengths = np.linalg.norm(motion.tails - motion.heads, axis=1)
    for index, name in enumerate(motion.names):
        frame = _UP @ motion.frames[index]
        bone = bones.new(name)
        bone.head = _UP @ motion.heads[index]
        bone.tail = _UP @ motion.heads[index] + lengths[index] * frame[:, 1]
        bone.align_roll(frame[:, 2])
        bone.parent = bones[motion.names[motion.parents[index]]] if motion.parents[index] >= 0 else None
    bpy.ops.object.mode_set(mode="OBJECT")
    return armature


def _key(armature: bpy.types.Object, motion: SkeletonMotion) -> None:
    frames = np.arange(len(motion.rotations))
    turns = _UP @ motion.rotations @ _UP.T
    for index, name in enumerate(motion.names):
        bone = armature.pose.bones[name]
        bone.rotation_mode = "QUATERNION"
        rest = np.array(bone.bone.matrix_local, np.float64)
        own = rest[:3, :3].T @ turns[:, index] @ rest[:3, :3]
        key_channels(armature, bone, "rotation_quaternion", frames, continuous(matrix_to_quaternion(own)))
        if motion.parents[index] < 0:
            moved = motion.positions[:, index] @ _UP.T - rest[:3, 3]
            key_channels(armature, bone, "location", frames, moved @ rest[:3, :3])
