"""Pose, camera and mesh in; a photoreal frame out. The main road of the whole product.

Shot -> rasterised shell -> samples -> (u, v, h) -> field -> volume rendering -> low-resolution maps -> super-resolution
-> frame. Training takes the same road (`trace`, `shade`, `image_of`) with its own loss at the end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from .avatar import Avatar
from .camera import Camera
from .colour import srgb_to_linear
from .device import torch_device
from .errors import LiveHandError
from .field.conditions import FrameConditions, field_inputs
from .field.field import CHANNELS, PaperField, PlaneField
from .geometry.mesh import PosedMesh, Topology, posed_mesh
from .geometry.uvh import SurfaceSamples, project_to_surface
from .hand.model import MIRROR_AXIS_ANGLE, HandModel
from .sampler import SamplerConfig, View, project, sample_rays
from .shot import DEPTH_BACKGROUND, Frame, Shot, Side, empty_frame
from .volume import Composite, composite
from .window import Window, hand_window

Precision = Literal["fp32", "bf16"]
Stage = Literal["pose", "rasterise", "sample", "field", "volume", "superres", "develop"]

# Alpha under half a level of 8 bits is none: super-resolution is never exactly 0 beside the hand.
_NOTHING = 0.5 / 255
# Samples the field is asked for at once: bounds memory, and is how often a render can be stopped.
_SAMPLES_AT_ONCE = 65536


class RenderStopped(Exception):
    """The caller's `should_stop` said so."""


class SurfaceRays(NamedTuple):
    """R rays as in `RaySamples`, their N samples laid on the surface."""

    pixel: Tensor
    directions: Tensor
    t: Tensor
    dt: Tensor
    is_stopped: Tensor
    samples: SurfaceSamples


