"""Somebody's skinned mesh at rest: a record, numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SkinnedSurface:
    """N vertices, F triangles of perhaps larger polygons, B bones of a `RestSkeleton`, in its order.

    Attributes:
        vertices_m: [N, 3] in the world, where the rest pose puts them.
        faces: [F, 3] vertex indices, outward by the right-hand rule.
        polygons: [F] which polygon of the mesh a triangle is of.
        weights: [N, B] >= 0; a row is scaled to sum to 1, as Blender's Armature modifier does. A row of zeros is a
            vertex that no bone moves.
    """

    vertices_m: np.ndarray
    faces: np.ndarray
    polygons: np.ndarray
    weights: np.ndarray
