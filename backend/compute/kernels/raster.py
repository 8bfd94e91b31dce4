"""Meshes before a camera: as `field.rays.project`, and as `geometry.rasterise` their layers and nearest faces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...geometry.tolerances import MIN_AREA_PX2, NEAR_M
from .compiled import compiled
from .compiled import compiled_part as part

_HALF, _0, _1, _NEAR_M, _MIN_AREA = (np.float32(value) for value in (0.5, 0, 1, NEAR_M, MIN_AREA_PX2))


class ProjectedMesh(NamedTuple):
    """A mesh before a camera.

    Attributes:
        positions_px: [V, 2].
        depth: [V] m.
        faces: [F, 3].
        is_orthographic: whether the depth of a face is linear on screen, as its inverse is before a pinhole.
    """

    positions_px: np.ndarray
    depth: np.ndarray
    faces: np.ndarray
    is_orthographic: bool = False


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
                z = fragment_depth(mesh, a, b, c, area, x, y)
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
                z = fragment_depth(mesh, a, b, c, area, x, y)
                if z > _0:
                    nearest[y * width + x] = min(nearest[y * width + x], z)


@part
def nearest_sides(projected, faces, size, cells, fronts, backs):
    """Lower `fronts` and `backs` [P] to the first front and the first back face in an image of size x size.

    Args:
        projected: [3, V] x and y, px, and depth, m.
        faces: [F, 3].
        size: of the image, px.
        cells: [4, V] buffer.
        fronts: [P] depth, m.
        backs: [P]; may be the same.
    """
    _fill_cells(projected, size, cells)
    for face in range(faces.shape[0]):
        a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
        x0, x1 = min(cells[0, a], cells[0, b], cells[0, c]), max(cells[1, a], cells[1, b], cells[1, c])
        y0, y1 = min(cells[2, a], cells[2, b], cells[2, c]), max(cells[3, a], cells[3, b], cells[3, c])
        if (x0 >= x1) | (y0 >= y1):
            continue
        # From corner a; the weights of b and c, and 1 / depth, are linear on screen.
        ax, ay = projected[0, a], projected[1, a]
        bx, by, cx, cy = projected[0, b] - ax, projected[1, b] - ay, projected[0, c] - ax, projected[1, c] - ay
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


@part
def _fill_cells(projected, size, cells):
    """Fill, of every vertex: the first column whose centres lie behind it, one after the last before it, and its rows.

    The least first and the largest last of a face's corners are the pixels in its bounding box.
    """
    most = np.float32(size)
    for vertex in range(np.uintp(projected.shape[1])):
        x, y = projected[0, vertex] - _HALF, projected[1, vertex] - _HALF
        x, y = min(max(x, -_1), most), min(max(y, -_1), most)
        cells[0, vertex], cells[1, vertex] = max(np.int32(np.ceil(x)), 0), min(np.int32(np.floor(x)) + 1, size)
        cells[2, vertex], cells[3, vertex] = max(np.int32(np.ceil(y)), 0), min(np.int32(np.floor(y)) + 1, size)


@compiled
def front_rows(mesh, width, height, first, last, rows):
    """Fill, of faces [first, last), the rows of pixels [0] to [1] that each touches; none of faces not to be drawn."""
    positions_px, depth, faces = mesh.positions_px, mesh.depth, mesh.faces
    for face in range(first, last):
        rows[face, 0], rows[face, 1] = 0, 0
        a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
        if projected_area(positions_px, depth, a, b, c) >= -_MIN_AREA:
            continue
        ax, bx, cx = positions_px[a, 0], positions_px[b, 0], positions_px[c, 0]
        ay, by, cy = positions_px[a, 1], positions_px[b, 1], positions_px[c, 1]
        if max(ax, bx, cx) < _0 or min(ax, bx, cx) > np.float32(width):
            continue
        if max(ay, by, cy) < _0 or min(ay, by, cy) > np.float32(height):
            continue
        rows[face, 0] = max(int(np.floor(min(ay, by, cy))), 0)
        rows[face, 1] = min(int(np.floor(max(ay, by, cy))) + 1, height)


@compiled
def nearest_of_rows(mesh, rows, width, first_row, last_row, nearest, face_at):
    """Lower `nearest` [P], m, to the first front face in rows [first_row, last_row), and note the face in `face_at`.

    `rows` as `front_rows` fills them.
    """
    positions_px, depth, faces = mesh.positions_px, mesh.depth, mesh.faces
    for face in range(faces.shape[0]):
        if rows[face, 1] <= first_row or rows[face, 0] >= last_row:
            continue
        a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
        x0, x1, y0, y1 = covered_centres(positions_px, a, b, c, width, first_row, last_row)
        if (x0 >= x1) | (y0 >= y1):
            continue
        area = projected_area(positions_px, depth, a, b, c)
        for y in range(y0, y1):
            for x in range(x0, x1):
                z = fragment_depth(mesh, a, b, c, area, x, y)
                if z > _0 and z < nearest[y * width + x]:
                    nearest[y * width + x], face_at[y * width + x] = z, face


@part
def projected_area(positions_px, depth, a, b, c):
    """Compute twice the signed area of a projected face, px^2; 0 where it is not drawn."""
    if min(depth[a], depth[b], depth[c]) <= _NEAR_M:
        return _0
    abx, aby = positions_px[b, 0] - positions_px[a, 0], positions_px[b, 1] - positions_px[a, 1]
    acx, acy = positions_px[c, 0] - positions_px[a, 0], positions_px[c, 1] - positions_px[a, 1]
    return abx * acy - aby * acx


@part
def covered_centres(positions_px, a, b, c, width, first_row, last_row):
    """Find columns [x0, x1) and rows [y0, y1) of the pixel centres in a face's bounding box."""
    ax, bx, cx = positions_px[a, 0], positions_px[b, 0], positions_px[c, 0]
    ay, by, cy = positions_px[a, 1], positions_px[b, 1], positions_px[c, 1]
    x0, x1 = _centres(min(ax, bx, cx), max(ax, bx, cx), 0, width)
    y0, y1 = _centres(min(ay, by, cy), max(ay, by, cy), first_row, last_row)
    return x0, x1, y0, y1


