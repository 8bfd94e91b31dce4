"""The rotation of the surface about each vertex, from the template to the pose.

The normal alone cannot shade fine relief: the two flanks of a tendon differ by how they lie to the light, so the field
needs the light's direction in the skin's own frame. The rotation is computed from the posed mesh, not from the joints,
so it also holds for sculpted hands, retargeted rigs and rotated armature objects.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from .mesh_tables import area_weighted_normals, neighbour_table

_MIN_LENGTH = 1e-12  # m; a tangent this short has no direction and becomes zero


class LocalFrames(NamedTuple):
    """The tangent of every vertex as a combination of its edges, and the template's frames.

    Attributes:
        neighbours: [V, K] vertex indices, padded with the vertex itself.
        weights: [V, K] weights of the edges to the neighbours; their weighted sum is the tangent.
        template: [V, 3, 3] rows tangent, bitangent, normal; unit length, canonical axes.
    """

    neighbours: Tensor
    weights: Tensor
    template: Tensor

    @classmethod
    def of(
        cls, vertices: np.ndarray, faces: np.ndarray, device: torch.device | str, mirror: np.ndarray | None = None
    ) -> LocalFrames:
        """Build the frames of a template mesh; `mirror` [3] turns it into its canonical mirror image (None: it is one).

        The weights are the least-squares combination of edges that gives the tangent in the template.
        """
        neighbours, frames = neighbour_table(faces, len(vertices)), _template_frames(vertices, faces)
        edges = vertices[neighbours] - vertices[:, None]
        in_plane = np.einsum("vkc,vac->vka", edges, frames[:, :2])  # [V, K, 2]
        gram = np.einsum("vka,vkb->vab", in_plane, in_plane)
        weights = np.einsum("vka,vab->vkb", in_plane, np.linalg.pinv(gram))[..., 0]
        canonical = frames if mirror is None else frames * mirror
        return cls(
            torch.as_tensor(neighbours, device=device),
            torch.as_tensor(weights, dtype=torch.float32, device=device),
            torch.as_tensor(canonical, dtype=torch.float32, device=device),
        )


def local_rotations(
    vertices: Float[Tensor, "V 3"], normals: Float[Tensor, "V 3"], frames: LocalFrames
) -> Float[Tensor, "V 3 3"]:
    """Compute matrices from the canonical template's directions to the world's, orthonormal (or mirrored)."""
    edges = vertices[frames.neighbours] - vertices[:, None]
    tangent = (frames.weights[..., None] * edges).sum(1)
    tangent = tangent - (tangent * normals).sum(-1, keepdim=True) * normals
    tangent = torch.nn.functional.normalize(tangent, dim=-1, eps=_MIN_LENGTH)
    posed = torch.stack([tangent, torch.linalg.cross(normals, tangent), normals], 1)
    return posed.transpose(1, 2) @ frames.template


def _template_frames(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute frames [V, 3, 3] with rows tangent (any), bitangent, normal."""
    normals = area_weighted_normals(vertices, faces)
    axis = np.eye(3)[np.abs(normals).argmin(1)]
    tangents = _unit(axis - (axis * normals).sum(1, keepdims=True) * normals)
    return np.stack([tangents, np.cross(normals, tangents), normals], 1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), _MIN_LENGTH)