@dataclass(frozen=True)
class Renderer:
    """One avatar on one hand and device.

    Attributes:
        avatar: the look.
        hand: the model of the meshes it will be given, either side.
        device: `auto` takes CUDA where there is one.
        precision: of the networks; geometry is always fp32.

    Raises:
        LiveHandError: the avatar belongs to another hand model, or the device is not there.
    """

    avatar: Avatar
    hand: HandModel
    device: str = "auto"
    precision: Precision = "fp32"

    def __post_init__(self):
        if self.hand.sha256 != self.avatar.hand_sha256:
            raise LiveHandError(
                f"avatar '{self.avatar.name}' must be given its own hand model '{self.avatar.hand_name}' "
                f"(sha256 {self.avatar.hand_sha256[:12]}...), got '{self.hand.name}' ({self.hand.sha256[:12]}...); "
                "choose that hand, or an avatar of this one"
            )
        for network in (self.avatar.field, self.avatar.superres):
            network.to(self.torch_device).eval()

    @torch.inference_mode()
    def render(
        self,
        shot: Shot,
        should_stop: Callable[[], bool] = lambda: False,
        on_stage: Callable[[Stage], None] = lambda stage: None,
    ) -> Frame:
        """Render one frame of the shot's size.

        Args:
            shot: the posed hand and its view.
            should_stop: asked between chunks of rays.
            on_stage: told each stage as it begins; the last one ends with the call.

        Raises:
            LiveHandError: the shot's mesh is not of this hand model.
            RenderStopped: `should_stop` said so.
        """
        on_stage("pose")
        topology = self._topology_of(shot)
        mesh = posed_mesh(topology, self._tensor(shot.vertices))
        window = window_of(mesh, shot.camera, self.avatar.config.sampler)
        if window is None:
            return empty_frame(shot.camera.size_px)
        view = view_of(window.camera_of(shot.camera), self.torch_device)
        conditions = FrameConditions.of(self._tensor(self._canonical_theta(shot)), topology, mesh)
        on_stage("sample")
        rays = trace(mesh, topology, view, self.avatar.config.sampler, None, self._scene_depth(shot, window))
        on_stage("field")
        with self._autocast():
            low = self._shade_in_chunks(rays, topology, conditions, mesh, view, should_stop)
            on_stage("superres")
            image, depth = image_of(self.avatar.superres, low, rays.pixel, view.size_px)
        on_stage("develop")
        return develop(image.float(), depth, window, shot.camera.size_px)

    @cached_property
    def torch_device(self) -> torch.device:
        """The device in use."""
        return torch_device(self.device)

    @cached_property
    def _topologies(self) -> dict[Side, Topology]:
        sides: tuple[Side, ...] = ("right", "left")
        return {side: Topology.of(self.hand.for_side(side), self.torch_device, self.hand.side) for side in sides}

    def _topology_of(self, shot: Shot) -> Topology:
        expected = len(self.hand.v_template)
        if len(shot.vertices) != expected:
            raise LiveHandError(
                f"the hand's mesh must have the {expected} vertices of '{self.hand.name}', got {len(shot.vertices)}; "
                "remove modifiers that add or drop vertices"
            )
        return self._topologies[shot.pose.side]

    def _canonical_theta(self, shot: Shot) -> np.ndarray:
        """The pose as the avatar's own side would have it."""
        return shot.pose.theta if shot.pose.side == self.hand.side else shot.pose.theta * MIRROR_AXIS_ANGLE

    def _scene_depth(self, shot: Shot, window: Window) -> Tensor | None:
        if shot.scene_depth is None:
            return None
        return self._tensor(window.low_resolution(shot.scene_depth, outside=DEPTH_BACKGROUND))

    def _shade_in_chunks(
        self,
        rays: SurfaceRays,
        topology: Topology,
        conditions: FrameConditions,
        mesh: PosedMesh,
        view: View,
        should_stop: Callable[[], bool],
    ) -> Composite:
        at_once = max(1, _SAMPLES_AT_ONCE // self.avatar.config.sampler.samples_per_ray)
        parts = []
        for chunk in split_rays(rays, at_once):
            if should_stop():
                raise RenderStopped
            shell_m = self.avatar.config.sampler.shell_m
            parts.append(shade(self.avatar.field, chunk, topology, conditions, mesh.scale, view, shell_m))
        return Composite(*(torch.cat(values) for values in zip(*parts, strict=True)))

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(array), dtype=torch.float32, device=self.torch_device)

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.torch_device.type, torch.bfloat16, enabled=self.precision == "bf16")


def view_of(camera: Camera, device: torch.device | str) -> View:
    """The camera as tensors."""
    K = torch.as_tensor(camera.K, dtype=torch.float32, device=device)
    world2cam = torch.as_tensor(np.linalg.inv(camera.cam2world), dtype=torch.float32, device=device)
    return View(K, world2cam, camera.size_px)


def window_of(mesh: PosedMesh, camera: Camera, config: SamplerConfig) -> Window | None:
    """The window of a posed hand and its shell; None where nothing of it is in view."""
    view = view_of(camera, mesh.vertices.device)
    positions_px, depth = project(view, mesh.vertices)
    reach_px = view.K[0, 0].abs() * config.shell_m * mesh.scale / depth
    return hand_window(positions_px.cpu().numpy(), depth.cpu().numpy(), reach_px.cpu().numpy(), camera.size_px)


def trace(
    mesh: PosedMesh,
    topology: Topology,
    view: View,
    config: SamplerConfig,
    generator: torch.Generator | None = None,
    scene_depth: Float[Tensor, "H W"] | None = None,
) -> SurfaceRays:
    """Sample the rays that meet the shell and lay the samples on the surface."""
    rays = sample_rays(mesh, topology, view, config, generator, scene_depth)
    samples = project_to_surface(rays.points.reshape(-1, 3), topology, mesh)
    return SurfaceRays(rays.pixel, rays.directions, rays.t, rays.dt, rays.is_stopped, samples)


