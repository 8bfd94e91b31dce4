"""A take as an armature and a skinned mesh with an action, as Blender's exporters write them."""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.geometry.rotation import continuous, matrix_to_quaternion
from ...backend.hand.model import HandModel
from ...backend.motion.spaces import TO_BLENDER
from ...backend.motion.writers.skeleton import SkeletonMotion, bone_names, skeleton_motion
from ...backend.motion.writers.take import Take, TakenHand
from ...backend.records.errors import LiveHandError
from ..rig.keyframes import key_channels

_UP = TO_BLENDER["y_up"]
_LEAST_WEIGHT = 1e-4
_MOST_FPS = 32767  # Blender's


def add_take(context: bpy.types.Context, take: Take) -> list[bpy.types.Object]:
    """Add an armature and a mesh for each hand to the context's scene, selected; returns the armature, then meshes.

    The scene gets the take's frames, from 0, and its rate.

    Raises:
        LiveHandError: Blender cannot have the rate.
    """
    motion = skeleton_motion(take)
    _set_time(context.scene, take)
    armature = _add_armature(context, motion)
    _key(armature, motion)
    meshes = [_add_mesh(context, hand, armature) for hand in take.hands]
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
            moved = motion.places[:, index] @ _UP.T - rest[:3, 3]
            key_channels(armature, bone, "location", frames, moved @ rest[:3, :3])


def _add_mesh(context: bpy.types.Context, hand: TakenHand, armature: bpy.types.Object) -> bpy.types.Object:
    model, beta = hand.own_model, hand.motion.betas.mean(0)
    vertices = hand.scale * (model.v_template + model.shapedirs @ beta) @ _UP.T
    name = f"{hand.side.capitalize()} Hand"
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices.tolist(), [], model.f.tolist())
    data.polygons.foreach_set("use_smooth", np.ones(len(model.f), bool))
    atlas = data.uv_layers.new(name="Atlas")
    atlas.data.foreach_set("uv", model.vt[model.ft].astype(np.float32).ravel())
    mesh = bpy.data.objects.new(name, data)
    context.collection.objects.link(mesh)
    _give_weights(mesh, model, bone_names(hand.side))
    mesh.parent = armature
    mesh.modifiers.new("Armature", "ARMATURE").object = armature
    return mesh


def _give_weights(mesh: bpy.types.Object, model: HandModel, names: tuple[str, ...]) -> None:
    """Give vertices the weights of the joints' bones [16] and of the forearm's, the last."""
    weights = np.concatenate([model.lbs_weights, model.arm_weights[:, None]], 1)
    weights[:, 0] -= model.arm_weights
    for column, name in enumerate(names):
        moved = np.flatnonzero(weights[:, column] > _LEAST_WEIGHT)
        if len(moved):
            group = mesh.vertex_groups.new(name=name)
            for vertex in moved.tolist():
                group.add([vertex], float(weights[vertex, column]), "REPLACE")
