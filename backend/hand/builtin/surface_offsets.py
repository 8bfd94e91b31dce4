"""Where the detailed surface lies beside the template's flat faces, as maps over the atlas."""

from __future__ import annotations

import numpy as np
import torch

from ...geometry.rasterise import rasterise
from ..model import HandModel
from .dependencies import needs
from .detailed_surface import DetailedSurface

with needs("scipy"):
    from scipy.ndimage import distance_transform_edt

OFFSETS = 256
"""Texels along each side of the maps."""


def surface_offsets(model: HandModel, detail: DetailedSurface, atlas_mm: float, veins_mm: float) -> np.ndarray:
    """[N, N, 3] mm: along u and v of the atlas, and height above the face, the row of the smallest v first.

    A texel holds the way from the point of the flat face that has its place in the atlas to the point of the detailed
    surface that has the same one, in the flat hand at rest. Where no chart is, the nearest chart's goes on.

    Args:
        model: whose template was subdivided.
        detail: the result, of some levels.
        atlas_mm: side of the atlas on the skin.
        veins_mm: height of veins.
    """
    parent = np.arange(len(detail.faces)) % len(model.f)  # as `loop.subdivide` orders faces
    corner_uv, corners = model.vt[model.ft], model.v_template[model.f]
    sides_uv, sides = (_sides(triangles)[parent] for triangles in (corner_uv, corners))
    share = np.linalg.solve(sides_uv[:, None], (detail.uv - corner_uv[parent][:, :1])[..., None])
    flat = corners[parent][:, :1] + (sides[:, None] @ share)[..., 0]
    surface = detail.vertices_m + detail.relief_m(np.zeros((16, 3)), veins_mm)
    offset = surface[detail.faces] - flat
    along = np.einsum("fij,fkj->fki", sides_uv @ np.linalg.pinv(sides), offset) * atlas_mm
    normal = np.cross(sides[..., 0], sides[..., 1])
    height = np.einsum("fj,fkj->fk", normal / np.linalg.norm(normal, axis=1, keepdims=True), offset) * 1e3
    return _painted(detail.uv, np.concatenate([along, height[..., None]], -1))


def _sides(triangles: np.ndarray) -> np.ndarray:
    """[F, D, 2] both sides from the first corner of triangles [F, 3, D], as columns."""
    return np.stack([triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]], -1)


def _painted(uv: np.ndarray, values: np.ndarray) -> np.ndarray:
    """[N, N, C] values [M, 3, C] of corners that lie at uv [M, 3, 2], within triangles; beside these the nearest."""
    px = uv * OFFSETS
    numbers = torch.arange(3 * len(uv)).reshape(-1, 3)
    places = torch.as_tensor(px.reshape(-1, 2), dtype=torch.float32)
    found = rasterise(places, torch.ones(len(places)), numbers, (OFFSETS, OFFSETS))
    pixel, face = found.pixel.numpy(), found.face.numpy()
    centre = np.stack([pixel % OFFSETS, pixel // OFFSETS], -1) + 0.5
    share = np.linalg.solve(_sides(px)[face], (centre - px[face, 0])[..., None])[..., 0]
    weights = np.concatenate([1 - share.sum(1, keepdims=True), share], 1)
    painted, is_empty = np.zeros((OFFSETS**2, values.shape[-1])), np.ones(OFFSETS**2, bool)
    painted[pixel], is_empty[pixel] = (values[face] * weights[..., None]).sum(1), False
    square = (OFFSETS, OFFSETS)
    nearest = distance_transform_edt(is_empty.reshape(square), return_distances=False, return_indices=True)
    row, column = np.asarray(nearest)
    return painted.reshape(*square, -1)[row, column].astype(np.float32)
