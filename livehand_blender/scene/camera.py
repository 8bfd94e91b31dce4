"""Converts Blender cameras to the backend's `Camera`, and Blender's axes to OpenCV's.

A Blender camera looks along its -Z with +Y up; OpenCV looks along +Z with +Y down. Blender counts image rows and the
border from the bottom; the backend from the top.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ...backend.records.camera import Camera
from ...backend.records.errors import LiveHandError

_LENS_TYPES = ("PERSP", "ORTHO")
_BLENDER_TO_OPENCV_AXES = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Region:
    """The rendered part of the image: Blender's render border, or all of it.

    Attributes:
        x0_px: first column.
        y0_px: first row, counted from the top.
        size_px: (width, height).
    """

    x0_px: int
    y0_px: int
    size_px: tuple[int, int]


@dataclass(frozen=True)
class Eye:
    """The properties of a camera that Blender's stereo settings change.

    Attributes:
        matrix_world: [4, 4] of the eye, in Blender's axes.
        shift_x: the eye's horizontal lens shift.
    """

    matrix_world: np.ndarray
    shift_x: float


def read_camera(camera: bpy.types.Object | None, render: bpy.types.RenderSettings, eye: Eye | None = None) -> Camera:
    """Read the camera of the whole image; crop it to the border with `render_region` and `Camera.cropped`.

    Args:
        camera: evaluated camera object of the frame.
        render: the scene's settings, for size, percentage and pixel aspect.
        eye: one eye of a stereo pair; None without stereo.

    Raises:
        LiveHandError: there is no camera, it is a panoramic one, or a parent shears or mirrors it.
    """
    if camera is None:
        raise LiveHandError(
            "a render needs a camera, the scene has none; add one and make it the active camera (Ctrl-Numpad 0)"
        )
    if camera.type != "CAMERA" or camera.data.type not in _LENS_TYPES:
        got = camera.data.type if camera.type == "CAMERA" else f"a {camera.type} object"
        raise LiveHandError(
            f"LiveHand renders perspective and orthographic cameras only, '{camera.name}' is {got}; "
            "set its lens type to Perspective"
        )
    size_px = image_size_px(render)
    shift_x = camera.data.shift_x if eye is None else eye.shift_x
    matrix_world = np.array(camera.matrix_world) if eye is None else eye.matrix_world
    K = _intrinsics(camera.data, shift_x, size_px, render.pixel_aspect_y / render.pixel_aspect_x)
    return Camera(K, _cam2world(matrix_world), size_px, is_orthographic=camera.data.type == "ORTHO")


def image_size_px(render: bpy.types.RenderSettings) -> tuple[int, int]:
    """Compute (width, height) of the whole image after the percentage, rounded down as Blender does."""
    percentage = render.resolution_percentage
    return render.resolution_x * percentage // 100, render.resolution_y * percentage // 100


def render_region(render: bpy.types.RenderSettings) -> Region:
    """Compute the render border in whole pixels, rounded as Blender does, or the whole image.

    Raises:
        LiveHandError: the border holds no pixel.
    """
    width, height = image_size_px(render)
    if not render.use_border:
        return Region(0, 0, (width, height))
    # Blender multiplies in single precision and truncates; anything else is sometimes off by one pixel.
    left, right = (int(np.float32(edge) * np.float32(width)) for edge in (render.border_min_x, render.border_max_x))
    bottom, top = (int(np.float32(edge) * np.float32(height)) for edge in (render.border_min_y, render.border_max_y))
    if right <= left or top <= bottom:
        raise LiveHandError(
            "the render border must hold at least one pixel, it holds none; clear it (Ctrl-Alt-B in a 3D view)"
        )
    return Region(left, height - top, (right - left, top - bottom))


def output_size_px(render: bpy.types.RenderSettings) -> tuple[int, int]:
    """Compute (width, height) of the file that Blender writes."""
    return render_region(render).size_px if render.use_crop_to_border else image_size_px(render)


def _intrinsics(lens: bpy.types.Camera, shift_x: float, size_px: tuple[int, int], pixel_aspect: float) -> np.ndarray:
    """Compute K, px, or px per m of an orthographic lens. `pixel_aspect` is a pixel's height over its width."""
    width, height = size_px
    fit = lens.sensor_fit
    if fit == "AUTO":
        fit = "HORIZONTAL" if width >= height * pixel_aspect else "VERTICAL"
        sensor_mm = lens.sensor_width
    else:
        sensor_mm = lens.sensor_width if fit == "HORIZONTAL" else lens.sensor_height
    # The side of the image that the sensor is fitted to, in pixel widths.
    fitted_px = width if fit == "HORIZONTAL" else height * pixel_aspect
    focal_px = fitted_px / lens.ortho_scale if lens.type == "ORTHO" else lens.lens / sensor_mm * fitted_px
    centre_x = width / 2 - shift_x * fitted_px
    centre_y = height / 2 + lens.shift_y * fitted_px / pixel_aspect
    return np.array([[focal_px, 0, centre_x], [0, focal_px / pixel_aspect, centre_y], [0, 0, 1]])


def _cam2world(matrix_world: np.ndarray) -> np.ndarray:
    """Remove the scale from a Blender camera's matrix, as Blender does, and convert its axes to OpenCV's."""
    rigid = np.array(matrix_world, np.float64)
    rigid[:3, :3] /= np.linalg.norm(rigid[:3, :3], axis=0)
    return rigid @ _BLENDER_TO_OPENCV_AXES
