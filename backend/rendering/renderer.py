"""Pose, camera and mesh in; a photoreal frame out. The main road of the whole product.

Shot -> posed mesh -> rasterised shell -> samples in (u, v, h) -> field -> volume rendering -> low-resolution maps ->
super-resolution -> frame. On the CPU the middle is done by kernels (`cpu.marching`), elsewhere and for the paper's
field by torch (`tracing`, `shading`), which training goes through too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from torch import Tensor

from ..geometry.mesh import PosedMesh, Topology, posed_mesh
from ..hand.model import MIRROR_AXIS_ANGLE, HandModel
from ..nerf.avatar import Avatar
from ..nerf.conditions import FrameConditions
from ..nerf.crop import Crop, hand_crop
from ..nerf.field import PlaneField
from ..nerf.maps import SeenRays, depth_profile, image_of
from ..nerf.rays import HandInView, camera_tensors, project
from ..nerf.sampler import SamplerConfig
from ..nerf.shade import shade_in_chunks
from ..nerf.trace import trace
from ..records.camera import Camera
from ..records.errors import LiveHandError
from ..records.shot import Frame, Shot, Side, empty_frame
from .decode import decode_frame
from .device import has_kernels, torch_device

if TYPE_CHECKING:
    from ..fast.fused_render import Marcher

Precision = Literal["fp32", "bf16"]
Stage = Literal["pose", "rasterise", "sample", "field", "superres", "decode"]
OnStage = Callable[[Stage], None]


class RenderStopped(Exception):
    """The caller's `should_stop` said so."""


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
        on_stage: OnStage = lambda stage: None,
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
        window = crop_of(mesh, shot.camera, self.avatar.config.sampler)
        if window is None:
            return empty_frame(shot.camera.size_px)
        view = camera_tensors(window.camera_of(shot.camera), self.torch_device)
        conditions = FrameConditions.of(self._tensor(self._canonical_theta(shot)), topology, mesh)
        hand = HandInView(mesh, topology, view)
        draw = self._march if self._marcher else self._trace
        seen = draw(hand, conditions, _stopping(should_stop), on_stage)
        on_stage("superres")
        with self._autocast():
            image, depth = image_of(self.avatar.superres, seen.composite, seen.pixel, view.size_px)
        on_stage("decode")
        profile = depth_profile(seen, window, shot.camera.size_px)
        return replace(decode_frame(image.float(), depth, window, shot.camera.size_px), profile=profile)

    def _march(
        self, hand: HandInView, conditions: FrameConditions, check: Callable[[], None], on_stage: OnStage
    ) -> SeenRays:
        """Low-resolution rays by the kernels."""
        from ..fast.shell import rasterise_shell

        assert self._marcher is not None
        on_stage("rasterise")
        layers = rasterise_shell(hand, self.avatar.config.sampler)
        on_stage("sample")
        marched = self._marcher.march(layers, hand, conditions, check)
        on_stage("field")
        with self._autocast():
            composite = self._marcher.decode(marched.told, marched.direction)
        return SeenRays(marched.pixel, composite, marched.t, marched.dt)

    def _trace(
        self, hand: HandInView, conditions: FrameConditions, check: Callable[[], None], on_stage: OnStage
    ) -> SeenRays:
        """Low-resolution rays by torch."""
        config = self.avatar.config.sampler
        on_stage("sample")
        rays = trace(hand, config)
        on_stage("field")
        with self._autocast():
            composite = shade_in_chunks(self.avatar.field, rays, hand, conditions, config.shell_m, check)
        return SeenRays(rays.pixel, composite, rays.t, rays.dt)

    @cached_property
    def _marcher(self) -> Marcher | None:
        """The kernels of this avatar's field; None where they cannot be used."""
        if not (isinstance(self.avatar.field, PlaneField) and has_kernels(self.torch_device)):
            return None
        from ..fast.fused_render import Marcher

        return Marcher(self.avatar.field, self.avatar.config.sampler)

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

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(array), dtype=torch.float32, device=self.torch_device)

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.torch_device.type, torch.bfloat16, enabled=self.precision == "bf16")


def _stopping(should_stop: Callable[[], bool]) -> Callable[[], None]:
    """A check that raises RenderStopped when it is told to stop."""

    def check() -> None:
        if should_stop():
            raise RenderStopped

    return check


def crop_of(mesh: PosedMesh, camera: Camera, config: SamplerConfig) -> Crop | None:
    """The window of a posed hand and its shell; None where nothing of it is in view."""
    view = camera_tensors(camera, mesh.vertices.device)
    positions_px, depth = project(view, mesh.vertices)
    reach_px = view.K.diagonal()[:2].abs().amax() * config.shell_m * mesh.scale / depth
    return hand_crop(positions_px.cpu().numpy(), depth.cpu().numpy(), reach_px.cpu().numpy(), camera.size_px)