def split_rays(rays: SurfaceRays, at_once: int) -> list[SurfaceRays]:
    """The same rays in chunks; at least one chunk, also of no rays."""
    per_ray = rays.t.shape[1]
    by_ray = zip(*(values.split(at_once) for values in rays[:5]), strict=True)
    by_sample = zip(*(values.split(at_once * per_ray) for values in rays.samples), strict=True)
    return [SurfaceRays(*r, samples=SurfaceSamples(*s)) for r, s in zip(by_ray, by_sample, strict=True)]


def shade(
    field: PaperField | PlaneField,
    rays: SurfaceRays,
    topology: Topology,
    conditions: FrameConditions,
    scale: Float[Tensor, ""],
    view: View,
    shell_m: float,
) -> Composite:
    """Ask the field at the samples and composite each ray."""
    per_ray = rays.t.shape[1]
    length = rays.directions.norm(dim=-1)
    unit = (rays.directions / length[:, None]).repeat_interleave(per_ray, 0)
    footprint_m = (rays.t / (view.K[0, 0] * scale)).reshape(-1)
    exposure = field.exposure(conditions.visibility)
    inputs = field_inputs(rays.samples, topology, conditions, exposure, unit, footprint_m, shell_m)
    sigma, channels = field(inputs)
    step_mm = rays.dt * length / scale * 1000
    sigma, channels = sigma.reshape(-1, per_ray), channels.reshape(-1, per_ray, CHANNELS)
    return composite(sigma, channels, rays.t, step_mm, rays.is_stopped)


def image_of(
    superres: nn.Module, low: Composite, pixel: Tensor, size_px: tuple[int, int]
) -> tuple[Float[Tensor, "4 H W"], Float[Tensor, "H W"]]:
    """Super-resolved RGBA, not clamped, and depth (infinite where no ray met the hand), at twice `size_px`."""
    maps, depth = low_resolution_maps(low, pixel, size_px)
    image = superres(maps[None].contiguous(memory_format=torch.channels_last))[0]
    return image, depth.repeat_interleave(2, 0).repeat_interleave(2, 1)


def low_resolution_maps(
    low: Composite, pixel: Tensor, size_px: tuple[int, int]
) -> tuple[Float[Tensor, "33 h w"], Float[Tensor, "h w"]]:
    """Rays scattered into maps [colour 3, features 29, alpha 1], zero where there is no ray; and depth."""
    width, height = size_px
    values = torch.cat([low.channels, low.alpha[:, None].to(low.channels.dtype)], -1)
    maps = values.new_zeros(width * height, values.shape[1]).index_put((pixel,), values)
    depth = torch.where(low.alpha > 0, low.depth, torch.full_like(low.depth, torch.inf))
    depth = low.depth.new_full((width * height,), torch.inf).index_put((pixel,), depth)
    return maps.T.reshape(-1, height, width), depth.reshape(height, width)


def develop(
    image: Float[Tensor, "4 h w"], depth: Float[Tensor, "h w"], window: Window, size_px: tuple[int, int]
) -> Frame:
    """RGBA as the network has it (sRGB-encoded colour times alpha) -> scene-linear premultiplied frame, whole size."""
    alpha = image[3].clamp(0, 1)
    alpha = torch.where(alpha < _NOTHING, torch.zeros_like(alpha), alpha)
    encoded = torch.minimum(image[:3].clamp(min=0), alpha)
    straight = encoded / torch.where(alpha > 0, alpha, torch.ones_like(alpha))
    linear = srgb_to_linear(straight) * alpha
    solid_depth = torch.where((alpha >= 0.5) & depth.isfinite(), depth, torch.full_like(depth, DEPTH_BACKGROUND))
    frame = empty_frame(size_px)
    window.paste(linear.permute(1, 2, 0).cpu().numpy(), frame.rgb)
    window.paste(alpha.cpu().numpy(), frame.alpha)
    window.paste(solid_depth.cpu().numpy(), frame.depth)
    return frame
