"""Cycles' render of the scene around the hands, in which the camera does not see the hands' meshes."""

from __future__ import annotations

from collections.abc import Mapping

import bpy
import numpy as np

from ...backend.records.errors import LiveHandError
from ...backend.rendering.composition import SceneLayer
from .passes import read_pass


def is_in_scene(scene: bpy.types.Scene) -> bool:
    """Whether the hands are to be rendered in their scene.

    Raises:
        LiveHandError: Cycles is switched off.
    """
    if scene.livehand.mode != "SCENE":
        return False
    if not hasattr(scene, "cycles"):
        raise LiveHandError(
            "a hand in its scene needs Blender's Cycles add-on, which is switched off; "
            "enable it in the preferences, or set LiveHand to Hand Only"
        )
    return True


def read_scene(
    result: bpy.types.RenderResult, layer: str, view: str, size_px: tuple[int, int]
) -> Mapping[str, np.ndarray]:
    """Cycles' passes of a view layer and stereo view, [H, W, C] by name, top row first."""
    passes = next(one for one in result.layers if one.name == layer).passes
    names = dict.fromkeys(one.name for one in passes)
    return {name: read_pass(passes.find_by_name(name, view), size_px) for name in names}


def scene_layer(passes: Mapping[str, np.ndarray]) -> SceneLayer:
    """The colours and depths that hide the hands or lie behind them."""
    combined = passes["Combined"]
    return SceneLayer(combined[..., :3], combined[..., 3], passes["Depth"][..., 0])
