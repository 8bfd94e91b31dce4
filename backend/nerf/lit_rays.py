"""Where the rays of a relightable hand meet the skin, and what light reaches them there."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from ..geometry.shadow_maps import Bounds, PointShadows
from .backend import RenderBackend
from .field import mean_features
from .light_samples import LightSamples, SkySamples
from .lighting import LightShadows, Openness, SurfacePoints, mean_diffuse, openness
from .lit_field import LitField
from .rays import HandInView, ray_directions, ray_origin
from .volume import Composite

SKY_MAP_PX, LAMP_MAP_PX = 64, 192
"""Sides of the shadow maps of one direction of the sky and of one sample of a lamp."""
_PROBES = 256
NO_OCCLUDERS = torch.zeros(0, 3, 3)


def surface_points(
    field: LitField,
    gathered: Composite,
    position: Float[Tensor, "R 3"],
    view: Float[Tensor, "R 3"],
) -> SurfacePoints:
    """The points with the normals that were gathered along the rays."""
    normal, relief_normal = (normalize(values, dim=-1) for values in field.normals(mean_features(gathered)))
    return SurfacePoints(position, normal.detach(), relief_normal, view)


def ray_positions(
    hand: HandInView, first_hit: Float[Tensor, " P"], pixel: Tensor, t: Float[Tensor, "R N"], dt: Float[Tensor, " R"]
) -> Float[Tensor, "R 3"]:
    """Where rays first meet the mesh, world, m; rays that only meet the shell: the middle of their samples.

    Args:
        hand: posed, in the rays' view.
        first_hit: depth of the mesh at every pixel, m; infinite beside it.
        pixel: of the rays.
        t: depth of the samples, m; only the first is read.
        dt: their step, m.
    """
    depth, middle = first_hit[pixel], t[:, 0] + 0.5 * (t.shape[1] - 1) * dt
    depth = torch.where(depth.isfinite(), depth, middle)
    return ray_origin(hand.camera) + depth[:, None] * ray_directions(hand.camera, pixel)


def open_to_sky(
    backend: RenderBackend, hand: HandInView, points: SurfacePoints, device: torch.device
) -> tuple[Openness, PointShadows]:
    """How open points lie among the parts of the hand itself, and the shadows that say so."""
    sky = SkySamples.of(None, device)
    shadows = backend.point_shadows(
        hand.mesh, hand.topology, NO_OCCLUDERS.to(device), sky.views(), points.position, SKY_MAP_PX
    )
    return openness(sky, shadows, points.normal), shadows


def light_shadows(
    backend: RenderBackend,
    hand: HandInView,
    light: LightSamples,
    occluders: Float[Tensor, "T 3 3"],
    position: Float[Tensor, "R 3"],
) -> LightShadows:
    """The shadows at points, of the hand itself and of occluders."""
    mesh, topology = hand.mesh, hand.topology
    probes = torch.linspace(0, len(mesh.vertices) - 1, _PROBES, device=position.device).round().long()
    points = torch.cat([position, mesh.vertices[probes]])
    views = (light.sky.views(), SKY_MAP_PX), (light.lamps.views(Bounds.of(mesh)), LAMP_MAP_PX)
    shadows = [backend.point_shadows(mesh, topology, occluders, view, points, map_px) for view, map_px in views]
    sky, lamps = (PointShadows(*(values[:, : len(position)] for values in one)) for one in shadows)
    of_probes = (PointShadows(*(values[:, len(position) :] for values in one)) for one in shadows)
    return LightShadows(sky, lamps, *mean_diffuse(light, *of_probes, points[len(position) :], mesh.normals[probes]))
