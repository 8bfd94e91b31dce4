"""Equals `sampler` and `geometry.tracking`: a ray's intervals, its samples, and where they lie over the surface."""

from __future__ import annotations

import numpy as np

from .compiled import compiled
from .surface import closest_on_part, signed_height

_1 = np.float32(1)


@compiled
def find_live(layer_depth, layer_face, count, inner, scene, first, last, is_live):
    """Mark the pixels in [first, last) whose rays have anything to sample."""
    layers = layer_depth.shape[1]
    start, end = np.empty(layers, np.float32), np.empty(layers, np.float32)
    for pixel in range(first, last):
        if count[pixel] > 0:
            depths, marks = layer_depth[pixel], layer_face[pixel]
            _, total, _ = interval_list(depths, marks, count[pixel], inner[pixel], scene[pixel], start, end)
            is_live[pixel] = total > 0


@compiled
def lay_samples(
    pixels,  # [R]
    directions,  # [R, 3]
    origin,  # [3]
    offsets,  # [R, N] in (0, 1): where in the union of a ray's intervals its samples lie
    layer_depth,
    layer_face,
    count,
    inner,
    scene,
    shapes,
    spheres,
    neighbours,
    faces,
    vertices,
    normals,
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
    layers, samples = layer_depth.shape[1], offsets.shape[1]
    start, end = np.empty(layers, np.float32), np.empty(layers, np.float32)
    part = np.empty(layers, np.int64)
    for ray in range(first, last):
        pixel = pixels[ray]
        depths, marks, crossings = layer_depth[pixel], layer_face[pixel], count[pixel]
        intervals, total, stopped = interval_list(depths, marks, crossings, inner[pixel], scene[pixel], start, end)
        dt[ray], is_stopped[ray] = total / np.float32(samples), stopped
        for crossing in range(crossings):
            part[crossing] = marks[crossing]
        for index in range(samples):
            since, depth = placed(offsets[ray, index] * total, start, end, intervals)
            t[ray, index] = depth
            x = origin[0] + depth * directions[ray, 0]
            y = origin[1] + depth * directions[ray, 1]
            z = origin[2] + depth * directions[ray, 2]
            deepest = np.float32(np.inf)
            for crossing in range(crossings):
                if depths[crossing] > depth:
                    break
                if marks[crossing] < 0 or depths[crossing] < since:
                    continue
                found, wb, wc, squared = closest_on_part(x, y, z, part[crossing], shapes, spheres, neighbours)
                part[crossing] = found
                h = signed_height(x, y, z, found, wb, wc, squared, faces, vertices, normals)
                if h < deepest:
                    deepest = h
                    face[ray, index], height[ray, index] = found, h
                    barycentric[ray, index, 0] = _1 - wb - wc
                    barycentric[ray, index, 1], barycentric[ray, index, 2] = wb, wc


@compiled
def interval_list(depths, marks, crossings, inner, scene, start, end):
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
    stop = min(inner, scene)
    for index in range(intervals):
        if scene < min(end[index], inner):
            is_stopped = False
        start[index], end[index] = min(start[index], stop), min(end[index], stop)
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
