"""How many samples Cycles takes in a 3D view: one where only hands are wanted, so that they have the cores."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import bpy

_GROUP, _SAMPLES = "cycles", "preview_samples"


@contextlib.contextmanager
def one_sample(depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """A context in which the evaluated scene asks for one sample in views; without Cycles' add-on it does nothing.

    The original scene does not change. The number is stored past Blender's properties: setting one would tag the scene
    as changed, so that the view would be updated, and Cycles restarted, without end.
    """
    scene = depsgraph.scene_eval
    if not hasattr(scene, _GROUP):
        yield
        return
    stored = _stored(scene)
    had_group = _GROUP in stored
    if not had_group:
        stored[_GROUP] = {}
    group = stored[_GROUP]
    before = group.get(_SAMPLES)
    group[_SAMPLES] = 1
    try:
        yield
    finally:
        if not had_group:
            del stored[_GROUP]
        elif before is None:
            del group[_SAMPLES]
        else:
            group[_SAMPLES] = before


def _stored(scene: bpy.types.Scene):
    """What holds the values of add-ons' properties: before Blender 5 the custom properties."""
    get = getattr(scene, "bl_system_properties_get", None)
    return scene if get is None else get(do_create=True)
