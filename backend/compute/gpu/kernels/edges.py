"""Outlines and edges of parts, and frames of them: as `surface.detail_mesh`, `edge_antialiasing`, `image.decode`."""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from ....image.decode import MIN_ALPHA as CLEAR_ALPHA
from ....image.shading import MIN_ALPHA
from ....records.frame import DEPTH_BACKGROUND
from ....surface.edge_antialiasing import SPREAD
from .compiled import Bools, Bools2, Bytes, Floats, Ints, Keys, Longs, Longs2, Vectors, kernel, part
from .hairs import WHOLE
from .raster import depth_of, face_of, fragment_depth, projected_area, word_of

# Loops over samples within loops over pixels: unrolled, they would take more registers than there are.
wp.set_module_options({"max_unroll": 8, "fuse_fp": False})
_BESIDE, _ITS_OWN = wp.constant(SPREAD[0]), wp.constant(SPREAD[1])
_MIN_ALPHA, _CLEAR_ALPHA, _BACKGROUND = (wp.constant(v) for v in (MIN_ALPHA, CLEAR_ALPHA, DEPTH_BACKGROUND))
_BITS, _ITSELF, _NO_BONE = wp.constant(16), wp.constant(4), wp.constant(-1)


@part
@no_type_check
def near_pixel(pixel: int, near: int, width: int, height: int) -> int:
    """Find one of the 3 x 3 pixels around one, row by row; the image's rim stands for what lies beyond it."""
    x = wp.clamp(pixel % width + near % 3 - 1, 0, width - 1)
    y = wp.clamp(pixel / width + near / 3 - 1, 0, height - 1)
    return y * width + x


@part
@no_type_check
def _tap(near: int) -> float:
    weight = float(_BESIDE)
    if near % 3 == 1:
        weight = _ITS_OWN
    other = float(_BESIDE)
    if near / 3 == 1:
        other = _ITS_OWN
    return weight * other


@kernel
@no_type_check
def mark_pixels(
    shown: Keys,
    bone_of_face: Bytes,
    apart: Bools2,
    width: int,
    height: int,
    steps: Floats,
    on_outline: Bools,
    between: Floats,
    first_part: Ints,
):
    """Fill which pixels lie on the outline, a depth between two parts, m (0: none), and a bone of one (-1: none).

    `steps` are the depth by which parts differ at least, m, and how much more at each metre.
    """
    pixel = wp.tid()
    seen = wp.int32(0)
    low = float(wp.inf)
    high = wp.float32(0.0)
    own_face = face_of(shown[pixel])
    own = int(_NO_BONE)
    if own_face >= 0:
        own = int(bone_of_face[own_face])
    other = int(_NO_BONE)
    for near in range(9):
        word = shown[near_pixel(pixel, near, width, height)]
        face = face_of(word)
        if face >= 0:
            depth = depth_of(word)
            seen += 1
            low = wp.min(low, depth)
            high = wp.max(high, depth)
            bone = int(bone_of_face[face])
            if own >= 0 and other < 0 and apart[own, bone]:
                other = bone
    on_outline[pixel] = seen > 0 and seen < 9
    middle = wp.float32(0.0)
    if seen > 0 and high - low > steps[0] + steps[1] * low:
        middle = 0.5 * (low + high)
    between[pixel] = middle
    if other >= 0:
        other = wp.min(own, other)
    first_part[pixel] = other


@part
@no_type_check
def _sample_x(k: int) -> float:
    return (float(k) + 0.5) / 16.0


@part
@no_type_check
def _sample_y(k: int) -> float:
    turned = ((k & 1) << 3) | ((k & 2) << 1) | ((k & 4) >> 1) | ((k & 8) >> 3)
    return (float(turned) + 0.5) / 16.0


