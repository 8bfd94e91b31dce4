"""Equals `field.sampler` and `field.surface_tracking`: a ray's intervals, its samples, and their surface points."""

from __future__ import annotations

import numpy as np

from .compiled import compiled
from .compiled import compiled_part as part
from .surface import closest_on_part, signed_height

_0, _1 = np.float32(0), np.float32(1)


@compiled
def find_live(crossings, first, last, is_live):
    """Mark the pixels in [first, last) whose rays have anything to sample."""
    start, end, since, part = ray_buffers(crossings)
    for pixel in range(first, last):
        if crossings.counts[pixel] > 0:
            _, total, _ = begin_ray(pixel, crossings, start, end, since, part)
            is_live[pixel] = total > _0


@compiled
def trace_samples(rays, offsets, crossings, surface, first, last, out):
    """Place the samples of rays [first, last) and project each onto the part of the surface that holds it deepest.

    `offsets` [R, N] in (0, 1) are the samples' places in the union of a ray's intervals; `out` is `TracedSamples`.
    """
    samples = offsets.shape[1]
    start, end, since, part = ray_buffers(crossings)
    tried = np.empty((3, surface.around.shape[2]), np.float32)
    for ray in range(first, last):
        pixel = rays.pixel[ray]
        intervals, total, out.is_stopped[ray] = begin_ray(pixel, crossings, start, end, since, part)
        out.dt[ray] = total / np.float32(samples)
        for index in range(samples):
            interval, depth = place_sample(offsets[ray, index] * total, start, end, intervals)
            out.t[ray, index] = depth
            x, y, z = point_at(rays, ray, depth)
            face, wb, wc, height = deepest_part(x, y, z, depth, since[interval], pixel, crossings, surface, part, tried)
            out.face[ray, index], out.height[ray, index] = face, height
            out.barycentric[ray, index, 0] = _1 - wb - wc
            out.barycentric[ray, index, 1], out.barycentric[ray, index, 2] = wb, wc


@compiled
def ray_buffers(crossings):
    """Buffers of one ray: starts, ends and `since` of its intervals, and the current face of each part it entered."""
    capacity = crossings.depth.shape[1]
    start, end, since = np.empty(capacity, np.float32), np.empty(capacity, np.float32), np.empty(capacity, np.float32)
    return start, end, since, np.empty(capacity, np.int64)


@part
def begin_ray(pixel, crossings, start, end, since, part):
    """Fill a ray's buffers; returns (number of intervals, their total length, whether the ray ends opaque)."""
    depths, faces, count = crossings.depth[pixel], crossings.face[pixel], crossings.counts[pixel]
    for crossing in range(count):
        part[crossing] = faces[crossing]
    intervals, total, is_stopped = interval_list(depths, faces, count, crossings.inner[pixel], start, end)
    for index in range(intervals):
        since[index] = start[index]
    near, far = crossings.known[pixel] - crossings.before, crossings.known[pixel] + crossings.behind
    about, is_cut = _reach(near, far, start, end, intervals)
    if about > crossings.least_reach:  # nothing where no surface is known: `near` is infinite
        for index in range(intervals):
            start[index], end[index] = min(max(start[index], near), far), min(max(end[index], near), far)
        return intervals, about, is_stopped or is_cut
    return intervals, total, is_stopped


@part
def _reach(near, far, start, end, intervals):
    """(Length of the intervals from `near` to `far`, whether any goes on behind)."""
    total, is_cut = _0, False
    for index in range(intervals):
        total += max(min(end[index], far) - max(start[index], near), _0)
        is_cut = is_cut or end[index] > far
    return total, is_cut


@part
def point_at(rays, ray, depth):
    """The point of a ray at a depth."""
    x = rays.origin[0] + depth * rays.directions[ray, 0]
    y = rays.origin[1] + depth * rays.directions[ray, 1]
    z = rays.origin[2] + depth * rays.directions[ray, 2]
    return x, y, z


@part
def deepest_part(x, y, z, depth, since, pixel, crossings, surface, part, tried):
    """(face, weight of b, weight of c, height m) of a sample, on the part of the surface that holds it deepest.

    Every part entered since the interval's start is tracked, from the face that `part` holds for it.
    """
    deepest, face, wb, wc = np.float32(np.inf), np.int64(0), _0, _0
    for crossing in range(crossings.counts[pixel]):
        entry = crossings.depth[pixel, crossing]
        if entry > depth:
            break
        if crossings.face[pixel, crossing] < 0 or entry < since:
            continue
        found, b, c, squared = closest_on_part(x, y, z, part[crossing], surface, tried)
        part[crossing] = found
        height = signed_height(x, y, z, found, b, c, squared, surface)
        if height < deepest:
            deepest, face, wb, wc = height, found, b, c
    return face, wb, wc, deepest


@part
def interval_list(depths, faces, count, inner, start, end):
    """Fill the intervals in which a ray is inside; returns (count, total length, whether the hand itself stops it)."""
    intervals, nesting = 0, 0
    for crossing in range(count):
        is_front = faces[crossing] >= 0
        nesting += 1 if is_front else -1
        if is_front and nesting <= 1:
            start[intervals] = depths[crossing]
            end[intervals] = _exit(depths, faces, count, crossing, nesting)
            intervals += 1
    total, is_stopped = np.float32(0), False
    for index in range(intervals):
        is_stopped = is_stopped or inner < end[index]
        start[index], end[index] = min(start[index], inner), min(end[index], inner)
        total += end[index] - start[index]
    return intervals, total, is_stopped


@part
def _exit(depths, faces, count, crossing, nesting):
    """Depth at which the nesting, given after `crossing`, returns to zero; the last crossing's if it never does."""
    while nesting > 0 and crossing + 1 < count:
        crossing += 1
        nesting += 1 if faces[crossing] >= 0 else -1
    return depths[crossing]


@part
def place_sample(offset, start, end, intervals):
    """(interval, depth) at an offset into the union of the intervals."""
    index = 0
    while index < intervals - 1 and offset > end[index] - start[index]:
        offset -= end[index] - start[index]
        index += 1
    return index, start[index] + offset
