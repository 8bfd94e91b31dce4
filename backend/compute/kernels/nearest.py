"""The nearest points of any triangles to points, by a tree of boxes, exact to rounding.

Triangles are sorted along a curve that fills space, and halved again and again: node k has the children 2 k + 1 and
2 k + 2.
Triangle test: Ericson 2004, "Real-Time Collision Detection", section 5.1.5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .compiled import compiled, compiled_part

_LEAF_TRIANGLES = 4
_CURVE_BITS = 10
_MOST_LEVELS = 48
_LEAST = 1e-30  # of squared lengths


class TriangleTree(NamedTuple):
    """F triangles in a tree of M nodes, of which the last L are leaves.

    Attributes:
        boxes: [M, 6] lowest and highest corner of each node's triangles.
        first: [L + 1] of the sorted triangles of each leaf.
        order: [F] their numbers before they were sorted.
        corners: [F, 9] of the sorted triangles.
    """

    boxes: np.ndarray
    first: np.ndarray
    order: np.ndarray
    corners: np.ndarray


def triangle_tree(corners: np.ndarray) -> TriangleTree:
    """Sort triangles [F, 3, 3] into a tree."""
    corners = np.ascontiguousarray(corners, np.float64)
    order = np.argsort(along_curve(corners.mean(1)), kind="stable")
    corners = corners[order]
    leaves = 1 << max(0, int(np.floor(np.log2(max(1, len(corners) / _LEAF_TRIANGLES)))))
    first = np.arange(leaves + 1) * len(corners) // leaves
    low, high = (
        np.minimum.reduceat(corners.min(1), first[:-1], axis=0),
        np.maximum.reduceat(corners.max(1), first[:-1], axis=0),
    )
    levels = [np.concatenate([low, high], 1)]
    while len(levels[0]) > 1:
        left, right = levels[0][::2], levels[0][1::2]
        joined = [np.minimum(left[:, :3], right[:, :3]), np.maximum(left[:, 3:], right[:, 3:])]
        levels.insert(0, np.concatenate(joined, 1))
    return TriangleTree(np.concatenate(levels), first, order, corners.reshape(-1, 9))


def along_curve(points: np.ndarray) -> np.ndarray:
    """Compute the numbers [F] of points [F, 3] along a Morton curve through their box."""
    low = points.min(0)
    size = max(float((points.max(0) - low).max()), 1e-12)
    cell = ((points - low) / size * ((1 << _CURVE_BITS) - 1)).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(_CURVE_BITS):
        for axis in range(3):
            code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


@compiled
def find_nearest(points, tree, face, weights):
    """Fill face [P] and weights [P, 3] of its corners with the triangle nearest to each of points [P, 3]."""
    leaves = len(tree.first) - 1
    waiting = np.empty(_MOST_LEVELS * 2, np.int64)
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        best, found, bv, bw = np.inf, 0, 0.0, 0.0
        waiting[0], count = 0, 1
        while count > 0:
            count -= 1
            node = waiting[count]
            if _box_distance(x, y, z, tree.boxes, node) >= best:
                continue
            if node >= leaves - 1:
                leaf = node - (leaves - 1)
                for triangle in range(tree.first[leaf], tree.first[leaf + 1]):
                    squared, v, w = _closest(x, y, z, tree.corners, triangle)
                    if squared < best:
                        best, found, bv, bw = squared, triangle, v, w
                continue
            left, right = 2 * node + 1, 2 * node + 2
            to_left = _box_distance(x, y, z, tree.boxes, left)
            to_right = _box_distance(x, y, z, tree.boxes, right)
            near, far = (left, right) if to_left <= to_right else (right, left)
            if max(to_left, to_right) < best:
                waiting[count] = far
                count += 1
            if min(to_left, to_right) < best:
                waiting[count] = near
                count += 1
        face[k] = tree.order[found]
        weights[k, 0], weights[k, 1], weights[k, 2] = 1.0 - bv - bw, bv, bw


@compiled_part
def _box_distance(x, y, z, boxes, node):
    """Compute the squared distance from a point to a node's box."""
    dx = max(boxes[node, 0] - x, 0.0, x - boxes[node, 3])
    dy = max(boxes[node, 1] - y, 0.0, y - boxes[node, 4])
    dz = max(boxes[node, 2] - z, 0.0, z - boxes[node, 5])
    return dx * dx + dy * dy + dz * dz


@compiled_part
def _closest(x, y, z, corners, triangle):
    """Compute (distance^2, weight of b, weight of c) of a triangle's point nearest to (x, y, z)."""
    ax, ay, az = corners[triangle, 0], corners[triangle, 1], corners[triangle, 2]
    bx, by, bz = corners[triangle, 3] - ax, corners[triangle, 4] - ay, corners[triangle, 5] - az
    cx, cy, cz = corners[triangle, 6] - ax, corners[triangle, 7] - ay, corners[triangle, 8] - az
    px, py, pz = x - ax, y - ay, z - az
    d1, d2 = bx * px + by * py + bz * pz, cx * px + cy * py + cz * pz
    d00, d11, d01 = bx * bx + by * by + bz * bz, cx * cx + cy * cy + cz * cz, bx * cx + by * cy + bz * cz
    d3, d4, d5, d6 = d1 - d00, d2 - d01, d1 - d01, d2 - d11
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        v, w = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v, w = d1 / max(d00, _LEAST), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        v, w = 0.0, d2 / max(d11, _LEAST)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / max(d4 - d3 + d5 - d6, _LEAST)
        v = 1.0 - w
    else:
        scale = 1.0 / max(va + vb + vc, _LEAST)
        v, w = vb * scale, vc * scale
    dx, dy, dz = px - v * bx - w * cx, py - v * by - w * cy, pz - v * bz - w * cz
    return dx * dx + dy * dy + dz * dz, v, w
