"""Which rays count at pixels by their depth, as `image.shading`, and what follows at steps, as `image.depth_steps`."""

from __future__ import annotations

import numpy as np

from .brdf import TINY
from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part
from .image import neighbours
from .series import gaussian

_0, _1, _INF = (np.float32(value) for value in (0, 1, np.inf))
LEAST_SHARE, OF_PIXEL, OF_NEXT = (np.float32(value) for value in (0.01, 0.5, 0.125))
"""As in `image.shading`."""
_LEAST_OPACITY = np.float32(1e-3)  # as in `image.depth_steps`


@compiled
def ray_shares(pixel, width, depth_of_rays, skin_depth, edge_m, first, last, shares):
    """Fill shares [P, 4] of pixels [first, last) as `image.shading.shares_of_rays`.

    `depth_of_rays` [h * w] is infinite where there is no ray, `skin_depth` [H * W] beside the hand.
    """
    height, large, per_edge = len(depth_of_rays) // width, 2 * width, _1 / edge_m
    for index in range(first, last):
        here = np.uint32(pixel[index])
        row = np.int64(here // np.uint32(large))
        column = np.int64(here) - row * large
        (a, b, c, d), (ea, eb, ec, ed) = neighbours(height, width, here)
        depths = depth_of_rays[a], depth_of_rays[b], depth_of_rays[c], depth_of_rays[d]
        even = (
            ea if depths[0] < _INF else _0,
            eb if depths[1] < _INF else _0,
            ec if depths[2] < _INF else _0,
            ed if depths[3] < _INF else _0,
        )
        at = np.uintp(here)
        left, right = at - np.uintp(min(column, 1)), at + np.uintp(min(large - 1 - column, 1))
        above, below = at - np.uintp(large * min(row, 1)), at + np.uintp(large * min(2 * height - 1 - row, 1))
        depth, beside = skin_depth[at], (skin_depth[left], skin_depth[right], skin_depth[above], skin_depth[below])
        own = _guided(even, depths, depth, per_edge)
        if _is_edge(depth, beside, edge_m):
            own = _softened(own, even, depths, beside, per_edge)
        shares[index, 0], shares[index, 1], shares[index, 2], shares[index, 3] = own


@part
def _is_edge(depth, beside, edge_m):
    """Return whether any of four depths differs from a pixel's own by more."""
    left, right, above, below = beside
    is_across = (abs(left - depth) > edge_m) | (abs(right - depth) > edge_m)
    return is_across | (abs(above - depth) > edge_m) | (abs(below - depth) > edge_m)


@part
def _softened(own, even, depths, beside, per_edge):
    """Mix the shares of a pixel with those at the depths of the four beside it."""
    sa, sb, sc, sd = OF_PIXEL * own[0], OF_PIXEL * own[1], OF_PIXEL * own[2], OF_PIXEL * own[3]
    for depth in beside:
        a, b, c, d = _guided(even, depths, depth, per_edge)
        sa, sb, sc, sd = sa + OF_NEXT * a, sb + OF_NEXT * b, sc + OF_NEXT * c, sd + OF_NEXT * d
    return sa, sb, sc, sd


@part
def _guided(even, depths, depth, per_edge):
    """Keep the shares of the rays at a depth, or of all if none is there."""
    a, b, c, d = _0, _0, _0, _0
    if depth < _INF:
        a, b = even[0] * gaussian((depth - depths[0]) * per_edge), even[1] * gaussian((depth - depths[1]) * per_edge)
        c, d = even[2] * gaussian((depth - depths[2]) * per_edge), even[3] * gaussian((depth - depths[3]) * per_edge)
    total = a + b + c + d
    if total <= LEAST_SHARE:
        a, b, c, d = even
        total = a + b + c + d
    whole = _1 / total
    return a * whole, b * whole, c * whole, d * whole


@compiled
def step_normals(at, share, row, width, of_rays, normal, first, last, out):
    """Fill out [P, 3] for pixels [first, last) as `image.depth_steps.normals_at_steps`.

    `row` [h * w] is the index among the normals `of_rays` [R, 3] of a low-resolution pixel, -1 for none.
    """
    height = len(row) // width
    for index in range(first, last):
        here = np.uintp(index)
        (a, b, c, d), (ea, eb, ec, ed) = neighbours(height, width, at[here])
        ra, rb, rc, rd = row[a], row[b], row[c], row[d]
        ea, eb, ec, ed = ea if ra >= 0 else _0, eb if rb >= 0 else _0, ec if rc >= 0 else _0, ed if rd >= 0 else _0
        sa, sb, sc, sd = share[here, 0], share[here, 1], share[here, 2], share[here, 3]
        whole = _1 / (ea + eb + ec + ed)
        off = abs(sa - ea * whole) + abs(sb - eb * whole) + abs(sc - ec * whole) + abs(sd - ed * whole)
        off = min(off, _1)
        sa, sb, sc, sd = sa if ra >= 0 else _0, sb if rb >= 0 else _0, sc if rc >= 0 else _0, sd if rd >= 0 else _0
        a, b, c, d = np.uintp(max(ra, 0)), np.uintp(max(rb, 0)), np.uintp(max(rc, 0)), np.uintp(max(rd, 0))
        x = sa * of_rays[a, 0] + sb * of_rays[b, 0] + sc * of_rays[c, 0] + sd * of_rays[d, 0]
        y = sa * of_rays[a, 1] + sb * of_rays[b, 1] + sc * of_rays[c, 1] + sd * of_rays[d, 1]
        z = sa * of_rays[a, 2] + sb * of_rays[b, 2] + sc * of_rays[c, 2] + sd * of_rays[d, 2]
        scale, kept = off / max(np.sqrt(x * x + y * y + z * z), TINY), _1 - off
        x, y = kept * normal[here, 0] + scale * x, kept * normal[here, 1] + scale * y
        z = kept * normal[here, 2] + scale * z
        inverse = _1 / max(np.sqrt(x * x + y * y + z * z), TINY)
        out[here, 0], out[here, 1], out[here, 2] = x * inverse, y * inverse, z * inverse


@compiled
def step_coefficients(at, share, maps, width, alpha, first, last, out):
    """Replace `out` [P, 14] of pixels [first, last) as `image.depth_steps.coefficients_at_steps`.

    `maps` [h * w, C] begin with the rays' premultiplied coefficients and end with their opacity.
    """
    height, opacity = len(maps) // width, np.uintp(maps.shape[1] - 1)
    for index in range(first, last):
        here = np.uintp(index)
        pixel = np.uintp(at[here])
        (a, b, c, d), (ea, eb, ec, ed) = neighbours(height, width, pixel)
        oa, ob = min(max(maps[a, opacity], _0), _1), min(max(maps[b, opacity], _0), _1)
        oc, od = min(max(maps[c, opacity], _0), _1), min(max(maps[d, opacity], _0), _1)
        sa, sb, sc, sd = share[here, 0], share[here, 1], share[here, 2], share[here, 3]
        ea, eb, ec, ed = ea * oa, eb * ob, ec * oc, ed * od
        all_, total = ea + eb + ec + ed, sa * oa + sb * ob + sc * oc + sd * od
        if all_ <= _LEAST_OPACITY or total <= _LEAST_OPACITY:
            continue
        whole, own = _1 / all_, _1 / total
        off = abs(sa * oa * own - ea * whole) + abs(sb * ob * own - eb * whole)
        off = min(off + abs(sc * oc * own - ec * whole) + abs(sd * od * own - ed * whole), _1)
        kept, scale = _1 - off, off * min(max(alpha[pixel], _0), _1) * own
        sa, sb, sc, sd = scale * sa, scale * sb, scale * sc, scale * sd
        for k in range(np.uintp(out.shape[1])):  # a number that is not known, or it is no vector loop
            of_rays = sa * maps[a, k] + sb * maps[b, k] + sc * maps[c, k] + sd * maps[d, k]
            out[here, k] = kept * out[here, k] + of_rays
