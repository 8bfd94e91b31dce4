"""Canonical coordinates of samples near the posed surface: atlas (u, v) and signed height h (paper section 3.1)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from .mesh import PosedMesh, Topology


class SurfaceSamples(NamedTuple):
    """S samples: the surface point below each, and its signed height (positive outside), in the template's metres."""

    face: Tensor
    barycentric: Tensor
    height_m: Tensor


def signed_height(
    points: Float[Tensor, "S 3"], nearest: SurfaceSamples, topology: Topology, mesh: PosedMesh
) -> Float[Tensor, " S"]:
    """Sign the unsigned distances of points, in the world's metres, over their nearest surface points.

    The sign is that of the offset along the interpolated vertex normal, which, unlike a face normal, is also correct at
    edges and vertices.
    """
    offset = points - interpolate(mesh.vertices, topology, nearest)
    normal = interpolate(mesh.normals, topology, nearest)
    return torch.where((offset * normal).sum(-1) < 0, -nearest.height_m, nearest.height_m)


def interpolate(
    vertex_values: Float[Tensor, "V C"], topology: Topology, samples: SurfaceSamples
) -> Float[Tensor, "S C"]:
    """Compute per-vertex values at the samples' surface points."""
    return _blend(vertex_values[topology.faces[samples.face]], samples.barycentric)


def atlas_uv(topology: Topology, samples: SurfaceSamples) -> Float[Tensor, "S 2"]:
    """Compute atlas coordinates of the samples, in the chart of their own face, so that no seam is crossed."""
    return _blend(topology.corner_uv[samples.face], samples.barycentric)


def _blend(corners: Float[Tensor, "S 3 C"], barycentric: Float[Tensor, "S 3"]) -> Float[Tensor, "S C"]:
    """Compute weighted sum of the corners (three products: far faster than a batch of tiny matrix products)."""
    a, b, c = corners.unbind(1)
    wa, wb, wc = barycentric.unbind(1)
    return a * wa[:, None] + b * wb[:, None] + c * wc[:, None]