@kernel
@no_type_check
def sample_faces(
    projected: Vectors,
    faces: Longs2,
    lanes: int,
    width: int,
    height: int,
    on_outline: Bools,
    slot: Ints,
    bits: Ints,
    samples: Keys,
):
    """Look for front faces at the samples of pixels on the outline, a bit for each, and of those with a slot.

    `samples` [S * 16] are lowered to the words of the nearest.
    """
    face, lane = wp.tid()
    a = projected[int(faces[face, 0])]
    b = projected[int(faces[face, 1])]
    c = projected[int(faces[face, 2])]
    area = projected_area(a, b, c)
    if area >= 0.0:
        return
    x0 = wp.clamp(int(wp.floor(wp.clamp(wp.min(a[0], wp.min(b[0], c[0])), -1.0, float(width)))), 0, width)
    x1 = wp.min(int(wp.floor(wp.clamp(wp.max(a[0], wp.max(b[0], c[0])), -1.0, float(width)))) + 1, width)
    y0 = wp.clamp(int(wp.floor(wp.clamp(wp.min(a[1], wp.min(b[1], c[1])), -1.0, float(height)))), 0, height)
    y1 = wp.min(int(wp.floor(wp.clamp(wp.max(a[1], wp.max(b[1], c[1])), -1.0, float(height)))) + 1, height)
    columns = wp.max(x1 - x0, 0)
    index = int(lane)
    while index < columns * (y1 - y0):
        x = x0 + index % columns
        y = y0 + index / columns
        pixel = y * width + x
        index += lanes
        if not on_outline[pixel] and slot[pixel] < 0:
            continue
        found = wp.int32(0)
        for k in range(_BITS):
            depth = fragment_depth(a, b, c, area, float(x) + _sample_x(k), float(y) + _sample_y(k))
            if depth > 0.0:
                found = found | (1 << k)
                if slot[pixel] >= 0:
                    wp.atomic_min(samples, slot[pixel] * _BITS + k, word_of(depth, face))
        if found != 0:
            wp.atomic_or(bits, pixel, found)


@part
@no_type_check
def _covered(shown: Keys, on_outline: Bools, bits: Ints, pixel: int) -> float:
    """Compute the covered share of a pixel's square."""
    share = wp.float32(0.0)
    if on_outline[pixel]:
        for k in range(_BITS):
            share += float((bits[pixel] >> k) & 1)
        share = share / float(_BITS)
    elif face_of(shown[pixel]) >= 0:
        share = wp.float32(1.0)
    return share


@kernel
@no_type_check
def spread_coverage(
    shown: Keys, on_outline: Bools, bits: Ints, width: int, height: int, coverage: Floats, depth: Floats, face: Longs
):
    """Fill what pixels show: coverage as `surface.detail_mesh.spread`, depth, m, and face.

    Where only a pixel's centre misses the surface, its depth is that of the nearest beside.
    """
    pixel = wp.tid()
    is_near = wp.bool(False)
    total = wp.float32(0.0)
    nearest = float(wp.inf)
    for near in range(9):
        at = near_pixel(pixel, near, width, height)
        is_near = is_near or on_outline[at]
        total += _tap(near) * _covered(shown, on_outline, bits, at)
        nearest = wp.min(nearest, depth_of(shown[at]))
    if not is_near:
        total = _covered(shown, on_outline, bits, pixel)
    coverage[pixel] = total
    own = depth_of(shown[pixel])
    if not wp.isfinite(own) and total > 0.0:
        own = nearest
    depth[pixel] = own
    face[pixel] = wp.int64(face_of(shown[pixel]))


@part
@no_type_check
def _is_first(word: wp.uint64, between: float, bone: int, bone_of_face: Bytes, apart: Bools2) -> bool:
    """Return whether a fragment is of the first part, as `surface.edge_antialiasing` has it."""
    is_first = wp.bool(False)
    if between > 0.0:
        is_first = depth_of(word) < between
    elif face_of(word) >= 0:
        is_first = not apart[int(bone_of_face[face_of(word)]), bone]
    return is_first


@kernel
@no_type_check
def edge_shares(
    count: Ints,
    pixel: Longs,
    shown: Keys,
    width: int,
    height: int,
    between: Floats,
    first_part: Ints,
    bone_of_face: Bytes,
    apart: Bools2,
    slot: Ints,
    samples: Keys,
    shows_first: Bools2,
    share: Floats,
):
    """Fill `surface.edge_antialiasing.EdgePixels` of pixels [S] that show two parts."""
    index = wp.tid()
    if index >= count[0]:
        return
    at = int(pixel[index])
    middle = between[at]
    bone = first_part[at]
    total = wp.float32(0.0)
    weights = wp.float32(0.0)
    for near in range(9):
        beside = near_pixel(at, near, width, height)
        is_first = _is_first(shown[beside], middle, bone, bone_of_face, apart)
        shows_first[near, index] = is_first
        if face_of(shown[beside]) >= 0 or near == _ITSELF:
            part_shown = wp.float32(0.0)
            if is_first:
                part_shown = wp.float32(1.0)
            if slot[beside] >= 0:
                ours = wp.float32(0.0)
                seen = wp.float32(0.0)
                for k in range(_BITS):
                    word = samples[slot[beside] * _BITS + k]
                    if face_of(word) >= 0:
                        seen += 1.0
                        if _is_first(word, middle, bone, bone_of_face, apart):
                            ours += 1.0
                part_shown = ours / wp.max(seen, 1.0)
            total += _tap(near) * part_shown
            weights += _tap(near)
    share[index] = total / weights


