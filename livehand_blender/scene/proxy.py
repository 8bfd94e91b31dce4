"""The hands' meshes are stand-ins where Cycles renders the scene: they cast shadows, and no camera sees them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import bpy
import numpy as np

from ..rig.hand import mesh_of
from .shot import visible_hands


@contextlib.contextmanager
def hidden_from_camera(depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """Within, the evaluated meshes of all visible hands have no camera ray visibility."""
    usual = hide_from_camera(depsgraph)
    try:
        yield
    finally:
        depsgraph.objects.foreach_set("visible_camera", usual)


def hide_from_camera(depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    """Take the camera ray visibility from the evaluated meshes of all visible hands; returns every object's before.

    The user's own data stay. All objects are set by one call: setting one object's property tags the scene as changed,
    and a view would be updated, and Cycles begin anew, for ever.
    """
    hidden = {mesh_of(hand.original).name_full for hand in visible_hands(depsgraph)}
    names = [thing.name_full for thing in depsgraph.objects]
    usual = np.empty(len(names), bool)
    depsgraph.objects.foreach_get("visible_camera", usual)
    depsgraph.objects.foreach_set("visible_camera", usual & [name not in hidden for name in names])
    return usual
