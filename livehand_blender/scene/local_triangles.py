"""The triangles of a scene's objects in their own spaces: read when first asked for, kept until they change."""

from __future__ import annotations

import bpy
import numpy as np

from .seen_hands import Place
from .solid import Solid

_Key = tuple[int, int]
"""An original object, which outlives its evaluations, and evaluated data: it may make instances of several."""


class LocalTriangles:
    """The triangles of one depsgraph's objects; a render has one for its frame, a view for as long as it lives."""

    def __init__(self):
        self._kept: dict[_Key, tuple[frozenset[int], np.ndarray]] = {}
        self._asked: set[_Key] = set()
        self._solids: dict[Place, Solid] = {}

    def of(self, thing: bpy.types.Object) -> np.ndarray:
        """[T, 3, 3] of an evaluated object or of an instance's, in its own space."""
        original = thing.original
        key = original.as_pointer(), thing.data.as_pointer()
        self._asked.add(key)
        if key not in self._kept:
            sources = frozenset(one.as_pointer() for one in (original, original.data) if one is not None)
            self._kept[key] = sources, _read(thing)
        return self._kept[key][1]

    def solid(self, place: Place, thing: bpy.types.Object, matrix: np.ndarray) -> Solid:
        """An object in a place, with its matrix [4, 4]: the one of the last call if it is the same."""
        local, known = self.of(thing), self._solids.get(place)
        if known is None or known.local is not local or not np.array_equal(known.matrix, matrix):
            known = self._solids[place] = Solid(place, local, matrix)
        return known

    def forget_changed(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Drop what the depsgraph's last updates have changed; a motion as a whole changes nothing."""
        changed = {update.id.original.as_pointer() for update in depsgraph.updates if update.is_updated_geometry}
        self._kept = {key: one for key, one in self._kept.items() if not one[0] & changed}

    def forget_unasked(self) -> None:
        """Drop what nobody has asked for since the last call."""
        self._kept = {key: one for key, one in self._kept.items() if key in self._asked}
        locals_kept = {id(triangles) for _, triangles in self._kept.values()}
        self._solids = {place: one for place, one in self._solids.items() if id(one.local) in locals_kept}
        self._asked.clear()


def _read(thing: bpy.types.Object) -> np.ndarray:
    mesh = thing.to_mesh()
    if mesh is None:  # a curve without an extent
        return np.zeros((0, 3, 3))
    try:
        mesh.calc_loop_triangles()
        vertices = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", vertices)
        corners = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("vertices", corners)
    finally:
        thing.to_mesh_clear()
    return vertices.reshape(-1, 3)[corners.reshape(-1, 3)]
