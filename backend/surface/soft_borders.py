"""Rays beside the borders of an atlas' charts, whose colours change softly from one chart to the other.

Networks learn each chart by itself: what is scattered, reflected and glossy steps at a border, which only a close view
shows, as a line across a nail.
"""

from __future__ import annotations

from math import cos, pi, sin
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..field.rays import CameraTensors
from ..field.volume import Composite
from ..image.maps import ray_of_pixel, rays_at
from ..light.indirect_diffuse import MeshPoints
from .atlas_borders import nearness_to_borders
from .ray_hits import RayHits

REACH_M = 0.0012
"""To both sides of a border, over which colours change."""
_LEAST_PX = 1.5  # of the reach in the rays' image; below, a border is hardly wider than a pixel
_MOST_PX = 24.0
_RINGS, _DIRECTIONS = (0.2, 0.45, 0.7, 1.0), 8
_BESIDE, _AT = 0.45, 0.8  # of a face's height, from its far corner to the border


class SoftBorders(NamedTuple):
    """The charts of a hand's atlas.

    Attributes:
        nearness: [V] 1 at the mesh's vertices on borders, 0 elsewhere.
    """

    nearness: Tensor

    @classmethod
    def of(cls, faces: np.ndarray, corner_uv: np.ndarray) -> SoftBorders:
        """Find the borders of a mesh's charts; faces [F, 3], corners [F, 3, 2]."""
        return cls(torch.as_tensor(nearness_to_borders(faces, corner_uv, rings=1), dtype=torch.float32))

    def softened(
        self,
        low: Composite,
        pixel: Int[Tensor, " R"],
        camera: CameraTensors,
        points: MeshPoints,
        hits: RayHits,
        edge_m: Float[Tensor, ""],
    ) -> Composite:
        """Return rays whose colours beside borders are means around, if the view is close enough to show a step.

        Args:
            low: decoded; its channels are premultiplied by opacity.
            pixel: of the rays, in the camera's image.
            camera: of the rays.
            points: where they meet the mesh.
            hits: with the surface; what misses it stays.
            edge_m: depths that differ by more are of other parts.
        """
        radius_px = REACH_M * camera.focal_px / camera.divisor(hits.depth)
        radius_px = torch.where(hits.depth.isfinite(), radius_px, 0).clamp(max=_MOST_PX)
        if not bool((radius_px > _LEAST_PX).any()):
            return low
        nearness = (self.nearness.to(low.alpha.device)[points.vertex] * points.weight).sum(-1)
        share = ((nearness - _BESIDE) / (_AT - _BESIDE)).clamp(0, 1) * (radius_px > _LEAST_PX)
        beside = (share > 0).nonzero()[:, 0]
        if not len(beside):
            return low
        mean = _mean_around(low, pixel, camera.size_px, beside, radius_px[beside], hits.depth / edge_m)
        channels = torch.lerp(low.channels[beside].float(), mean[:, :-1], share[beside, None])
        alpha = torch.lerp(low.alpha[beside].float(), mean[:, -1], share[beside])
        return low._replace(
            channels=low.channels.index_put((beside,), channels.to(low.channels.dtype)),
            alpha=low.alpha.index_put((beside,), alpha.to(low.alpha.dtype)),
        )


def _mean_around(
    low: Composite,
    pixel: Int[Tensor, " R"],
    size_px: tuple[int, int],
    rays: Int[Tensor, " K"],
    radius_px: Float[Tensor, " K"],
    depth: Float[Tensor, " R"],
) -> Float[Tensor, "K D"]:
    """Average channels and opacity over discs around rays, on the same part; `depth` counts steps between parts."""
    width, height = size_px
    x, y = pixel[rays] % width, torch.div(pixel[rays], width, rounding_mode="floor")
    ray_at = ray_of_pixel(pixel, width * height)
    packed = torch.cat([low.channels, low.alpha[:, None]], -1)
    total = packed[rays].float()
    weights = torch.ones_like(radius_px)
    for index, ring in enumerate(_RINGS):
        for k in range(_DIRECTIONS):
            angle = 2 * pi * (k + 0.5 * (index % 2)) / _DIRECTIONS
            across, down = ((radius_px * ring * part(angle)).round().long() for part in (cos, sin))
            ray = rays_at(ray_at, x + across, y + down, size_px)
            there = ray.clamp(min=0)
            gap = (depth[there] - depth[rays]).nan_to_num(torch.inf)
            weight = (ray >= 0) * torch.exp(-gap.square()) * ring
            total += weight[:, None] * packed[there]
            weights = weights + weight
    return total / weights[:, None]
