"""The last launches of a lit frame: super-resolution, the surface's detail, and its colours in the light."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from ...light.lighting import COEFFICIENTS, RELIGHTABLE_FEATURES
from ...surface.hairs import SEGMENTS
from .blocks import part_of, stride_of
from .frame_buffers import COVERED, EDGES, FrameBuffers, LitBuffers
from .frame_light import add_products
from .kernels.detail import add_skin
from .kernels.edges import develop_pixels, edge_shares, list_edges, mark_pixels, sample_faces, spread_coverage
from .kernels.hairs import draw_hairs, pose_hairs
from .kernels.hits import list_covered, paint_maps
from .kernels.pixels import enlarge_pixels, ray_shares, smooth_pixels, step_pixels
from .kernels.relight import relit_pixels
from .kernels.tiles import ROWS

_LANES = 1


def add_coverage(frame: LitBuffers) -> None:
    """Add what full-size pixels show of the surface, and where one part of it ends before another."""
    width, height = (2 * size for size in frame.shape.size_px)
    pixels, edges, faces = width * height, frame.shape.edges, len(frame.model.template.faces)
    for name, kind in (
        ("on_outline", wp.bool),
        ("between", wp.float32),
        ("part", wp.int32),
        ("coverage", wp.float32),
        ("seen_m", wp.float32),
        ("seen_face", wp.int64),
    ):
        frame.new(name, kind, pixels)
    frame.new("edge_pixel", wp.int64, edges)
    frame.new("shows_first", wp.bool, 9, edges)
    frame.new("edge_share", wp.float32, edges)
    frame.named("edge_count", part_of(frame["counts"], EDGES, 1))
    parts, sizes = ("bone_of_face", "apart"), (width, height)
    frame.add(mark_pixels, pixels, "shown", *parts, *sizes, "part_steps", "on_outline", "between", "part")
    listed = "edge_count", "edge_pixel", "slot", "has_overflow"
    frame.add(list_edges, pixels, "between", "part", edges, *listed)
    looked_for = "on_outline", "slot", "sample_bits", "samples"
    frame.add(sample_faces, (faces, _LANES), "fine_at", "fine_faces", _LANES, *sizes, *looked_for)
    shown = "shown", "on_outline", "sample_bits", *sizes, "coverage", "seen_m", "seen_face"
    frame.add(spread_coverage, pixels, *shown)
    about = "edge_pixel", "shown", *sizes, "between", "part", *parts, "slot", "samples"
    frame.add(edge_shares, edges, "edge_count", *about, "shows_first", "edge_share")


def add_superres(frame: LitBuffers) -> None:
    """Add the maps of rays, and the convolutions over them."""
    width, rays = frame.shape.size_px[0], frame.shape.rays
    of_rays = "ray_count", "pixel", "row", width, "low", "alpha", "hit_m", "edge_m", "rings"
    shown = "relief_normal", "position", "view_direction", "world2cam", COEFFICIENTS + RELIGHTABLE_FEATURES
    frame.add(paint_maps, rays, *of_rays, *shown, "maps34", "padded", "depth_of_rays")
    add_convolutions(frame)


def add_convolutions(frame: FrameBuffers[Any, Any]) -> None:
    """Add the convolutions of super-resolution, from `padded` to `tail`."""
    width, height = frame.shape.size_px
    stride, rows = width + 2, frame.image_rows
    inside = np.zeros((rows, 1), np.float32)
    inside[: (height + 2) * stride].reshape(height + 2, stride)[1:-1, 1:-1] = 1
    frame.constant("inside", inside, wp.float32)
    shifts = np.array([(tap // 3 - 1) * stride + tap % 3 - 1 for tap in range(9)], np.int32)
    frame.constant("nine_taps", shifts, wp.int32)
    first, last = stride + 1, (height + 1) * stride - 1
    frame.constant("last_row", np.array([last], np.int32), wp.int32)
    layers = frame.networks.superres
    images = [frame.new(f"image{number}", frame.half, rows, layers[0].outputs) for number in range(2)]
    tail = frame.new("tail", wp.float32, rows, layers[-1].outputs)
    tiles, values = -(-(last - first) // int(ROWS)), frame["padded"]
    for number, layer in enumerate(layers):
        answer = tail if number == len(layers) - 1 else images[number % 2]
        add_products(frame, tiles, layer, ("last_row", first, "nine_taps"), values, "inside", answer)
        values = answer


def add_pixels(frame: LitBuffers) -> None:
    """Add the pixels of the full-size image, in no light."""
    (width, height), most = frame.shape.size_px, 4 * frame.shape.rays
    frame.new("covered", wp.int64, most)
    for name in ("view_of_pixel", "even_normal", "bump_normal", "surface_normal", "blurred_normal"):
        frame.new(name, wp.vec3, most)
    for name in ("alpha_squared", "nail"):
        frame.new(name, wp.float32, most)
    frame.new("coefficients", wp.float32, most, COEFFICIENTS)
    frame.new("shares", wp.float32, most, 4)
    frame.named("covered_count", part_of(frame["counts"], COVERED, 1))
    found = "covered_count", "covered", "view_of_pixel", "has_overflow"
    frame.add(list_covered, most, "row", width, "full_view", most, *found)
    maps = maps_of(frame["maps34"], width, height)
    detail = "tail", width + 2, 1
    frame.add(enlarge_pixels, most, "covered_count", maps, *detail, "covered", "world2cam", "values", "alphas")
    frame.add(smooth_pixels, most, "covered_count", "values", "covered", 2 * width, "coefficients", "even_normal")
    at = "covered", width, "depth_of_rays", "seen_m", "edge_m"
    frame.add(ray_shares, most, "covered_count", *at, "shares")
    steps = "covered", "shares", "row", width, "relief_normal", "even_normal", "bump_normal"
    frame.add(step_pixels, most, "covered_count", *steps, maps, "alphas", "coefficients")
    _add_skin(frame, most)


def maps_of(rows: wp.array, width: int, height: int) -> wp.array:
    """Return rows [h * w, C] of pixels as maps [C, h, w], without a copy."""
    strides, shape = (4, width * stride_of(rows), stride_of(rows)), (rows.shape[1], height, width)
    return wp.array(ptr=rows.ptr, dtype=wp.float32, shape=shape, strides=strides, device=rows.device)


def _add_skin(frame: LitBuffers, most: int) -> None:
    maps = frame.model.maps
    resolution = 1 if maps.ratio is None else maps.ratio.resolution
    seen = "seen_face", "seen_m", "coverage", "full_view"
    surface = "fine", "fine_normals", "fine_faces", "fine_uv", "fine_flex"
    tables = "maps", "maps_first", maps.resolution, "ratio", "ratio_first", resolution
    of_blood = "drains", "drains_log_albedo", "pressed"
    of_pixels = "skin_constants", "pigment_colour", *of_blood, "covered", "view_of_pixel"
    written = "coefficients", "bump_normal", "surface_normal", "blurred_normal", "alpha_squared", "nail", "alphas"
    frame.add(add_skin, most, "covered_count", *seen, *surface, *tables, *of_pixels, *written)


def add_colours(frame: LitBuffers) -> None:
    """Add the colours of pixels in the light, and the frame's pixels."""
    (width, _), most = frame.shape.size_px, 4 * frame.shape.rays
    normals = "bump_normal", "surface_normal", "blurred_normal", "alpha_squared", "view_of_pixel"
    lit = "shares", "smooth_light", "row", width, "lamp_rgb", "lamp_radius_rad"
    skin = "nail", "sharpness", "radiance", "lobes"
    frame.add(relit_pixels, most, "covered_count", "covered", "coefficients", *normals, *lit, *skin, "colours")
    edges = "slot", frame.shape.edges, "shows_first", "edge_share"
    if frame.shape.has_hairs:
        _add_hairs(frame)
    hairs = "hair_sums", "hair_depth_bits", "hair_unit"
    frame.add(
        develop_pixels,
        most,
        "colours",
        "alphas",
        "seen_m",
        2 * width,
        *edges,
        *hairs,
        "rgb",
        "pixel_alpha",
        "pixel_depth",
    )


