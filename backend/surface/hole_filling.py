"""Rays that meet an avatar's surface where the field is transparent: they have the colours of the skin around.

There the surface stands out of the rays' shell, or parts of the hand are so near that a ray stops in neither. Their
colours would be divided by next to nothing, and super-resolution would see a hole.
"""

from __future__ import annotations

from math import cos, pi, sin

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..field.rays import RenderedRays
from ..field.volume import Composite
from ..image.maps import ray_of_pixel, rays_at
from ..light.lighting import SurfacePoints
from .ray_hits import RayHits

CLEAR, OPAQUE = 0.3, 0.7
"""Opacities at which a ray's colours are those around, and its own."""
RINGS_PX, DIRECTIONS = (1.0, 2.0, 4.0, 8.0, 16.0), 12
BEHIND = 100.0  # times the least difference of depth between parts
LEAST_OPACITY, LEAST_WEIGHT = 0.02, 1e-6


def add_missing_rays(rays: RenderedRays, hits: RayHits) -> tuple[RenderedRays, RayHits]:
    """Add a fully transparent ray in every other pixel of the surface; return all rays, and where each meets it.

    Args:
        rays: that meet the shell.
        hits: of all pixels of the image.
    """
    is_missed = hits.depth.isfinite()
    is_missed[rays.pixel] = False
    missed = is_missed.nonzero()[:, 0]
    if len(missed):
        clear = Composite(*(values.new_zeros(len(missed), *values.shape[1:]) for values in rays.composite))
        t = hits.depth[missed, None].expand(-1, rays.t.shape[1])
        rays = RenderedRays(
            pixel=torch.cat([rays.pixel, missed]),
            composite=Composite(*(torch.cat(both) for both in zip(rays.composite, clear, strict=True))),
            t=torch.cat([rays.t, t]),
            dt=torch.cat([rays.dt, rays.dt.new_zeros(len(missed))]),
        )
    return rays, RayHits(hits.depth[rays.pixel], hits.normal[rays.pixel])


def inpaint(
    low: Composite, pixel: Int[Tensor, " R"], size_px: tuple[int, int], hits: RayHits, edge_m: Float[Tensor, ""]
) -> Composite:
    """Fill the rays that are all but transparent with channels and opacity of the skin around, at its depth.

    Args:
        low: decoded; its channels are premultiplied by opacity.
        pixel: of the rays, in an image of this size.
        size_px: of that image.
        hits: with the surface; what misses it stays.
        edge_m: depths that differ by more are of other parts.
    """
    own = own_share(low.alpha, hits)
    clear = (own < 1).nonzero()[:, 0]
    if len(clear) == 0:
        return low
    around = _around(pixel, size_px, clear)
    there = around.clamp(min=0)
    gap = ((hits.depth[there] - hits.depth[clear]) / edge_m).nan_to_num(torch.inf)
    radius = gap.new_tensor(RINGS_PX).repeat_interleave(DIRECTIONS)[:, None]
    weight = own[there] * (around >= 0) * torch.exp(-gap.square()) / radius.square()
    total = weight.sum(0)
    is_known = total > LEAST_WEIGHT
    clear, there, weight = clear[is_known], there[:, is_known], (weight / total)[:, is_known, None]
    alpha = low.alpha[:, None].float()
    straight = low.channels.float() / alpha.clamp(min=LEAST_OPACITY)
    share = own[clear, None]
    opacity = torch.lerp((weight * alpha[there]).sum(0), alpha[clear], share)
    colours = torch.lerp((weight * straight[there]).sum(0), straight[clear], share)
    return low._replace(
        channels=low.channels.index_put((clear,), (colours * opacity).to(low.channels.dtype)),
        alpha=low.alpha.index_put((clear,), opacity[:, 0].to(low.alpha.dtype)),
    )


def own_share(alpha: Float[Tensor, " R"], hits: RayHits) -> Float[Tensor, " R"]:
    """Return how much rays of these opacities count for what they gathered; all that miss the surface count whole."""
    return torch.where(hits.depth.isfinite(), ((alpha - CLEAR) / (OPAQUE - CLEAR)).clamp(0, 1), 1)


def drop_outliers(
    points: SurfacePoints, alpha: Float[Tensor, " R"], hits: RayHits, edge_m: Float[Tensor, ""]
) -> SurfacePoints:
    """Move transparent rays' points that miss the surface far behind it, so that no pixel of it has their light.

    Their normals are divided by next to nothing: beside outlines, pixels would be bright or dark by chance.

    Args:
        points: of the rays.
        alpha: opacity of the rays.
        hits: with the surface.
        edge_m: depths that differ by more are of other parts.
    """
    is_outlier = ~hits.depth.isfinite() & (alpha < CLEAR)
    behind = points.position + BEHIND * edge_m * points.view
    return points._replace(position=torch.where(is_outlier[:, None], behind, points.position))


def _around(pixel: Int[Tensor, " R"], size_px: tuple[int, int], rays: Int[Tensor, " K"]) -> Int[Tensor, "S K"]:
    """Find the rays on rings around some of them; -1 for none."""
    width, height = size_px
    angles = [2 * pi * k / DIRECTIONS for k in range(DIRECTIONS)]
    offsets = [(round(r * cos(angle)), round(r * sin(angle))) for r in RINGS_PX for angle in angles]
    dx, dy = pixel.new_tensor(offsets)[:, None].unbind(-1)
    x, y = pixel[rays] % width + dx, torch.div(pixel[rays], width, rounding_mode="floor") + dy
    return rays_at(ray_of_pixel(pixel, width * height), x, y, size_px)
