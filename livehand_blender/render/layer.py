"""A view layer's picture: where it goes, and, while it is on its way, what it waits for."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import bpy

from ...backend.rendering.frame_task import ExposureFrames
from ..scene.camera import render_region
from .cycles_scene import is_in_scene
from .frame_setup import FrameSetup
from .passes import Pass, cryptomatte_passes, wanted_passes


class Pending(NamedTuple):
    """A stereo view's picture on its way (of a mono render the only one, named by an empty string).

    Attributes:
        view: its name.
        stage: the hands.
        wait: gives the moments' frames, or None where the user has stopped the render.
    """

    view: str
    stage: FrameSetup
    wait: Callable[[], tuple[ExposureFrames, ...] | None]


class Output(NamedTuple):
    """Where a view layer's picture goes.

    Attributes:
        scene: whose picture it is; the original, which outlives the depsgraph.
        layer: its name.
        size_px: (width, height).
        passes: that it has switched on.
        cryptomatte: names of the passes of ranks that it has switched on.
        is_in_scene: whether Cycles renders it first.
    """

    scene: bpy.types.Scene
    layer: str
    size_px: tuple[int, int]
    passes: list[Pass]
    cryptomatte: list[str]
    is_in_scene: bool

    @classmethod
    def of(cls, depsgraph: bpy.types.Depsgraph) -> Output:
        """The depsgraph's layer."""
        layer, scene = depsgraph.view_layer, depsgraph.scene
        size_px = render_region(scene.render).size_px
        return cls(scene, layer.name, size_px, wanted_passes(layer), cryptomatte_passes(layer), is_in_scene(scene))
