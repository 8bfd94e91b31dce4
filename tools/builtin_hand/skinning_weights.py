"""Skinning weights: 1 in the bones' cores, harmonic between them, smoothed, then transferred to the template.

Harmonic with respect to the cotangent Laplacian (Baran & Popovic 2007 without the heat term). Build frame, mm.
"""

from __future__ import annotations

import numpy as np

from ...backend.teacher.dependencies import needs
from ...backend.teacher.frames import swap_distal
from ...backend.teacher.meshes import vertex_normals
from ...backend.teacher.rays import Ray
from .bone_cores import UNLABELLED, bone_cores

with needs("scipy"):
    from scipy import sparse
    from scipy.sparse.linalg import splu
    from scipy.spatial import KDTree

_JOINTS = 16
_SMOOTHINGS = 12
_LEAST_WEIGHT = 0.003  # smaller influences are dropped
_LEAST_TRANSFERRED = 0.004
_NEIGHBOURS, _NEIGHBOUR_WIDTH = 12, 2.0  # of the transfer; width mm
_COTANGENT_RANGE = (0.02, 8.0)  # avoids negative or huge weights of obtuse and sliver triangles


def dense_weights(rays: dict[str, Ray], vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute [N, 16] weights of a dense closed mesh of the hand."""
    labels = bone_cores(rays, swap_distal(vertices), vertex_normals(vertices, faces))
    adjacency = _cotangent_adjacency(vertices, faces)
    weights = np.clip(_harmonic(adjacency, labels), 0, 1)
    mean = sparse.diags_array(1 / adjacency.sum(1)) @ adjacency
    for _ in range(_SMOOTHINGS):
        weights = 0.5 * weights + 0.5 * (mean @ weights)
    return _pruned(weights, _LEAST_WEIGHT)


def transferred_weights(
    source: tuple[np.ndarray, np.ndarray], source_weights: np.ndarray, vertices: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Compute [V, 16] weights at vertices near the dense mesh `source` (vertices, faces).

    A mean over the nearest source vertices, weighted by the agreement of normals, so that a finger gets no weights of
    its neighbour across the gap.
    """
    distance, nearest = KDTree(source[0]).query(vertices, k=_NEIGHBOURS)
    agreement = np.einsum("vkc,vc->vk", vertex_normals(*source)[nearest], normals)
    share = np.exp(-((distance / _NEIGHBOUR_WIDTH) ** 2)) * np.clip(agreement, 0.01, 1) ** 2 + 1e-12
    share /= share.sum(1, keepdims=True)
    return _pruned(np.einsum("vk,vkj->vj", share, source_weights[nearest]), _LEAST_TRANSFERRED)


def _cotangent_adjacency(vertices: np.ndarray, faces: np.ndarray) -> sparse.csr_array:
    """Compute half the sum of the clipped cotangents of the angles opposite each edge: [N, N], symmetric."""
    rows, columns, values = [], [], []
    for corner in range(3):
        a, b, c = (faces[:, (corner + k) % 3] for k in range(3))
        to_b, to_c = vertices[b] - vertices[a], vertices[c] - vertices[a]
        area = np.maximum(np.linalg.norm(np.cross(to_b, to_c), axis=1), 1e-9)
        half_cotangent = 0.5 * np.clip((to_b * to_c).sum(1) / area, *_COTANGENT_RANGE)
        rows += [b, c]
        columns += [c, b]
        values += [half_cotangent, half_cotangent]
    index = (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array((np.concatenate(values), index), shape=(len(vertices),) * 2)


def _harmonic(adjacency: sparse.csr_array, labels: np.ndarray) -> np.ndarray:
    """Solve Laplace's equation between the labels: [N, 16], 1 for the labelled joint."""
    known = labels != UNLABELLED
    weights = np.zeros((len(labels), _JOINTS))
    weights[np.flatnonzero(known), labels[known]] = 1
    laplacian = sparse.csr_array(sparse.diags_array(adjacency.sum(1)) - adjacency)
    between = laplacian[~known]
    right_side = -(between[:, known] @ weights[known])
    weights[~known] = splu(sparse.csc_array(between[:, ~known])).solve(np.ascontiguousarray(right_side))
    return weights


def _pruned(weights: np.ndarray, least: float) -> np.ndarray:
    weights = np.where(weights < least, 0, weights)
    return weights / weights.sum(1, keepdims=True)
