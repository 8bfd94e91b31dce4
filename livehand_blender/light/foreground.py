"""Reads the triangles of the scene that may stand before the hands in a view."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import bpy
import numpy as np

from ...backend.records.camera import Camera
from ..hands.visible_hands import InstanceId, meets_camera_rays
from .solids import MESH_LIKE, LocalTriangles, Solid, placed

_NEAREST_M = 1e-3
_MAX_TRIANGLES = 200_000


class Box(NamedTuple):
    """The part of an image that holds the hands, px, and the depth of their farthest point, m."""

    low: np.ndarray
    high: np.ndarray
    depth_m: float

    @classmethod
    def of(cls, camera: Camera, hands: Sequence[np.ndarray]) -> Box:
        """Find the box of the hands' vertices [V, 3] in the world; the whole image if they reach behind the camera."""
        pixels, depth = camera.project(np.concatenate(hands))
        if depth.min() < _NEAREST_M:
            return cls(np.zeros(2), np.array(camera.size_px, np.float64), float(depth.max()))
        return cls(pixels.min(0), pixels.max(0), float(depth.max()))

    def holds(self, camera: Camera, points: np.ndarray) -> np.ndarray:
        """Mark [N] each group of points [N, K, 3] that may cover a part of the box."""
        pixels, depth = camera.project(points.reshape(-1, 3))
        pixels, depth = pixels.reshape(*points.shape[:2], 2), depth.reshape(points.shape[:2])
        is_over = ((pixels.max(1) >= self.low) & (pixels.min(1) <= self.high)).all(1)
        reaches_behind = depth.min(1) < _NEAREST_M
        return (is_over | reaches_behind) & (depth.max(1) > _NEAREST_M) & (depth.min(1) < self.depth_m)


class Foreground:
    """The objects that may stand before hands, as a depsgraph has them; their triangles are read when a camera asks.

    Args:
        depsgraph: of the view.
        own: the hands' meshes, which do not count.
        local: triangles that were read before.
    """

    def __init__(self, depsgraph: bpy.types.Depsgraph, own: Collection[InstanceId], local: LocalTriangles):
        self._local = local
        self._solids: dict[int, Solid] = {}
        numbers, boxes = [], []
        for number, instance in enumerate(depsgraph.object_instances):
            thing = instance.object
            if (
                thing.type in MESH_LIKE
                and meets_camera_rays(instance, depsgraph.view_layer)
                and InstanceId.of(instance) not in own
            ):
                numbers.append(number)
                boxes.append(placed(np.array(thing.bound_box), np.array(instance.matrix_world)))
        self._numbers, self._boxes = np.array(numbers, int), np.reshape(boxes, (-1, 8, 3))

    def before(self, depsgraph: bpy.types.Depsgraph, camera: Camera, hands: Sequence[np.ndarray]) -> tuple[Solid, ...]:
        """Find the objects that may hide hands, given by their vertices [V, 3]; the depsgraph must not have changed."""
        if not hands:
            return ()
        numbers = self._numbers[Box.of(camera, hands).holds(camera, self._boxes)].tolist()
        missing = set(numbers) - self._solids.keys()
        if missing:
            for number, instance in enumerate(depsgraph.object_instances):
                if number in missing:
                    instance_id, matrix = InstanceId.of(instance), np.array(instance.matrix_world)
                    self._solids[number] = self._local.solid(instance_id, instance.object, matrix)
        return tuple(self._solids[number] for number in numbers)


def foreground_triangles(solids: Sequence[Solid], camera: Camera, hands: Sequence[np.ndarray]) -> np.ndarray:
    """Collect triangles [T, 3, 3] in the world, m, all before the camera; of too many, the nearest. Needs no bpy.

    Args:
        solids: that may hide the hands.
        camera: of the view.
        hands: vertices [V, 3] of the hands in the world, m.
    """
    if not (solids and hands):
        return np.zeros((0, 3, 3))
    box = Box.of(camera, hands)
    found = [triangles[box.holds(camera, triangles)] for triangles in (solid.triangles for solid in solids)]
    triangles = clipped(camera, np.concatenate(found))
    if len(triangles) <= _MAX_TRIANGLES:
        return triangles
    depth = camera.project(triangles.mean(1))[1]
    return triangles[np.argpartition(depth, _MAX_TRIANGLES)[:_MAX_TRIANGLES]]


def clipped(camera: Camera, triangles: np.ndarray) -> np.ndarray:
    """Clip away what of the triangles [T, 3, 3] lies behind the camera, or nearer than a millimetre."""
    depth = camera.project(triangles.reshape(-1, 3))[1].reshape(-1, 3)
    is_before = (depth >= _NEAREST_M).all(1)
    parts = [
        part
        for corners, one in zip(triangles[~is_before], depth[~is_before], strict=True)
        for part in _parts(corners, one)
    ]
    return np.concatenate([triangles[is_before], np.reshape(parts, (-1, 3, 3))])


def _parts(corners: np.ndarray, depth: np.ndarray) -> list[np.ndarray]:
    """Cut a triangle's part before the camera into triangles, at most two."""
    outline = []
    for k in range(3):
        start, end, near, far = corners[k], corners[k - 2], depth[k], depth[k - 2]
        if near >= _NEAREST_M:
            outline.append(start)
        if (near >= _NEAREST_M) != (far >= _NEAREST_M):
            outline.append(start + (end - start) * (_NEAREST_M - near) / (far - near))
    return [np.stack([outline[0], outline[k], outline[k + 1]]) for k in range(1, len(outline) - 1)]
