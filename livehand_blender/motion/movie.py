"""Frames of a movie by Blender's own decoder: its sequencer renders them as images into a folder.

Blender turns phones' videos upright, and shows them at an even rate.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy

from ...backend.records.errors import LiveHandError
from ...backend.system.files import check_regular
from ..scene.removal import remove_scene

_AT_ONCE = 10  # frames, during which Blender's window stands still
_QUALITY = 95
_MOST_FRAMES = 300_000


class Movie:
    """A movie in a scene of its own, which `close` removes.

    Attributes:
        fps: frames per second.
        count: frames.
        size_px: (width, height).

    Raises:
        LiveHandError: Blender cannot read the file as a movie.
    """

    def __init__(self, path: Path):
        check_regular(path)
        scene = bpy.data.scenes.new("LiveHand Movie")
        self._scene: bpy.types.Scene | None = scene
        try:
            editor = scene.sequence_editor_create()
            strips = editor.strips if hasattr(editor, "strips") else editor.sequences  # Blender 4.2 and 4.3
            try:
                strip = strips.new_movie("movie", str(path), 1, 1)
            except RuntimeError as error:
                raise LiveHandError(f"{path} must be a movie that Blender reads ({error}); convert it") from error
            element = strip.elements[0]
            self.fps = float(getattr(element, "orig_fps", 0) or 0)
            self.count = int(strip.frame_duration)
            self.size_px = (int(element.orig_width), int(element.orig_height))
            if not (self.fps > 0 and 0 < self.count <= _MOST_FRAMES and min(self.size_px) > 0):
                raise LiveHandError(f"{path} must be a movie that Blender reads, got no frames; convert it")
            self._set_up(scene)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Remove the scene."""
        if self._scene is not None:
            remove_scene(self._scene)
            self._scene = None

    def write_frames(self, folder: Path) -> Iterator[int]:
        """Write the frames as pictures whose names are in order, a few at each step; yields how many are there."""
        scene = self._scene
        assert scene is not None
        scene.render.filepath = str(folder / "f######")
        for first in range(1, self.count + 1, _AT_ONCE):
            scene.frame_start, scene.frame_end = first, min(first + _AT_ONCE - 1, self.count)
            bpy.ops.render.render(animation=True, scene=scene.name)
            yield scene.frame_end

    def _set_up(self, scene: bpy.types.Scene) -> None:
        render = scene.render
        render.resolution_x, render.resolution_y = self.size_px
        render.resolution_percentage = 100
        render.pixel_aspect_x = render.pixel_aspect_y = 1
        render.fps, render.fps_base = max(1, round(self.fps)), max(1, round(self.fps)) / self.fps
        render.use_sequencer, render.use_file_extension = True, True
        render.image_settings.file_format = "JPEG"
        render.image_settings.quality = _QUALITY
        scene.view_settings.view_transform = "Standard"
        scene.view_settings.look = "None"
        scene.sequencer_colorspace_settings.name = "sRGB"
