"""Renders an image in several light groups at once, each denoised by itself, as linear pixels."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np

from ...backend.capture.exr import read_exr
from ...backend.records.errors import LiveHandError
from ..compositing.tree import IS_GROUP, compositor_of

_WHOLE = "whole"  # the file of the sum of all groups


class LightGroupPasses:
    """The light groups of a scene, and the compositor that denoises and saves them.

    Cycles' own denoiser knows Combined alone, so it is switched off; the compositor's is the same.
    """

    def __init__(self, scene: bpy.types.Scene, most: int):
        self._scene = scene
        self._layer = scene.view_layers[0]
        self.names = tuple(f"group{index}" for index in range(most))
        for name in self.names:
            self._layer.lightgroups.add(name=name)
        scene.cycles.use_denoising = False
        self._layer.cycles.denoising_store_passes = True

    def render(self, count: int, is_denoised: bool = True) -> tuple[np.ndarray, list[np.ndarray]]:
        """Render alpha [h, w] and the first `count` groups [h, w, 3], premultiplied: float32, of the render's border.

        They add up to Combined if they are not denoised.
        """
        layers = self._layers(self.names[:count], is_denoised)
        alpha = np.clip(layers[_WHOLE]["A"], 0, 1)
        groups = [_colours(layers[name]) for name in self.names[:count]]
        return alpha, [np.where(alpha[..., None] > 0, np.maximum(group, 0), 0) for group in groups]

    def combined(self) -> np.ndarray:
        """Render Combined [h, w, 3] alone, not denoised."""
        return _colours(self._layers((), False)[_WHOLE])

    def _layers(self, groups: tuple[str, ...], is_denoised: bool) -> dict[str, dict[str, np.ndarray]]:
        """Render the channels of Combined and of the groups."""
        names = (_WHOLE, *groups)
        with tempfile.TemporaryDirectory(prefix="livehand") as folder:
            self._connect(Path(folder), names, is_denoised)
            bpy.ops.render.render(write_still=False)
            return {name: _channels(Path(folder), name) for name in names}

    def _connect(self, folder: Path, names: tuple[str, ...], is_denoised: bool) -> None:
        """Save Combined and the groups as files in the folder."""
        tree = compositor_of(self._scene)
        tree.nodes.clear()
        passes = tree.nodes.new("CompositorNodeRLayers")
        file = tree.nodes.new("CompositorNodeOutputFile")
        _set_output(file, folder, names)
        tree.links.new(passes.outputs["Image"], file.inputs[_WHOLE])
        for name in names[1:]:
            picture = passes.outputs[f"Combined_{name}"]
            if is_denoised:
                denoise = tree.nodes.new("CompositorNodeDenoise")
                tree.links.new(picture, denoise.inputs["Image"])
                tree.links.new(passes.outputs["Denoising Normal"], denoise.inputs["Normal"])
                tree.links.new(passes.outputs["Denoising Albedo"], denoise.inputs["Albedo"])
                picture = denoise.outputs[0]
            tree.links.new(picture, file.inputs[name])


def _set_output(file: bpy.types.Node, folder: Path, names: tuple[str, ...]) -> None:
    """Write one uncompressed float OpenEXR file for each name."""
    if IS_GROUP:
        file.directory, file.file_name = str(folder), ""
        file.format.media_type = "IMAGE"
        file.file_output_items.clear()
        for name in names:
            file.file_output_items.new("RGBA", name)
    else:
        file.base_path = str(folder)
        file.file_slots.clear()
        for name in names:
            file.file_slots.new(name)
    file.format.file_format = "OPEN_EXR"
    file.format.color_mode = "RGBA"
    file.format.color_depth = "32"
    file.format.exr_codec = "NONE"


def _channels(folder: Path, name: str) -> dict[str, np.ndarray]:
    """Read the channels of a file, whose name ends with the frame's number."""
    paths = list(folder.glob(f"{name}*.exr"))
    if len(paths) != 1:
        raise LiveHandError(f"Cycles must write one picture of {name}, got {len(paths)}; is the disk full?")
    return read_exr(paths[0])


def _colours(channels: dict[str, np.ndarray]) -> np.ndarray:
    return np.stack([channels[name] for name in "RGB"], -1)
