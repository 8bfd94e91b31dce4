"""Replaces a hand's mesh by the avatar's surface while Cycles measures light, in a copy of the scene.

Where light grazes or shadows end, the mesh's few faces do not tell what the skin receives that frames show.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import bpy
import numpy as np

from ...backend.records.surface_mesh import SurfaceMesh
from ..hands.proxy import SCENE_RAYS
from ..light.light_linking import LinkRule

_NAME = "LiveHand Surface"


@contextlib.contextmanager
def measurement_proxy(scene: bpy.types.Scene, mesh_name: str, surface: SurfaceMesh) -> Iterator[str]:
    """A context in which a scene has the surface besides the mesh object of this full name; yields its full name.

    It has the mesh's first material, and rays meet it as they meet the mesh.
    """
    (mesh,) = (item for item in bpy.data.objects if item.name_full == mesh_name)  # the scene's, or its set's
    data = bpy.data.meshes.new(_NAME)
    data.from_pydata(surface.vertices.tolist(), [], surface.faces.tolist())
    data.polygons.foreach_set("use_smooth", np.ones(len(surface.faces), bool))
    data.materials.append(next((slot.material for slot in mesh.material_slots), None))
    item = bpy.data.objects.new(_NAME, data)
    for name in SCENE_RAYS:
        setattr(item, name, getattr(mesh, name))
    try:
        scene.collection.objects.link(item)
        yield item.name_full
    finally:
        bpy.data.objects.remove(item)
        bpy.data.meshes.remove(data)


def is_light_linked(mesh_name: str) -> bool:
    """Whether lamps are linked to the object of this full name, or kept off it; they would not know its stand-in."""
    linking = (item.light_linking for item in bpy.data.objects)
    rules = (LinkRule.of(side) for one in linking for side in (one.receiver_collection, one.blocker_collection))
    return any(mesh_name in rule.excluded or mesh_name in (rule.included or ()) for rule in rules)
