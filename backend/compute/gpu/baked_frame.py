"""A whole frame in the light of a capture as one sequence of launches: as `lit_frame`, of avatars without a surface.

Its rays are sampled along all of the shell, the light that reaches the hand is a code of each vertex, and the colours
come out of super-resolution as they are. Lamps, occluders and hair do not show in it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
import warp as wp

from ...field.conditions import LIGHT_CHANNELS, LOCAL_POSE_CHANNELS
from ...field.sampler import BEFORE_M, BEHIND_M, LEAST_REACH_M
from ...geometry.tolerances import TRANSPARENT
from ...light.visibility import BIAS_M, DIRECTIONS, MAP_PX, direction_frames
from ..whole_frames import BakedModel, BakedShot, RayOpacity, ShotPixels
from .blocks import HostBlock, Layout, part_of
from .frame_buffers import RAYS, FrameBuffers, Layouts, answer_layout, padded_layout
from .frame_image import add_convolutions, maps_of
from .frame_light import add_decoder_layers, new_decoder_inputs
from .frame_model import DeviceModel, Tables, precision_on
from .frame_parameters import CAMERA, fill_camera, focal_of
from .frame_pose import MOTION, on_pose_bits
from .frame_rays import add_sampled_rays
from .frame_shape import ImageShape
from .kept_frames import KeptFrames
from .kernels.baked import baked_inputs, decode_pixels, light_codes, paint_rays, place_in_maps
from .kernels.hits import project_layers
from .kernels.shadow import draw_nearest, fill_lit_share
from .kernels.skinning import mesh_surface, vertex_conditions
from .ray_stages import CAPACITY

BakedBuffers = FrameBuffers[BakedModel, ImageShape]
_POSE_CHANNELS = 3 + 9 + LOCAL_POSE_CHANNELS
_OF_RAYS = {"t": wp.float32, "dt": wp.float32, "weights": wp.float32, "row": wp.int32, "counts": wp.int32}
"""What of rays goes back to the host beside the pixels."""


class BakedFrame:
    """Frames of one shape: buffers, and the sequence over them."""

    def __init__(self, on_device: DeviceModel[BakedModel], shape: ImageShape) -> None:
        layouts = baked_layouts(on_device.model, shape, precision_on(on_device.device))
        self.buffers: BakedBuffers = FrameBuffers(on_device, shape, layouts, CAPACITY)
        frame = self.buffers
        frame.add_begin()
        _add_mesh(frame)
        _add_visibility(frame)
        _add_shell_of_mesh(frame)
        add_sampled_rays(frame, TRANSPARENT)
        _add_decoder(frame)
        _add_image(frame)
        for name in _OF_RAYS:
            frame.sequence.then(lambda name=name: wp.copy(frame[f"host_{name}"], frame[name]))
        frame.add_end()

    def render(self, shot: BakedShot) -> tuple[ShotPixels, RayOpacity] | None:
        """Render a frame, as `BakedFrameRenderer.render`; None: a list has overflowed."""
        frame = self.buffers
        _fill_parameters(frame.host, frame.model, shot)
        pixels = frame.rendered()
        if pixels is None:
            return None
        t, dt, weights, row, counts = (frame.answer[f"host_{name}"] for name in _OF_RAYS)
        rays, (width, height) = int(counts[RAYS]), frame.shape.size_px
        return pixels, RayOpacity(row.reshape(height, width), t[:rays], dt[:rays], weights[:rays])


def baked_frames(model: BakedModel, device: str) -> KeptFrames[BakedShot, ImageShape, tuple[ShotPixels, RayOpacity]]:
    """Return what renders frames of a model in any shape."""
    on_device = DeviceModel.of(model, _tables_of(model), device)
    return KeptFrames(lambda shot: ImageShape(shot.camera.size_px), lambda shape: BakedFrame(on_device, shape))


def _tables_of(model: BakedModel) -> Tables:
    config, light = model.superres.config, model.field.light
    return {
        "map_frames": (direction_frames(DIRECTIONS, "cpu"), wp.mat33),
        "light_weight": (light.weight, wp.float32),
        "light_bias": (light.bias, wp.float32),
        "grade": (np.array((*config.gain, *config.bias), np.float32), wp.float32),
        # Of the motion of an avatar's surface, which `vertex_conditions` fills as well.
        "template": (np.zeros((model.vertices, 3), np.float32), wp.vec3),
        "mirror": (np.ones((1, 3), np.float32), wp.vec3),
        "flex": (np.zeros(model.vertices, np.float32), wp.float32),
    }


def baked_layouts(model: BakedModel, shape: ImageShape, half: Any) -> Layouts:
    """Lay out frames in the light of a capture."""
    rays, samples = shape.rays, model.sampler.samples_per_ray
    parameters: Layout = {
        "vertices": (wp.vec3, (model.vertices,)),
        "joint_pose": (wp.float32, (model.skinning.lbs_weights.shape[1], 9)),
        **CAMERA,
        "scale": (wp.float32, (1,)),
        "lifts_m": (wp.float32, (2,)),
        "reaches_m": (wp.float32, (3,)),
        "units": (wp.float32, (3,)),
        "sphere": (wp.float32, (5,)),
        "map_bias": (wp.float32, (1,)),
    }
    sizes = {"t": (rays, samples), "dt": (rays,), "weights": (rays, samples), "row": (rays,), "counts": (3,)}
    answer = {**answer_layout(shape), **{f"host_{name}": (kind, sizes[name]) for name, kind in _OF_RAYS.items()}}
    zeros: Layout = {
        "counts": (wp.int32, (3,)),
        "has_overflow": (wp.int32, (1,)),
        "farthest_bits": (wp.int32, (1,)),
        "crossings": (wp.int32, (rays,)),
        "maps33": (wp.float32, (rays, model.superres.head.in_channels)),
        **padded_layout(shape, half),
    }
    infinity: Layout = {
        "stop_bits": (wp.int32, (rays,)),
        "nearest": (wp.int32, (DIRECTIONS, MAP_PX**2)),
        "depth_of_rays": (wp.float32, (rays,)),
    }
    return Layouts(parameters, answer, zeros, {"row": (wp.int32, (rays,))}, infinity)


def _fill_parameters(host: HostBlock, model: BakedModel, shot: BakedShot) -> None:
    scale, shell_m, bias_m = shot.scale, model.sampler.shell_m * shot.scale, BIAS_M * shot.scale
    radius_m = float(shot.bounds.radius) + 2 * bias_m
    fill_camera(host, shot.camera)
    named: dict[str, Any] = {
        "vertices": shot.vertices,
        "joint_pose": shot.joint_pose,
        "window": shot.window_px,
        "scale": scale,
        "lifts_m": (shell_m, 0.0),
        "reaches_m": (scale * BEFORE_M, scale * BEHIND_M, scale * LEAST_REACH_M),
        "units": (model.sampler.shell_m, focal_of(shot.camera), scale),
        "sphere": (*shot.bounds.centre.tolist(), radius_m, bias_m),
        "map_bias": bias_m / radius_m,
    }
    for name, values in named.items():
        host[name][:] = values


def _add_mesh(frame: BakedBuffers) -> None:
    """Add the normals of the mesh, and what the field takes of its vertices."""
    vertices = frame.model.vertices
    motion = frame.constant("motion", np.zeros((vertices, MOTION)), wp.float32)
    frame.new("normals", wp.vec3, vertices)
    frame.new("area_m2", wp.float32, vertices)
    frame.new("vertex_channels", wp.float32, vertices, _POSE_CHANNELS + LIGHT_CHANNELS)
    of_mesh = "vertices", "faces", "start", "around"
    frame.add(mesh_surface, vertices, *of_mesh, motion, "normals", "area_m2", "farthest_bits")
    about = "vertices", "normals", "frame_neighbours", "frame_weights", "frame_template"
    moved = "skinning", "joint_pose", "template", "mirror", "scale", on_pose_bits(), "farthest_bits", "flex"
    frame.add(vertex_conditions, vertices, *about, *moved, "vertex_channels", motion)


def _add_visibility(frame: BakedBuffers) -> None:
    """Add the shadow maps of the hand by itself, and the code of the light that its vertices see."""
    vertices, faces = frame.model.vertices, len(frame.model.topology.faces)
    for name in ("placed", "lifted"):
        frame.new(name, wp.vec3, DIRECTIONS, vertices)
    lit = frame.new("lit", wp.float32, DIRECTIONS, vertices)
    of_maps = DIRECTIONS, vertices
    frame.add(place_in_maps, of_maps, "vertices", "normals", "sphere", "map_frames", "placed", "lifted")
    frame.add(draw_nearest, (DIRECTIONS, faces), "placed", "faces", MAP_PX, "nearest")
    frame.add(fill_lit_share, of_maps, "lifted", "nearest", MAP_PX, "map_bias", lit)
    of_light = "light_weight", "light_bias", _POSE_CHANNELS
    frame.add(light_codes, (vertices, LIGHT_CHANNELS), "normals", "map_frames", lit, *of_light, "vertex_channels")


def _add_shell_of_mesh(frame: BakedBuffers) -> None:
    """Add the shell about the mesh, in which no surface of the avatar's lies."""
    vertices, rays = frame.model.vertices, frame.shape.rays
    for name in ("moved", "points", "casters"):
        frame.new(name, wp.vec3, vertices)
    layers = frame.new("layers", wp.vec3, 4 * vertices)
    of_mesh = "vertices", "normals", "vertices", "K", "world2cam", "scale", "lifts_m"
    frame.add(project_layers, vertices, *of_mesh, "moved", layers.reshape((4, vertices)), "points", "casters")
    for number, name in ((0, "inflated"), (1, "deflated")):
        frame.named(name, part_of(layers, number * vertices, vertices))
    frame.constant("hit_m", torch.full((rays,), torch.inf), wp.float32)


def _add_decoder(frame: BakedBuffers) -> None:
    inputs, field = new_decoder_inputs(frame), frame.model.field
    of_rays = "ray_count", "channels", "alpha", field.normal_slice.start, "directions"
    frame.add(baked_inputs, frame.shape.rays, *of_rays, inputs)
    add_decoder_layers(frame, inputs)


def _add_image(frame: BakedBuffers) -> None:
    (width, height), rays = frame.shape.size_px, frame.shape.rays
    of_rays = "ray_count", "pixel", width, "raw", "alpha", "mean_depth"
    frame.add(paint_rays, rays, *of_rays, "maps33", "padded", "depth_of_rays")
    add_convolutions(frame)
    shown = "rgb", "pixel_alpha", "pixel_depth"
    maps = maps_of(frame["maps33"], width, height)
    frame.add(decode_pixels, 4 * rays, maps, "tail", "window", "grade", "depth_of_rays", *shown)