@part
@no_type_check
def blended_colour(
    colours: Vectors,
    alpha: Floats,
    depth: Floats,
    width: int,
    here: int,
    shows_first: Bools2,
    share: Floats,
    index: int,
) -> wp.vec3:
    """Compute the colour of a pixel that shows two parts; `index` is its place among these."""
    height = depth.shape[0] / width
    of_first = wp.vec3()
    of_other = wp.vec3()
    first = wp.float32(0.0)
    other = wp.float32(0.0)
    for near in range(9):
        at = near_pixel(here, near, width, height)
        if wp.isfinite(depth[at]) and alpha[at] > _MIN_ALPHA:
            straight = colours[at] / alpha[at]
            if shows_first[near, index]:
                of_first += straight
                first += 1.0
            else:
                of_other += straight
                other += 1.0
    result = colours[here]
    if first > 0.0 and other > 0.0:
        of_first = of_first / first
        of_other = of_other / other
        if wp.isfinite(depth[here]) and alpha[here] > _MIN_ALPHA:  # of its own part it has its own colour alone
            if shows_first[_ITSELF, index]:
                of_first = colours[here] / alpha[here]
            else:
                of_other = colours[here] / alpha[here]
        result = (of_other + share[index] * (of_first - of_other)) * wp.min(alpha[here], 1.0)
    return result


@kernel
@no_type_check
def blend_parts(
    colours: Vectors,
    alpha: Floats,
    depth: Floats,
    width: int,
    pixel: Longs,
    shows_first: Bools2,
    share: Floats,
    out: Vectors,
):
    """Fill the colours [S] of pixels that show two parts; `colours`, `alpha` and `depth` are the image's."""
    index = wp.tid()
    out[index] = blended_colour(colours, alpha, depth, width, int(pixel[index]), shows_first, share, index)


@kernel
@no_type_check
def list_edges(between: Floats, part: Ints, capacity: int, count: Ints, pixel: Longs, slot: Ints, overflow: Ints):
    """List the pixels that show two parts; `slot` is -1 where it was, for all others."""
    at = wp.tid()
    if between[at] <= 0.0 and part[at] < 0:
        return
    place = wp.atomic_add(count, 0, 1)
    if place >= capacity:
        overflow[0] = 1
        return
    pixel[place] = wp.int64(at)
    slot[at] = place


@part
@no_type_check
def _summed(sums: Longs2, pixel: int, column: int) -> float:
    return wp.float32(wp.float64(sums[pixel, column]) / WHOLE)


@kernel
@no_type_check
def develop_pixels(
    colours: Vectors,
    alpha: Floats,
    depth: Floats,
    width: int,
    slot: Ints,
    slots: int,
    shows_first: Bools2,
    share: Floats,
    hair_sums: Longs2,
    hair_depth_bits: Ints,
    hair_unit: Floats,
    out_rgb: Vectors,
    out_alpha: Floats,
    out_depth: Floats,
):
    """Fill premultiplied scene-linear RGB, alpha, and depth, m, of pixels [H * W]; `slot`: its place among edges.

    Of hairs there are the sums and depths of `hairs.draw_hairs`, or none.
    """
    pixel = wp.tid()
    colour = colours[pixel]
    edge = slot[pixel]
    if edge >= 0 and edge < slots:
        colour = blended_colour(colours, alpha, depth, width, pixel, shows_first, share, edge)
    opacity = float(alpha[pixel])
    behind_m = float(depth[pixel])
    if hair_sums.shape[0] > 0 and hair_sums[pixel, 3] > wp.int64(0):
        hair = wp.vec3(_summed(hair_sums, pixel, 0), _summed(hair_sums, pixel, 1), _summed(hair_sums, pixel, 2))
        total = _summed(hair_sums, pixel, 3)
        covered = wp.min(total, 1.0)
        colour = (1.0 - covered) * colour + (hair_unit[0] * covered / total) * hair
        opacity += covered * (1.0 - opacity)
    if hair_sums.shape[0] > 0 and not wp.isfinite(behind_m):
        behind_m = wp.cast(hair_depth_bits[pixel], wp.float32)
    opacity = wp.min(opacity, 1.0)
    if opacity <= _CLEAR_ALPHA:
        opacity = wp.float32(0.0)
        colour = wp.vec3()
    out_rgb[pixel] = colour
    out_alpha[pixel] = opacity
    out_depth[pixel] = _BACKGROUND
    if opacity >= 0.5 and wp.isfinite(behind_m):
        out_depth[pixel] = behind_m
