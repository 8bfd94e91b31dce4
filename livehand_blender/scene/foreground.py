"""Reads the triangles of the scene that may stand before the hands in a view."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import bpy
import numpy as np

from ...backend.records.camera import Camera
from .occluders import MESH_LIKE, local_triangles
from .seen_hands import Place

_NEAREST_M = 1e-3
_MAX_TRIANGLES = 200_000


class Box(NamedTuple):
    """The part of an image that holds the hands, px, and the depth of their farthest point, m."""

    low: np.ndarray
    high: np.ndarray
    depth_m: float

    @classmethod
    def of(cls, camera: Camera, hands: Sequence[np.ndarray]) -> Box:
        """The box of the hands' vertices [V, 3] in the world; of the whole image if they reach behind the camera."""
        pixels, depth = camera.project(np.concatenate(hands))
        if depth.min() < _NEAREST_M:
            return cls(np.zeros(2), np.array(camera.size_px, np.float64), float(depth.max()))
        return cls(pixels.min(0), pixels.max(0), float(depth.max()))

    def holds(self, camera: Camera, points: np.ndarray) -> np.ndarray:
        """[N] whether each group of points [N, K, 3] may cover a part of the box."""
        pixels, depth = camera.project(points.reshape(-1, 3))
        pixels, depth = pixels.reshape(*points.shape[:2], 2), depth.reshape(points.shape[:2])
        is_over = ((pixels.max(1) >= self.low) & (pixels.min(1) <= self.high)).all(1)
        reaches_behind = depth.min(1) < _NEAREST_M
        return (is_over | reaches_behind) & (depth.max(1) > _NEAREST_M) & (depth.min(1) < self.depth_m)


def read_foreground(
    depsgraph: bpy.types.Depsgraph, camera: Camera, hands: Sequence[np.ndarray], own: Collection[Place]
) -> np.ndarray:
    """[T, 3, 3] triangles in the world, m, all before the camera; of too many, the nearest.

    Args:
        depsgraph: of the view.
        camera: of the view.
        hands: vertices [V, 3] of the hands in the world, m.
        own: the places of the hands' meshes, which do not count.
    """
    if not hands:
        return np.zeros((0, 3, 3))
    box = Box.of(camera, hands)
    local: dict[int, np.ndarray] = {}
    found = [np.zeros((0, 3, 3))]
    for instance in depsgraph.object_instances:
        thing = instance.object
        if thing.type in MESH_LIKE and instance.show_self and thing.visible_camera and Place.of(instance) not in own:
            matrix = np.array(instance.matrix_world)
            if box.holds(camera, _placed(np.array(thing.bound_box), matrix)[None])[0]:
                key = thing.data.as_pointer()
                if key not in local:
                    local[key] = local_triangles(thing)
                triangles = _placed(local[key], matrix)
                found.append(triangles[box.holds(camera, triangles)])
    triangles = clipped(camera, np.concatenate(found))
    if len(triangles) <= _MAX_TRIANGLES:
        return triangles
    depth = camera.project(triangles.mean(1))[1]
    return triangles[np.argpartition(depth, _MAX_TRIANGLES)[:_MAX_TRIANGLES]]


def clipped(camera: Camera, triangles: np.ndarray) -> np.ndarray:
    """The triangles [T, 3, 3] without what lies behind the camera, or nearer than a millimetre."""
    depth = camera.project(triangles.reshape(-1, 3))[1].reshape(-1, 3)
    is_before = (depth >= _NEAREST_M).all(1)
    parts = [
        part
        for corners, one in zip(triangles[~is_before], depth[~is_before], strict=True)
        for part in _parts(corners, one)
    ]
    return np.concatenate([triangles[is_before], np.reshape(parts, (-1, 3, 3))])


def _parts(corners: np.ndarray, depth: np.ndarray) -> list[np.ndarray]:
    """The triangles of a triangle's part before the camera, at most two."""
    outline = []
    for k in range(3):
        start, end, near, far = corners[k], corners[k - 2], depth[k], depth[k - 2]
        if near >= _NEAREST_M:
            outline.append(start)
        if (near >= _NEAREST_M) != (far >= _NEAREST_M):
            outline.append(start + (end - start) * (_NEAREST_M - near) / (far - near))
    return [np.stack([outline[0], outline[k], outline[k + 1]]) for k in range(1, len(outline) - 1)]


def _placed(local: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return local @ matrix[:3, :3].T + matrix[:3, 3]
