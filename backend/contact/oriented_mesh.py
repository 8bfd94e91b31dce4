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


def walked_faces(first: np.ndarray, second: np.ndarray, alike: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Walk over neighbours.

    Args:
        first: [E] faces that share an edge with another.
        second: [E] the other ones.
        alike: [E] whether both are wound alike.
        count: of faces, F.

    Returns:
        The connected part of each face [F], by its first face in rising order, and whether it is wound otherwise than
        that first one [F] bool.
    """
    part = _parts(first, second, count)
    roots, label = np.unique(part, return_inverse=True)
    flips, is_walked = np.zeros(count, bool), np.zeros(count, bool)
    start, other, change = _neighbours(first, second, alike, count)
    ring = roots
    is_walked[ring] = True
    while len(ring):
        begin, many = start[ring], start[ring + 1] - start[ring]
        before = np.repeat(np.arange(len(ring)), many)
        edge = np.repeat(begin - np.cumsum(many) + many, many) + np.arange(int(many.sum()))
        found, flipped = other[edge], flips[ring][before] ^ change[edge]
        new = ~is_walked[found]
        found, at = np.unique(found[new], return_index=True)
        flips[found] = flipped[new][at]
        is_walked[found] = True
        ring = found
    return label.reshape(-1), flips


def _parts(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """Find the smallest face [F] of each face's part: neighbours take the smaller one's, and what that one has."""
    part = np.arange(count)
    while True:
        least = np.minimum(part[first], part[second])
        after = part.copy()
        np.minimum.at(after, part[first], least)
        np.minimum.at(after, part[second], least)
        after = after[after]
        if np.array_equal(after, part):
            return part
        part = after


def _neighbours(
    first: np.ndarray, second: np.ndarray, alike: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """List the neighbours of face f at start[f] to start[f + 1], and whether each is wound otherwise."""
    face, other = np.concatenate([first, second]), np.concatenate([second, first])
    order = np.argsort(face, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(face, minlength=count))])
    return start, other[order], ~np.tile(alike, 2)[order]


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
