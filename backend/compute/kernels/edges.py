"""Edges: which pixels show two parts, their blend, and means that cross no edge.

As `surface.detail_mesh`, `surface.edge_antialiasing.blended` and `image.edge_avoiding_filter`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .compiled import compiled, compiled_loosely
from .compiled import compiled_part as part
from .compiled import compiled_part_loosely as loose_part
from .series import gaussian

_0, _HALF, _1, _INF = (np.float32(value) for value in (0, 0.5, 1, np.inf))
_BITS = 16
_NO_BONE, _MOST_BONE = np.int8(-1), np.int8(127)


class EdgeMask(NamedTuple):
    """Which of P pixels show two parts of a surface of M faces (`surface.edge_antialiasing`).

    Attributes:
        between: [P] a depth between both parts, m; 0: depths separate none.
        part: [P] a bone of one of two parts; -1: bones separate none.
        bone_of_face: [M].
        apart: [B, B] whether two bones are of two parts.
    """

    between: np.ndarray
    part: np.ndarray
    bone_of_face: np.ndarray
    apart: np.ndarray


class EdgeSamples(NamedTuple):
    """What samples of the S pixels of P that show two parts show.

    Attributes:
        slot: [P] of each pixel among the S; -1 for none.
        depth: [S, 16] m; infinite beside the surface.
        face: [S, 16] -1 beside it.
    """

    slot: np.ndarray
    depth: np.ndarray
    face: np.ndarray


class RaysOnSurface(NamedTuple):
    """Where R rays meet a surface, in an image of P pixels.

    Attributes:
        pixel: [R] of each ray.
        row: [P] which ray a pixel has, -1 for none.
        width: of the image, px.
        position: [R, 3] m.
        normal: [R, 3].
        off_plane_m: at which distance from the tangent plane rays are of another surface.
    """

    pixel: np.ndarray
    row: np.ndarray
    width: int
    position: np.ndarray
    normal: np.ndarray
    off_plane_m: np.float32


@compiled
def mark_outline(face_at, width, height, first_row, last_row, on_outline):
    """Mark the pixels in rows [first_row, last_row) around which some centres see the mesh and others do not."""
    some, all_ = np.empty(width + 2, np.uint8), np.empty(width + 2, np.uint8)
    for y in range(first_row, last_row):
        above, here, below = _rows_around(y, width, height)
        for x in range(width):
            a, b, c = face_at[above + x] >= 0, face_at[here + x] >= 0, face_at[below + x] >= 0
            some[x + 1], all_[x + 1] = a | b | c, a & b & c
        _repeat_ends(some)
        _repeat_ends(all_)
        for x in range(width):
            is_some = some[x] | some[x + 1] | some[x + 2]
            on_outline[here + x] = is_some != (all_[x] & all_[x + 1] & all_[x + 2])


@compiled
def find_part_edges(nearest, face_at, width, height, step_m, step_per_m, first_row, last_row, marks):
    """Fill rows [first_row, last_row) of `marks` (`EdgeMask`)."""
    low, high = np.empty(width + 2, np.float32), np.empty(width + 2, np.float32)
    bones = np.empty((3, width + 2), np.int8)
    least, most = np.empty(width + 2, np.int8), np.empty(width + 2, np.int8)
    for y in range(first_row, last_row):
        above, here, below = _rows_around(y, width, height)
        for x in range(width):
            a, b, c = nearest[above + x], nearest[here + x], nearest[below + x]
            low[x + 1] = min(a, b, c)
            high[x + 1] = max(a if a < _INF else _0, b if b < _INF else _0, c if c < _INF else _0)
        _repeat_ends(low)
        _repeat_ends(high)
        for x in range(width):
            near, far = min(low[x], low[x + 1], low[x + 2]), max(high[x], high[x + 1], high[x + 2])
            is_step = far - near > step_m + step_per_m * near
            marks.between[here + x] = _HALF * (near + far) if is_step else _0
        for row, start in enumerate((above, here, below)):
            for x in range(width):
                face = face_at[start + x]
                bones[row, x + 1] = marks.bone_of_face[face] if face >= 0 else _NO_BONE
            _repeat_ends(bones[row])
        for x in range(width + 2):
            a, b, c = bones[0, x], bones[1, x], bones[2, x]
            most[x] = max(a, b, c)
            least[x] = min(a if a >= 0 else _MOST_BONE, b if b >= 0 else _MOST_BONE, c if c >= 0 else _MOST_BONE)
        for x in range(width):
            own, marks.part[here + x] = bones[1, x + 1], _NO_BONE
            if own < 0 or (min(least[x], least[x + 1], least[x + 2]) == max(most[x], most[x + 1], most[x + 2])):
                continue
            other = _first_apart(bones, x, own, marks.apart)
            if other >= 0:
                marks.part[here + x] = min(own, other)


@part
def _first_apart(bones, x, own, apart):
    """Find the first bone, row by row, that is apart from a pixel's own among the nine around it; -1: none is."""
    for row in range(3):
        for column in range(x, x + 3):
            bone = bones[row, column]
            if bone >= 0 and apart[own, bone]:
                return bone
    return _NO_BONE


