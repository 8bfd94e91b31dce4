"""Closes a hand that is open at the wrist, as MANO is, by faces between the vertices of the open edge.

The renderer's depth bounds and closest points require a closed surface.
"""

from __future__ import annotations

import numpy as np

from ..geometry.mesh_tables import half_edges, open_half_edges, repeated_half_edges
from ..records.errors import LiveHandError


def capped(v_template: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Find faces [F + C, 3] of the closed surface: `f`, then the faces of its caps."""
    return np.concatenate([f, *cap_faces(v_template, f)])


def cap_faces(v_template: np.ndarray, f: np.ndarray) -> list[np.ndarray]:
    """Find the faces [C, 3] that close each open edge of a surface [V, 3], [F, 3], wound like their neighbours.

    Raises:
        LiveHandError: the faces are not consistently wound, or an open edge touches itself.
    """
    loops = _open_loops(f)
    edges = set(map(tuple, np.sort(half_edges(f), 1).tolist())) if loops else set()
    return [_triangulated(loop, v_template, edges) for loop in loops]


def _open_loops(f: np.ndarray) -> list[list[int]]:
    """Find loops of vertices along the boundary, in the direction of the missing faces."""
    if len(repeated_half_edges(f)):
        raise LiveHandError("faces must be wound alike and meet in pairs, got an edge that two faces run the same way")
    open_edges = open_half_edges(f).tolist()
    following = {b: a for a, b in open_edges}
    if len(following) != len(open_edges):
        raise LiveHandError("an open edge must not touch itself, got a vertex where two loops meet; close the mesh")
    loops = []
    while following:
        start, at = following.popitem()
        loop = [start]
        while at != start:
            loop.append(at)
            at = following.pop(at)
        loops.append(loop)
    return loops


def _triangulated(loop: list[int], points: np.ndarray, edges: set[tuple[int, int]]) -> np.ndarray:
    """Triangulate a loop by ear clipping, the ear with the shortest cut first: triangles [C, 3].

    A cut may not coincide with an edge of the surface, which would then have four faces. If there is no proper ear, the
    shortest allowed cut is used.
    """
    flat = dict(zip(loop, _flattened(points[loop]), strict=True))
    rest, faces = list(loop), []
    while len(rest) > 3:
        corners = [(rest[i - 1], rest[i], rest[(i + 1) % len(rest)]) for i in range(len(rest))]
        allowed = [corner for corner in corners if (min(corner[0], corner[2]), max(corner[0], corner[2])) not in edges]
        ears = [corner for corner in allowed if _is_ear(corner, rest, flat)] or allowed
        if not ears:
            raise LiveHandError("an open edge must leave room for a cap, got one that the surface itself spans")
        ear = min(ears, key=lambda corner: float(np.linalg.norm(points[corner[0]] - points[corner[2]])))
        faces.append(ear)
        rest.remove(ear[1])
    return np.array([*faces, rest])


def _plane_axes(normal: np.ndarray) -> np.ndarray:
    """Compute [3, 2] unit axes of the plane of a normal of any length, right-handed with it."""
    right = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
    up = np.cross(normal, right)
    return np.stack([right / np.linalg.norm(right), up / np.linalg.norm(up)], 1)


def _flattened(loop_points: np.ndarray) -> np.ndarray:
    """Return [n, 2] positions in the loop's mean plane, counter-clockwise."""
    centred = loop_points - loop_points.mean(0)
    return centred @ _plane_axes(np.cross(centred, np.roll(centred, -1, 0)).sum(0))


def _is_ear(corner: tuple[int, int, int], rest: list[int], flat: dict[int, np.ndarray]) -> bool:
    """Tell whether the corner is convex and its triangle contains no other vertex of the loop."""
    a, b, c = (flat[vertex] for vertex in corner)
    others = np.array([flat[vertex] for vertex in rest if vertex not in corner])
    inside = (_side(a, b, others) > 0) & (_side(b, c, others) > 0) & (_side(c, a, others) > 0)
    return bool(_side(a, b, c[None])[0] > 0 and not inside.any())


def _side(start: np.ndarray, end: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Compute twice the signed area of start, end and each point: positive on the left."""
    along, offsets = end - start, points - start
    return along[0] * offsets[:, 1] - along[1] * offsets[:, 0]


def flat_cap(v_template: np.ndarray, cap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lay a cap [C, 3] into its mean plane: positions [n, 2] m of its vertices from (0, 0) on, and its faces [C, 3]."""
    vertices, faces = np.unique(cap, return_inverse=True)
    a, b, c = (v_template[cap[:, corner]] for corner in range(3))
    flat = v_template[vertices] @ _plane_axes(np.cross(b - a, c - a).sum(0))
    return flat - flat.min(0), faces.reshape(cap.shape)
