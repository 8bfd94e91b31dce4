"""A posed triangle mesh: what all poses share, and what one pose adds.

V vertices, F faces; all tensors lie on one device. Lengths are metres of the world; `scale` is the posed mesh's size
relative to its template, so that everything learnt in the template's metres carries over.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from .local_rotation import LocalFrames
from .tolerances import LANES


class Topology(NamedTuple):
    """What all poses of a mesh share.

    Attributes:
        faces: [F, 3] vertex indices.
        corner_uv: [F, 3, 2] atlas coordinates of each face's corners.
        neighbours: [F, 1 + K] each face, and the faces that share a vertex with it; itself again up to K, a multiple of
            LANES.
        edges: [E, 2] vertex indices.
        edge_length_m: [] mean edge length of the template, from which a posed mesh's scale follows.
        frames: the template's local frame at every vertex.
    """

    faces: Tensor
    corner_uv: Tensor
    neighbours: Tensor
    edges: Tensor
    edge_length_m: Tensor
    frames: LocalFrames

    @classmethod
    def of(
        cls,
        vertices: np.ndarray,
        faces: np.ndarray,
        corner_uv: np.ndarray,
        device: torch.device | str = "cpu",
        mirror: np.ndarray | None = None,
    ) -> Topology:
        """Build the topology of a template mesh.

        Args:
            vertices: [V, 3] m.
            faces: [F, 3] vertex indices.
            corner_uv: [F, 3, 2] atlas coordinates.
            device: of the tensors.
            mirror: [3] factors that turn the template into its canonical mirror image; None: it is canonical.
        """
        indices = torch.as_tensor(faces, device=device)
        template = torch.as_tensor(vertices, dtype=torch.float32, device=device)
        edges = torch.cat([indices[:, [0, 1]], indices[:, [1, 2]], indices[:, [2, 0]]])
        return cls(
            faces=indices,
            corner_uv=torch.as_tensor(corner_uv, dtype=torch.float32, device=device),
            neighbours=face_neighbours(indices),
            edges=edges,
            edge_length_m=mean_edge_length(template, edges),
            frames=LocalFrames.of(vertices, faces, device, mirror),
        )


class PosedMesh(NamedTuple):
    """One pose. vertices [V, 3] m world, unit vertex normals [V, 3] outward, scale [] against the template."""

    vertices: Tensor
    normals: Tensor
    scale: Tensor


def posed_mesh(topology: Topology, vertices: Float[Tensor, "V 3"]) -> PosedMesh:
    """Compute normals and scale of posed vertices."""
    scale = mean_edge_length(vertices, topology.edges) / topology.edge_length_m
    return PosedMesh(vertices, vertex_normals(vertices, topology.faces), scale)


def vertex_normals(vertices: Float[Tensor, "V 3"], faces: Int[Tensor, "F 3"]) -> Float[Tensor, "V 3"]:
    """Compute area-weighted mean of the faces' normals, unit length; zero where a vertex has no area around it."""
    a, b, c = vertices[faces].unbind(1)
    face_normals = torch.linalg.cross(b - a, c - a)
    summed = torch.zeros_like(vertices)
    for corner in range(3):
        summed = summed.index_add(0, faces[:, corner], face_normals)
    return torch.nn.functional.normalize(summed, dim=-1)


def mean_edge_length(vertices: Float[Tensor, "V 3"], edges: Int[Tensor, "E 2"]) -> Float[Tensor, ""]:
    """Compute mean length of the edges, m."""
    ends = vertices[edges]
    return (ends[:, 0] - ends[:, 1]).norm(dim=-1).mean()


def face_neighbours(faces: Int[Tensor, "F 3"]) -> Int[Tensor, "F M"]:
    """List for each face the faces that share a vertex with it, and itself again up to K, a multiple of LANES."""
    corner_of = faces.reshape(-1)
    order = torch.argsort(corner_of, stable=True)
    count = torch.bincount(corner_of)
    first = torch.cumsum(count, 0) - count
    around = [(order[first[v] : first[v] + count[v]] // 3).tolist() for v in range(len(count))]
    rows = []
    for face, corners in enumerate(faces.tolist()):
        others = {other for corner in corners for other in around[corner]} - {face}
        rows.append([face, *sorted(others)])
    most = max(len(row) - 1 for row in rows)
    width = 1 + -(-most // LANES) * LANES
    padded = [row + [row[0]] * (width - len(row)) for row in rows]
    return torch.tensor(padded, dtype=torch.long, device=faces.device)