@part
def _rows_around(y, width, height):
    """Find where the rows of pixels above, at and below y begin; the image's rim stands for what lies beyond it."""
    return max(y - 1, 0) * width, y * width, min(y + 1, height - 1) * width


@part
def _repeat_ends(row):
    """Repeat the rim of a row for what lies beyond it, too."""
    last = len(row) - 1
    row[0], row[last] = row[1], row[last - 1]


@compiled
def sample_faces(mesh, rows, samples, width, first_row, last_row, on_outline, bits, at_edges):
    """Look for front faces at the `samples` [2, 16] of pixels in rows [first_row, last_row).

    Of outline pixels, set a bit for every sample in a face; of those in `at_edges` (`EdgeSamples`), note the nearest.
    """
    positions_px, faces, depth = mesh.positions_px, mesh.faces, mesh.depth
    for face in range(faces.shape[0]):
        if rows[face, 1] <= first_row or rows[face, 0] >= last_row:
            continue
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, bx, cx = positions_px[a, 0], positions_px[b, 0], positions_px[c, 0]
        ay, by, cy = positions_px[a, 1], positions_px[b, 1], positions_px[c, 1]
        corners = ax, ay, bx, by, cx, cy
        x0, x1 = max(int(np.floor(min(ax, bx, cx))), 0), min(int(np.floor(max(ax, bx, cx))) + 1, width)
        for y in range(max(rows[face, 0], first_row), min(rows[face, 1], last_row)):
            for x in range(x0, x1):
                at = y * width + x
                slot = at_edges.slot[at]
                if not on_outline[at] and slot < 0:
                    continue
                found = np.uint32(0)
                for k in range(np.uintp(samples.shape[1])):  # a number that is not known, or it is no vector loop
                    wa, wb, wc = _edges(corners, np.float32(x) + samples[0, k], np.float32(y) + samples[1, k])
                    is_inside = (wa <= _0) & (wb <= _0) & (wc <= _0)  # front faces are clockwise on screen
                    found |= np.uint32(is_inside) << np.uint32(k)
                if found != 0 and slot >= 0:
                    depths = depth[a], depth[b], depth[c], mesh.is_orthographic
                    _note_nearest(found, slot, face, corners, depths, x, y, samples, at_edges)
                bits[at] |= np.uint16(found)


@part
def _edges(corners, px, py):
    """Compute twice the signed areas, px^2, of a point and the sides of a face, opposite its corners a, b and c."""
    ax, ay, bx, by, cx, cy = corners
    wa = (cx - bx) * (py - by) - (cy - by) * (px - bx)
    wb = (ax - cx) * (py - cy) - (ay - cy) * (px - cx)
    wc = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    return wa, wb, wc


@part
def _note_nearest(found, slot, face, corners, depths, x, y, samples, at_edges):
    """Note a face at the samples at which a pixel found it, where nothing nearer was.

    `depths` are its corners', and whether they are linear on screen.
    """
    for k in range(_BITS):
        if (found >> np.uint32(k)) & np.uint32(1):
            wa, wb, wc = _edges(corners, np.float32(x) + samples[0, k], np.float32(y) + samples[1, k])
            if depths[3]:
                z = (wa * depths[0] + wb * depths[1] + wc * depths[2]) / (wa + wb + wc)
            else:
                z = (wa + wb + wc) / (wa / depths[0] + wb / depths[1] + wc / depths[2])
            if z < at_edges.depth[slot, k]:
                at_edges.depth[slot, k], at_edges.face[slot, k] = z, face


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
    """Fill rows [first_row, last_row) of the squares' coverage, spread as `surface.detail_mesh.spread` does."""
    near = np.empty(width + 2, np.bool_)
    for y in range(first_row, last_row):
        above, here, below = _rows_around(y, width, height)
        for x in range(width):
            near[x + 1] = on_outline[above + x] | on_outline[here + x] | on_outline[below + x]
            coverage[here + x] = covered[here + x]
        _repeat_ends(near)
        for x in range(width):
            if not (near[x] | near[x + 1] | near[x + 2]):
                continue
            total = _0
            for row, start in enumerate((above, here, below)):
                for column in range(3):
                    total += taps[row] * taps[column] * covered[start + min(max(x + column - 1, 0), width - 1)]
            coverage[here + x] = total


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
    """Return whether a fragment is of the first part, as `surface.edge_antialiasing` has it."""
    if between > _0:
        return depth < between
    return face >= 0 and not marks.apart[marks.bone_of_face[face], bone]


