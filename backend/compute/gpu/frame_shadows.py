"""Launches of a lit frame: the shadows of all views, at rays, at surfels and at points of nearby geometry."""

from __future__ import annotations

import warp as wp

from ...light.sky_samples import SKY_DIRECTIONS
from .blocks import address_of, part_of, part_of_rows, stride_of
from .frame_buffers import FrameBuffers
from .frame_nearby import POINTS
from .frame_views import casters_of
from .kernels.shadow import draw_occluders, draw_sides, find_bounds, look_up, project_casters

_LANES_OF_OCCLUDERS = 1 << 15  # threads of a view, at most, unless there are more triangles
_BOUND_PARTS = 32  # times the lanes: threads that look for the bounds of a view's points


def add_shadows(frame: FrameBuffers) -> None:
    """Add the shadows of all views: of the sky and of lamps, at rays and at surfels."""
    model, shape = frame.model, frame.shape
    vertices, views = len(model.albedo), shape.views
    parts = 1 if frame.lanes == 1 else _BOUND_PARTS * frame.lanes
    seen = "ray_count", "spheres", "frames", "distance", "table"
    if shape.has_patches:
        room = part_of(frame["points"], vertices + 2 * shape.rays, 2 * POINTS)
        frame.sequence.then(lambda: wp.copy(room, frame["patch_lifted"]))
    frame.add(find_bounds, (views, parts), *seen, "points", parts, "bounds")
    casters = casters_of(model)[: 3 if shape.casts_finest else 2]
    frame.new("placed", wp.vec3, views, vertices + casters[-1].vertices)
    frame.add(project_casters, (views, max(one.vertices for one in casters)), *seen, "bounds", "casters", "placed")
    faces = max(one.faces for one in casters)
    frame.add(draw_sides, (views, faces), "table", "placed", "casting_faces", "shadow_maps")
    lanes = min(frame.lanes, max(1, _LANES_OF_OCCLUDERS // max(shape.triangles, 1)))
    others = "occluders", "triangles", lanes, "shadow_maps"
    frame.add(draw_occluders, (views, shape.triangles, lanes), *seen, "bounds", *others)
    _add_look_ups(frame, seen)


def _add_look_ups(frame: FrameBuffers, seen: tuple[str, ...]) -> None:
    """Add what views see of points, and name the parts of it."""
    shape, vertices = frame.shape, len(frame.model.albedo)
    rays, surfels, patch_sky = shape.view_groups[1:4]
    most, on_hand = vertices + shape.rays, surfels.stop
    lit, depth_in_m = (frame.new(name, wp.float32, on_hand, most) for name in ("lit", "depth_in_m"))
    alone = frame.new("alone", wp.float32, SKY_DIRECTIONS if shape.triangles else 0, most)
    maps = "shadow_maps", "lengths"
    frame.add(look_up, (on_hand, most), *seen, "points", "bounds", *maps, lit, depth_in_m, alone)
    for name, values in (("lit", lit), ("depth_in_m", depth_in_m)):
        frame.named(f"sky_{name}", _block_of(values, 0, vertices, shape.sky, shape.rays))
        frame.named(f"lamp_{name}", _block_of(values, rays.start, 0, shape.samples, shape.rays))
    frame.named("surfel_sky_lit", _block_of(lit, 0, 0, shape.sky, vertices))
    frame.named("surfel_lamp_lit", _block_of(lit, surfels.start, 0, shape.at_surfels, vertices))
    of_hand = alone if shape.triangles else lit
    frame.named("surfel_open_sky", _block_of(of_hand, 0, 0, SKY_DIRECTIONS, vertices))
    frame.named("open_sky", _block_of(of_hand, 0, vertices, SKY_DIRECTIONS, shape.rays))
    if shape.has_patches:
        first, count = patch_sky.start, shape.views - patch_sky.start
        there = (part_of_rows(frame[name], first, count) for name in ("frames", "distance", "table"))
        on_patches = (frame.new(f"patch_{name}", wp.float32, count, POINTS) for name in ("lit", "depth_in_m"))
        bounds, none = part_of_rows(frame["bounds"], first, count), frame.new("none", wp.float32, 0, POINTS)
        given = "ray_count", "spheres", *there, "points", bounds, *maps
        frame.add(look_up, (count, POINTS), *given, *on_patches, none)
        frame.named("patch_sky_lit", part_of_rows(frame["patch_lit"], 0, shape.sky))
        frame.named("patch_lamp_lit", part_of_rows(frame["patch_lit"], shape.sky, shape.at_surfels))


def _block_of(values: wp.array, row: int, column: int, rows: int, columns: int) -> wp.array:
    """Return a part of a matrix, without a copy."""
    at = address_of(values) + row * stride_of(values) + 4 * column
    strides = stride_of(values), 4
    return wp.array(ptr=at, dtype=wp.float32, shape=(rows, columns), strides=strides, device=values.device)
