"""Reads the triangles of the scene's objects that may shadow a hand."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

import bpy
import numpy as np

from .reach import Reach, bounding_balls

LOGGER = logging.getLogger(__name__)

_MAX_TRIANGLES = 50_000
_MESH_LIKE = {"MESH", "CURVE", "SURFACE", "META", "FONT"}


class Solid(NamedTuple):
    """An object's triangles [T, 3, 3] in the world, m, and its full name."""

    name: str
    triangles: np.ndarray


def read_solids(depsgraph: bpy.types.Depsgraph, reaches: Sequence[Reach]) -> tuple[Solid, ...]:
    """The triangles within any reach of all objects that cast shadows, instances and hands included."""
    local: dict[int, np.ndarray] = {}
    solids = []
    for instance in depsgraph.object_instances:
        thing = instance.object
        if thing.type not in _MESH_LIKE or not instance.show_self or not thing.visible_shadow:
            continue
        matrix = np.array(instance.matrix_world, np.float64)
        if not _touches_any(reaches, *_ball_of(thing, matrix)).any():
            continue
        key = thing.data.as_pointer()
        if key not in local:
            local[key] = local_triangles(thing)
        triangles = local[key] @ matrix[:3, :3].T + matrix[:3, 3]
        triangles = triangles[_touches_any(reaches, *bounding_balls(triangles))]
        if len(triangles):
            solids.append(Solid(thing.original.name_full, triangles))
    return tuple(solids)


def occluders_of(solids: Sequence[Solid], reach: Reach, mesh_name: str) -> np.ndarray:
    """[T, 3, 3] the triangles within a hand's reach, without its own mesh; if there are too many, the nearest."""
    triangles = np.concatenate([np.zeros((0, 3, 3)), *(one.triangles for one in solids if one.name != mesh_name)])
    triangles = triangles[reach.touches(*bounding_balls(triangles))]
    if len(triangles) <= _MAX_TRIANGLES:
        return triangles
    LOGGER.warning(
        "%d triangles may shadow '%s': the nearest %d do, the others do not", len(triangles), mesh_name, _MAX_TRIANGLES
    )
    centres, radii = bounding_balls(triangles)
    distance_m = np.linalg.norm(centres - reach.start, axis=1) - radii
    return triangles[np.sort(np.argpartition(distance_m, _MAX_TRIANGLES)[:_MAX_TRIANGLES])]


def local_triangles(thing: bpy.types.Object) -> np.ndarray:
    """[T, 3, 3] of an evaluated object, in its own space."""
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


def _touches_any(reaches: Sequence[Reach], centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    return np.any([reach.touches(centres, radii) for reach in reaches], axis=0)


def _ball_of(thing: bpy.types.Object, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre [1, 3] and radius [1] of a ball around an object's bounding box."""
    corners = np.array(thing.bound_box) @ matrix[:3, :3].T + matrix[:3, 3]
    centre = corners.mean(0)
    return centre[None], np.linalg.norm(corners - centre, axis=1).max(keepdims=True)
