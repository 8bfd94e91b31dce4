"""Custom shapes of the animator's bones: rings around the joints, diamonds at the fingertip targets.

The two shapes are objects outside every scene, made once per file and shared by all its hands.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.hand.bones import (
    FINGERS,
    bone_name,
    finger_joints,
    forearm_name,
    master_name,
    shown_target_name,
    target_name,
)
from ...backend.records.side import Side

_COLLECTION = "LiveHand Bone Shapes"
_RING, _DIAMOND = "LiveHand Ring", "LiveHand Diamond"
_RING_CORNERS = 24
# Just outside the built-in hand's skin.
_FINGER_RADIUS_M, _THUMB_RADIUS_M, _WRIST_RADIUS_M, _FOREARM_RADIUS_M = 0.0105, 0.0125, 0.038, 0.052
_DIAMOND_RADIUS_M = 0.005
# Seen on Blender's grey and on skin; the selected and the active bone are brighter.
_BONE_RGB, _TARGET_RGB, _MASTER_RGB = (1.0, 0.85, 0.1), (1.0, 0.2, 0.15), (0.2, 0.7, 1.0)
_MASTER_HEIGHT_M = 0.025
_WIRE_PX = 2.0


def set_bone_shapes(armature: bpy.types.Object, side: Side) -> None:
    """Give the animator's bones their shapes and colours."""
    ring, diamond = _shape(_RING), _shape(_DIAMOND)
    armature.livehand.bone_shapes = bpy.data.collections[_COLLECTION]  # which comes along when the hand is appended
    _set_shape(armature.pose.bones[bone_name(0, side)], ring, _WRIST_RADIUS_M, _BONE_RGB)
    forearm = armature.pose.bones.get(forearm_name(side))
    if forearm is not None:
        _set_shape(forearm, ring, _FOREARM_RADIUS_M, _BONE_RGB)
        forearm.custom_shape_translation = (0, forearm.bone.length / 2, 0)
    for finger in FINGERS:
        radius_m = _THUMB_RADIUS_M if finger == "thumb" else _FINGER_RADIUS_M
        for joint in finger_joints(finger):
            bone = armature.pose.bones[bone_name(joint, side)]
            _set_shape(bone, ring, radius_m, _BONE_RGB)
            bone.custom_shape_translation = (0, bone.bone.length / 2, 0)
        target = armature.pose.bones[target_name(finger, side)]
        _set_shape(target, diamond, _DIAMOND_RADIUS_M, _TARGET_RGB)
        target.custom_shape_transform = armature.pose.bones[shown_target_name(finger, side)]
        master = armature.pose.bones[master_name(finger, side)]
        _set_shape(master, diamond, _DIAMOND_RADIUS_M, _MASTER_RGB)
        # Over the back of the finger, and the end of a lever: it moves when the master turns.
        master.custom_shape_translation = (0, master.bone.length / 2, -_MASTER_HEIGHT_M)


def _set_shape(bone: bpy.types.PoseBone, shape: bpy.types.Object, radius_m: float, rgb: tuple) -> None:
    bone.custom_shape = shape
    bone.use_custom_shape_bone_size = False
    bone.custom_shape_scale_xyz = (radius_m,) * 3
    bone.custom_shape_wire_width = _WIRE_PX
    bone.bone.color.palette = "CUSTOM"
    colours = bone.bone.color.custom
    colours.normal, colours.select, colours.active = rgb, (1.0, 1.0, 1.0), (0.6, 1.0, 1.0)


def _shape(name: str) -> bpy.types.Object:
    """Return this file's shape of that name, of radius 1, with Y along the bone."""
    shape = bpy.data.objects.get((name, None))
    if shape is not None:
        return _out_of_sight(shape)
    vertices, edges = _ring() if name == _RING else _diamond()
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, edges, [])
    return _out_of_sight(bpy.data.objects.new(name, mesh))


def _out_of_sight(shape: bpy.types.Object) -> bpy.types.Object:
    """Hide it in a collection: Blender puts it, or objects without one, into the scene that a hand is appended to."""
    collection = bpy.data.collections.get((_COLLECTION, None)) or bpy.data.collections.new(_COLLECTION)
    collection.hide_viewport = collection.hide_render = True
    if shape.name not in collection.objects:
        collection.objects.link(shape)
    return shape


def _ring() -> tuple[list, list]:
    angle = np.linspace(0, 2 * np.pi, _RING_CORNERS, endpoint=False)
    vertices = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], -1)
    return vertices.tolist(), [(k, (k + 1) % _RING_CORNERS) for k in range(_RING_CORNERS)]


def _diamond() -> tuple[list, list]:
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    # Each corner is joined to all but the opposite one.
    return vertices.tolist(), [(a, b) for a in range(6) for b in range(a) if a - b != 3]
