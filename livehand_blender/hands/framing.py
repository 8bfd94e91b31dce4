"""Hands put into the picture: the scene's camera, and 3D views."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Matrix

from ...backend.geometry.framing import fitting_camera
from ..rig.hand import RiggedHand
from .shot import world_vertices

_SIZE_PX = (1080, 1350)
_FROM = (0.35, -1.0, 0.15)
_FILLED = 0.82
_SENSOR_MM = 36.0
_DISPLAY_M, _CLIP_M = 0.1, 0.01
_OPENCV_TO_BLENDER = np.diag([1.0, -1, -1, 1])


def framed_vertices(hand: RiggedHand, depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    """Read [N, 3] in the world, m: the evaluated mesh without the arm, if modifiers keep its vertices."""
    vertices, framed = world_vertices(hand.mesh.evaluated_get(depsgraph)), hand.model.framed_vertices
    return vertices[framed] if len(vertices) == len(framed) else vertices


def add_framing_camera(scene: bpy.types.Scene, hand: RiggedHand, depsgraph: bpy.types.Depsgraph) -> bpy.types.Object:
    """Add a camera that shows the hand upright from the front, and make it the scene's, with a picture of its shape."""
    view = fitting_camera(framed_vertices(hand, depsgraph), _FROM, _SIZE_PX, _FILLED)
    width, height = scene.render.resolution_x, scene.render.resolution_y = _SIZE_PX
    lens = bpy.data.cameras.new("Camera")
    camera = bpy.data.objects.new("Camera", lens)
    lens.sensor_fit, lens.sensor_width = "HORIZONTAL", _SENSOR_MM
    lens.lens = view.K[0, 0] * _SENSOR_MM / width
    lens.shift_x = (width / 2 - view.K[0, 2]) / width
    lens.shift_y = (view.K[1, 2] - height / 2) / width
    lens.clip_start, lens.display_size = _CLIP_M, _DISPLAY_M
    camera.matrix_world = Matrix((view.cam2world @ _OPENCV_TO_BLENDER).tolist())
    scene.collection.objects.link(camera)
    scene.camera = camera
    return camera


def frame_in_view(context: bpy.types.Context) -> bool:
    """Turn the context's 3D view to the selected objects, unless it looks through a camera; returns whether it did."""
    area = context.area
    if area is None or area.type != "VIEW_3D" or context.region_data is None:
        return False
    if context.region_data.view_perspective == "CAMERA":
        return False
    region = next(one for one in area.regions if one.type == "WINDOW")
    with context.temp_override(area=area, region=region):
        bpy.ops.view3d.view_selected(use_all_regions=False)
    return True


def views_of(window: bpy.types.Window) -> Iterator[bpy.types.SpaceView3D]:
    """List a window's 3D views."""
    for area in window.screen.areas:
        if area.type == "VIEW_3D" and isinstance(area.spaces.active, bpy.types.SpaceView3D):
            yield area.spaces.active
