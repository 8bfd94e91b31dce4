"""Colours that the scene's view transform shows as Standard would show the hand's.

AgX and Filmic are made for light without bounds; an avatar's colours were learnt from images and are what is to be
seen. So the inverse of the view is looked for: on a grid of colours, by Gauss-Newton steps against Blender's own colour
management, once per view; in between it is interpolated. Exposure, gamma, white balance and curves act as ever.

Colours are linear and straight. They are sought as non-negative Rec.2020, which reaches more of what AgX can show than
Rec.709 does; `code` is log2 of them, `axis` the 2.4th root of a Rec.709 component, [N, 3] both.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

from ...backend.records.errors import LiveHandError
from ...backend.records.shot import Frame
from .colour import in_working_space, rec709_to_working_space

_GRID_SIZE = 33
_STEPS = 10
_AXIS_POWER = 2.4
_CODE_RANGE = (-14.0, 8.0)
# A step this long is seen well in 16 bits, and short against the bends of any view.
_PROBE = 0.05
# A view that misses half of all colours by more than this (8-bit levels) is no view that can be inverted.
_BEARABLE_LEVELS = 4.0
_REC2020_TO_REC709 = np.array(
    [[1.660491, -0.587641, -0.072850], [-0.124550, 1.132900, -0.008349], [-0.018151, -0.100579, 1.118730]]
)


class ViewTransform(NamedTuple):
    """The part of a scene's colour management that is undone."""

    display: str
    transform: str
    look: str

    @classmethod
    def of_scene(cls, scene: bpy.types.Scene) -> ViewTransform:
        """As it is set now."""
        settings = scene.view_settings
        return cls(scene.display_settings.display_device, settings.view_transform, settings.look)

    @property
    def standard(self) -> ViewTransform:
        """What the colours are to look like on the same display."""
        return ViewTransform(self.display, "Standard", "None")


def kept_look(rgb_linear: np.ndarray, scene: bpy.types.Scene) -> np.ndarray:
    """The colours to render, so that they are shown as Standard shows `rgb_linear`.

    The first call for a view takes about a second. Colours that the view cannot show (bright saturated ones under AgX)
    come as near as it can get; some results have a negative component, as saturated colours beyond Rec.709 do.

    Args:
        rgb_linear: [..., 3] linear Rec.709, straight; what lies outside [0, 1] is clipped, as Standard does.
        scene: whose view transform and look are undone.

    Raises:
        LiveHandError: the view shows different colours alike (False Color), so that nothing undoes it.
    """
    view = ViewTransform.of_scene(scene)
    if view == view.standard:
        return rgb_linear
    axis = np.clip(rgb_linear, 0, 1).reshape(-1, 3) ** (1 / _AXIS_POWER)
    kept = _rgb_of_code(_interpolated(_inverse(view), axis))
    return kept.reshape(rgb_linear.shape).astype(rgb_linear.dtype)


def frame_with_kept_look(frame: Frame, scene: bpy.types.Scene) -> Frame:
    """The frame in colours that are shown as Standard shows its own; see `kept_look`. Alpha and depth stay."""
    is_seen = frame.alpha > 0
    alpha = frame.alpha[is_seen][:, None]
    rgb = np.zeros_like(frame.rgb)
    rgb[is_seen] = kept_look(frame.rgb[is_seen] / alpha, scene) * alpha
    return replace(frame, rgb=rgb)


def in_scene_colours(frame: Frame, scene: bpy.types.Scene) -> Frame:
    """A backend frame as the scene's colour management wants it: in its working space, with its look kept if asked for.

    Raises:
        LiveHandError: as `kept_look`.
    """
    return in_working_space(frame_with_kept_look(frame, scene) if scene.livehand.keep_look else frame)


@lru_cache(maxsize=4)
def _inverse(view: ViewTransform) -> np.ndarray:
    """[_GRID_SIZE, _GRID_SIZE, _GRID_SIZE, 3] code of each colour of the grid."""
    ticks = np.linspace(0, 1, _GRID_SIZE)
    rgb = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), -1).reshape(-1, 3) ** _AXIS_POWER
    wanted = _shown(rgb, view.standard)
    code, error = _solve(rgb, wanted, view)
    missed_levels = float(np.median(np.abs(error).max(-1)) * 255)
    if missed_levels > _BEARABLE_LEVELS:
        raise LiveHandError(
            f"Keep Look needs a view transform that can be undone, '{view.transform}' is {missed_levels:.0f} levels "
            "off for half of all colours; choose Standard, AgX or Filmic (Render properties, Color Management), or "
            "turn Keep Look off"
        )
    return code.reshape(_GRID_SIZE, _GRID_SIZE, _GRID_SIZE, 3)


