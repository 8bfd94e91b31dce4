"""Launches of a lit frame: shadows, what the decoder makes of rays, and the light at them."""

from __future__ import annotations

import warp as wp

from ...image.shading import ray_row_columns
from ...light.lighting import COEFFICIENTS, RELIGHTABLE_FEATURES
from ...light.sky_samples import SKY_DIRECTIONS
from .blocks import address_of, columns_of, part_of, stride_of
from .frame_buffers import FrameBuffers
from .frame_model import Layer
from .frame_parameters import LAMP_COLUMNS
from .kernels.decoder import FEW, decode_rays, decoder_inputs, multiply_rows_plainly
from .kernels.features import add_lamps, add_surfels, sky_features, sum_surfels
from .kernels.pixels import mean_over_surface
from .kernels.shadow import draw_sides, find_bounds, look_up, project_casters
from .kernels.surfels import reflect_on_rays, surfel_radiance
from .kernels.tiles import ROWS, multiply_rows

_BOUND_PARTS = 32  # times the lanes: threads that look for the bounds of a view's points


def add_shadows(frame: FrameBuffers) -> None:
    """Add the shadows of all views: of the sky and of lamps, at rays and at surfels."""
    model, shape = frame.model, frame.shape
    vertices, views = len(model.albedo), shape.views
    parts = 1 if frame.lanes == 1 else _BOUND_PARTS * frame.lanes
    seen = "ray_count", "sphere", "frames", "distance", "table"
    frame.add(find_bounds, (views, parts), *seen, "points", parts, "bounds")
    casting = max(vertices, model.casting_vertices)
    frame.new("placed", wp.vec3, views, vertices + model.casting_vertices)
    frame.add(project_casters, (views, casting), *seen, "bounds", "casters", "placed")
    faces = max(len(model.topology.faces), model.casting_faces)
    frame.add(draw_sides, (views, faces), "table", "placed", "casting_faces", "shadow_maps")
    most = vertices + shape.rays
    lit, depth_in_m = (frame.new(name, wp.float32, views, most) for name in ("lit", "depth_in_m"))
    frame.add(look_up, (views, most), *seen, "points", "bounds", "shadow_maps", "lengths", lit, depth_in_m)
    first, second = shape.sky, shape.sky + shape.samples
    for name, values in (("lit", lit), ("depth_in_m", depth_in_m)):
        frame.named(f"sky_{name}", _block_of(values, 0, vertices, shape.sky, shape.rays))
        frame.named(f"cell_{name}", _block_of(values, 0, vertices, SKY_DIRECTIONS, shape.rays))
        frame.named(f"lamp_{name}", _block_of(values, first, 0, shape.samples, shape.rays))
        frame.named(f"surfel_sky_{name}", _block_of(values, 0, 0, shape.sky, vertices))
        frame.named(f"surfel_lamp_{name}", _block_of(values, second, 0, shape.samples, vertices))


def _block_of(values: wp.array, row: int, column: int, rows: int, columns: int) -> wp.array:
    """Return a part of a matrix, without a copy."""
    at = address_of(values) + row * stride_of(values) + 4 * column
    strides = stride_of(values), 4
    return wp.array(ptr=at, dtype=wp.float32, shape=(rows, columns), strides=strides, device=values.device)


def add_decoder(frame: FrameBuffers) -> None:
    """Add the decoding of rays."""
    rays, width = frame.shape.rays, frame.model.field.config.width
    rows = rays + int(ROWS)
    near = frame.model.field.near_channels
    inputs = frame.new("decoder_inputs", frame.half, rows, 64)
    frame.named("cells", part_of(frame["towards"], 0, SKY_DIRECTIONS))
    at = "view_direction", "normal", "cells", "cell_lit"
    frame.add(decoder_inputs, rays, "ray_count", "channels", "alpha", near, *at, inputs)
    frame.new("every_row", wp.float32, rows, 1).fill_(1.0)
    hidden = [frame.new(f"hidden{number}", frame.half, rows, width) for number in range(2)]
    answers = *hidden, frame.new("raw", wp.float32, rows, 64)
    tiles, values = -(-rays // int(ROWS)), inputs
    for layer, answer in zip(frame.networks.decoder, answers, strict=True):
        add_products(frame, tiles, layer, ("ray_count", 0, "one_tap"), values, "every_row", answer)
        values = answer
    channels = COEFFICIENTS + RELIGHTABLE_FEATURES
    frame.new("low", wp.float32, rays, channels)
    frame.add(decode_rays, (rays, channels), "ray_count", COEFFICIENTS, "raw", "alpha", "low")


def add_products(
    frame: FrameBuffers,
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


def add_light(frame: FrameBuffers) -> None:
    """Add the light features of rays, smoothed over neighbours on the same surface."""
    shape, vertices = frame.shape, len(frame.model.albedo)
    of_sky = "towards", "flux"
    lamps = *LAMP_COLUMNS, "lamp_rgb"
    frame.new("radiance_of_surfels", wp.vec3, vertices)
    skin = "vertices", "normals", "albedo"
    frame.add(
        surfel_radiance, vertices, *skin, *of_sky, "surfel_sky_lit", *lamps, "surfel_lamp_lit", "radiance_of_surfels"
    )
    parts = frame.lanes
    frame.new("surfel_sums", wp.float32, vertices, parts, 4)
    frame.new("received", wp.vec3, vertices)
    discs = "vertices", "normals", "area_m2", "radiance_of_surfels"
    frame.add(add_surfels, (vertices, parts), "vertices", "normals", *discs, parts, "surfel_sums")
    frame.add(sum_surfels, vertices, "surfel_sums", "received")
    _name_features(frame)
    points = "normal", "relief_normal", "view_direction"
    sky = *of_sky, "brightness", "sky_share", "sky_lit", "sky_depth_in_m"
    frame.add(sky_features, shape.rays, "ray_count", *points, *sky, "sky_vectors", "lobe_visibility", "scattered")
    if shape.samples:
        of_lamps = *lamps, "lamp_lit", "lamp_depth_in_m", "lamp_vectors", "scattered"
        frame.add(add_lamps, shape.rays, "ray_count", "position", "normal", "relief_normal", *of_lamps)
    at = "corner", "corner_weight", "position", "normal"
    frame.add(reflect_on_rays, shape.rays, "ray_count", *at, *discs, "received", "reflected")
    of_rays = "pixel", "row", shape.size_px[0], "position", "normal", "off_plane_m"
    frame.add(mean_over_surface, shape.rays, "ray_count", *of_rays, 1, "light", "smooth_light")


def _name_features(frame: FrameBuffers) -> None:
    """Make the rows of features, and name their columns as `LightFeatures` does."""
    at = ray_row_columns(frame.shape.lamps)
    columns = at["reflected"].stop
    light = frame.new("light", wp.float32, frame.shape.rays, columns)
    frame.new("smooth_light", wp.float32, frame.shape.rays, columns)
    columns_of(light, at["arriving"].start, wp.float32, (3,)).fill_(1.0)
    frame.named("lamp_vectors", columns_of(light, 0, wp.vec3, (frame.shape.lamps,)))
    frame.named("sky_vectors", columns_of(light, at["sky_vectors"].start, wp.vec3, (3,)))
    frame.named("lobe_visibility", columns_of(light, at["lobe_visibility"].start, wp.float32, (2,)))
    frame.named("scattered", columns_of(light, at["scattered"].start, wp.vec3, (2,)))
    frame.named("reflected", columns_of(light, at["reflected"].start, wp.vec3, ()))
