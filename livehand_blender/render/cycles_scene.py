"""Cycles' render of the scene around the hands, in which the camera does not see the hands' meshes."""

from __future__ import annotations

import bpy

from ...backend.records.errors import LiveHandError
from ...backend.rendering.composition import SceneLayer
from .passes import ScenePasses


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


def scene_layer(passes: ScenePasses) -> SceneLayer:
    """The colours and depths that hide the hands or lie behind them."""
    combined = passes["Combined"]
    return SceneLayer(combined[..., :3], combined[..., 3], passes["Depth"][..., 0])
