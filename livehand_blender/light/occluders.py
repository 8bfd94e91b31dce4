"""Reads the triangles of the scene's objects that may shadow a hand or reflect light on it."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import bpy
import numpy as np

from ..hands.followed_skin import FollowedHand, followed_hands
from ..hands.visible_hands import InstanceId, visible_hands
from .reach import Reach, bounding_balls
from .solids import MESH_LIKE, LocalTriangles, Solid

LOGGER = logging.getLogger(__name__)

_MAX_TRIANGLES = 50_000


def read_solids(
    depsgraph: bpy.types.Depsgraph, reaches: Mapping[InstanceId, Reach], local: LocalTriangles
) -> tuple[Solid, ...]:
    """Read the objects within any hand's reach that cast shadows, instances and other hands included.

    Without the skin of rigs that hands follow: it lies where they do.
    """
    near = _near_instances(depsgraph, reaches)
    solids = tuple(
        local.solid(InstanceId.of(instance), instance.object, near[number])
        for number, instance in enumerate(depsgraph.object_instances)
        if number in near
    )
    followed = followed_hands(depsgraph)
    own = {visible.instance_id for visible in visible_hands(depsgraph)} if followed else set()
    return tuple(solid if solid.instance_id in own else _without_skin(solid, followed) for solid in solids)


def _without_skin(solid: Solid, followed: Sequence[FollowedHand]) -> Solid:
    """Leave out the triangles of a solid that are the skin of followed hands."""
    is_skin = np.zeros(len(solid.triangles), bool)
    for hand in followed:
        is_skin |= hand.skin_of(solid.triangles)
    return replace(solid, local=solid.local[~is_skin], albedo=solid.albedo[~is_skin]) if is_skin.any() else solid


def _near_instances(depsgraph: bpy.types.Depsgraph, reaches: Mapping[InstanceId, Reach]) -> dict[int, np.ndarray]:
    """Map the number of each instance that casts shadows and whose bounding box touches a reach to its matrix [4, 4].

    All boxes are tested at once: a meadow has a hundred thousand instances. A hand does not count for itself.
    """
    boxes: dict[int, np.ndarray] = {}
    numbers, matrices, corners = [], [], []
    (only,) = reaches if len(reaches) == 1 else (None,)
    for number, instance in enumerate(depsgraph.object_instances):
        thing = instance.object
        if thing.type in MESH_LIKE and instance.show_self and thing.visible_shadow and not _is_same(only, instance):
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
    radii = np.linalg.norm(corner - centres[:, None], axis=-1).max(1)
    touched = np.any([reach.touches(centres, radii) for reach in reaches.values()], axis=0)
    return {numbers[k]: matrix[k] for k in np.flatnonzero(touched)}


def _is_same(wanted: InstanceId | None, instance: bpy.types.DepsgraphObjectInstance) -> bool:
    """Tell whether an instance is the wanted one; the name is compared first, because that is quick."""
    if wanted is None or instance.object.original.name_full != wanted.name:
        return False
    return InstanceId.of(instance) == wanted


class Occluders(NamedTuple):
    """Triangles [T, 3, 3], world, m, and their albedo [T, 3]."""

    triangles: np.ndarray
    albedo: np.ndarray


def occluders_of(solids: Sequence[Solid], reach: Reach, hand: InstanceId) -> Occluders:
    """Select the triangles within a hand's reach, without its own mesh; if there are too many, the nearest.

    Needs no bpy.
    """
    near = [(one, reach.touches(*one.balls)) for one in solids if one.instance_id != hand]
    triangles = np.concatenate([np.zeros((0, 3, 3)), *(one.triangles[which] for one, which in near)])
    albedo = np.concatenate([np.zeros((0, 3)), *(one.albedo[which] for one, which in near)])
    if len(triangles) <= _MAX_TRIANGLES:
        return Occluders(triangles, albedo)
    LOGGER.warning(
        "%d triangles may shadow '%s': the nearest %d do, the others do not", len(triangles), hand.name, _MAX_TRIANGLES
    )
    centres, radii = bounding_balls(triangles)
    distance_m = np.linalg.norm(centres - reach.start, axis=1) - radii
    kept = np.sort(np.argpartition(distance_m, _MAX_TRIANGLES)[:_MAX_TRIANGLES])
    return Occluders(triangles[kept], albedo[kept])
