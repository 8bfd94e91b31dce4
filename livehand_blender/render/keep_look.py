"""Ignore View Transform: colours that the scene's view transform displays as Standard would display the hand's.

AgX and Filmic are made for unbounded light, but an avatar's colours were learnt from images and are display colours
already. So the view transform and its look are inverted, once per view, against Blender's own colour management.
Exposure, gamma, white balance and curves act as usual.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

from ...backend.image.view_inverse import ViewInverse
from ...backend.records.errors import LiveHandError
from ...backend.records.frame import Frame
from ..scene.colour import in_working_space, rec709_to_working_space

# A view whose inverse is off by more than this for half of all colours (8-bit levels) cannot be inverted.
_MAX_ERROR_LEVELS = 4.0


class ViewTransform(NamedTuple):
    """The part of a scene's colour management that is inverted."""

    display: str
    transform: str
    look: str

    @classmethod
    def of_scene(cls, scene: bpy.types.Scene) -> ViewTransform:
        """Read the scene's present settings."""
        settings = scene.view_settings
        return cls(scene.display_settings.display_device, settings.view_transform, settings.look)

    @property
    def standard(self) -> ViewTransform:
        """The view on the same display whose appearance is kept."""
        return ViewTransform(self.display, "Standard", "None")


def in_scene_colours(frame: Frame, scene: bpy.types.Scene) -> Frame:
    """Convert a backend frame to the working space, with its look kept if the scene says so and it is not lit.

    The colours of a lit hand are light, which the view transform is made for.

    Raises:
        LiveHandError: as `kept_look`.
    """
    keeps_look = scene.livehand.keep_look and not frame.is_lit
    return in_working_space(frame_with_kept_look(frame, scene) if keeps_look else frame)


def frame_with_kept_look(frame: Frame, scene: bpy.types.Scene) -> Frame:
    """Change the frame's colours to be displayed as Standard displays its own; alpha and depth do not change."""
    is_covered = frame.alpha > 0
    alpha = frame.alpha[is_covered][:, None]
    rgb = np.zeros_like(frame.rgb)
    rgb[is_covered] = kept_look(frame.rgb[is_covered] / alpha, scene) * alpha
    return replace(frame, rgb=rgb)


def kept_look(rgb_linear: np.ndarray, scene: bpy.types.Scene) -> np.ndarray:
    """Compute the colours to render so that they are displayed as Standard displays `rgb_linear`.

    The first call for a view takes about a second. Colours that the view cannot display (bright saturated ones under
    AgX) come as near as possible.

    Args:
        rgb_linear: [..., 3] linear Rec.709, straight; clipped to [0, 1], as Standard does.
        scene: whose view transform and look are inverted.

    Raises:
        LiveHandError: the view displays different colours alike (False Color) and has no inverse.
    """
    view = ViewTransform.of_scene(scene)
    return rgb_linear if view == view.standard else _inverse(view)(rgb_linear)


@lru_cache(maxsize=4)
def _inverse(view: ViewTransform) -> ViewInverse:
    inverse = ViewInverse.solve(partial(_shown, view=view), partial(_shown, view=view.standard))
    error_levels = inverse.error * 255
    if error_levels > _MAX_ERROR_LEVELS:
        raise LiveHandError(
            f"Ignore View Transform needs a view transform that can be inverted, '{view.transform}' is "
            f"{error_levels:.0f} levels off for half of all colors; choose Standard, AgX or Filmic (Render properties, "
            "Color Management), or turn Ignore View Transform off"
        )
    return inverse


def _shown(rgb_linear: np.ndarray, view: ViewTransform) -> np.ndarray:
    """Compute [N, 3] in [0, 1]: what Blender saves to a 16-bit PNG for linear Rec.709 colours.

    It uses temporary data apart from the open file, so it may be called in the middle of a render.

    Raises:
        LiveHandError: Blender's colour management does not have the view.
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
        saved.pixels.foreach_get(rgba.ravel())  # ravel is a view here: the array is contiguous
    return rgba[:count, :3].astype(np.float64)


def _scene_with(view: ViewTransform, data: bpy.types.BlendData) -> bpy.types.Scene:
    scene = data.scenes.new("Colors")
    try:
        scene.display_settings.display_device = view.display
        scene.view_settings.view_transform, scene.view_settings.look = view.transform, view.look
    except TypeError as error:
        raise LiveHandError(
            f"Ignore View Transform needs the view transform '{view.transform}' of display '{view.display}', which "
            "Blender's color management does not have; turn Ignore View Transform off"
        ) from error
    scene.view_settings.exposure, scene.view_settings.gamma = 0, 1
    scene.render.dither_intensity = 0
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "16"
    settings.compression = 0
    return scene
