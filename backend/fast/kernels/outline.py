"""Equals `nerf.fine_mesh.seen_surface`: the nearest faces of a mesh of many small ones, and what pixels show of it."""

from __future__ import annotations

import numpy as np

from ...geometry.tolerances import MIN_AREA_PX2
from .compiled import compiled
from .compiled import compiled_part as part
from .raster import covered_centres, fragment_depth, projected_area

_0, _HALF, _1, _INF, _MIN_AREA = (np.float32(value) for value in (0, 0.5, 1, np.inf, MIN_AREA_PX2))
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
def mark_parts(nearest, face_at, width, height, step_m, step_per_m, first_row, last_row, marks):
    """Fill rows [first_row, last_row) of `marks` (`PartMarks`)."""
    for y in range(first_row, last_row):
        for x in range(width):
            at, low, high, other = y * width + x, _INF, _0, -1
            own = marks.bone_of_face[face_at[at]] if face_at[at] >= 0 else -1
            for below in range(max(y - 1, 0), min(y + 2, height)):
                for right in range(max(x - 1, 0), min(x + 2, width)):
                    near = below * width + right
                    low = min(low, nearest[near])
                    high = max(high, nearest[near] if nearest[near] < _INF else _0)
                    if other < 0 and own >= 0 and face_at[near] >= 0:
                        bone = marks.bone_of_face[face_at[near]]
                        other = bone if marks.apart[own, bone] else -1
            marks.between[at] = _HALF * (low + high) if high - low > step_m + step_per_m * low else _0
            marks.part[at] = min(own, other) if other >= 0 else -1


@compiled
def sample_faces(mesh, rows, samples, width, first_row, last_row, on_outline, bits, at_edges):
    """Look for front faces at the samples of pixels in rows [first_row, last_row).

    Of outline pixels, set a bit for every sample in a face; of those in `at_edges` (`EdgeSamples`), note the nearest.
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
                slot = at_edges.slot[at]
                if not on_outline[at] and slot < 0:
                    continue
                found = np.uint16(0)
                for k in range(_BITS):
                    px, py = np.float32(x) + samples[k, 0], np.float32(y) + samples[k, 1]
                    wa = (cx - bx) * (py - by) - (cy - by) * (px - bx)
                    wb = (ax - cx) * (py - cy) - (ay - cy) * (px - cx)
                    wc = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
                    if (wa <= _0) & (wb <= _0) & (wc <= _0):  # front faces are clockwise on screen
                        found |= np.uint16(1 << k)
                        if slot >= 0:
                            z = (wa + wb + wc) / (wa / depth[a] + wb / depth[b] + wc / depth[c])
                            if z < at_edges.depth[slot, k]:
                                at_edges.depth[slot, k], at_edges.face[slot, k] = z, face
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


@part
def _is_first(depth, face, between, bone, marks):
    """Whether a fragment is of the first part, as `nerf.part_edges` has it."""
    if between > _0:
        return depth < between
    return face >= 0 and not marks.apart[marks.bone_of_face[face], bone]


@compiled
def edge_shares(pixel, seen, marks, samples, taps, first, last, share, shows_first):
    """Fill of slots [first, last) what `nerf.part_edges.PartEdges` tells.

    `seen` is the first front faces' depth and index at pixels' centres, and the image's width and height.
    """
    nearest, face_at, width, height = seen
    for slot in range(first, last):
        at = pixel[slot]
        y, x, between, bone = at // width, at % width, marks.between[at], marks.part[at]
        total, weights = _0, _0
        for row in range(3):
            below = min(max(y + row - 1, 0), height - 1) * width
            for column in range(3):
                near = below + min(max(x + column - 1, 0), width - 1)
                is_first = _is_first(nearest[near], face_at[near], between, bone, marks)
                shows_first[3 * row + column, slot] = is_first
                if not (nearest[near] < _INF or (row == 1 and column == 1)):
                    continue
                shown, of_near = np.float32(is_first), samples.slot[near]
                if of_near >= 0:
                    ours, all_ = _0, _0
                    for k in range(_BITS):
                        depth, face = samples.depth[of_near, k], samples.face[of_near, k]
                        if depth < _INF:
                            all_ += _1
                            ours += np.float32(_is_first(depth, face, between, bone, marks))
                    shown = ours / max(all_, _1)
                weight = taps[row] * taps[column]
                total += weight * shown
                weights += weight
        share[slot] = total / weights
