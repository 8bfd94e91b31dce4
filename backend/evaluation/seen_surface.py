"""The posed mesh as a view sees it: how far each pixel's surface lies, and how open it is to the sky."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..geometry.mesh import PosedMesh, Topology
from ..geometry.rasterise import rasterise
from ..geometry.visibility import DIRECTIONS, direction_frames
from ..nerf.rays import CameraTensors, project
from ..rendering.backends import choose_backend

_MIN_COSINES = 1e-3  # a vertex without a normal faces no direction; all others reach about 8


class SeenSurface(NamedTuple):
    """Over the pixels of a view.

    Attributes:
        depth: [H, W] m along the optical axis of the nearest front face; infinite where there is none.
        openness: [H, W] cosine-weighted share of the sky that the rest of the hand leaves free, 0..1; 1 off the mesh.
        footprint: [H, W] width of a pixel on the surface seen straight on, m.
        scale: [] the posed hand's size against its template.
    """

    depth: Tensor
    openness: Tensor
    footprint: Tensor
    scale: Tensor


def vertex_openness(mesh: PosedMesh, topology: Topology) -> Tensor:
    """[V] cosine-weighted share of the sky's directions that each vertex sees past the rest of the hand, 0..1."""
    directions = direction_frames(DIRECTIONS, mesh.vertices.device)[:, 2]
    all_of_it = (mesh.normals @ directions.T).clamp(min=0).sum(1)
    return choose_backend(mesh.vertices.device).visibility(mesh, topology).sum(1) / all_of_it.clamp(min=_MIN_COSINES)


def seen_surface(mesh: PosedMesh, topology: Topology, openness: Tensor, view: CameraTensors) -> SeenSurface:
    """Rasterise the mesh; each face carries the mean openness [V] of its corners."""
    fragments = rasterise(*project(view, mesh.vertices), topology.faces, view.size_px)
    pixel, face, depth = (values[fragments.is_front] for values in fragments[:3])
    width, height = view.size_px
    nearest = torch.full((height * width,), torch.inf, device=depth.device)
    nearest = nearest.scatter_reduce(0, pixel, depth, "amin")
    is_seen = depth == nearest[pixel]
    open_there = torch.ones_like(nearest)
    open_there[pixel[is_seen]] = openness[topology.faces].mean(1)[face[is_seen]]
    nearest = nearest.reshape(height, width)
    return SeenSurface(nearest, open_there.reshape(height, width), nearest / view.K[0, 0].abs(), mesh.scale)