@compiled
def edge_shares(pixel, seen, marks, samples, taps, first, last, share, shows_first):
    """Fill `surface.edge_antialiasing.EdgePixels` for slots [first, last).

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


_RGB, _ITSELF = 3, 4


@compiled_loosely
def blend_parts(colours, alpha, depth, width, edges, least_alpha, first, last, out):
    """Fill out [S, 3] for slots [first, last) of `edges`: pixel [S], shows_first [9, S] and share [S].

    Colours [P, 3], alpha [P] and depth [P] are the image's.
    """
    pixel, shows_first, share = edges
    height = len(depth) // width
    total, count = np.empty((2, _RGB), np.float32), np.empty(2, np.float32)  # of the first part and of the other
    for slot in range(first, last):
        here = pixel[slot]
        y, x = here // width, here % width
        total[:], count[:] = _0, _0
        for row in range(3):
            for column in range(3):
                at = min(max(y + row - 1, 0), height - 1) * width + min(max(x + column - 1, 0), width - 1)
                if depth[at] < _INF and alpha[at] > least_alpha:
                    part = 0 if shows_first[3 * row + column, slot] else 1
                    count[part] += _1
                    for c in range(_RGB):
                        total[part, c] += colours[at, c] / alpha[at]
        has_both = count[0] > _0 and count[1] > _0
        if depth[here] < _INF and alpha[here] > least_alpha:  # of its own part it has its own colour alone
            own = 0 if shows_first[_ITSELF, slot] else 1
            count[own] = _1
            for c in range(_RGB):
                total[own, c] = colours[here, c] / alpha[here]
        for c in range(_RGB):
            out[slot, c] = colours[here, c]
            if has_both:
                of_first, of_other = total[0, c] / count[0], total[1, c] / count[1]
                out[slot, c] = (of_other + share[slot] * (of_first - of_other)) * min(alpha[here], _1)


_AROUND = 9


@compiled_loosely
def mean_over_surface(rays, shares, stride, before, first, last, after):
    """Fill `after` [R, C] for rays [first, last): means of `before` over rays beside them (`RaysOnSurface`)."""
    others, weights = np.empty(_AROUND, np.uintp), np.empty(_AROUND, np.float32)
    for index in range(first, last):
        here = np.uintp(index)
        _weigh_around(here, rays, shares, stride, others, weights)
        _mean_of_rows(before, others, weights, after[here])


@loose_part
def _weigh_around(here, rays, shares, stride, others, weights):
    """Fill the rays [9] around one, itself where there is none, and their weights, which add up to 1."""
    height = len(rays.row) // rays.width
    y, x = rays.pixel[here] // rays.width, rays.pixel[here] % rays.width
    total, slot = _0, np.uintp(0)
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            there_y, there_x = y + stride * dy, x + stride * dx
            is_inside = 0 <= there_y < height and 0 <= there_x < rays.width
            ray = rays.row[there_y * rays.width + there_x] if is_inside else np.int32(-1)
            other, off_m, facing = np.uintp(ray) if ray >= 0 else here, _0, _0
            for k in range(3):
                off_m += (rays.position[other, k] - rays.position[here, k]) * rays.normal[here, k]
                facing += rays.normal[other, k] * rays.normal[here, k]
            off, facing = off_m / rays.off_plane_m, max(facing, _0)
            weight = shares[abs(dy) + abs(dx)]
            if other != here:
                weight *= facing * facing * facing * facing * gaussian(off)
            elif dy != 0 or dx != 0:
                weight = _0
            others[slot], weights[slot] = other, weight
            total += weight
            slot += np.uintp(1)
    inverse = _1 / total
    for k in range(_AROUND):
        weights[k] *= inverse


@loose_part
def _mean_of_rows(rows, which, weights, out):
    """Fill out [C] with the weighted sum of nine rows."""
    a, b, c, d, e, f, g, h, i = which[0], which[1], which[2], which[3], which[4], which[5], which[6], which[7], which[8]
    wa, wb, wc, wd, we = weights[0], weights[1], weights[2], weights[3], weights[4]
    wf, wg, wh, wi = weights[5], weights[6], weights[7], weights[8]
    for k in range(np.uintp(len(out))):
        upper = wa * rows[a, k] + wb * rows[b, k] + wc * rows[c, k]
        middle = wd * rows[d, k] + we * rows[e, k] + wf * rows[f, k]
        out[k] = upper + middle + wg * rows[g, k] + wh * rows[h, k] + wi * rows[i, k]
