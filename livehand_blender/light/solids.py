"""Objects of the scene that may shadow or hide a hand: plain values, which may leave Blender's thread.

Their triangles are read when first asked for, and kept until they change. Materials are asked once between two calls of
`forget_unasked`: they change without a word about the objects that wear them, and a meadow of instances wears a few.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import bpy
import numpy as np

from ..hands.visible_hands import InstanceId
from .albedo import albedo_of
from .reach import bounding_balls

MESH_LIKE = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
"""The types of objects that have triangles."""

_Key = tuple[int, int]
"""An original object, which outlives its evaluations, and evaluated data: it may make instances of several."""


@dataclass(frozen=True, eq=False)
class Solid:
    """One instance of an object; what is computed of it is kept.

    Attributes:
        instance_id: of the object.
        local: [T, 3, 3] its triangles in its own space.
        matrix: [4, 4] to the world.
        albedo: [T, 3] of its triangles, if they were diffuse.
    """

    instance_id: InstanceId
    local: np.ndarray
    matrix: np.ndarray
    albedo: np.ndarray

    @cached_property
    def triangles(self) -> np.ndarray:
        """[T, 3, 3] in the world, m."""
        return placed(self.local, self.matrix)

    @cached_property
    def balls(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres [T, 3] and radii [T] of balls around the triangles."""
        return bounding_balls(self.triangles)


def placed(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Move points [..., 3] by a matrix [4, 4]."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


class _Read(NamedTuple):
    """What was read of an object: data blocks that it depends on, triangles [T, 3, 3] and their material slots [T]."""

    sources: frozenset[int]
    triangles: np.ndarray
    slot: np.ndarray


class LocalTriangles:
    """The triangles of one depsgraph's objects; a render has one for its frame, a view for as long as it lives."""

    def __init__(self):
        self._kept: dict[_Key, _Read] = {}
        self._asked: set[_Key] = set()
        self._solids: dict[InstanceId, Solid] = {}
        self._albedos: dict[int, np.ndarray] = {}

    def of(self, thing: bpy.types.Object) -> np.ndarray:
        """Read [T, 3, 3] of an evaluated object or of an instance's, in its own space."""
        return self._read(thing).triangles

    def _read(self, thing: bpy.types.Object) -> _Read:
        original = thing.original
        key = original.as_pointer(), thing.data.as_pointer()
        self._asked.add(key)
        if key not in self._kept:
            sources = frozenset(one.as_pointer() for one in (original, original.data) if one is not None)
            self._kept[key] = _Read(sources, *_triangles(thing))
        return self._kept[key]

    def solid(self, instance_id: InstanceId, thing: bpy.types.Object, matrix: np.ndarray) -> Solid:
        """Place an instance of an object by its matrix [4, 4]: the solid of the last call if it is the same."""
        _, local, slot = self._read(thing)
        palette = [self._albedo(slot.material) for slot in thing.material_slots] or [self._albedo(None)]
        solid, albedo = self._solids.get(instance_id), np.array(palette)[slot]
        if (
            solid is None
            or solid.local is not local
            or not np.array_equal(solid.matrix, matrix)
            or not np.array_equal(solid.albedo, albedo)
        ):
            solid = self._solids[instance_id] = Solid(instance_id, local, matrix, albedo)
        return solid

    def forget_changed(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Drop what the depsgraph's last updates have changed; a motion as a whole changes nothing."""
        changed = {update.id.original.as_pointer() for update in depsgraph.updates if update.is_updated_geometry}
        self._kept = {key: one for key, one in self._kept.items() if not one.sources & changed}

    def forget_unasked(self) -> None:
        """Drop what nobody has asked for since the last call."""
        self._kept = {key: one for key, one in self._kept.items() if key in self._asked}
        locals_kept = {id(one.triangles) for one in self._kept.values()}
        self._solids = {instance_id: one for instance_id, one in self._solids.items() if id(one.local) in locals_kept}
        self._asked.clear()
        self._albedos.clear()

    def _albedo(self, material: bpy.types.Material | None) -> np.ndarray:
        key = 0 if material is None else material.as_pointer()
        if key not in self._albedos:
            self._albedos[key] = albedo_of(material)
        return self._albedos[key]


def _triangles(thing: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """Read triangles [T, 3, 3] and their material slots [T], of those that the object has."""
    mesh = thing.to_mesh()
    if mesh is None:  # a curve without an extent
        return np.zeros((0, 3, 3)), np.zeros(0, int)
    try:
        mesh.calc_loop_triangles()
        vertices = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", vertices)
        corners = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("vertices", corners)
        slot = np.empty(len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("material_index", slot)
    finally:
        thing.to_mesh_clear()
    return vertices.reshape(-1, 3)[corners.reshape(-1, 3)], slot.clip(0, max(len(thing.material_slots) - 1, 0))
