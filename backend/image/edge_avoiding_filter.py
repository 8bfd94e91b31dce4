"""Means over neighbouring rays that meet the same surface.

Light is computed ray by ray. Shadows of soft lamps have the steps of their samples, and those of the sky of its cells:
they are smoothed. A hard lamp's have no steps, and would only lose their edge, beyond which gloss seems to shine that
is many times as bright.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..light.lamp_samples import HARD_RAD
from ..light.lighting import LightFeatures, SurfacePoints
from .maps import ray_of_pixel
from .shading import ray_rows, with_ray_rows

SHARES = (4.0, 2.0, 1.0)
"""Of neighbours that differ in none, one and both coordinates."""
OFF_PLANE_M, FACING_POWER = 0.003, 4
"""Neighbours count for less, the farther they lie off the surface's tangent plane, and the more it turns."""


class RaySurfacePoints(NamedTuple):
    """Where R rays meet a surface.

    Attributes:
        position: [R, 3] m, world.
        normal: [R, 3] unit, or zero.
        pixel: [R] row * width + column, in the rays' image.
        size_px: width and height of that image.
        off_plane_m: `OFF_PLANE_M` on the posed hand.
    """

    position: Tensor
    normal: Tensor
    pixel: Tensor
    size_px: tuple[int, int]
    off_plane_m: float

    @classmethod
    def of(cls, points: SurfacePoints, pixel: Tensor, size_px: tuple[int, int], scale: Tensor) -> RaySurfacePoints:
        """Prepare the rays at `pixel` for the filter; `scale` is the posed mesh's."""
        return cls(points.position, points.normal, pixel, size_px, OFF_PLANE_M * float(scale))


EdgeAvoidingMean = Callable[[Tensor, RaySurfacePoints, int], Tensor]
"""`edge_avoiding_mean`, or what equals it."""


def edge_avoiding_mean(values: Float[Tensor, "R C"], hit_points: RaySurfacePoints, stride: int) -> Float[Tensor, "R C"]:
    """Average over 3 x 3 rays, `stride` apart, on the same surface (Dammertz et al. 2010, edge-avoiding wavelets)."""
    position, normal = hit_points.position, hit_points.normal
    row, at = _rows_around(hit_points, stride)
    summed, total = SHARES[0] * values, values.new_full((len(values), 1), SHARES[0])
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            if dx == dy == 0:
                continue
            other = row[at + stride * (dy * (hit_points.size_px[0] + 2 * stride) + dx)]
            off_m = ((position[other] - position) * normal).sum(-1)
            facing = (normal[other] * normal).sum(-1).clamp(min=0) ** FACING_POWER
            near = torch.exp(-((off_m / hit_points.off_plane_m) ** 2))
            weight = (SHARES[abs(dx) + abs(dy)] * facing * near * (other >= 0))[:, None]
            summed, total = summed + weight * values[other], total + weight
    return summed / total


def smoothed_light(
    features: LightFeatures, hit_points: RaySurfacePoints, means: EdgeAvoidingMean = edge_avoiding_mean
) -> LightFeatures:
    """Smooth the features: each ray's light becomes the mean of the rays beside it on the same surface.

    What hard lamps shine on it directly stays.
    """
    smoothed = with_ray_rows(features, means(ray_rows(features), hit_points, 1))
    hard = (2 * features.lamp_radius_rad < HARD_RAD).nonzero()[:, 0]
    smoothed.lamp_vectors[:, hard] = features.lamp_vectors[:, hard]
    return smoothed


def _rows_around(hit_points: RaySurfacePoints, border: int) -> tuple[Int[Tensor, " P"], Int[Tensor, " R"]]:
    """Find the ray of each pixel of the image, -1 for none, with a border around it, and the rays' positions in it."""
    width, height = hit_points.size_px
    wide = width + 2 * border
    at = (torch.div(hit_points.pixel, width, rounding_mode="floor") + border) * wide + hit_points.pixel % width + border
    return ray_of_pixel(at, wide * (height + 2 * border)), at
