"""What the normals of the detailed surface have and those of the detail surface's larger triangles lack, as slopes.

Nails step out of the skin, and creases are narrower than a triangle of the detail surface: its normals smear them.
These slopes bend them back, as a normal map does that is baked from a finer mesh.
"""

from __future__ import annotations

import numpy as np

from ...backend.geometry.loop import split_corners
from ...backend.hand.model import HandModel
from ...backend.surface.detail_maps_file import ATLAS_MM
from ...backend.surface.detail_surface import LEVELS
from ...backend.teacher.dependencies import needs
from ...backend.teacher.detailed_surface import DetailedSurface
from ...backend.teacher.loop import subdivide
from ...backend.teacher.meshes import vertex_normals
from .fine_offsets import fine_surface

with needs("scipy"):
    from scipy.ndimage import gaussian_filter

_LEAST_COSINE = 0.2  # of both normals: steeper slopes than this are none
_TOWARDS_MIDDLE = (0.0, 1 / 3, 2 / 3)  # of each triangle, whose values are spread there, too
_BLUR_TEXELS, _LEAST_WEIGHT = 0.7, 1e-3


def unresolved_slopes(model: HandModel, detail: DetailedSurface, size: int) -> np.ndarray:
    """Compute [2, size, size] float32: along u and v over the atlas, m a m, at rest.

    Args:
        model: the built-in right hand.
        detail: its detailed surface, one level of subdivision finer than the detail surface.
        size: of the map.
    """
    coarse = subdivide(model.f, model.vt[model.ft], len(model.v_template), LEVELS)
    vertices = coarse.matrix @ model.v_template + fine_surface(model, detail).offset_m
    shown = split_corners(vertex_normals(vertices, coarse.faces)[coarse.faces])
    shown = shown / np.linalg.norm(shown, axis=-1, keepdims=True)
    wanted = vertex_normals(detail.vertices_m, detail.faces)[detail.faces]
    slopes = slopes_between(shown, wanted, detail.vertices_m[detail.faces], detail.uv)
    return spread_over_atlas(detail.uv, slopes, size)


def slopes_between(shown: np.ndarray, wanted: np.ndarray, corners_m: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Compute [M, 3, 2] slopes along u and v, at M triangles' corners, that bend normals [M, 3, 3] `shown` to `wanted`.

    Args:
        shown: unit.
        wanted: unit.
        corners_m: [M, 3, 3].
        uv: [M, 3, 2] in the atlas.
    """
    aside = shown - wanted / np.maximum((wanted * shown).sum(-1, keepdims=True), _LEAST_COSINE)
    along = np.linalg.solve(uv[:, 1:] - uv[:, :1], corners_m[:, 1:] - corners_m[:, :1])  # m for a side of the atlas
    return np.einsum("mcx,mkx->mck", aside, along) / (ATLAS_MM / 1000)


def spread_over_atlas(uv: np.ndarray, values: np.ndarray, size: int) -> np.ndarray:
    """Average values [M, 3, C] at corners uv [M, 3, 2] around texels: [C, size, size] float32; 0 beside triangles."""
    total = np.zeros((size, size, values.shape[-1] + 1))
    for share in _TOWARDS_MIDDLE:
        place, value = (x + share * (x.mean(1, keepdims=True) - x) for x in (uv * size - 0.5, values))
        first = np.floor(place).astype(int)
        for column in (0, 1):
            for row in (0, 1):
                texel = first + np.array((column, row))
                weight = (1 - np.abs(place - texel)).prod(-1, keepdims=True)
                at = texel.clip(0, size - 1)
                np.add.at(total, (at[..., 1], at[..., 0]), np.concatenate([value * weight, weight], -1))
    near = gaussian_filter(total, (_BLUR_TEXELS, _BLUR_TEXELS, 0))
    total = np.where(total[..., -1:] > _LEAST_WEIGHT, total, near)
    is_known = total[..., -1] > _LEAST_WEIGHT
    mean = total[..., :-1] / np.maximum(total[..., -1:], _LEAST_WEIGHT)
    return np.moveaxis(np.where(is_known[..., None], mean, 0), -1, 0).astype(np.float32)
