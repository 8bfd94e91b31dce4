"""Equals `nerf.fine_mesh.seen_surface`: the nearest faces of a mesh of many small ones, and what pixels show of it."""

from __future__ import annotations

import numpy as np

from ...geometry.tolerances import MIN_AREA_PX2
from .compiled import compiled
from .raster import covered_centres, fragment_depth, projected_area

_0, _HALF, _INF, _MIN_AREA = np.float32(0), np.float32(0.5), np.float32(np.inf), np.float32(MIN_AREA_PX2)
_BITS = 16


@compiled
def front_rows(mesh, width, height, first, last, rows):
    """Fill, of faces [first, last), the rows of pixels [0] to [1] that each touches; none of faces not to be drawn."""
    positions_px, depth, faces = mesh.positions_px, mesh.depth, mesh.faces
    for face in range(first, last):
        rows[face, 0], rows[face, 1] = 0, 0
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
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
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        area = projected_area(positions_px, depth, a, b, c)
        x0, x1, y0, y1 = covered_centres(positions_px, a, b, c, width, first_row, last_row)
        for y in range(y0, y1):
            for x in range(x0, x1):
                z = fragment_depth(positions_px, depth, a, b, c, area, x, y)
                if z > _0 and z < nearest[y * width + x]:
                    nearest[y * width + x], face_at[y * width + x] = z, face


@compiled
def mark_outline(face_at, width, height, first_row, last_row, on_outline):
    """Mark the pixels in rows [first_row, last_row) around which some centres see the mesh and others do not."""
    for y in range(first_row, last_row):
        for x in range(width):
            own, differs = face_at[y * width + x] >= 0, False
            for below in range(max(y - 1, 0), min(y + 2, height)):
                for right in range(max(x - 1, 0), min(x + 2, width)):
                    differs |= (face_at[below * width + right] >= 0) != own
            on_outline[y * width + x] = differs


@compiled
def mark_steps(nearest, width, height, step_m, step_per_m, first_row, last_row, between):
    """Fill `between` [P] in rows [first_row, last_row): a depth between two parts around a pixel, 0 for one part."""
    for y in range(first_row, last_row):
        for x in range(width):
            low, high = _INF, _0
            for below in range(max(y - 1, 0), min(y + 2, height)):
                for right in range(max(x - 1, 0), min(x + 2, width)):
                    here = nearest[below * width + right]
                    low = min(low, here)
                    high = max(high, here if here < _INF else _0)
            between[y * width + x] = _HALF * (low + high) if high - low > step_m + step_per_m * low else _0


@compiled
def sample_faces(mesh, rows, samples, width, first_row, last_row, on_outline, slot, bits, depths):
    """Look for front faces at the samples of pixels in rows [first_row, last_row).

    Of outline pixels, set a bit for every sample in a face; of pixels with a slot (>= 0), lower the depths [S, 16], m.
    """
    positions_px, faces, depth = mesh.positions_px, mesh.faces, mesh.depth
    for face in range(faces.shape[0]):
        if rows[face, 1] <= first_row or rows[face, 0] >= last_row:
            continue
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, bx, cx = positions_px[a, 0], positions_px[b, 0], positions_px[c, 0]
        ay, by, cy = positions_px[a, 1], positions_px[b, 1], positions_px[c, 1]
        x0, x1 = max(int(np.floor(min(ax, bx, cx))), 0), min(int(np.floor(max(ax, bx, cx))) + 1, width)
        for y in range(max(rows[face, 0], first_row), min(rows[face, 1], last_row)):
            for x in range(x0, x1):
                at = y * width + x
                if not on_outline[at] and slot[at] < 0:
                    continue
                found = np.uint16(0)
                for k in range(_BITS):
                    px, py = np.float32(x) + samples[k, 0], np.float32(y) + samples[k, 1]
                    wa = (cx - bx) * (py - by) - (cy - by) * (px - bx)
                    wb = (ax - cx) * (py - cy) - (ay - cy) * (px - cx)
                    wc = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
                    if (wa <= _0) & (wb <= _0) & (wc <= _0):  # front faces are clockwise on screen
                        found |= np.uint16(1 << k)
                        if slot[at] >= 0:
                            z = (wa + wb + wc) / (wa / depth[a] + wb / depth[b] + wc / depth[c])
                            depths[slot[at], k] = min(depths[slot[at], k], z)
                bits[at] |= found


@compiled
def pixel_squares(face_at, on_outline, bits, first, last, covered):
    """Fill the covered share of the squares of pixels [first, last)."""
    for at in range(first, last):
        if on_outline[at]:
            count, left = 0, bits[at]
            for k in range(_BITS):
                count += (left >> np.uint16(k)) & np.uint16(1)
            covered[at] = np.float32(count) / np.float32(_BITS)
        else:
            covered[at] = np.float32(face_at[at] >= 0)


@compiled
def spread_coverage(covered, on_outline, taps, width, height, first_row, last_row, coverage):
    """Fill rows [first_row, last_row) of the squares' coverage, spread as `nerf.fine_mesh.spread` does."""
    for y in range(first_row, last_row):
        for x in range(width):
            at, is_near = y * width + x, False
            for below in range(max(y - 1, 0), min(y + 2, height)):
                for right in range(max(x - 1, 0), min(x + 2, width)):
                    is_near |= on_outline[below * width + right]
            coverage[at] = covered[at]
            if not is_near:
                continue
            total = _0
            for row in range(3):
                below = min(max(y + row - 1, 0), height - 1) * width
                for column in range(3):
                    total += taps[row] * taps[column] * covered[below + min(max(x + column - 1, 0), width - 1)]
            coverage[at] = total


@compiled
def depth_at_rim(nearest, coverage, width, height, first_row, last_row, depth):
    """Fill rows [first_row, last_row) of the depth; of the nearest beside where only a pixel's centre misses it."""
    for y in range(first_row, last_row):
        for x in range(width):
            at = y * width + x
            depth[at] = nearest[at]
            if nearest[at] < np.inf or coverage[at] <= _0:
                continue
            for below in range(max(y - 1, 0), min(y + 2, height)):
                for right in range(max(x - 1, 0), min(x + 2, width)):
                    depth[at] = min(depth[at], nearest[below * width + right])


@compiled
def nearer_squares(depths, between, first, last, share):
    """Fill the share of samples of slots [first, last) that lie before `between` [S], among those of the surface."""
    for at in range(first, last):
        near, shown = _0, _0
        for k in range(_BITS):
            near += np.float32(depths[at, k] < between[at])
            shown += np.float32(depths[at, k] < _INF)
        share[at] = near / max(shown, np.float32(1))


@compiled
def spread_steps(pixel, between, square, slot, nearest, taps, width, height, first, last, share):
    """Fill the shares of slots [first, last), spread as `nerf.depth_steps` does."""
    for at in range(first, last):
        y, x = pixel[at] // width, pixel[at] % width
        total, weights = _0, _0
        for row in range(3):
            below = min(max(y + row - 1, 0), height - 1) * width
            for column in range(3):
                near = below + min(max(x + column - 1, 0), width - 1)
                if not (nearest[near] < _INF or (row == 1 and column == 1)):
                    continue
                weight = taps[row] * taps[column]
                shown = square[slot[near]] if slot[near] >= 0 else np.float32(nearest[near] < between[at])
                total += weight * shown
                weights += weight
        share[at] = total / weights
