"""The parameters of geometry near the hand: triangles that cast shadows, and patches that reflect light."""

from __future__ import annotations

import numpy as np
import torch
import warp as wp

from ...light.nearby_geometry import MOST_PATCHES, MOST_POINTS, Patches
from ...light.shadow_maps import LAMP_MAP_PX, SKY_MAP_PX
from ..whole_frames import LitShot
from .blocks import HostBlock, Layout
from .frame_shape import FrameShape

POINTS = MOST_POINTS
"""Room for points of patches."""


def nearby_layout(shape: FrameShape) -> Layout:
    """Lay out the parameters of nearby geometry, as far as frames of a shape have any.

    `patch_lifted` are points as the sky's shadow maps see them, and then as lamps' do; `patch_start` are where those of
    each patch begin.
    """
    layout: Layout = {"triangles": (wp.int32, (1,)), "occluders": (wp.vec3, (3 * shape.triangles,))}
    if not shape.has_patches:
        return layout
    return {
        **layout,
        "patch_lifted": (wp.vec3, (2 * POINTS,)),
        "point_position": (wp.vec3, (POINTS,)),
        "point_normal": (wp.vec3, (POINTS,)),
        "point_share": (wp.float32, (POINTS,)),
        "patch_start": (wp.int32, (MOST_PATCHES + 1,)),
        "patch_count": (wp.int32, (1,)),
        "patch_position": (wp.vec3, (MOST_PATCHES,)),
        "patch_normal": (wp.vec3, (MOST_PATCHES,)),
        "patch_area_m2": (wp.float32, (MOST_PATCHES,)),
        "patch_albedo": (wp.vec3, (MOST_PATCHES,)),
    }


def fill_nearby(host: HostBlock, shot: LitShot) -> None:
    """Fill the parameters of nearby geometry."""
    host["triangles"][:] = len(shot.occluders)
    host["occluders"][: 3 * len(shot.occluders)] = shot.occluders.reshape(-1, 3)
    if shot.patches is not None:
        _fill_patches(host, shot.patches, torch.as_tensor(shot.vertices))


def _fill_patches(host: HostBlock, patches: Patches, vertices: torch.Tensor) -> None:
    """Fill patches and their points, patch by patch."""
    points, bounds = patches.points, patches.points.bounds_with(vertices)
    count, order = len(points.position), np.argsort(points.patch.numpy(), kind="stable")
    for first, map_px in ((0, SKY_MAP_PX), (POINTS, LAMP_MAP_PX)):
        host["patch_lifted"][first : first + count] = points.lifted(bounds, map_px).numpy()[order]
    areas, patch = points.area_m2.numpy()[order], points.patch.numpy()[order]
    of_patch = np.bincount(patch, areas, len(patches.position))
    host["point_share"][:count] = areas / of_patch[patch]
    host["patch_start"][:] = np.searchsorted(patch, np.arange(MOST_PATCHES + 1))
    for name in ("position", "normal"):
        host[f"point_{name}"][:count] = getattr(points, name).numpy()[order]
    host["patch_count"][:] = len(patches.position)
    for name in ("position", "normal", "area_m2", "albedo"):
        host[f"patch_{name}"][: len(patches.position)] = getattr(patches, name).numpy()