@part
def _centres(low, high, first, last):
    """Find the pixels in [first, last) whose centres lie in [low, high], as a range."""
    start = max(int(np.ceil(max(low - _HALF, np.float32(first)))), first)
    end = min(int(np.floor(min(high - _HALF, np.float32(last)))) + 1, last)
    return start, end


@part
def fragment_depth(mesh, a, b, c, area, x, y):
    """Compute the depth of a face at a pixel's centre; 0 where it does not cover it."""
    positions_px, depth = mesh.positions_px, mesh.depth
    px, py = np.float32(x) + _HALF, np.float32(y) + _HALF
    ax, ay = positions_px[a, 0], positions_px[a, 1]
    bx, by = positions_px[b, 0], positions_px[b, 1]
    cx, cy = positions_px[c, 0], positions_px[c, 1]
    w0 = ((cx - bx) * (py - by) - (cy - by) * (px - bx)) / area
    w1 = ((ax - cx) * (py - cy) - (ay - cy) * (px - cx)) / area
    w2 = ((bx - ax) * (py - ay) - (by - ay) * (px - ax)) / area
    if w0 < _0 or w1 < _0 or w2 < _0:
        return _0
    if mesh.is_orthographic:
        return w0 * depth[a] + w1 * depth[b] + w2 * depth[c]
    return _1 / (w0 / depth[a] + w1 / depth[b] + w2 / depth[c])


@part
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


@compiled
def project_vertices(vertices, K, world2cam, is_orthographic, first, last, positions_px, depth):
    """Fill positions_px [V, 2] and depth [V], m, of vertices [first, last) before a camera, in double precision."""
    k, to_camera = K.astype(np.float64), world2cam.astype(np.float64)
    for index in range(first, last):
        row = np.uintp(index)
        x, y, z = np.float64(vertices[row, 0]), np.float64(vertices[row, 1]), np.float64(vertices[row, 2])
        right = to_camera[0, 0] * x + to_camera[0, 1] * y + to_camera[0, 2] * z + to_camera[0, 3]
        down = to_camera[1, 0] * x + to_camera[1, 1] * y + to_camera[1, 2] * z + to_camera[1, 3]
        ahead = to_camera[2, 0] * x + to_camera[2, 1] * y + to_camera[2, 2] * z + to_camera[2, 3]
        divisor = 1.0 if is_orthographic else ahead
        scale = k[2, 0] * right + k[2, 1] * down + k[2, 2] * divisor
        positions_px[row, 0] = (k[0, 0] * right + k[0, 1] * down + k[0, 2] * divisor) / scale
        positions_px[row, 1] = (k[1, 0] * right + k[1, 1] * down + k[1, 2] * divisor) / scale
        depth[row] = ahead