def _add_hairs(frame: LitBuffers) -> None:
    """Add what hairs cover of pixels, and their colours there."""
    hairs, width = frame.model.hairs, frame.shape.size_px[0]
    count = len(hairs.radius_m)
    tables = {
        "hair_corners": (hairs.corners, wp.int64),
        "hair_weights": (hairs.weights, wp.vec3),
        "hair_rise": (hairs.rise, wp.vec3),
        "hair_bend": (hairs.bend, wp.vec3),
        "hair_radius_m": (hairs.radius_m, wp.float32),
        "hair_albedo": (np.array(frame.model.hair_albedo), wp.float32),
    }
    for name, (values, kind) in tables.items():
        frame.constant(name, values, kind)
    for name in ("hair_points", "hair_placed"):
        frame.new(name, wp.vec3, count, SEGMENTS + 1)
    frame.new("hair_normal", wp.vec3, count)
    frame.new("hair_ray", wp.int32, count)
    grown = "hair_corners", "hair_weights", "hair_rise", "hair_bend", "fine", "fine_normals", "scale"
    seen = "full_K", "world2cam", "window", width, "row", "seen_m"
    posed = "hair_points", "hair_placed", "hair_normal"
    frame.add(pose_hairs, count, "hair_count", *grown, *seen, *posed, "hair_ray", "longest_bits")
    of_view = "units", "full_view", "window", width, "seen_m"
    of_light = "smooth_light", "lamp_rgb", "hair_albedo", "hair_unit"
    drawn = *posed, "hair_radius_m", "hair_ray", "longest_bits", *of_view, *of_light
    frame.add(draw_hairs, (count, SEGMENTS), "hair_count", *drawn, "hair_sums", "hair_depth_bits")
