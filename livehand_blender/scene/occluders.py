"""Reads the triangles of the scene's objects that may shadow a hand."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

import bpy
import numpy as np

from .reach import Reach, bounding_balls
from .seen_hands import Place

LOGGER = logging.getLogger(__name__)

_MAX_TRIANGLES = 50_000
MESH_LIKE = {"MESH", "CURVE", "SURFACE", "META", "FONT"}


class Solid(NamedTuple):
    """An object's triangles [T, 3, 3] in the world, m, and its place."""

    place: Place
    triangles: np.ndarray


def read_solids(depsgraph: bpy.types.Depsgraph, reaches: Sequence[Reach]) -> tuple[Solid, ...]:
    """The triangles within any reach of all objects that cast shadows, instances and hands included."""
    near = _near_instances(depsgraph, reaches)
    local: dict[int, np.ndarray] = {}
    solids = []
    for number, instance in enumerate(depsgraph.object_instances):
        if number in near:
            thing, matrix = instance.object, near[number]
            key = thing.data.as_pointer()
            if key not in local:
                local[key] = local_triangles(thing)
            triangles = local[key] @ matrix[:3, :3].T + matrix[:3, 3]
            triangles = triangles[_touches_any(reaches, *bounding_balls(triangles))]
            if len(triangles):
                solids.append(Solid(Place.of(instance), triangles))
    return tuple(solids)


def _near_instances(depsgraph: bpy.types.Depsgraph, reaches: Sequence[Reach]) -> dict[int, np.ndarray]:
    """Number of each instance that casts shadows and whose bounding box touches a reach -> its matrix [4, 4].

    All boxes are tested at once: a meadow has a hundred thousand instances.
    """
    boxes: dict[int, np.ndarray] = {}
    numbers, matrices, corners = [], [], []
    for number, instance in enumerate(depsgraph.object_instances):
        thing = instance.object
        if thing.type in MESH_LIKE and instance.show_self and thing.visible_shadow:
            key = thing.data.as_pointer()
            if key not in boxes:
                boxes[key] = np.array(thing.bound_box)
            numbers.append(number)
            matrices.append(instance.matrix_world.copy())
            corners.append(boxes[key])
    if not numbers:
        return {}
    matrix = np.array(matrices, np.float64)  # [I, 4, 4]
    corner = np.array(corners) @ matrix[:, :3, :3].transpose(0, 2, 1) + matrix[:, None, :3, 3]  # [I, 8, 3]
    centres = corner.mean(1)
    touched = _touches_any(reaches, centres, np.linalg.norm(corner - centres[:, None], axis=-1).max(1))
    return {numbers[k]: matrix[k] for k in np.flatnonzero(touched)}


def occluders_of(solids: Sequence[Solid], reach: Reach, hand: Place) -> np.ndarray:
    """[T, 3, 3] the triangles within a hand's reach, without its own mesh; if there are too many, the nearest."""
    triangles = np.concatenate([np.zeros((0, 3, 3)), *(one.triangles for one in solids if one.place != hand)])
    triangles = triangles[reach.touches(*bounding_balls(triangles))]
    if len(triangles) <= _MAX_TRIANGLES:
        return triangles
    LOGGER.warning(
        "%d triangles may shadow '%s': the nearest %d do, the others do not", len(triangles), hand.name, _MAX_TRIANGLES
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
