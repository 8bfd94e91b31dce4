"""Equals `geometry.rasterise`: a mesh's layers per pixel, sorted by depth, and its nearest ones."""

from __future__ import annotations

import numpy as np

from ...geometry.tolerances import MIN_AREA_PX2, NEAR_M
from .compiled import compiled

_HALF, _0, _1, _NEAR_M, _MIN_AREA = (np.float32(value) for value in (0.5, 0, 1, NEAR_M, MIN_AREA_PX2))


@compiled
def find_crossings(mesh, width, first_row, last_row, crossings):
    """Insert the fragments in rows [first_row, last_row) into their pixels' lists, nearest first, and drop excess ones.

    `mesh` is a `ProjectedMesh`; `crossings.counts` is zero at the start.
    """
    positions_px, depth, faces, count = mesh.positions_px, mesh.depth, mesh.faces, crossings.counts
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        area = projected_area(positions_px, depth, a, b, c)
        if abs(area) <= _MIN_AREA:
            continue
        x0, x1, y0, y1 = covered_centres(positions_px, a, b, c, width, first_row, last_row)
        mark = face if area < _0 else -1 - face
        for y in range(y0, y1):
            for x in range(x0, x1):
                z = fragment_depth(positions_px, depth, a, b, c, area, x, y)
                if z > _0:
                    count[y * width + x] = _insert(
                        crossings.depth, crossings.face, y * width + x, count[y * width + x], z, mark
                    )


@compiled
def nearest_depth(mesh, width, first_row, last_row, has_backs, nearest):
    """Lower `nearest` [P], m, to the first front (`has_backs`: any) face in rows [first_row, last_row)."""
    positions_px, depth, faces = mesh.positions_px, mesh.depth, mesh.faces
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        area = projected_area(positions_px, depth, a, b, c)
        if abs(area) <= _MIN_AREA or (area > _0 and not has_backs):
            continue
        x0, x1, y0, y1 = covered_centres(positions_px, a, b, c, width, first_row, last_row)
        for y in range(y0, y1):
            for x in range(x0, x1):
                z = fragment_depth(positions_px, depth, a, b, c, area, x, y)
                if z > _0:
                    nearest[y * width + x] = min(nearest[y * width + x], z)


@compiled
def nearest_sides(projected, faces, size, fronts, backs):
    """Lower `fronts` and `backs` [P] to the first front and the first back face in an image of size x size.

    Args:
        projected: [3, V] x and y, px, and depth, m.
        faces: [F, 3].
        size: of the image, px.
        fronts: [P] depth, m.
        backs: [P]; may be the same.
    """
    for face in range(faces.shape[0]):
        a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
        ax, bx, cx = projected[0, a], projected[0, b], projected[0, c]
        ay, by, cy = projected[1, a], projected[1, b], projected[1, c]
        x0, x1 = _centres(min(ax, bx, cx), max(ax, bx, cx), 0, size)
        y0, y1 = _centres(min(ay, by, cy), max(ay, by, cy), 0, size)
        if (x0 >= x1) | (y0 >= y1):
            continue
        # From corner a; the weights of b and c, and 1 / depth, are linear on screen.
        bx, by, cx, cy = bx - ax, by - ay, cx - ax, cy - ay
        area = bx * cy - by * cx
        za, zb, zc = projected[2, a], projected[2, b], projected[2, c]
        if (abs(area) <= _MIN_AREA) | (min(za, zb, zc) <= _NEAR_M):
            continue
        nearest = fronts if area < _0 else backs
        inverse, near, left = _1 / area, _1 / za, np.float32(x0) + _HALF - ax
        to_b, to_c = (_1 / zb - near) * inverse, (_1 / zc - near) * inverse
        along_x, along_y = cy * to_b - by * to_c, bx * to_c - cx * to_b
        for y in range(y0, y1):
            py, row = np.float32(y) + _HALF - ay, np.uintp(y * size + x0)
            for x in range(np.uintp(x1 - x0)):
                px = np.float32(np.int32(x)) + left
                wb, wc = (px * cy - py * cx) * inverse, (py * bx - px * by) * inverse
                z = _1 / (near + px * along_x + py * along_y)
                is_covered = (wb >= _0) & (wc >= _0) & (wb + wc <= _1)
                nearest[row + x] = min(nearest[row + x], z if is_covered else np.float32(np.inf))


@compiled
def projected_area(positions_px, depth, a, b, c):
    """Twice the signed area of a projected face, px^2; 0 where it is not drawn."""
    if min(depth[a], depth[b], depth[c]) <= _NEAR_M:
        return _0
    abx, aby = positions_px[b, 0] - positions_px[a, 0], positions_px[b, 1] - positions_px[a, 1]
    acx, acy = positions_px[c, 0] - positions_px[a, 0], positions_px[c, 1] - positions_px[a, 1]
    return abx * acy - aby * acx


@compiled
def covered_centres(positions_px, a, b, c, width, first_row, last_row):
    """Columns [x0, x1) and rows [y0, y1) of the pixel centres in a face's bounding box."""
    ax, bx, cx = positions_px[a, 0], positions_px[b, 0], positions_px[c, 0]
    ay, by, cy = positions_px[a, 1], positions_px[b, 1], positions_px[c, 1]
    x0, x1 = _centres(min(ax, bx, cx), max(ax, bx, cx), 0, width)
    y0, y1 = _centres(min(ay, by, cy), max(ay, by, cy), first_row, last_row)
    return x0, x1, y0, y1


@compiled
def _centres(low, high, first, last):
    """The pixels in [first, last) whose centres lie in [low, high], as a range."""
    start = max(int(np.ceil(max(low - _HALF, np.float32(first)))), first)
    end = min(int(np.floor(min(high - _HALF, np.float32(last)))) + 1, last)
    return start, end


@compiled
def fragment_depth(positions_px, depth, a, b, c, area, x, y):
    """Depth of a face at a pixel's centre; 0 where it does not cover it. 1/z is linear on screen."""
    px, py = np.float32(x) + _HALF, np.float32(y) + _HALF
    ax, ay = positions_px[a, 0], positions_px[a, 1]
    bx, by = positions_px[b, 0], positions_px[b, 1]
    cx, cy = positions_px[c, 0], positions_px[c, 1]
    w0 = ((cx - bx) * (py - by) - (cy - by) * (px - bx)) / area
    w1 = ((ax - cx) * (py - cy) - (ay - cy) * (px - cx)) / area
    w2 = ((bx - ax) * (py - ay) - (by - ay) * (px - ax)) / area
    if w0 < _0 or w1 < _0 or w2 < _0:
        return _0
    return _1 / (w0 / depth[a] + w1 / depth[b] + w2 / depth[c])


@compiled
def _insert(depths, marks, pixel, count, depth, mark):
    """Put a fragment in its place in a pixel's sorted list; returns the list's new length."""
    if count == depths.shape[1]:
        count -= 1
        if depth >= depths[pixel, count]:
            return count + 1
    slot = count
    while slot > 0 and depths[pixel, slot - 1] > depth:
        depths[pixel, slot], marks[pixel, slot] = depths[pixel, slot - 1], marks[pixel, slot - 1]
        slot -= 1
    depths[pixel, slot], marks[pixel, slot] = depth, mark
    return count + 1
