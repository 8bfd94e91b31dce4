"""Points spread evenly over a mesh (Poisson discs), and what the mesh is there in a pose."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

_CANDIDATES = 6  # for each point
_PACKED = 0.44  # share of the area that discs of half the distance cover, when no candidate fits between


class SpreadPoints(NamedTuple):
    """N points: faces [N], barycentric weights [N, 3], and the least distance between two where they were spread, m."""

    face: np.ndarray
    weights: np.ndarray
    spacing_m: float

    def at(self, corner_values: np.ndarray) -> np.ndarray:
        """Interpolate values [M, 3, C] at faces' corners: [N, C]."""
        return (corner_values[self.face] * self.weights[..., None]).sum(1)


def spread_points(vertices: np.ndarray, faces: np.ndarray, count: int, seed: int = 0) -> SpreadPoints:
    """Spread about `count` points over a mesh [V, 3] m, [M, 3], none closer to another on the same side of it.

    Of random candidates in random order each is taken that no taken one is close to (Luby 1986: in parallel).
    """
    rng = np.random.default_rng(seed)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1) / 2
    spacing_m = float(np.sqrt(4 * _PACKED * area.sum() / (np.pi * count)))
    face = rng.choice(len(faces), _CANDIDATES * count, p=area / area.sum())
    u, v = np.sqrt(rng.random(len(face))), rng.random(len(face))
    weights = np.stack([1 - u, u * (1 - v), u * v], 1)
    candidates = SpreadPoints(face, weights, spacing_m)
    pairs = _close_pairs(candidates.at(corners), spacing_m)
    same_side = (normals[face[pairs[:, 0]]] * normals[face[pairs[:, 1]]]).sum(1) > 0
    taken = _first_of_neighbours(len(face), pairs[same_side])
    return SpreadPoints(face[taken], weights[taken], spacing_m)


def _close_pairs(points: np.ndarray, distance: float) -> np.ndarray:
    """Find all pairs [K, 2] of points [N, 3] that are no farther apart, each once: by cells of that width."""
    cell = np.floor((points - points.min(0)) / distance).astype(np.int64) + 1
    strides = np.array([(cell[:, 1].max() + 2) * (cell[:, 2].max() + 2), cell[:, 2].max() + 2, 1])
    key = cell @ strides
    order = np.argsort(key, kind="stable")
    key, points = key[order], points[order]
    found = []
    for beside in product((-1, 0, 1), repeat=3):
        step = int(np.dot(beside, strides))
        if step < 0:  # that pair is found from the other cell
            continue
        first = np.searchsorted(key, key + step, "left") if step else np.arange(1, len(key) + 1)
        count = np.searchsorted(key, key + step, "right") - first
        one = np.repeat(np.arange(len(key)), count)
        other = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count) + first[one]
        is_close = ((points[one] - points[other]) ** 2).sum(1) <= distance**2
        found.append(np.stack([one[is_close], other[is_close]], 1))
    return order[np.concatenate(found)]


def _first_of_neighbours(count: int, pairs: np.ndarray) -> np.ndarray:
    """Find those of [0, count) that are taken when each, in order, is taken unless a neighbour was."""
    is_open, is_taken = np.ones(count, bool), np.zeros(count, bool)
    while is_open.any():
        is_later = np.zeros(count, bool)
        is_later[pairs.max(1)] = True
        now = is_open & ~is_later
        is_taken |= now
        is_open &= ~now
        beside = now[pairs]
        is_open[pairs[beside[:, 0], 1]] = False
        is_open[pairs[beside[:, 1], 0]] = False
        pairs = pairs[is_open[pairs].all(1)]
    return np.flatnonzero(is_taken)
