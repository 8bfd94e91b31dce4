"""The hands' meshes are proxies in Cycles' render of the scene: they cast shadows, but no camera sees them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import bpy
import numpy as np

from ..rig.hand import mesh_of
from .shot import visible_hands


@contextlib.contextmanager
def hidden_from_camera(depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """A context in which the evaluated meshes of all visible hands have no camera ray visibility."""
    before = hide_from_camera(depsgraph)
    try:
        yield
    finally:
        depsgraph.objects.foreach_set("visible_camera", before)


def hide_from_camera(depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    """Hide the evaluated meshes of all visible hands from camera rays; returns every object's visibility before.

    The original objects do not change. One call sets all objects: setting a single object's property tags the scene as
    changed, so that the view would be updated, and Cycles restarted, without end.
    """
    hidden = {mesh_of(hand.original).name_full for hand in visible_hands(depsgraph)}
    names = [item.name_full for item in depsgraph.objects]
    before = np.empty(len(names), bool)
    depsgraph.objects.foreach_get("visible_camera", before)
    depsgraph.objects.foreach_set("visible_camera", before & [name not in hidden for name in names])
    return before


def show_alone(depsgraph: bpy.types.Depsgraph, mesh_name: str) -> None:
    """Hide all evaluated objects but one, given by its full name, from camera rays; instances hide with their parents.

    The original objects do not change.
    """
    depsgraph.objects.foreach_set("visible_camera", [item.name_full == mesh_name for item in depsgraph.objects])
