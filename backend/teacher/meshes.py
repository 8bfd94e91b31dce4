"""Vertex normals and checks of closed triangle meshes, with trimesh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import trimesh

from ..records.errors import LiveHandError


class QuadMesh(NamedTuple):
    """Vertices [V, 3] (build frame, mm, on the surface) and quads [Q, 4] of the template."""

    vertices: np.ndarray
    quads: np.ndarray


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute unit normals [N, 3], angle-weighted."""
    return np.array(trimesh.Trimesh(vertices, faces, process=False).vertex_normals)


def outward(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Flip the faces if they enclose a negative volume.

    Raises:
        LiveHandError: the mesh is not a closed surface of genus 0.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if not (mesh.is_watertight and mesh.is_winding_consistent and mesh.euler_number == 2):
        raise LiveHandError(
            f"the hand's mesh must be closed and without handles, got Euler number {mesh.euler_number}, "
            f"watertight: {mesh.is_watertight}; change the anatomy less or refine the grid"
        )
    return faces if mesh.volume > 0 else faces[:, ::-1]
