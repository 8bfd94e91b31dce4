"""Blender's output settings for each of our file formats."""

from __future__ import annotations

from dataclasses import dataclass

import bpy


@dataclass(frozen=True)
class OutputSettings:
    """Bits per channel of each format: the scene's own if the scene is set to that format.

    Attributes:
        exr_depth: `16` (half) or `32`; Depth is always 32.
        png_depth: `8` or `16`.
    """

    exr_depth: str = "16"
    png_depth: str = "8"

    @classmethod
    def of_scene(cls, scene: bpy.types.Scene) -> OutputSettings:
        """Read the settings, before `use` changes them."""
        settings = scene.render.image_settings
        is_exr = settings.file_format in ("OPEN_EXR", "OPEN_EXR_MULTILAYER")
        return cls(
            exr_depth=settings.color_depth if is_exr else cls.exr_depth,
            png_depth=settings.color_depth if settings.file_format == "PNG" else cls.png_depth,
        )

    def use(self, scene: bpy.types.Scene, file_format: str) -> None:
        """Make the scene save `exr` (multilayer: every pass of every view layer) or `png`, both with alpha.

        View transform, look and dither do not change.
        """
        settings = scene.render.image_settings
        is_exr = file_format == "exr"
        if hasattr(settings, "media_type"):  # Blender 5 offers multilayer EXR only after this
            settings.media_type = "MULTI_LAYER_IMAGE" if is_exr else "IMAGE"
        settings.file_format = "OPEN_EXR_MULTILAYER" if is_exr else "PNG"
        settings.color_mode = "RGBA"
        settings.color_depth = self.exr_depth if is_exr else self.png_depth
        if is_exr:
            settings.exr_codec = "ZIP"  # lossless, and the frame check can decompress it
