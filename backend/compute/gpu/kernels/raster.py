"""Meshes before a camera: as `field.rays`, and as `geometry.rasterise` their nearest faces.

What a pixel shows is one word: the bits of the depth above the face's number. The least of such words is the nearest
face, and of those at one depth the first, in whatever order threads come.
"""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from ....geometry.tolerances import MIN_AREA_PX2, NEAR_M
from .compiled import INFINITE_BITS, Floats, Floats2, Keys, Longs, Longs2, Vectors, kernel, part

wp.set_module_options({"fuse_fp": False})  # strict: which of two faces is the nearer hangs on the last bit
_NEAR_M = wp.constant(NEAR_M)
_MIN_AREA = wp.constant(MIN_AREA_PX2)
_INFINITE = wp.constant(INFINITE_BITS)
_NO_FACE = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
_DEPTH_AT = wp.constant(wp.uint64(32))
_FACE_BITS = wp.constant(wp.uint64(0xFFFFFFFF))
_TINY = wp.constant(1e-12)


@kernel
@no_type_check
def prepare_view(K: Floats2, world2cam: Floats2, view: Vectors):
    """Fill view [4] of a camera: its centre, and the world directions of a column, of a row, and of pixel (0, 0)."""
    k = wp.mat33d()
    turn = wp.mat33d()
    offset = wp.vec3d()
    for row in range(3):
        for column in range(3):
            k[row, column] = wp.float64(K[row, column])
            turn[row, column] = wp.float64(world2cam[row, column])
        offset[row] = wp.float64(world2cam[row, 3])
    to_world = wp.transpose(turn)
    axes = to_world * wp.inverse(k)
    view[0] = -wp.vec3(to_world * offset)
    for column in range(3):
        view[1 + column] = wp.vec3(wp.vec3d(axes[0, column], axes[1, column], axes[2, column]))


@part
@no_type_check
def direction_of(view: Vectors, pixel: int, width: int) -> wp.vec3:
    """Compute the world direction of depth 1 through a pixel's centre."""
    x = float(pixel % width) + 0.5
    y = float(pixel / width) + 0.5
    return x * view[1] + (y * view[2] + view[3])


@kernel
@no_type_check
def ray_directions(view: Vectors, pixel: Longs, width: int, out: Vectors):
    """Fill the directions of depth 1 through the centres of pixels [R]."""
    ray = wp.tid()
    out[ray] = direction_of(view, int(pixel[ray]), width)


@kernel
@no_type_check
def view_directions(view: Vectors, pixel: Longs, width: int, out: Vectors):
    """Fill the unit directions through the centres of pixels [R]."""
    ray = wp.tid()
    out[ray] = wp.normalize(direction_of(view, int(pixel[ray]), width))


@part
@no_type_check
def projected_point(point: wp.vec3, K: Floats2, world2cam: Floats2) -> wp.vec3:
    """Compute x and y, px, and depth, m, of a point, in double precision."""
    x = wp.float64(point[0])
    y = wp.float64(point[1])
    z = wp.float64(point[2])
    camera = wp.vec3d()
    image = wp.vec3d()
    for row in range(3):
        camera[row] = (
            wp.float64(world2cam[row, 0]) * x
            + wp.float64(world2cam[row, 1]) * y
            + wp.float64(world2cam[row, 2]) * z
            + wp.float64(world2cam[row, 3])
        )
    for row in range(3):
        image[row] = (
            wp.float64(K[row, 0]) * camera[0] + wp.float64(K[row, 1]) * camera[1] + wp.float64(K[row, 2]) * camera[2]
        )
    return wp.vec3(wp.float32(image[0] / image[2]), wp.float32(image[1] / image[2]), wp.float32(camera[2]))


@kernel
@no_type_check
def project_vertices(
    vertices: Vectors, normals: Vectors, lift_m: Floats, K: Floats2, world2cam: Floats2, projected: Vectors
):
    """Fill x and y, px, and depth, m, of vertices raised along their normals."""
    vertex = wp.tid()
    projected[vertex] = projected_point(vertices[vertex] + lift_m[0] * normals[vertex], K, world2cam)


@part
@no_type_check
def projected_area(a: wp.vec3, b: wp.vec3, c: wp.vec3) -> float:
    """Compute twice the signed area of a projected face, px^2; 0 where it is not drawn."""
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if wp.min(a[2], wp.min(b[2], c[2])) <= _NEAR_M or wp.abs(area) <= _MIN_AREA:
        area = wp.float32(0.0)
    return area


@part
@no_type_check
def covered_centres(a: wp.vec3, b: wp.vec3, c: wp.vec3, width: int, height: int) -> wp.vec4i:
    """Find columns [x0, x1) and rows [y0, y1) of the pixel centres in a face's bounding box; (0, 0, 0, 0): none."""
    x0 = _first_centre(wp.min(a[0], wp.min(b[0], c[0])), width)
    x1 = _last_centre(wp.max(a[0], wp.max(b[0], c[0])), width)
    y0 = _first_centre(wp.min(a[1], wp.min(b[1], c[1])), height)
    y1 = _last_centre(wp.max(a[1], wp.max(b[1], c[1])), height)
    box = wp.vec4i(x0, x1, y0, y1)
    if x0 >= x1 or y0 >= y1:
        box = wp.vec4i(0, 0, 0, 0)
    return box


