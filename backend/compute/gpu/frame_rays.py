"""Launches of a lit frame: rays through the shell, what the field gathers along them, and where they meet the skin."""

from __future__ import annotations

from typing import Any

import torch
import warp as wp

from ...field.sampler import strata
from .blocks import part_of
from .frame_buffers import RAYS, FrameBuffers, LitBuffers
from .kernels.hits import list_rays, meet_skin
from .kernels.planes import gather_samples, sum_samples, weigh_samples
from .kernels.shell import face_corners, fill_intervals, find_crossings, trace_samples


def add_rays(frame: LitBuffers) -> None:
    """Add the rays: their list, their samples, the field at these, and where they meet the skin."""
    add_sampled_rays(frame)
    _add_hits(frame)


def add_sampled_rays(frame: FrameBuffers[Any, Any], transparent: float = 0.0) -> None:
    """Add the rays of frames of any kind: their list, their samples, and the field at these.

    Args:
        frame: to which they are added.
        transparent: as `weigh_samples` takes it.
    """
    _add_shell(frame)
    _add_samples(frame)
    _add_field(frame, transparent)


def _add_shell(frame: FrameBuffers[Any, Any]) -> None:
    (width, height), pixels, faces = frame.shape.size_px, frame.shape.rays, len(frame.model.topology.faces)
    for name, kind in (("crossing_m", wp.float32), ("crossing_face", wp.int32), ("start_m", wp.float32)):
        frame.new(name, kind, frame.capacity, pixels)
    for name in ("end_m", "since_m"):
        frame.new(name, wp.float32, frame.capacity, pixels)
    for name, kind in (("intervals", wp.int32), ("length_m", wp.float32), ("stopped", wp.bool), ("live", wp.bool)):
        frame.new(name, kind, pixels)
    lists = "crossings", "crossing_m", "crossing_face", "stop_bits"
    sizes = frame.lanes, width, height
    frame.add(find_crossings, (faces, frame.lanes), "inflated", "deflated", "faces", *sizes, *lists)
    inside = "start_m", "end_m", "since_m", "intervals", "length_m", "stopped", "live", "has_overflow"
    frame.add(fill_intervals, pixels, *lists, "hit_m", "reaches_m", frame.model.sampler.max_layers, *inside)
    frame.new("pixel", wp.int64, pixels)
    frame.new("directions", wp.vec3, pixels)
    frame.new("is_stopped", wp.bool, pixels)
    frame.named("ray_count", part_of(frame["counts"], RAYS, 1))
    found = "ray_count", "pixel", "row", "directions", "is_stopped", "has_overflow"
    frame.add(list_rays, pixels, "live", "stopped", "view", width, "window", "hit_m", pixels, *found)


def _add_samples(frame: FrameBuffers[Any, Any]) -> None:
    rays, samples, width = frame.shape.rays, frame.model.sampler.samples_per_ray, frame.shape.size_px[0]
    faces = len(frame.model.topology.faces)
    frame.new("corners", wp.vec3, faces, 3)
    frame.add(face_corners, (faces, 3), "moved", "faces", "corners")
    offsets = strata(rays, samples, torch.zeros(1), None)
    frame.constant("offsets", offsets, wp.float32)
    frame.new("t", wp.float32, rays, samples)
    frame.new("dt", wp.float32, rays)
    for name, kind in (("sample_face", wp.int64), ("sample_weights", wp.vec3), ("sample_height", wp.float32)):
        frame.new(name, kind, rays * samples)
    lists = "crossings", "crossing_m", "crossing_face", "start_m", "end_m", "since_m", "intervals", "length_m"
    surface = "moved", "normals", "faces", "neighbours", "corners", "scale"
    found = (frame[name].reshape((rays, samples)) for name in ("sample_face", "sample_weights", "sample_height"))
    of_rays = "ray_count", "view", width, "pixel", "offsets", "hit_m"
    frame.add(trace_samples, rays, *of_rays, *lists, *surface, "t", "dt", *found)


def _add_field(frame: FrameBuffers[Any, Any], transparent: float) -> None:
    rays, samples = frame.shape.rays, frame.model.sampler.samples_per_ray
    channels = frame.model.field.gathered_channels
    frame.new("gathered", wp.float32, rays * samples, channels)
    frame.new("sigma", wp.float32, rays, samples)
    at = "sample_face", "sample_weights", "sample_height", "t", "units", "faces", "corner_uv", "vertex_channels"
    of_field = "planes", "planes_layout", "texels_m", "near_weight", "near_bias", "density_weight", "density_bias"
    frame.add(gather_samples, (rays, samples), "ray_count", *at, *of_field, "gathered", "sigma")
    for name in ("alpha", "mean_depth"):
        frame.new(name, wp.float32, rays)
    frame.new("weights", wp.float32, rays, samples)
    frame.new("channels", wp.float32, rays, channels)
    steps = "sigma", "t", "dt", "directions", "is_stopped", "units", transparent
    frame.add(weigh_samples, rays, "ray_count", *steps, "alpha", "mean_depth", "weights")
    frame.add(sum_samples, (rays, channels), "ray_count", "gathered", "weights", "channels")


def _add_hits(frame: LitBuffers) -> None:
    rays, width = frame.shape.rays, frame.shape.size_px[0]
    frame.new("corner", wp.int64, rays, 3)
    frame.new("corner_weight", wp.float32, rays, 3)
    for name in ("view_direction", "normal", "relief_normal"):
        frame.new(name, wp.vec3, rays)
    layers = "shown_mesh", "shown_outer", "hit_m", "hit_normals"
    rendered = "t", "dt", "weights", "channels", "alpha", frame.model.field.near_channels
    of_mesh = "vertices", "faces", "edge_m"
    found = "corner", "corner_weight", "position", "on_surface", "view_direction", "normal", "relief_normal"
    frame.add(meet_skin, rays, "ray_count", "pixel", width, "view", *layers, *rendered, *of_mesh, *found)
