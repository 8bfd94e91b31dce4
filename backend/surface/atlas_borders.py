"""Borders of charts in an atlas: maps that jump from one side to the other are made to meet there.

Networks learn each chart by itself, and their rays pass over its borders obliquely, so that pictures show a soft change
where their map has a step. What a map is compared with must not have it either.
"""

from __future__ import annotations

import numpy as np
import torch

from ..geometry.loop import split_corners, split_faces
from .atlas_texels import AtlasTexels

RINGS = 2
"""Of faces beside a border, over which a map changes to the mean of both sides."""
_APART = 1e-6  # of the atlas


def joined_borders(image: np.ndarray, faces: np.ndarray, corner_uv: np.ndarray) -> np.ndarray:
    """Return a map whose values on both sides of charts' borders are the same.

    At borders it is interpolated between means around vertices, which both sides share.

    Args:
        image: [A, A, C].
        faces: [F, 3] of the surface.
        corner_uv: [F, 3, 2].
    """
    texels = AtlasTexels.of(torch.as_tensor(corner_uv, dtype=torch.float32), torch.as_tensor(faces), len(image))
    values = texels.from_map(image)
    means, texels_around = texels.at_vertices(values, np.ones(len(values)))
    share = nearness_to_borders(faces, corner_uv) * (texels_around > 0)
    near = texels.at_texels(share[:, None])
    return texels.as_map((values + near * (texels.at_texels(means) - values)).astype(np.float32))


def nearness_to_borders(faces: np.ndarray, corner_uv: np.ndarray, rings: int = RINGS) -> np.ndarray:
    """Compute, at each vertex [N], 1 on charts' borders, falling to 0 over rings of faces."""
    vertex, uv = faces.ravel(), corner_uv.reshape(-1, 2)
    least, most = np.full((vertex.max() + 1, 2), np.inf), np.full((vertex.max() + 1, 2), -np.inf)
    np.minimum.at(least, vertex, uv)
    np.maximum.at(most, vertex, uv)
    ring = np.where((most - least).max(1) > _APART, 0, rings)
    for _ in range(rings):
        beside = ring.copy()
        np.minimum.at(beside, vertex, np.repeat(ring[faces].min(1) + 1, 3))
        ring = np.minimum(ring, beside)
    return 1 - ring / rings


def split_atlas(faces: np.ndarray, corner_uv: np.ndarray, levels: int) -> tuple[np.ndarray, np.ndarray]:
    """Split the faces [F, 3] of a closed mesh and their corners [F, 3, 2] in four, so many times."""
    for _ in range(levels):
        faces, corner_uv = split_faces(faces, int(faces.max()) + 1).faces, split_corners(corner_uv)
    return faces, corner_uv
