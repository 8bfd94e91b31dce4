"""Cycles on the benchmark's frames: the built-in hand's detailed surface, as captures render it.

What is timed is one still render. Its stage `sync`, which is not counted as Cycles' time, ends when Cycles reports its
first sample: until then it copies the scene and builds the acceleration structure. The denoiser belongs to `render`.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...backend.benchmark.cases import SYNC
from ...backend.benchmark.motion import MotionFrame
from ...backend.benchmark.stopwatch import Stages, Stopwatch
from ...backend.hand.builtin.detailed_surface import detailed_surface
from ...backend.hand.model_file import load_default_hand
from ...backend.runtime.stdout import blender_silenced
from ..capture.bake import bake_skin
from ..capture.scene import capture_scene, set_camera
from ..capture.skin import SkinTone, baked_material
from ..capture.surface import SkinSurface


@dataclass(frozen=True)
class CyclesHand:
    """The lit scene with the hand in it."""

    scene: bpy.types.Scene
    surface: SkinSurface

    @classmethod
    def create(cls, skin: Path | None, threads: int | None) -> CyclesHand:
        """Build the scene; `skin` is a folder of baked maps, or one to put them into (None: they are not kept)."""
        with blender_silenced(), tempfile.TemporaryDirectory() as folder:
            scene = capture_scene(threads)
            model = load_default_hand()
            surface = SkinSurface.create(model, detailed_surface(model))
            maps = bake_skin(surface.object, skin or Path(folder), SkinTone())
            surface.object.data.materials.append(baked_material(maps, SkinTone()))
            for image in bpy.data.images:
                image.pack()  # the folder may go before the first render
        return cls(scene, surface)

    def render(self, moment: MotionFrame, samples: int) -> Stages:
        """Render one frame, denoised; what synchronising and rendering took, the pose being set already."""
        self.surface.set_pose(moment.pose)
        set_camera(self.scene, moment.camera)
        self.scene.cycles.use_denoising = True  # baking turns it off
        self.scene.cycles.samples = samples
        stopwatch = Stopwatch()
        with blender_silenced(), _first_sample(stopwatch):
            stopwatch.begin(SYNC)
            bpy.ops.render.render()
            return stopwatch.stop()


@contextlib.contextmanager
def _first_sample(stopwatch: Stopwatch) -> Iterator[None]:
    """Begin the stage `render` when the render's statistics first speak of samples."""
    told = []

    def on_statistics(statistics: str, *_) -> None:
        if not told and "Sample" in str(statistics):
            told.append(statistics)
            stopwatch.begin("render")

    bpy.app.handlers.render_stats.append(on_statistics)
    try:
        yield
    finally:
        bpy.app.handlers.render_stats.remove(on_statistics)
