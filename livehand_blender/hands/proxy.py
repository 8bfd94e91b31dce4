"""The hands' meshes are proxies in Cycles' render of the scene: they shadow and reflect, but no camera sees them."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator, Mapping
from itertools import chain

import bpy
import numpy as np

from ..scene.colour import rec709_to_working_space
from .visible_hands import InstanceId

SCENE_RAYS = (
    "visible_diffuse",
    "visible_glossy",
    "visible_transmission",
    "visible_volume_scatter",
    "visible_shadow",
)
"""The properties of an object that tell which rays meet it, beside the camera's."""
# The material that Add Hand makes; its base colour is its colour in Solid shading until the user changes one.
_SKIN, _TOLERANCE = "LiveHand Skin", 1e-4


@contextlib.contextmanager
def hidden_from_camera(depsgraph: bpy.types.Depsgraph, meshes: Collection[InstanceId]) -> Iterator[None]:
    """Open a context in which the evaluated meshes of hands have no camera ray visibility.

    Instanced ones keep that until they are evaluated again: setting them tags their collection as changed.
    """
    before = hide_from_camera(depsgraph, meshes)
    try:
        yield
    finally:
        depsgraph.objects.foreach_set("visible_camera", before)


def hide_from_camera(depsgraph: bpy.types.Depsgraph, meshes: Collection[InstanceId]) -> np.ndarray:
    """Hide the evaluated meshes of hands from camera rays; returns what the scene's own objects were.

    The original objects do not change. One call sets all objects: setting a single object's property tags the scene as
    changed, so that the view would be updated, and Cycles restarted, without end.
    """
    hidden = {mesh.name for mesh in meshes}
    if any(mesh.instancer for mesh in meshes):
        for collection in depsgraph.ids:
            if isinstance(collection, bpy.types.Collection):
                _hide(collection.objects, hidden)
    return _hide(depsgraph.objects, hidden)


def _hide(objects: bpy.types.bpy_prop_collection, names: set[str], from_rays: str = "visible_camera") -> np.ndarray:
    """Hide the objects of these full names from rays of one kind, unless they are; returns what all objects were."""
    before = np.empty(len(objects), bool)
    objects.foreach_get(from_rays, before)
    after = before & [thing.name_full not in names for thing in objects]
    if not np.array_equal(before, after):
        objects.foreach_set(from_rays, after)
    return before


def show_alone(depsgraph: bpy.types.Depsgraph, mesh_name: str) -> None:
    """Hide all evaluated objects but one, given by its full name, from camera rays; instances hide with their parents.

    The original objects do not change.
    """
    depsgraph.objects.foreach_set("visible_camera", [item.name_full == mesh_name for item in depsgraph.objects])


def hide_from_scene(depsgraph: bpy.types.Depsgraph, mesh_name: str) -> None:
    """Hide an evaluated object, given by its full name, from all rays but the camera's; the original stays."""
    for rays in SCENE_RAYS:
        _hide(depsgraph.objects, {mesh_name}, rays)


def use_albedo(depsgraph: bpy.types.Depsgraph, albedo: Mapping[str, np.ndarray]) -> None:
    """Let evaluated meshes reflect light as their avatars' skin does; a material that the user set or changed stays.

    The original materials do not change, and nothing is tagged as changed. Hands that share a material share an albedo.

    Args:
        depsgraph: of the frame.
        albedo: full name of each mesh object -> [3] linear Rec.709.
    """
    for mesh in (thing for thing in depsgraph.objects if thing.name_full in albedo):
        rgb = np.asarray(albedo[mesh.name_full], np.float32)
        for colour in chain(*(_plain_colours(slot.material) for slot in mesh.material_slots)):
            colour.foreach_set((*(rec709_to_working_space() @ rgb), 1.0))  # an assignment would tag the material


def move_vertices(depsgraph: bpy.types.Depsgraph, vertices: Mapping[str, np.ndarray]) -> None:
    """Move the vertices of evaluated meshes; the original meshes do not change, and nothing is tagged as changed.

    Args:
        depsgraph: of the frame, which nothing reads afterwards.
        vertices: full name of each mesh object -> [V, 3] world.
    """
    for item in (thing for thing in depsgraph.objects if thing.name_full in vertices):
        to_object = np.array(item.matrix_world.inverted())
        local = vertices[item.name_full] @ to_object[:3, :3].T + to_object[:3, 3]
        item.data.vertices.foreach_set("co", local.astype(np.float32).ravel())


def _plain_colours(material: bpy.types.Material | None) -> Iterator[bpy.types.bpy_prop_array]:
    """Yield the base colour of our own material, if nothing is linked to it and it was not changed."""
    if material is None or material.node_tree is None or not material.original.name.startswith(_SKIN):
        return
    original = material.original
    for node in original.node_tree.nodes:
        if node.type == "BSDF_PRINCIPLED":
            base = node.inputs["Base Color"]
            if not base.is_linked and np.allclose(base.default_value, original.diffuse_color, atol=_TOLERANCE):
                yield material.node_tree.nodes[node.name].inputs["Base Color"].default_value
