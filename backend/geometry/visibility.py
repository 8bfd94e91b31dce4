"""How much light each vertex could get from each of a few directions: the cheap knowledge of self-shadowing.

One small shadow map per direction, all of them rasterised at once. The result is multiplied by a learned light later,
so it says nothing of any light itself: T[v, k] = max(0, n_v . d_k) x (share of the sky at d_k that v sees).
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..rendering.device import has_kernels
from .mesh import PosedMesh, Topology
from .rasterise import rasterise

DIRECTIONS = 32
_MAP_PX = 64
# A vertex is in shadow of what lies this far before it, seen from a point lifted off its own surface; template metres.
_BIAS_M = 0.003
# The map's camera stands off by this many hand radii: so far that 1/z, which `rasterise` interpolates, is linear.
_STAND_OFF = 20.0


def visibility_transfer(mesh: PosedMesh, topology: Topology) -> Float[Tensor, "V K"]:
    """Cosine-weighted visibility of `DIRECTIONS` directions spread over the sphere, in the world's axes."""
    frames = direction_frames(DIRECTIONS, mesh.vertices.device)
    centre = mesh.vertices.mean(0)
    bias = _BIAS_M * mesh.scale
    radius = (mesh.vertices - centre).norm(dim=-1).amax() + 2 * bias
    positions = _in_frames(mesh.vertices - centre, frames) / radius
    lifted = _in_frames(mesh.vertices + bias * mesh.normals - centre, frames) / radius
    share = _lit_share_by_kernel if has_kernels(mesh.vertices.device) else _lit_share
    seen = share(positions, lifted, bias / radius, topology)
    cosine = (mesh.normals @ frames[:, 2].T).clamp(min=0)
    return cosine * seen.T


def direction_frames(count: int, device: torch.device | str) -> Float[Tensor, "K 3 3"]:
    """Orthonormal frames whose third row is a direction; the directions form a Fibonacci sphere."""
    index = torch.arange(count, device=device, dtype=torch.float32)
    z = 1 - 2 * (index + 0.5) / count
    longitude = index * pi * (3 - sqrt(5))
    radius = (1 - z * z).sqrt()
    direction = torch.stack([radius * longitude.cos(), radius * longitude.sin(), z], -1)
    across = torch.stack([-longitude.sin(), longitude.cos(), torch.zeros_like(z)], -1)
    return torch.stack([across, torch.linalg.cross(direction, across), direction], 1)


def _in_frames(offsets: Float[Tensor, "V 3"], frames: Float[Tensor, "K 3 3"]) -> Float[Tensor, "K V 3"]:
    """(x, y, height towards the light) of every vertex in every frame."""
    return torch.einsum("kij,vj->kvi", frames, offsets)


def _depth_maps(positions: Float[Tensor, "K V 3"], topology: Topology) -> Float[Tensor, "K P"]:
    """The maps stacked into one image."""
    count, vertex_count = positions.shape[:2]
    rows = torch.arange(count, device=positions.device)[:, None] * _MAP_PX
    pixels = _map_px(positions)
    pixels = torch.stack([pixels[..., 0], pixels[..., 1] + rows], -1).reshape(-1, 2)
    faces = topology.faces + vertex_count * torch.arange(count, device=positions.device)[:, None, None]
    fragments = rasterise(pixels, _depth(positions).reshape(-1), faces.reshape(-1, 3), (_MAP_PX, _MAP_PX * count))
    maps = positions.new_full((count * _MAP_PX * _MAP_PX,), torch.inf)
    return maps.scatter_reduce(0, fragments.pixel, fragments.depth, "amin").reshape(count, -1)


def _lit_share(
    positions: Float[Tensor, "K V 3"], lifted: Float[Tensor, "K V 3"], bias: Float[Tensor, ""], topology: Topology
) -> Float[Tensor, "K V"]:
    """Share of the nearest map pixels that lie no nearer to the light than each lifted vertex, weighted bilinearly."""
    maps = _depth_maps(positions, topology)
    position = (_map_px(lifted) - 0.5).clamp(0, _MAP_PX - 1.001)
    first = position.floor()
    share = position - first
    column, row = first.long().unbind(-1)
    depth, lit = _depth(lifted), torch.zeros_like(share[..., 0])
    for dy, weight_y in ((0, 1 - share[..., 1]), (1, share[..., 1])):
        for dx, weight_x in ((0, 1 - share[..., 0]), (1, share[..., 0])):
            blocker = maps.gather(1, (row + dy) * _MAP_PX + column + dx)
            lit = lit + weight_x * weight_y * (depth - bias <= blocker)
    return lit


def _lit_share_by_kernel(
    positions: Float[Tensor, "K V 3"], lifted: Float[Tensor, "K V 3"], bias: Float[Tensor, ""], topology: Topology
) -> Float[Tensor, "K V"]:
    from ..fast.kernels.compiled import in_parallel
    from ..fast.kernels.shadow import lit_share

    inputs = [values.numpy() for values in (_map_px(positions), _depth(positions), _map_px(lifted), _depth(lifted))]
    inputs += [np.float32(bias), topology.faces.numpy(), _MAP_PX]
    lit = torch.empty(lifted.shape[:2])
    out = lit.numpy()
    in_parallel(lambda first, last: lit_share(*inputs, first, last, out), len(lit), torch.get_num_threads())
    return lit


def _map_px(positions: Float[Tensor, "K V 3"]) -> Float[Tensor, "K V 2"]:
    """Unit-disc positions -> px, a pixel of margin on every side so that no map touches the next."""
    return (positions[..., :2] * 0.5 + 0.5) * (_MAP_PX - 2) + 1


def _depth(positions: Float[Tensor, "K V 3"]) -> Float[Tensor, "K V"]:
    return _STAND_OFF - positions[..., 2]
