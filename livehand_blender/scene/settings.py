"""The scene settings with which an avatar's colours are displayed as they were learnt."""

from __future__ import annotations

import bpy

ENGINE = "LIVEHAND"
_FORMATS_WITH_ALPHA = {"PNG", "OPEN_EXR", "OPEN_EXR_MULTILAYER", "TIFF"}


def use_livehand(scene: bpy.types.Scene) -> None:
    """Make LIVEHAND the scene's engine: Standard view, no dither, transparent film, RGBA files."""
    scene.render.engine = ENGINE
    scene.render.film_transparent = True
    scene.render.dither_intensity = 0.0
    view = scene.view_settings
    view.view_transform, view.look = "Standard", "None"
    view.exposure, view.gamma, view.use_curve_mapping = 0.0, 1.0, False
    image = scene.render.image_settings
    if image.file_format in _FORMATS_WITH_ALPHA:
        image.color_mode = "RGBA"
