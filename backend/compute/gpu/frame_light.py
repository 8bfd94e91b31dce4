"""Launches of a lit frame: what the decoder makes of rays, and the light at them, with that of nearby geometry."""

from __future__ import annotations

import numpy as np
import warp as wp

from ...image.shading import ray_row_columns
from ...light.lighting import COEFFICIENTS, RELIGHTABLE_FEATURES
from ...light.near_field_light import sky_cells
from ...light.nearby_geometry import MOST_PATCHES
from ...light.sky_samples import SKY_DIRECTIONS
from .blocks import columns_of, part_of
from .frame_buffers import FrameBuffers
from .frame_model import Layer
from .frame_nearby import POINTS
from .frame_parameters import LAMP_COLUMNS, SURFEL_LAMP_COLUMNS
from .kernels.decoder import FEW, decode_rays, decoder_inputs, multiply_rows_plainly
from .kernels.features import add_lamps, add_surfels, sky_features, sum_surfels
from .kernels.nearby import light_of_patches, near_field_light, reflect_on_surfels, share_among_patches
from .kernels.pixels import mean_over_surface
from .kernels.surfels import reflect_on_rays, surfel_radiance
from .kernels.tiles import ROWS, multiply_rows

_DISCS = "vertices", "normals", "area_m2", "radiance_of_surfels"
_PATCHES = "patch_count", "patch_position", "patch_normal", "patch_area_m2", "emitted"


def add_decoder(frame: FrameBuffers) -> None:
    """Add the decoding of rays."""
    rays, width = frame.shape.rays, frame.model.field.config.width
    rows = rays + int(ROWS)
    near = frame.model.field.near_channels
    inputs = frame.new("decoder_inputs", frame.half, rows, 64)
    frame.named("cells", part_of(frame["towards"], 0, SKY_DIRECTIONS))
    at = "view_direction", "normal", "cells", "open_sky"
    frame.add(decoder_inputs, rays, "ray_count", "channels", "alpha", near, *at, inputs)
    frame.constant("every_row", np.ones((rows, 1)), wp.float32)
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
    at_near = at["near_field_specular"].start
    frame.named("near_field_specular", columns_of(light, at_near, wp.vec3, (2,)))
    frame.named("scattered", columns_of(light, at["scattered"].start, wp.vec3, (2,)))
    frame.named("reflected", columns_of(light, at["reflected"].start, wp.vec3, ()))


def _add_patches(frame: FrameBuffers) -> None:
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


def _name_tables(frame: FrameBuffers) -> None:
    nearest, weights = sky_cells(frame.model.albedo.device)
    frame.constant("sky_cell", nearest, wp.int64)
    frame.constant("sky_weight", weights, wp.float32)
    frame.constant("white", np.ones((POINTS, 3)), wp.vec3)


def _add_near_rays(frame: FrameBuffers) -> None:
    """Add the light of patches on rays to what they receive of the rest."""
    at = "position", "normal", "relief_normal", "view_direction"
    of_patches = *_PATCHES, "open_sky", "sky_cell", "sky_weight"
    light = "sky_vectors", "near_field_specular", "scattered"
    frame.add(near_field_light, frame.shape.rays, "ray_count", *at, *of_patches, *light)
