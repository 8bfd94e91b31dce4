"""The paper's renderer as published, built from the backend's parts: the baseline of `livehand benchmark`.

It renders the whole frame at half resolution without a crop. Every ray has one interval, from the first to the last
surface of the inflated mesh, with 16 samples, each of which searches all faces for the nearest; a 4 x 128 MLP follows,
then super-resolution of the whole frame in the plain layout (NCHW) and single precision. It is faster than the
authors' code in three places: the nearest faces are found by a better loop (`brute_force.py`), the MLP runs in chunks
that stay in the cache, and the constant modulation of the convolutions is folded in.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...avatars.avatar import Avatar
from ...field.conditions import FieldInputs
from ...field.rays import CameraTensors, camera_tensors, project, ray_directions, ray_origin
from ...field.volume import Composite, Steps
from ...geometry.closest_point import closest_on_triangles
from ...geometry.mesh import PosedMesh, Topology, posed_mesh
from ...geometry.rasterise import rasterise
from ...geometry.uvh import SurfaceSamples, atlas_uv, signed_height
from ...hand.model import HandModel
from ...hand.topology import topology_of
from ...image.crop import Crop
from ...image.decode import decode_frame
from ...image.maps import low_resolution_maps
from ...records.frame import Frame
from ...records.render_hooks import Stage
from ...records.shot import Shot
from .brute_force import nearest_faces

_RAYS_AT_ONCE = 1024


class WholeRays(NamedTuple):
    """R rays: pixel [R], directions [R, 3] of depth 1, depths t [R, N] of the samples in m, their step dt [R] in m."""

    pixel: Tensor
    directions: Tensor
    t: Tensor
    dt: Tensor


class PublishedRenderer:
    """Renders an avatar of the `paper` configuration as its authors do, for the hand's own side only.

    Args:
        avatar: the avatar; its networks are copied, the caller's are neither moved nor changed.
        hand: its hand model.
        device: to render on.
    """

    def __init__(self, avatar: Avatar, hand: HandModel, device: torch.device):
        self.avatar, self.device = avatar, device
        self._topology = topology_of(hand, device)
        self._field, self._superres = (deepcopy(n).to(device).eval() for n in (avatar.field, avatar.superres))

    @torch.inference_mode()
    def render(self, shot: Shot, on_stage: Callable[[Stage], None] = lambda stage: None) -> Frame:
        """Render one frame of the shot's size; `on_stage` receives the name of each stage as it begins."""
        on_stage("pose")
        vertices = torch.as_tensor(np.ascontiguousarray(shot.vertices), dtype=torch.float32, device=self.device)
        mesh = posed_mesh(self._topology, vertices)
        low_camera = shot.camera.scaled(0.5)
        view = camera_tensors(low_camera, self.device)
        on_stage("rasterise")
        rays = whole_rays(mesh, self._topology, view, self.avatar.config.sampler.shell_m, self._samples_per_ray)
        on_stage("sample")
        samples = nearest_samples(_points(rays, view), self._topology, mesh)
        on_stage("field")
        low = self._shade(rays, samples, torch.as_tensor(shot.pose.theta, dtype=torch.float32), mesh.scale)
        on_stage("superres")
        maps, depth = low_resolution_maps(low, rays.pixel, view.size_px)
        image = self._superres(maps[None].contiguous())[0]
        on_stage("decode")
        depth = depth.repeat_interleave(2, 0).repeat_interleave(2, 1)
        return decode_frame(image, depth, Crop(0, 0, *low_camera.size_px), shot.camera.size_px)

    @property
    def _samples_per_ray(self) -> int:
        return self.avatar.config.sampler.samples_per_ray

    def _shade(self, rays: WholeRays, samples: SurfaceSamples, theta: Tensor, scale: Tensor) -> Composite:
        """Run the MLP at all samples, and composite along each ray."""
        count = self._samples_per_ray
        length = rays.directions.norm(dim=-1)
        height = samples.height_m / self.avatar.config.sampler.shell_m
        theta = theta.reshape(-1).to(self.device)
        is_stopped = torch.zeros_like(rays.pixel, dtype=torch.bool)
        of_samples = (atlas_uv(self._topology, samples), height)
        of_rays = (rays.directions / length[:, None], rays.t, rays.dt * length / scale * 1000, is_stopped)
        by_sample = (values.split(_RAYS_AT_ONCE * count) for values in of_samples)
        by_ray = (values.split(_RAYS_AT_ONCE) for values in of_rays)
        parts = [
            self._field(FieldInputs.of_paper(uv, height, view, theta), Steps(*steps))
            for uv, height, view, *steps in zip(*by_sample, *by_ray, strict=True)
        ]
        return Composite(*(torch.cat(values) for values in zip(*parts, strict=True)))


def whole_rays(mesh: PosedMesh, topology: Topology, view: CameraTensors, shell_m: float, count: int) -> WholeRays:
    """Place `count` samples per ray at the centres of equal strata, from the inflated mesh's first to last surface."""
    positions_px, depth = project(view, mesh.vertices + shell_m * mesh.scale * mesh.normals)
    fragments = rasterise(positions_px, depth, topology.faces, view.size_px)
    empty = depth.new_full((view.size_px[0] * view.size_px[1],), torch.inf)
    near = empty.scatter_reduce(0, fragments.pixel, fragments.depth, "amin")
    far = (-empty).scatter_reduce(0, fragments.pixel, fragments.depth, "amax")
    (pixel,) = torch.where(far > near)
    near, dt = near[pixel], (far - near)[pixel] / count
    strata = torch.arange(count, device=near.device) + 0.5
    return WholeRays(pixel, ray_directions(view, pixel), near[:, None] + strata * dt[:, None], dt)


def nearest_samples(points: Float[Tensor, "S 3"], topology: Topology, mesh: PosedMesh) -> SurfaceSamples:
    """Find the nearest surface point of every sample by searching all faces."""
    triangles = mesh.vertices[topology.faces]
    face = nearest_faces(points, triangles)
    barycentric, squared = closest_on_triangles(points, triangles[face])
    height = signed_height(points, SurfaceSamples(face, barycentric, squared.sqrt()), topology, mesh)
    return SurfaceSamples(face, barycentric, height / mesh.scale)


def _points(rays: WholeRays, view: CameraTensors) -> Float[Tensor, "S 3"]:
    return (ray_origin(view) + rays.t[..., None] * rays.directions[:, None, :]).reshape(-1, 3)
