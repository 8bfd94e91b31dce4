"""Renders scenes of a stranger by Cycles: scene-linear pictures of the hand, premultiplied, cut to its box."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from time import perf_counter, strftime
from typing import NamedTuple, Protocol

import bpy
import numpy as np

from ...backend.capture.exr import read_exr
from ...backend.capture.lights import CaptureLight
from ...backend.capture.person import Person
from ...backend.hand.lbs import posed_vertices
from ...backend.hand.model import HandModel
from ...livehand_blender.capture.lighting import SceneLighting
from ...livehand_blender.capture.lit_image import Box, set_border, write_picture
from ...livehand_blender.capture.render import builtin_surface
from ...livehand_blender.capture.scene import capture_scene, set_camera
from ...livehand_blender.scene.file_paths import output_path
from .script import Scene

_MARGIN_M, _MARGIN_PX = 0.01, 4  # around the template's box; its detailed surface lies up to 8 mm outside


_FEW_SAMPLES = 16  # with which denoising may not take longer than rendering


class Log(Protocol):
    """Takes a line for people."""

    def __call__(self, line: str) -> None:
        """Show or keep it."""
        ...


class Job(NamedTuple):
    """A picture to be rendered; seeds differ, so that noise differs between pictures."""

    path: Path
    scene: Scene
    seed: int


class Studio:
    """The scene with a stranger's hand in it."""

    def __init__(self, model: HandModel, person: Person, log_factor: np.ndarray, folder: Path, threads: int):
        """Build and bake it; the folder keeps the maps. `log_factor` [A, A, 3] has the row of the smallest v first."""
        self._model, self._folder = model, folder
        self._scene = capture_scene(threads)
        self._scene.render.image_settings.file_format = "OPEN_EXR"
        self._scene.render.image_settings.color_depth = "32"
        self._scene.render.image_settings.exr_codec = "ZIP"
        self._lighting = SceneLighting(self._scene)
        self._surface = builtin_surface(model, person, folder, factor_image(np.exp(log_factor)))

    def render(self, scene: Scene, path: Path, samples: int, seed: int) -> None:
        """Write one picture of the whole size as OpenEXR."""
        self._surface.set_pose(scene.pose)
        self._lighting.set_lights([CaptureLight("", scene.light)], [""])
        set_camera(self._scene, scene.camera)
        cycles = self._scene.cycles
        cycles.samples, cycles.seed = samples, seed
        cycles.denoising_prefilter = "ACCURATE" if samples > _FEW_SAMPLES else "FAST"
        box = hand_box(self._model, scene)
        set_border(self._scene.render, box)
        part = self._folder / "part.exr"
        self._scene.render.filepath = output_path(part)
        bpy.ops.render.render(write_still=True)
        channels = read_exr(part)
        colours = np.stack([channels[name] for name in "RGB"], -1)
        write_picture(path, np.maximum(colours, 0), np.clip(channels["A"], 0, 1), box, scene.camera.size_px)


def render_missing(studio: Studio, jobs: Iterable[Job], samples: int, log: Log) -> None:
    """Render what is not there yet."""
    for job in jobs:
        if not job.path.is_file():
            start = perf_counter()
            studio.render(job.scene, job.path, samples, job.seed)
            log(f"{strftime('%H:%M:%S')} {job.path.parent.name}/{job.path.name}: {perf_counter() - start:.1f} s")


def hand_box(model: HandModel, scene: Scene) -> Box:
    """Find the part of the picture that may show the hand."""
    camera = scene.camera
    at_px, depth_m = camera.project(posed_vertices(model, scene.pose))
    margin_px = _MARGIN_PX + _MARGIN_M * camera.K[0, 0] / depth_m.min()
    low = np.clip(np.floor(at_px.min(0) - margin_px), 0, np.array(camera.size_px) - 1)
    high = np.clip(np.ceil(at_px.max(0) + margin_px), low + 1, camera.size_px)
    return (*low.astype(int).tolist(), *high.astype(int).tolist())


def factor_image(factor: np.ndarray) -> bpy.types.Image:
    """Make an image of a factor [A, A, 3], the row of the smallest v first, as Blender's are."""
    height, width = factor.shape[:2]
    image = bpy.data.images.new("factor", width, height, float_buffer=True, alpha=False)
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = factor
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()  # or Cycles may ask for a file
    return image
