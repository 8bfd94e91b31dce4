"""Self-shadowing: how much light each vertex can receive from each of a few directions.

One small shadow map per direction, all rasterised at once. The result does not depend on any light; a learned light
multiplies it later: T[v, k] = max(0, n_v . d_k) x (share of the sky at d_k that v sees).
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sqrt
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ..geometry.mesh import PosedMesh, Topology
from ..geometry.rasterise import rasterise

DIRECTIONS = 32
MAP_PX = 64
# A blocker shadows a vertex if it lies farther than this before the point lifted off the vertex; template metres.
BIAS_M = 0.003
# Distance of the map's camera in mesh radii: so large that 1/z, which `rasterise` interpolates, is linear.
STAND_OFF = 20.0

LitShare = Callable[["ShadowMapPoints", Topology], Tensor]
"""(points, topology) -> [K, V] the share of nearby map pixels in which a vertex is lit."""


class ShadowMapPoints(NamedTuple):
    """The mesh in K shadow maps.

    Attributes:
        px: [K, V, 2] position of each vertex in its map.
        depth: [K, V] depth of each vertex, mesh radii.
        lifted_px: [K, V, 2] the same of each vertex lifted off the surface along its normal.
        lifted_depth: [K, V].
        bias: [] mesh radii.
    """

    px: Tensor
    depth: Tensor
    lifted_px: Tensor
    lifted_depth: Tensor
    bias: Tensor


def visibility_transfer(mesh: PosedMesh, topology: Topology, lit_share: LitShare | None = None) -> Float[Tensor, "V K"]:
    """Compute the cosine-weighted visibility of `DIRECTIONS` directions spread over the sphere, in the world's axes.

    Args:
        mesh: the pose.
        topology: of the mesh.
        lit_share: compares the points with the maps; None: `lit_share_reference`.
    """
    frames = direction_frames(DIRECTIONS, mesh.vertices.device)
    centre = mesh.vertices.mean(0)
    bias = BIAS_M * mesh.scale
    radius = (mesh.vertices - centre).norm(dim=-1).amax() + 2 * bias
    positions = _in_frames(mesh.vertices - centre, frames) / radius
    lifted = _in_frames(mesh.vertices + bias * mesh.normals - centre, frames) / radius
    points = ShadowMapPoints(_map_px(positions), _depth(positions), _map_px(lifted), _depth(lifted), bias / radius)
    cosine = (mesh.normals @ frames[:, 2].T).clamp(min=0)
    return cosine * (lit_share or lit_share_reference)(points, topology).T


def direction_frames(count: int, device: torch.device | str) -> Float[Tensor, "K 3 3"]:
    """Make orthonormal frames whose third row is a direction; the directions form a Fibonacci sphere."""
    index = torch.arange(count, device=device, dtype=torch.float32)
    z = 1 - 2 * (index + 0.5) / count
    longitude = index * pi * (3 - sqrt(5))
    radius = (1 - z * z).sqrt()
    direction = torch.stack([radius * longitude.cos(), radius * longitude.sin(), z], -1)
    across = torch.stack([-longitude.sin(), longitude.cos(), torch.zeros_like(z)], -1)
    return torch.stack([across, torch.linalg.cross(direction, across), direction], 1)


def _in_frames(offsets: Float[Tensor, "V 3"], frames: Float[Tensor, "K 3 3"]) -> Float[Tensor, "K V 3"]:
    """Transform every vertex into every frame: (x, y, height towards the light)."""
    return torch.einsum("kij,vj->kvi", frames, offsets)


def lit_share_reference(points: ShadowMapPoints, topology: Topology) -> Float[Tensor, "K V"]:
    """Compute the bilinear share of the four nearest map pixels that are no nearer to the light than the vertex."""
    maps = _depth_maps(points, topology)
    position = (points.lifted_px - 0.5).clamp(0, MAP_PX - 1.001)
    first = position.floor()
    share = position - first
    column, row = first.long().unbind(-1)
    lit = torch.zeros_like(share[..., 0])
    for dy, weight_y in ((0, 1 - share[..., 1]), (1, share[..., 1])):
        for dx, weight_x in ((0, 1 - share[..., 0]), (1, share[..., 0])):
            blocker = maps.gather(1, (row + dy) * MAP_PX + column + dx)
            lit = lit + weight_x * weight_y * (points.lifted_depth - points.bias <= blocker)
    return lit


def _depth_maps(points: ShadowMapPoints, topology: Topology) -> Float[Tensor, "K P"]:
    """Rasterise the nearest depth per pixel; the maps are one tall image."""
    count, vertex_count = points.depth.shape
    rows = torch.arange(count, device=points.px.device)[:, None] * MAP_PX
    pixels = torch.stack([points.px[..., 0], points.px[..., 1] + rows], -1).reshape(-1, 2)
    faces = topology.faces + vertex_count * torch.arange(count, device=points.px.device)[:, None, None]
    fragments = rasterise(pixels, points.depth.reshape(-1), faces.reshape(-1, 3), (MAP_PX, MAP_PX * count))
    maps = points.px.new_full((count * MAP_PX * MAP_PX,), torch.inf)
    return maps.scatter_reduce(0, fragments.pixel, fragments.depth, "amin").reshape(count, -1)


def _map_px(positions: Float[Tensor, "K V 3"]) -> Float[Tensor, "K V 2"]:
    """Map unit-disc positions to px, with a margin of one pixel, so that no map touches the next."""
    return (positions[..., :2] * 0.5 + 0.5) * (MAP_PX - 2) + 1


def _depth(positions: Float[Tensor, "K V 3"]) -> Float[Tensor, "K V"]:
    return STAND_OFF - positions[..., 2]
