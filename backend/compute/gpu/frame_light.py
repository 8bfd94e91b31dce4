"""Launches of a lit frame: shadows, what the decoder makes of rays, and the light at them and at nearby geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from ...image.shading import ray_row_columns
from ...light.lighting import COEFFICIENTS, RELIGHTABLE_FEATURES
from ...light.near_field_light import sky_cells
from ...light.nearby_geometry import MOST_PATCHES
from ...light.sky_samples import SKY_DIRECTIONS
from .blocks import address_of, columns_of, part_of, part_of_rows, stride_of
from .frame_buffers import FrameBuffers, LitBuffers
from .frame_model import Layer
from .frame_nearby import POINTS
from .frame_parameters import LAMP_COLUMNS, SURFEL_LAMP_COLUMNS
from .frame_views import casters_of
from .kernels.decoder import FEW, decode_rays, decoder_inputs, multiply_rows_plainly
from .kernels.features import add_lamps, add_surfels, sky_features, sum_surfels
from .kernels.nearby import light_of_patches, near_field_light, reflect_on_surfels, share_among_patches
from .kernels.pixels import mean_over_surface
from .kernels.shadow import draw_occluders, draw_sides, find_bounds, look_up, project_casters
from .kernels.surfels import reflect_on_rays, surfel_radiance
from .kernels.tiles import ROWS, multiply_rows

_LANES_OF_OCCLUDERS = 1 << 15  # threads of a view, at most, unless there are more triangles
_BOUND_PARTS = 32  # times the lanes: threads that look for the bounds of a view's points
_DISCS = "vertices", "normals", "area_m2", "radiance_of_surfels"
_PATCHES = "patch_count", "patch_position", "patch_normal", "patch_area_m2", "emitted"


def add_shadows(frame: LitBuffers) -> None:
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


def _add_look_ups(frame: LitBuffers, seen: tuple[str, ...]) -> None:
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


def add_decoder(frame: LitBuffers) -> None:
    """Add the decoding of rays."""
    rays, near = frame.shape.rays, frame.model.field.near_channels
    inputs = new_decoder_inputs(frame)
    frame.named("cells", part_of(frame["towards"], 0, SKY_DIRECTIONS))
    at = "view_direction", "normal", "cells", "open_sky"
    frame.add(decoder_inputs, rays, "ray_count", "channels", "alpha", near, *at, inputs)
    add_decoder_layers(frame, inputs)
    channels = COEFFICIENTS + RELIGHTABLE_FEATURES
    frame.new("low", wp.float32, rays, channels)
    frame.add(decode_rays, (rays, channels), "ray_count", COEFFICIENTS, "raw", "alpha", "low")


def new_decoder_inputs(frame: FrameBuffers[Any, Any]) -> wp.array:
    """Make the rows of what goes into the decoder, as wide as its first layer."""
    return frame.new("decoder_inputs", frame.half, frame.shape.rays + int(ROWS), frame.networks.decoder[0].inputs)


def add_decoder_layers(frame: FrameBuffers[Any, Any], inputs: wp.array) -> None:
    """Add the decoder's layers, from its inputs to `raw`."""
    rays = frame.shape.rays
    rows, layers = rays + int(ROWS), frame.networks.decoder
    frame.constant("every_row", np.ones((rows, 1)), wp.float32)
    hidden = [frame.new(f"hidden{number}", frame.half, rows, layer.outputs) for number, layer in enumerate(layers[:-1])]
    answers = *hidden, frame.new("raw", wp.float32, rows, layers[-1].outputs)
    tiles, values = -(-rays // int(ROWS)), inputs
    for layer, answer in zip(layers, answers, strict=True):
        add_products(frame, tiles, layer, ("ray_count", 0, "one_tap"), values, "every_row", answer)
        values = answer


def add_products(
    frame: FrameBuffers[Any, Any],
    tiles: int,
    layer: Layer,
    rows: tuple[str, int, str],
    values: wp.array,
    mask: str,
    answer: wp.array,
) -> None:
    """Add a layer of a network; `rows` are the limit, the first, and the shifts of rows that are multiplied."""
    limit, first, shifts = rows
    given = frame[limit], first, frame[shifts], values, layer.weight, layer.bias, frame[mask], layer.slope, layer.kept
    if frame.has_tiles:
        frame.sequence.add_tiles(multiply_rows, (tiles, layer.blocks), *given, answer)
        return
    dim = tiles * int(ROWS), layer.weight.shape[2] // int(FEW)
    frame.sequence.add(multiply_rows_plainly, dim, *given, answer)


def add_light(frame: LitBuffers) -> None:
    """Add the light features of rays, smoothed over neighbours on the same surface."""
    shape, vertices = frame.shape, len(frame.model.albedo)
    of_sky = "towards", "flux"
    lamps = *LAMP_COLUMNS, "lamp_rgb"
    frame.new("radiance_of_surfels", wp.vec3, vertices)
    skin = "vertices", "normals", "albedo"
    at_surfels = *of_sky, "surfel_sky_lit", *SURFEL_LAMP_COLUMNS, "lamp_rgb", "surfel_lamp_lit"
    frame.add(surfel_radiance, vertices, *skin, *at_surfels, "radiance_of_surfels")
    if shape.has_patches:
        _add_patches(frame)
    parts = frame.lanes
    frame.new("surfel_sums", wp.float32, vertices, parts, 4)
    frame.new("received", wp.vec3, vertices)
    frame.add(add_surfels, (vertices, parts), "vertices", "normals", *_DISCS, parts, "surfel_sums")
    frame.add(sum_surfels, vertices, "surfel_sums", "received")
    _name_features(frame)
    points = "normal", "relief_normal", "view_direction"
    sky = *of_sky, "brightness", "sky_share", "sky_lit", "sky_depth_in_m"
    frame.add(sky_features, shape.rays, "ray_count", *points, *sky, "sky_vectors", "lobe_visibility", "scattered")
    if shape.samples:
        of_lamps = *lamps, "lamp_lit", "lamp_depth_in_m", "lamp_vectors", "scattered"
        frame.add(add_lamps, shape.rays, "ray_count", "position", "normal", "relief_normal", *of_lamps)
    at = "corner", "corner_weight", "position", "normal"
    frame.add(reflect_on_rays, shape.rays, "ray_count", *at, *_DISCS, "received", "reflected")
    if shape.has_patches:
        _add_near_rays(frame)
    of_rays = "pixel", "row", shape.size_px[0], "position", "normal", "off_plane_m"
    frame.add(mean_over_surface, shape.rays, "ray_count", *of_rays, 1, "lamp_radius_rad", "light", "smooth_light")


def _name_features(frame: LitBuffers) -> None:
    """Make the rows of features, and name their columns as `LightFeatures` does."""
    at = ray_row_columns(frame.shape.lamps)
    columns = at["reflected"].stop
    light = frame.new("light", wp.float32, frame.shape.rays, columns)
    frame.new("smooth_light", wp.float32, frame.shape.rays, columns)
    columns_of(light, at["arriving"].start, wp.float32, (3,)).fill_(1.0)
    frame.named("lamp_vectors", columns_of(light, 0, wp.vec3, (frame.shape.lamps,)))
    frame.named("sky_vectors", columns_of(light, at["sky_vectors"].start, wp.vec3, (3,)))
    frame.named("lobe_visibility", columns_of(light, at["lobe_visibility"].start, wp.float32, (2,)))
    at_near = at["near_field_specular"].start
    frame.named("near_field_specular", columns_of(light, at_near, wp.vec3, (2,)))
    frame.named("scattered", columns_of(light, at["scattered"].start, wp.vec3, (2,)))
    frame.named("reflected", columns_of(light, at["reflected"].start, wp.vec3, ()))


def _add_patches(frame: LitBuffers) -> None:
    """Add what patches receive of the light and of the hand, what they reflect, and what surfels receive of that."""
    vertices, parts = len(frame.model.albedo), frame.lanes
    _name_tables(frame)
    lamps = *SURFEL_LAMP_COLUMNS, "lamp_rgb"
    white, lit = ("point_position", "point_normal", "white"), ("patch_sky_lit", *lamps, "patch_lamp_lit")
    frame.new("of_points", wp.vec3, POINTS)
    frame.add(surfel_radiance, POINTS, *white, "towards", "flux", *lit, "of_points")
    sums = frame.new("patch_sums", wp.float32, MOST_PATCHES, parts, 4)
    at = "patch_position", "patch_normal"
    frame.add(add_surfels, (MOST_PATCHES, parts), *at, *_DISCS, parts, sums)
    for name in ("first_light", "of_hand", "emitted"):
        frame.new(name, wp.vec3, MOST_PATCHES)
    of_points = "of_points", "point_share", "patch_start", "patch_albedo", sums, "first_light", "of_hand"
    frame.add(light_of_patches, MOST_PATCHES, *of_points)
    shared = *_PATCHES[:4], "patch_albedo", "first_light", "of_hand", "emitted"
    frame.add(share_among_patches, MOST_PATCHES, *shared)
    of_patches = *_PATCHES, "surfel_open_sky", "sky_cell", "sky_weight"
    frame.add(reflect_on_surfels, vertices, "vertices", "normals", "albedo", *of_patches, "radiance_of_surfels")


def _name_tables(frame: LitBuffers) -> None:
    nearest, weights = sky_cells(frame.model.albedo.device)
    frame.constant("sky_cell", nearest, wp.int64)
    frame.constant("sky_weight", weights, wp.float32)
    frame.constant("white", np.ones((POINTS, 3)), wp.vec3)


def _add_near_rays(frame: LitBuffers) -> None:
    """Add the light of patches on rays to what they receive of the rest."""
    at = "position", "normal", "relief_normal", "view_direction"
    of_patches = *_PATCHES, "open_sky", "sky_cell", "sky_weight"
    light = "sky_vectors", "near_field_specular", "scattered"
    frame.add(near_field_light, frame.shape.rays, "ray_count", *at, *of_patches, *light)