@part
@no_type_check
def _first_centre(low: float, count: int) -> int:
    return int(wp.ceil(wp.clamp(low - 0.5, 0.0, float(count))))


@part
@no_type_check
def _last_centre(high: float, count: int) -> int:
    return wp.min(int(wp.floor(wp.clamp(high - 0.5, -1.0, float(count)))) + 1, count)


@part
@no_type_check
def fragment_depth(a: wp.vec3, b: wp.vec3, c: wp.vec3, area: float, x: float, y: float) -> float:
    """Compute the depth of a face at a point of the image; 0 where it does not cover it. 1/z is linear on screen."""
    wa = ((c[0] - b[0]) * (y - b[1]) - (c[1] - b[1]) * (x - b[0])) / area
    wb = ((a[0] - c[0]) * (y - c[1]) - (a[1] - c[1]) * (x - c[0])) / area
    wc = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
    depth = wp.float32(0.0)
    if wa >= 0.0 and wb >= 0.0 and wc >= 0.0:
        depth = 1.0 / (wa / a[2] + wb / b[2] + wc / c[2])
    return depth


@kernel
@no_type_check
def find_fronts(projected: Vectors, faces: Longs2, lanes: int, width: int, height: int, shown: Keys):
    """Lower the words of pixels [P] to the nearest front faces'; the pixels of a face are shared by `lanes` threads."""
    face, lane = wp.tid()
    a = projected[int(faces[face, 0])]
    b = projected[int(faces[face, 1])]
    c = projected[int(faces[face, 2])]
    area = projected_area(a, b, c)
    if area >= 0.0:
        return
    box = covered_centres(a, b, c, width, height)
    columns = box[1] - box[0]
    index = int(lane)
    while index < columns * (box[3] - box[2]):
        x = box[0] + index % columns
        y = box[2] + index / columns
        depth = fragment_depth(a, b, c, area, float(x) + 0.5, float(y) + 0.5)
        if depth > 0.0:
            wp.atomic_min(shown, y * width + x, word_of(depth, face))
        index += lanes


@part
@no_type_check
def word_of(depth: float, face: int) -> wp.uint64:
    """Make the word of a fragment."""
    return (wp.uint64(wp.cast(depth, wp.uint32)) << _DEPTH_AT) | wp.uint64(face)


@part
@no_type_check
def depth_of(word: wp.uint64) -> float:
    """Read the depth of a word, m; infinite for none."""
    depth = wp.cast(_INFINITE, wp.float32)
    if word != _NO_FACE:
        depth = wp.cast(wp.uint32(word >> _DEPTH_AT), wp.float32)
    return depth


@part
@no_type_check
def face_of(word: wp.uint64) -> int:
    """Read the face of a word; -1 for none."""
    face = wp.int32(-1)
    if word != _NO_FACE:
        face = int(word & _FACE_BITS)
    return face


@kernel
@no_type_check
def read_words(shown: Keys, depth: Floats, face: Longs):
    """Fill depth [P], m, and face [P] of words."""
    pixel = wp.tid()
    depth[pixel] = depth_of(shown[pixel])
    face[pixel] = wp.int64(face_of(shown[pixel]))


@kernel
@no_type_check
def normals_at(
    projected: Vectors,
    normals: Vectors,
    faces: Longs2,
    shown: Keys,
    pixel: Longs,
    width: int,
    depth: Floats,
    out: Vectors,
):
    """Fill depth [R] and unit normals [R] of what the centres of pixels [R] show; 0 where that is nothing."""
    ray = wp.tid()
    at = int(pixel[ray])
    face = face_of(shown[at])
    depth[ray] = depth_of(shown[at])
    normal = wp.vec3()
    if face >= 0:
        corner_a = int(faces[face, 0])
        corner_b = int(faces[face, 1])
        corner_c = int(faces[face, 2])
        a = projected[corner_a]
        b = projected[corner_b]
        c = projected[corner_c]
        x = float(at % width) + 0.5
        y = float(at / width) + 0.5
        wa = ((c[0] - b[0]) * (y - b[1]) - (c[1] - b[1]) * (x - b[0])) / a[2]
        wb = ((a[0] - c[0]) * (y - c[1]) - (a[1] - c[1]) * (x - c[0])) / b[2]
        wc = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / c[2]
        mixed = (wa * normals[corner_a] + wb * normals[corner_b] + wc * normals[corner_c]) / (wa + wb + wc)
        normal = mixed / wp.max(wp.length(mixed), _TINY)
    out[ray] = normal
