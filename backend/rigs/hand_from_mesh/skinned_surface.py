"""The record of a user's skinned mesh at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SkinnedSurface:
    """N vertices, F triangles of polygons, and weights of the B bones of a `SourceSkeleton`, in its order.

    Attributes:
        vertices_m: [N, 3] world positions in the rest pose.
        faces: [F, 3] vertex indices, outward by the right-hand rule.
        polygons: [F] index of the polygon that each triangle is part of.
        weights: [N, B] >= 0; rows are scaled to sum to 1, as by Blender's Armature modifier. A row of zeros is a
            vertex that no bone moves.
    """

    vertices_m: np.ndarray
    faces: np.ndarray
    polygons: np.ndarray
    weights: np.ndarray
