"""Cycles' render of the scene around the hands, in which the camera does not see the hands' meshes."""

from __future__ import annotations

import bpy

from ...backend.records.errors import LiveHandError
from ...backend.render.composition import SceneLayer
from ..light.solid import MESH_LIKE
from ..rig.hand import hand_of_mesh
from .passes import ScenePasses

_SEEN = {*MESH_LIKE, "CURVES", "POINTCLOUD", "VOLUME"}


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


def has_only_hands(depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether only hands are wanted, or nothing else is there to be seen."""
    if depsgraph.scene.livehand.mode != "SCENE":
        return True
    return not any(
        instance.show_self and instance.object.type in _SEEN and hand_of_mesh(instance.object.original) is None
        for instance in depsgraph.object_instances
    )


def scene_layer(passes: ScenePasses) -> SceneLayer:
    """The colours and depths that hide the hands or lie behind them."""
    combined = passes["Combined"]
    return SceneLayer(combined[..., :3], combined[..., 3], passes["Depth"][..., 0])
