"""Grows a forearm's quads on the hand's: rings from a loop of its edges above the wrist, and a square grid at the end.

The hand's own vertices and quads short of that loop stay as they are. Build frame, mm.
"""

from __future__ import annotations

import numpy as np

from ...backend.geometry.mesh_tables import open_half_edges
from ...backend.records.errors import LiveHandError
from ...backend.teacher.forearm import ARM_FROM_MM, FOREARM_MM
from ...backend.teacher.loop import neighbour_mean
from ...backend.teacher.meshes import QuadMesh
from ...backend.teacher.projection import project_to_surface
from ...backend.teacher.rays import Ray

_LOOP_MM = 22.0  # beyond the wrist
_RINGS = 22
_LAST_RING_MM = 13.0  # short of the end
_LAST_RADIUS_MM = 30.0
_RELAXATIONS = 40


def forearm_quads(rays: dict[str, Ray], hand: QuadMesh) -> QuadMesh:
    """Grow a forearm of `FOREARM_MM` on the hand, on its surface.

    Raises:
        LiveHandError: the quads have no loop around the wrist that a square grid can end.
    """
    kept = hand.quads[hand.vertices[hand.quads, 0].mean(1) < _LOOP_MM]
    used, corners = np.unique(kept, return_inverse=True)
    kept, vertices = corners.reshape(-1, 4), hand.vertices[used]
    loop = _border(kept)
    if len(loop) % 4:
        raise LiveHandError(f"the loop at the wrist must have a multiple of 4 edges, got {len(loop)}; remesh the hand")
    grown = _ring_positions(vertices[loop])
    end = _end_positions(grown[-1])
    rings = np.vstack([loop, len(vertices) + np.arange(_RINGS * len(loop)).reshape(_RINGS, -1)])
    grid = _end_grid(rings[-1], len(vertices) + grown.shape[0] * grown.shape[1])
    quads = np.concatenate([kept, _quads_between(rings), _quads_of_grid(grid)])
    together = np.concatenate([vertices, grown.reshape(-1, 3), end])
    return QuadMesh(_relaxed(rays, together, quads, len(vertices)), quads)


def _border(quads: np.ndarray) -> np.ndarray:
    """List the vertices around the only opening of the quads, in the direction of their winding."""
    after = dict(open_half_edges(np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])).tolist())
    loop = [min(after)]
    while len(loop) < len(after):
        loop.append(after[loop[-1]])
    if len(set(loop)) < len(loop):
        raise LiveHandError("the quads at the wrist must end in one loop; remesh the hand")
    return np.array(loop)


def _ring_positions(loop: np.ndarray) -> np.ndarray:
    """Place rings [rings, L, 3] from the loop [L, 3] to an even circle at the end."""
    angle = np.unwrap(np.arctan2(loop[:, 2], loop[:, 1]))
    even = angle.mean() + (np.arange(len(loop)) - (len(loop) - 1) / 2) * 2 * np.pi / len(loop) * np.sign(np.ptp(angle))
    even = even if angle[-1] > angle[0] else even[::-1]
    across = _LAST_RADIUS_MM * np.stack([np.cos(even), np.sin(even)], 1)
    last = np.column_stack([np.full(len(loop), FOREARM_MM - _LAST_RING_MM), across])
    share = np.arange(1, _RINGS + 1)[:, None, None] / _RINGS
    return loop + share * (last - loop)


def _end_positions(ring: np.ndarray) -> np.ndarray:
    """Fill the ring with a square grid of n x n faces, [(n - 1)^2, 3], by Coons' patch."""
    n = len(ring) // 4
    grid = _border_of_grid(ring)
    u, v = (np.arange(n + 1) / n)[:, None, None], (np.arange(n + 1) / n)[None, :, None]
    between = (1 - u) * grid[:1] + u * grid[-1:] + (1 - v) * grid[:, :1] + v * grid[:, -1:]
    bilinear = (1 - u) * ((1 - v) * grid[0, 0] + v * grid[0, -1]) + u * ((1 - v) * grid[-1, 0] + v * grid[-1, -1])
    patch = between - bilinear
    patch[..., 0] = FOREARM_MM
    return patch[1:-1, 1:-1].reshape(-1, 3)


def _border_of_grid(ring: np.ndarray) -> np.ndarray:
    """Lay the 4 n entries of the ring around the border of [n + 1, n + 1, ...], with zeros inside."""
    n = len(ring) // 4
    grid = np.zeros((n + 1, n + 1, *ring.shape[1:]), ring.dtype)
    sides = ring.reshape(4, n, *ring.shape[1:])
    grid[0, :n], grid[:n, n], grid[n, :0:-1], grid[:0:-1, 0] = sides
    return grid


def _end_grid(ring: np.ndarray, first: int) -> np.ndarray:
    """Return [n + 1, n + 1] vertex indices of the end: the ring around new ones from `first`."""
    grid = _border_of_grid(ring)
    inner = len(grid) - 2
    grid[1:-1, 1:-1] = first + np.arange(inner * inner).reshape(inner, inner)
    return grid


def _quads_between(rings: np.ndarray) -> np.ndarray:
    here, there = rings[:-1], rings[1:]
    corners = (np.roll(here, -1, 1), here, there, np.roll(there, -1, 1))
    return np.stack(corners, -1).reshape(-1, 4)


def _quads_of_grid(grid: np.ndarray) -> np.ndarray:
    corners = (grid[:-1, 1:], grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:])
    return np.stack(corners, -1).reshape(-1, 4)


def _relaxed(rays: dict[str, Ray], vertices: np.ndarray, quads: np.ndarray, own: int) -> np.ndarray:
    """Space vertices evenly on the surface, those after the hand's `own` ones."""
    around = np.vstack([quads[:, corners] for corners in ([0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3])])
    mean, of_arm = neighbour_mean(around, len(vertices)), np.flatnonzero(vertices[:, 0] > ARM_FROM_MM)

    def onto_surface(steps: int) -> None:
        vertices[of_arm] = project_to_surface(
            rays, vertices[of_arm], with_details=False, steps=steps, forearm_mm=FOREARM_MM
        )

    for _ in range(_RELAXATIONS):
        onto_surface(1)
        vertices[own:] = (0.5 * vertices + 0.5 * (mean @ vertices))[own:]
    onto_surface(4)
    return vertices