def _solve(rgb: np.ndarray, wanted: np.ndarray, view: ViewTransform) -> tuple[np.ndarray, np.ndarray]:
    """Codes that are shown as `wanted` [N, 3], starting from `rgb`, and what is left of the error [N, 3].

    Levenberg's damping, each colour with its own: where the view is flat, or the colour out of reach, steps stay short.
    """
    code = np.log2(np.maximum(rgb @ np.linalg.inv(_REC2020_TO_REC709).T, 2.0**-10))
    error, slopes = _probe(code, wanted, view)
    damping = np.full(len(rgb), 1e-4)
    for _ in range(_STEPS):
        normal = slopes.transpose(0, 2, 1) @ slopes + damping[:, None, None] * np.eye(3)
        step = np.linalg.solve(normal, slopes.transpose(0, 2, 1) @ error[..., None])[..., 0]
        tried = np.clip(code - np.clip(step, -2, 2), *_CODE_RANGE)
        new_error, new_slopes = _probe(tried, wanted, view)
        better = (new_error**2).sum(-1) < (error**2).sum(-1)
        code = np.where(better[:, None], tried, code)
        error = np.where(better[:, None], new_error, error)
        slopes = np.where(better[:, None, None], new_slopes, slopes)
        damping = np.clip(np.where(better, damping / 4, damping * 8), 1e-8, 10)
    return code, error


def _probe(code: np.ndarray, wanted: np.ndarray, view: ViewTransform) -> tuple[np.ndarray, np.ndarray]:
    """What is shown too much [N, 3], and its slopes by code [N, 3 shown, 3 code]."""
    codes = np.stack([code, *(code + _PROBE * axis for axis in np.eye(3))])
    shown = _shown(_rgb_of_code(codes.reshape(-1, 3)), view).reshape(codes.shape)
    return shown[0] - wanted, np.moveaxis((shown[1:] - shown[0]) / _PROBE, 0, -1)


def _rgb_of_code(code: np.ndarray) -> np.ndarray:
    return np.exp2(code) @ _REC2020_TO_REC709.T


def _shown(rgb_linear: np.ndarray, view: ViewTransform) -> np.ndarray:
    """[N, 3] in [0, 1]: what Blender saves to a 16-bit PNG for linear Rec.709 colours.

    It happens in data of its own, away from the open file, so that it may happen in the middle of a render.

    Raises:
        LiveHandError: Blender's colour management does not know the view.
    """
    count = len(rgb_linear)
    width = int(np.ceil(np.sqrt(count)))
    rgba = np.ones((width * width, 4), np.float32)
    rgba[:count, :3] = rgb_linear @ rec709_to_working_space().T
    with bpy.data.temp_data() as data, tempfile.TemporaryDirectory() as folder:
        image = data.images.new("Colors", width, width, float_buffer=True)
        image.pixels.foreach_set(rgba.ravel())
        path = str(Path(folder) / "colors.png")
        image.save_render(path, scene=_scene_with(view, data))
        saved = data.images.load(path)
        saved.colorspace_settings.name = "Non-Color"
        saved.pixels.foreach_get(rgba.ravel())  # a view: the rows are one block
    return rgba[:count, :3].astype(np.float64)


def _scene_with(view: ViewTransform, data: bpy.types.BlendData) -> bpy.types.Scene:
    scene = data.scenes.new("Colors")
    try:
        scene.display_settings.display_device = view.display
        scene.view_settings.view_transform, scene.view_settings.look = view.transform, view.look
    except TypeError as error:
        raise LiveHandError(
            f"Keep Look needs the view transform '{view.transform}' of display '{view.display}', Blender's colour "
            "management has none of that name; turn Keep Look off"
        ) from error
    scene.view_settings.exposure, scene.view_settings.gamma = 0, 1
    scene.render.dither_intensity = 0
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "16"
    settings.compression = 0
    return scene


def _interpolated(table: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """[N, 3], trilinear between the table's points, which are evenly spaced along `axis` [N, 3] in [0, 1]."""
    place = axis * (_GRID_SIZE - 1)
    low = np.minimum(place.astype(int), _GRID_SIZE - 2)
    part = place - low
    total = np.zeros_like(place)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, part, 1 - part), -1, keepdims=True)
        total += weight * table[tuple((low + corner).T)]
    return total
