"""Reads the backend `Camera` of a 3D view, be it a free view, perspective or orthographic, or one through a camera.

Blender's `window_matrix` is the projection of the whole region, including a camera view's zoom, offset and lens shift.
Blender counts a region's rows from the bottom, as OpenGL does.
"""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np

from ...backend.records.camera import Camera
from ..scene.camera import read_camera, render_region

# A free orthographic view shows what lies behind its centre, too. From so far back, single precision is 0.01 mm.
_BACK_M = 100.0
_OPENGL_TO_OPENCV_AXES = np.diag([1.0, -1.0, -1.0, 1.0])


class Rectangle(NamedTuple):
    """Part of a region, px, rows counted from the top; right and bottom are excluded."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self.right - self.left, self.bottom - self.top


class RegionView(NamedTuple):
    """What a 3D view shows: a rectangle of its region, px, and the rectangle's camera."""

    camera: Camera
    rectangle: Rectangle


def read_view(context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> RegionView | None:
    """Read the view of the context's region, cropped to the render border; None if the border lies outside.

    Raises:
        LiveHandError: the view is a camera's, and that is at fault.
    """
    region, space = context.region, context.space_data
    camera = region_camera(context.region_data, (region.width, region.height))
    rectangle = (
        _border(context, depsgraph, camera) if _has_border(space, depsgraph) else Rectangle(0, 0, *camera.size_px)
    )
    if min(rectangle.size_px) <= 0:
        return None
    return RegionView(camera.cropped(rectangle.left, rectangle.top, rectangle.size_px), rectangle)


def region_camera(view: bpy.types.RegionView3D, size_px: tuple[int, int]) -> Camera:
    """Read the camera of a whole region."""
    projection = np.array(view.window_matrix, np.float64)
    is_orthographic = bool(projection[3, 3] != 0)
    # Where the axis leaves the region's middle: lengths are divided by -z, or by 1.
    aside, up = projection[:2, 3] if is_orthographic else -projection[:2, 2]
    half_width, half_height = size_px[0] / 2, size_px[1] / 2
    K = np.array(
        [
            [half_width * projection[0, 0], 0, half_width * (1 + aside)],
            [0, half_height * projection[1, 1], half_height * (1 - up)],
            [0, 0, 1],
        ]
    )
    cam2world = _inverse(np.array(view.view_matrix, np.float64)) @ _OPENGL_TO_OPENCV_AXES
    if is_orthographic and view.view_perspective != "CAMERA":
        cam2world[:3, 3] -= _BACK_M * cam2world[:3, 2]
    return Camera(K, cam2world, size_px, is_orthographic)


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Invert an affine matrix [4, 4] by hand; `backend.field.rays.camera_tensors` says why."""
    turn, inverse = matrix[:3, :3], np.eye(4)
    across = np.cross(turn[[1, 2, 0]], turn[[2, 0, 1]])
    inverse[:3, :3] = across.T / (turn[0] * across[0]).sum()
    inverse[:3, 3] = -(inverse[:3, :3] * matrix[:3, 3]).sum(1)
    return inverse


def _has_border(space: bpy.types.SpaceView3D, depsgraph: bpy.types.Depsgraph) -> bool:
    if space.region_3d.view_perspective == "CAMERA":
        return depsgraph.scene.render.use_border
    return space.use_render_border


def _border(context: bpy.types.Context, depsgraph: bpy.types.Depsgraph, camera: Camera) -> Rectangle:
    """Crop the render border to the region."""
    space = context.space_data
    width, height = camera.size_px
    if space.region_3d.view_perspective == "CAMERA":
        left, top, right, bottom = _camera_border(space, depsgraph, camera)
    else:
        left, right = space.render_border_min_x * width, space.render_border_max_x * width
        top, bottom = (1 - space.render_border_max_y) * height, (1 - space.render_border_min_y) * height
    edges = (max(left, 0), max(top, 0), min(right, width), min(bottom, height))
    return Rectangle(*(round(edge) for edge in edges))


def _camera_border(
    space: bpy.types.SpaceView3D, depsgraph: bpy.types.Depsgraph, camera: Camera
) -> tuple[float, float, float, float]:
    """Compute left, top, right and bottom of the render border, px of a region that shows a camera's image."""
    scene = depsgraph.scene
    viewed_from = space.camera if space.use_local_camera else scene.camera
    image = read_camera(viewed_from.evaluated_get(depsgraph), scene.render).K
    scale = camera.K[[0, 1], [0, 1]] / image[[0, 1], [0, 1]]
    border = render_region(scene.render)
    corner = np.array([border.x0_px, border.y0_px])
    first, last = (camera.K[:2, 2] + scale * (c - image[:2, 2]) for c in (corner, corner + border.size_px))
    return first[0], first[1], last[0], last[1]
