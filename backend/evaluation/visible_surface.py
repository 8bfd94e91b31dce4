"""The posed mesh in a view: each pixel's depth and its ambient occlusion to the sky."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..field.rays import CameraTensors, project
from ..geometry.mesh import PosedMesh, Topology
from ..geometry.rasterise import rasterise
from ..light.visibility import DIRECTIONS, direction_frames
from ..render.backends import choose_backend

_MIN_COSINES = 1e-3  # a vertex without a normal faces no direction; all others have about 8


class VisibleSurface(NamedTuple):
    """Maps over the pixels of a view.

    Attributes:
        depth: [H, W] m along the optical axis of the nearest front face; infinite where there is none.
        ambient_occlusion: [H, W] cosine-weighted share of the sky that the hand does not hide, 0..1; 1 off the mesh.
        footprint: [H, W] width of a pixel on a surface that faces the camera, m.
        scale: [] size of the posed hand relative to its template.
    """

    depth: Tensor
    ambient_occlusion: Tensor
    footprint: Tensor
    scale: Tensor


def vertex_ambient_occlusion(mesh: PosedMesh, topology: Topology) -> Tensor:
    """Compute [V] cosine-weighted share of the sky that the hand does not hide from each vertex, 0..1."""
    directions = direction_frames(DIRECTIONS, mesh.vertices.device)[:, 2]
    unhidden = (mesh.normals @ directions.T).clamp(min=0).sum(1)
    visible = choose_backend(mesh.vertices.device).visibility(mesh, topology).sum(1)
    return visible / unhidden.clamp(min=_MIN_COSINES)


def visible_surface(
    mesh: PosedMesh, topology: Topology, ambient_occlusion: Tensor, view: CameraTensors
) -> VisibleSurface:
    """Rasterise the mesh; a face has the mean ambient occlusion [V] of its corners."""
    fragments = rasterise(*project(view, mesh.vertices), topology.faces, view.size_px)
    pixel, face, depth = (values[fragments.is_front] for values in fragments[:3])
    width, height = view.size_px
    nearest = torch.full((height * width,), torch.inf, device=depth.device)
    nearest = nearest.scatter_reduce(0, pixel, depth, "amin")
    is_seen = depth == nearest[pixel]
    nearest_ambient_occlusion = torch.ones_like(nearest)
    nearest_ambient_occlusion[pixel[is_seen]] = ambient_occlusion[topology.faces].mean(1)[face[is_seen]]
    nearest = nearest.reshape(height, width)
    return VisibleSurface(
        nearest, nearest_ambient_occlusion.reshape(height, width), nearest / view.K[0, 0].abs(), mesh.scale
    )
