"""Cycles on the benchmark's frames: the built-in hand's detailed surface, as captures render it.

One still render is timed. In its stage `sync`, which ends at the first sample and is not counted, Cycles copies the
scene and builds the acceleration structure. The stage `render` includes the denoiser.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...backend.hand.model_file import load_default_hand
from ...backend.research.benchmark.cases import SYNC
from ...backend.research.benchmark.motion import MotionFrame
from ...backend.research.benchmark.stopwatch import Stages, Stopwatch
from ...backend.system.command import blender_silenced
from ...backend.teacher.detailed_surface import detailed_surface
from ..capture.bake import bake_skin
from ..capture.scene import capture_scene, set_camera
from ..capture.skin import SkinTone, baked_material
from ..capture.surface import SkinSurface
from ..scene.file_paths import output_path


@dataclass(frozen=True)
class CyclesHand:
    """The lit scene with the hand."""

    scene: bpy.types.Scene
    surface: SkinSurface

    @classmethod
    def create(cls, skin: Path | None, threads: int | None) -> CyclesHand:
        """Build the scene; `skin` is a folder of baked maps, which are baked into it if missing (None: not kept)."""
        with blender_silenced(), tempfile.TemporaryDirectory() as folder:
            scene = capture_scene(threads)
            model = load_default_hand()
            surface = SkinSurface.create(model, detailed_surface(model))
            maps = bake_skin(surface.object, skin or Path(folder), SkinTone())
            surface.object.data.materials.append(baked_material(maps, SkinTone()))
            for image in bpy.data.images:
                image.pack()  # a temporary folder is gone before the first render
        return cls(scene, surface)

    def render(self, frame: MotionFrame, samples: int) -> Stages:
        """Render one frame with denoising; returns the cost of `sync` and `render`, without setting the pose."""
        self.surface.set_pose(frame.pose)
        set_camera(self.scene, frame.camera)
        self.scene.cycles.samples = samples
        stopwatch = Stopwatch()
        with blender_silenced(), _first_sample(stopwatch):
            stopwatch.begin(SYNC)
            bpy.ops.render.render()
            return stopwatch.stop()

    def save(self, frame: MotionFrame, samples: int, path: Path) -> None:
        """Render one frame with denoising into a PNG; raises OSError where it cannot be written."""
        self.surface.set_pose(frame.pose)
        set_camera(self.scene, frame.camera)
        self.scene.cycles.samples = samples
        self.scene.cycles.use_denoising = True
        self.scene.render.filepath = output_path(path)
        with blender_silenced():
            bpy.ops.render.render(write_still=True)


@contextlib.contextmanager
def _first_sample(stopwatch: Stopwatch) -> Iterator[None]:
    """Begin the stage `render` when the render's statistics first mention samples."""
    is_sampling = False

    def on_statistics(statistics: str, *_) -> None:
        nonlocal is_sampling
        if not is_sampling and "Sample" in str(statistics):
            is_sampling = True
            stopwatch.begin("render")

    bpy.app.handlers.render_stats.append(on_statistics)
    try:
        yield
    finally:
        bpy.app.handlers.render_stats.remove(on_statistics)
