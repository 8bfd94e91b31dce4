"""A mesh as found in a scene -> connected parts whose faces point outwards.

Vertices in the same place are one, faces without an area are left out. Within a part, faces are wound like most of
those around them; a closed part then encloses a positive volume, and an open one keeps the side that most of its area
had in front.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.mesh_tables import half_edges, open_half_edges
from ..records.errors import LiveHandError
from .walked_faces import walked_faces

_SAME_SHARE = 1e-6  # of the mesh's size, within which vertices are one
MOST_FACES = 2_000_000


@dataclass(frozen=True)
class OrientedPart:
    """A connected surface: vertices [N, 3] m, faces [F, 3] counter-clockwise from outside, and if it has no rim."""

    vertices: np.ndarray
    faces: np.ndarray
    is_closed: bool


def oriented_parts(vertices: np.ndarray, faces: np.ndarray) -> list[OrientedPart]:
    """Split a mesh of vertices [N, 3] m and faces [F, 3] into oriented parts.

    Raises:
        LiveHandError: there is no face with an area, too many faces, or a vertex that is not finite.
    """
    if not np.isfinite(vertices).all():
        raise LiveHandError("the object's vertices must be finite, got NaN or infinity; check its modifiers")
    if len(faces) > MOST_FACES:
        raise LiveHandError(
            f"the object must have at most {MOST_FACES:,} triangles, got {len(faces):,}; add a Decimate modifier"
        )
    vertices, faces = _merged(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))
    if not len(faces):
        raise LiveHandError("the object must have faces with an area, got none; choose a mesh with faces")
    joints = _joints(faces)
    label, flips = walked_faces(*joints, len(faces))
    count = int(label.max()) + 1
    faces = _wound_alike(faces, flips, label, count)
    return [_facing_outwards(vertices, faces[label == part]) for part in range(count)]


def _merged(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Make one of vertices in the same place, and drop faces that have no area."""
    if not len(faces):
        return vertices, faces
    used = vertices[np.unique(faces)]
    size = float((used.max(0) - used.min(0)).max())
    keys = np.round((vertices - used.min(0)) / max(size * _SAME_SHARE, 1e-12)).astype(np.int64)
    _, first, merged = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    vertices, faces = vertices[first], merged.reshape(-1)[faces]
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return vertices, faces[area > (size * _SAME_SHARE) ** 2]


def _joints(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """List pairs of faces that share an edge which no third face has: first [E], second [E], and if they are alike."""
    halves = half_edges(faces)
    face = np.tile(np.arange(len(faces)), 3)
    low, high = halves.min(1), halves.max(1)
    order = np.lexsort((high, low))
    low, high, face, forward = low[order], high[order], face[order], (halves[:, 0] < halves[:, 1])[order]
    same = (low[1:] == low[:-1]) & (high[1:] == high[:-1])
    of_two = same & ~np.append(same[1:], False) & ~np.insert(same[:-1], 0, False)
    k = np.flatnonzero(of_two)
    return face[k], face[k + 1], forward[k] != forward[k + 1]


def _wound_alike(faces: np.ndarray, flips: np.ndarray, label: np.ndarray, count: int) -> np.ndarray:
    """Turn faces [F] that are wound otherwise than their part's first one, or the others where those are fewer."""
    turned = np.bincount(label, weights=flips, minlength=count)
    flips = flips ^ (2 * turned > np.bincount(label, minlength=count))[label]
    faces = faces.copy()
    faces[flips] = faces[flips][:, ::-1]
    return faces


def _facing_outwards(vertices: np.ndarray, faces: np.ndarray) -> OrientedPart:
    used, packed = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], packed.reshape(-1, 3)
    is_closed = not len(open_half_edges(faces))
    a, b, c = (vertices[faces[:, corner]] - vertices.mean(0) for corner in range(3))
    if is_closed and np.einsum("fc,fc->", a, np.cross(b, c)) < 0:
        faces = faces[:, ::-1].copy()
    return OrientedPart(vertices, faces, is_closed)
