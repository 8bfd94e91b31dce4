"""Equals `sampler` and `geometry.tracking`: a ray's intervals, its samples, and where they lie over the surface."""

from __future__ import annotations

import numpy as np

from .compiled import compiled
from .surface import closest_on_part, signed_height

_0, _1 = np.float32(0), np.float32(1)


@compiled
def find_live(layers, first, last, is_live):
    """Mark the pixels in [first, last) whose rays have anything to sample."""
    start, end, part = ray_buffers(layers)
    for pixel in range(first, last):
        if layers[2][pixel] > 0:
            _, total, _ = begin_ray(pixel, layers, start, end, part)
            is_live[pixel] = total > _0


@compiled
def lay_samples(
    pixels,  # [R]
    directions,  # [R, 3]
    origin,  # [3]
    offsets,  # [R, N] in (0, 1): where in the union of a ray's intervals its samples lie
    layers,  # `cpu.shell.Layers`
    surface,  # `cpu.shell.surface_arrays`
    first,
    last,
    t,  # [R, N] out, m
    dt,  # [R] out, m
    is_stopped,  # [R] out
    face,  # [R, N] out
    barycentric,  # [R, N, 3] out
    height,  # [R, N] out, m of the world
):
    """Place the samples of rays [first, last) and lay each on the part of the surface that holds it deepest."""
    samples = offsets.shape[1]
    start, end, part = ray_buffers(layers)
    tried = np.empty((3, surface[1].shape[2]), np.float32)
    for ray in range(first, last):
        intervals, total, is_stopped[ray] = begin_ray(pixels[ray], layers, start, end, part)
        dt[ray] = total / np.float32(samples)
        for index in range(samples):
            since, depth = placed(offsets[ray, index] * total, start, end, intervals)
            t[ray, index] = depth
            x, y, z = point_at(origin, directions, ray, depth)
            found, wb, wc, h = deepest_part(x, y, z, depth, since, pixels[ray], layers, surface, part, tried)
            face[ray, index], height[ray, index] = found, h
            barycentric[ray, index, 0] = _1 - wb - wc
            barycentric[ray, index, 1], barycentric[ray, index, 2] = wb, wc


@compiled
def ray_buffers(layers):
    """Room for one ray: starts and ends of its intervals, and the face of each part that it follows."""
    capacity = layers[0].shape[1]
    return np.empty(capacity, np.float32), np.empty(capacity, np.float32), np.empty(capacity, np.int64)


@compiled
def begin_ray(pixel, layers, start, end, part):
    """Fill a ray's buffers; returns (how many intervals, their total length, whether the hand itself stops it)."""
    layer_depth, layer_face, crossings, inner = layers
    depths, marks, count = layer_depth[pixel], layer_face[pixel], crossings[pixel]
    for crossing in range(count):
        part[crossing] = marks[crossing]
    return interval_list(depths, marks, count, inner[pixel], start, end)


@compiled
def point_at(origin, directions, ray, depth):
    """The point of a ray at a depth."""
    x = origin[0] + depth * directions[ray, 0]
    y = origin[1] + depth * directions[ray, 1]
    z = origin[2] + depth * directions[ray, 2]
    return x, y, z


@compiled
def deepest_part(x, y, z, depth, since, pixel, layers, surface, part, tried):
    """(face, weight of b, weight of c, height m) of a sample, on the part of the surface that holds it deepest.

    Every part entered since the interval's start is followed, from the face `part` has for it.
    """
    layer_depth, layer_face, crossings, _ = layers
    shapes, around, neighbours, faces, vertices, normals = surface
    deepest, face, wb, wc = np.float32(np.inf), np.int64(0), _0, _0
    for crossing in range(crossings[pixel]):
        entry = layer_depth[pixel, crossing]
        if entry > depth:
            break
        if layer_face[pixel, crossing] < 0 or entry < since:
            continue
        found, b, c, squared = closest_on_part(x, y, z, part[crossing], shapes, around, neighbours, tried)
        part[crossing] = found
        height = signed_height(x, y, z, found, b, c, squared, faces, vertices, normals)
        if height < deepest:
            deepest, face, wb, wc = height, found, b, c
    return face, wb, wc, deepest


@compiled
def interval_list(depths, marks, crossings, inner, start, end):
    """Fill the starts and ends of where a ray is inside: (how many, total length, whether the hand itself stops it)."""
    intervals, nesting = 0, 0
    for crossing in range(crossings):
        is_front = marks[crossing] >= 0
        nesting += 1 if is_front else -1
        if is_front and nesting <= 1:
            start[intervals] = depths[crossing]
            end[intervals] = _exit(depths, marks, crossings, crossing, nesting)
            intervals += 1
    total, is_stopped = np.float32(0), False
    for index in range(intervals):
        is_stopped = is_stopped or inner < end[index]
        start[index], end[index] = min(start[index], inner), min(end[index], inner)
        total += end[index] - start[index]
    return intervals, total, is_stopped


@compiled
def _exit(depths, marks, crossings, crossing, nesting):
    """Depth at which the nesting, known after `crossing`, is back at none; the last crossing's where it never is."""
    while nesting > 0 and crossing + 1 < crossings:
        crossing += 1
        nesting += 1 if marks[crossing] >= 0 else -1
    return depths[crossing]


@compiled
def placed(offset, start, end, intervals):
    """(start of the interval, depth) at an offset into the union of the intervals."""
    index = 0
    while index < intervals - 1 and offset > end[index] - start[index]:
        offset -= end[index] - start[index]
        index += 1
    return start[index], start[index] + offset
