"""Custom shapes of the animator's bones: rings around the joints, diamonds at the fingertip targets.

The two shapes are objects outside every scene, made once per file and shared by all its hands.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.hand.bones import FINGERS, bone_name, finger_joints, target_name
from ...backend.records.side import Side

_RING, _DIAMOND = "LiveHand Ring", "LiveHand Diamond"
_RING_CORNERS = 24
# Just outside the built-in hand's skin.
_FINGER_RADIUS_M, _THUMB_RADIUS_M, _WRIST_RADIUS_M = 0.0105, 0.0125, 0.038
_DIAMOND_RADIUS_M = 0.005
_BONE_COLOUR, _TARGET_COLOUR = "THEME04", "THEME01"


def set_bone_shapes(armature: bpy.types.Object, side: Side) -> None:
    """Give the animator's bones their shapes and colours."""
    ring, diamond = _shape(_RING), _shape(_DIAMOND)
    _set_shape(armature.pose.bones[bone_name(0, side)], ring, _WRIST_RADIUS_M, _BONE_COLOUR)
    for finger in FINGERS:
        radius_m = _THUMB_RADIUS_M if finger == "thumb" else _FINGER_RADIUS_M
        for joint in finger_joints(finger):
            bone = armature.pose.bones[bone_name(joint, side)]
            _set_shape(bone, ring, radius_m, _BONE_COLOUR)
            bone.custom_shape_translation = (0, bone.bone.length / 2, 0)
        _set_shape(armature.pose.bones[target_name(finger, side)], diamond, _DIAMOND_RADIUS_M, _TARGET_COLOUR)


def _set_shape(bone: bpy.types.PoseBone, shape: bpy.types.Object, radius_m: float, colour: str) -> None:
    bone.custom_shape = shape
    bone.use_custom_shape_bone_size = False
    bone.custom_shape_scale_xyz = (radius_m,) * 3
    bone.bone.color.palette = colour


def _shape(name: str) -> bpy.types.Object:
    """This file's shape of that name, of radius 1, with Y along the bone."""
    known = bpy.data.objects.get((name, None))
    if known is not None:
        return known
    vertices, edges = _ring() if name == _RING else _diamond()
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, edges, [])
    return bpy.data.objects.new(name, mesh)


def _ring() -> tuple[list, list]:
    angle = np.linspace(0, 2 * np.pi, _RING_CORNERS, endpoint=False)
    vertices = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], -1)
    return vertices.tolist(), [(k, (k + 1) % _RING_CORNERS) for k in range(_RING_CORNERS)]


def _diamond() -> tuple[list, list]:
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    # Each corner is joined to all but the opposite one.
    return vertices.tolist(), [(a, b) for a in range(6) for b in range(a) if a - b != 3]
