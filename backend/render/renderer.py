"""Pose, camera and mesh in; a photoreal frame out: the main path of the product.

Shot -> posed mesh -> rasterised shell -> samples in (u, v, h) -> field -> volume rendering -> low-resolution maps ->
super-resolution -> frame. A `RenderBackend` computes the stages from the shell to volume rendering; training uses the
same backend and the same maps.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from ..avatars.avatar import Avatar
from ..compute.backend import Decoder, OnStage, Precision, RayRenderer, RenderBackend, RenderHooks, Stage
from ..field.conditions import FrameConditions
from ..field.field import MlpField, PlaneField
from ..field.rays import HandInView, RenderedRays, camera_tensors
from ..field.relightable import LitField
from ..field.sampler import SamplerConfig
from ..geometry.mesh import PosedMesh, Topology
from ..hand.model import MIRROR_AXIS_ANGLE, HandModel
from ..hand.posed_bones import bone_frames, check_on_pose
from ..hand.topology import Skinning, topology_of
from ..image.crop import Crop, crop_of
from ..image.decode import decode_frame
from ..image.maps import depth_profile, image_of
from ..light.fineness import MOVING, WHOLE
from ..records.errors import LiveHandError
from ..records.frame import Frame, empty_frame
from ..records.light import Light, Sky
from ..records.shot import HandPose, Shot
from ..records.side import Side
from ..records.surface_mesh import SurfaceMesh
from ..surface.fine_mesh import LevelsOfDetail, on_surface
from ..surface.hair_growth import Hairs
from ..surface.hairs import PosedHairs
from .albedo import vertex_albedo
from .backends import choose_backend
from .device import rendering_device
from .known_skin import KnownSkin, hairs_on, skin_of
from .lit_hand import LitHand, PosedSkin, render_lit_hand
from .rough_light import baked_light, roughly_relit

_EVEN_SKY = Sky(np.ones((1, 1, 3)))
Network = TypeVar("Network", bound=nn.Module)


class _Networks(NamedTuple):
    """The networks of an avatar in one precision; decoder None: its field has none."""

    superres: Callable[[Tensor], Tensor]
    decoder: Decoder | None


class _Last(threading.local):
    """Of each thread, the last hand that it rendered, for the next light that falls on it; None before."""

    hand: LitHand | None = None


class RenderStopped(Exception):
    """The caller's `should_stop` returned True."""


@dataclass(frozen=True)
class Renderer:
    """One avatar on one hand model and device. It copies the avatar's networks at its first render and uses the copies.

    Attributes:
        avatar: the trained appearance.
        hand: the model of the meshes to render, of either side.
        device: as `rendering_device` takes it.
        precision: of the networks; geometry is always fp32.
        backend: computes the costly stages; None: the best one for the device.
        has_rough_light: whether an avatar with baked light is relit roughly, if its own light is known (`rough_light`).
        has_skin_detail: whether outline, normals and detail are the skin's own, where it is known (`known_skin`).

    Raises:
        LiveHandError: the avatar belongs to another hand model, or the device is not available.
    """

    avatar: Avatar
    hand: HandModel
    device: str = "auto"
    precision: Precision = "fp32"
    backend: RenderBackend | None = None
    has_rough_light: bool = False
    has_skin_detail: bool = True

    def __post_init__(self):
        if self.hand.sha256 != self.avatar.hand_sha256:
            raise LiveHandError(
                f"avatar '{self.avatar.name}' must be given its own hand model '{self.avatar.hand_name}' "
                f"(sha256 {self.avatar.hand_sha256[:12]}...), got '{self.hand.name}' ({self.hand.sha256[:12]}...); "
                "choose that hand, or an avatar of this one"
            )
        rendering_device(self.device)

    @torch.inference_mode()
    def render(
        self,
        shot: Shot,
        should_stop: Callable[[], bool] = lambda: False,
        on_stage: OnStage = lambda stage: None,
    ) -> Frame:
        """Render one frame of the shot's size.

        Args:
            shot: the posed hand and its camera.
            should_stop: queried at every stage, and between chunks of rays and bands of super-resolution.
            on_stage: called when a stage begins; the last stage ends with the call.

        Raises:
            LiveHandError: the shot's mesh is not of this hand model.
            RenderStopped: `should_stop` returned True.
        """
        check = _check(should_stop)
        on_stage = _both(check, on_stage)
        on_stage("pose")
        topology = self._topology_of(shot)
        known = self._last.hand
        if known is not None and known.shows(shot):
            return self._in_light(known, shot, on_stage)
        with self._backend.threads_of_frame(0):  # a mesh is small
            mesh = self._backend.posed_mesh(topology, self._tensor(shot.vertices))
            crop = crop_of(mesh, shot.camera, self.avatar.config.sampler, self.avatar.config.superres.scale)
        if crop is None:
            return empty_frame(shot.camera.size_px)
        with self._backend.threads_of_frame(crop.pixels):
            return self._render_crop(shot, crop, mesh, topology, on_stage, check)

    def _render_crop(
        self,
        shot: Shot,
        crop: Crop,
        mesh: PosedMesh,
        topology: Topology,
        on_stage: OnStage,
        check: Callable[[], None],
    ) -> Frame:
        scale = self.avatar.config.superres.scale
        fineness = MOVING if shot.is_moving else WHOLE
        camera = camera_tensors(crop.camera_of(shot.camera), self.torch_device)
        hand = HandInView(mesh, topology, camera, fineness=fineness)
        conditions = self._conditions(shot, hand)
        on_stage("rasterise")
        skin = None if self._skin is None else self._posed_skin(self._skin, shot, hand)
        met = hand if skin is None else on_surface(hand, skin.mesh, skin.hits.depth)
        rays = self._render_rays(met, conditions, RenderHooks(on_stage, check))
        if isinstance(self._field, LitField):
            lit = self._last.hand = self._lit_hand(shot, crop, hand, rays, self._field, skin, on_stage, check)
            return self._in_light(lit, shot, on_stage)
        on_stage("superres")
        superres = _asking(self._networks_of(shot).superres, check)
        image, depth = image_of(superres, rays.composite, rays.pixel, hand.camera.size_px, scale)
        on_stage("decode")
        frame = decode_frame(image.float(), depth, crop, shot.camera.size_px)
        if scale == 2:
            frame = replace(frame, profile=depth_profile(rays, crop, shot.camera.size_px))
        if shot.light is None or self._rough_light is None:
            return frame
        on_stage("light")
        return roughly_relit(frame, shot, hand, crop, self.hand, self._backend, self._rough_light)

    @torch.inference_mode()
    def posed_surface(self, shot: Shot) -> SurfaceMesh | None:
        """The skin's own surface as frames show it; None: it is not known, they show the mesh's."""
        if self._skin is None:
            return None
        topology = self._topology_of(shot)
        mesh = self._backend.posed_mesh(topology, self._tensor(shot.vertices))
        template = self._levels_of(shot.pose.side).finest
        fine = self._skin.posed(template, shot.pose, mesh, topology.frames, self._backend)
        return SurfaceMesh(fine.vertices.cpu().numpy(), fine.faces.cpu().numpy())

    @property
    def sampler(self) -> SamplerConfig:
        """How rays that meet the hand are sampled."""
        config = self.avatar.config.sampler
        return config if self._skin is None else config.at_surface

    def forget(self) -> None:
        """Forget this thread's last hand, so that its next frame is rendered from its pose on, whatever it shows."""
        self._last.hand = None

    @property
    def frames_at_once(self) -> int:
        """As in `HandRenderer`: any number of threads may render."""
        return self._backend.frames_at_once

    @property
    def is_relightable(self) -> bool:
        """Whether frames depend on the shot's light."""
        return isinstance(self.avatar.field, LitField) or self._rough_light is not None

    @property
    def mean_albedo(self) -> np.ndarray | None:
        """[3] linear diffuse reflectance of the skin; None: not known, as light is baked into its colours."""
        return self._vertex_albedo.mean(0) if isinstance(self.avatar.field, LitField) else None

    @cached_property
    def _vertex_albedo(self) -> np.ndarray:
        return vertex_albedo(self.avatar, self.hand)

    @cached_property
    def _skin_albedo(self) -> Tensor:
        return self._tensor(self._vertex_albedo)

    @cached_property
    def _rough_light(self) -> Light | None:
        """The light that is baked into the avatar, if it is to be exchanged."""
        return baked_light(self.avatar) if self.has_rough_light else None

    @cached_property
    def torch_device(self) -> torch.device:
        """The device in use."""
        return rendering_device(self.device)

    @cached_property
    def _backend(self) -> RenderBackend:
        return self.backend or choose_backend(self.torch_device)

    @cached_property
    def _field(self) -> MlpField | PlaneField:
        return self._own(self.avatar.field)

    @cached_property
    def _render_rays(self) -> RayRenderer:
        return self._backend.ray_renderer(self._field, self.avatar.config.sampler, self.precision)

    @cached_property
    def _last(self) -> _Last:
        return _Last()

    def _lit_hand(
        self,
        shot: Shot,
        crop: Crop,
        hand: HandInView,
        rays: RenderedRays,
        field: LitField,
        skin: PosedSkin | None,
        on_stage: OnStage,
        check: Callable[[], None],
    ) -> LitHand:
        backend, networks = self._backend, self._networks_of(shot)
        assert networks.decoder is not None
        superres, decoder = _asking(networks.superres, check), networks.decoder
        return render_lit_hand(
            shot, crop, hand, rays, field, superres, backend, decoder, self._skin_albedo, skin, on_stage
        )

    def _posed_skin(self, skin: KnownSkin, shot: Shot, hand: HandInView) -> PosedSkin:
        levels = self._levels_of(shot.pose.side)
        template = levels.seen_in(hand) if shot.is_moving else levels.finest
        mesh = skin.posed(template, shot.pose, hand.mesh, hand.topology.frames, self._backend)
        hits = self._backend.ray_hits(mesh, hand.camera, hand.camera.every_pixel)
        if shot.hair == 0 or shot.is_moving:
            return PosedSkin(skin.maps, mesh, hits)
        return PosedSkin(skin.maps, mesh, hits, PosedHairs.of(self._hairs.first(shot.hair), mesh, skin.hair_albedo))

    def _levels_of(self, side: Side) -> LevelsOfDetail:
        """The known skin's surface; it must be known."""
        assert self._skin is not None
        if side not in self._fine_templates:
            model = self.hand.for_side(side)
            self._fine_templates[side] = LevelsOfDetail.of(self._skin.surface, model, self.torch_device)
        return self._fine_templates[side]

    @cached_property
    def _skin(self) -> KnownSkin | None:
        """The avatar's skin, where it is known and its field can be lit."""
        is_lit = isinstance(self._field, LitField)
        return skin_of(self.avatar, self.torch_device) if self.has_skin_detail and is_lit else None

    @cached_property
    def _fine_templates(self) -> dict[Side, LevelsOfDetail]:
        """Of the sides that have been rendered."""
        return {}

    @cached_property
    def _hairs(self) -> Hairs:
        """Of either hand, where its skin is known."""
        assert self._skin is not None
        return hairs_on(self._skin, self._levels_of("right").finest)

    def _in_light(self, lit: LitHand, shot: Shot, on_stage: OnStage) -> Frame:
        """The hand in the shot's light, or in its capture's."""
        on_stage("light")
        light = shot.light or Light(sky=self.avatar.sky or _EVEN_SKY)
        with self._backend.threads_of_frame(lit.crop.pixels):
            return replace(lit.frame(self._backend, light), is_lit=shot.light is not None)

    def _networks_of(self, shot: Shot) -> _Networks:
        """What moves needs no more than bf16."""
        precision = "bf16" if shot.is_moving else self.precision
        if precision not in self._networks:
            self._networks[precision] = self._networks_in(precision)
        return self._networks[precision]

    @cached_property
    def _networks(self) -> dict[Precision, _Networks]:
        """In the precisions that have been asked for."""
        return {}

    def _networks_in(self, precision: Precision) -> _Networks:
        field, device = self._field, self.torch_device
        superres = self._backend.superres(self._own(self.avatar.superres), device, precision)
        decoder = self._backend.decoder(field, device, precision) if isinstance(field, LitField) else None
        return _Networks(superres, decoder)

    def _own(self, network: Network) -> Network:
        """A copy for inference on this device; the avatar's own networks are not changed."""
        return deepcopy(network).to(self.torch_device).eval()

    @cached_property
    def _skinning(self) -> Skinning:
        return Skinning.of(self.hand, self.torch_device)

    @cached_property
    def _topologies(self) -> dict[Side, Topology]:
        sides: tuple[Side, ...] = ("right", "left")
        return {side: topology_of(self.hand.for_side(side), self.torch_device, self.hand.side) for side in sides}

    def _topology_of(self, shot: Shot) -> Topology:
        expected = len(self.hand.v_template)
        if len(shot.vertices) != expected:
            raise LiveHandError(
                f"the hand's mesh must have the {expected} vertices of '{self.hand.name}', got {len(shot.vertices)}; "
                "remove modifiers that add or drop vertices"
            )
        return self._topologies[shot.pose.side]

    def _conditions(self, shot: Shot, hand: HandInView) -> FrameConditions:
        theta = self._canonical_theta(shot.pose)
        if isinstance(self._field, LitField):  # its shadows come with the light
            visibility = hand.mesh.vertices.new_zeros(len(hand.mesh.vertices), 0)
        else:
            visibility = self._backend.visibility(hand.mesh, hand.topology)
        conditions = FrameConditions.of(
            self._tensor(theta), self._skinning, hand.topology, hand.mesh, visibility, self._backend.local_rotations
        )
        if not isinstance(self._field, MlpField) or self._field.asks != "bones":
            return conditions
        check_on_pose(shot, self.hand)
        bones = self._tensor(bone_frames(self.hand, shot.pose))
        return conditions._replace(bones=bones, bone_weights=self._skinning.lbs_weights)

    def _canonical_theta(self, pose: HandPose) -> np.ndarray:
        """The pose mirrored to the avatar's own side."""
        return pose.theta if pose.side == self.hand.side else pose.theta * MIRROR_AXIS_ANGLE

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(array), dtype=torch.float32, device=self.torch_device)


def _both(check: Callable[[], None], on_stage: OnStage) -> OnStage:
    def both(stage: Stage) -> None:
        check()
        on_stage(stage)

    return both


def _asking(network: Callable[[Tensor], Tensor], check: Callable[[], None]) -> Callable[[Tensor], Tensor]:
    """The network, asking before it enlarges another band."""

    def asking(maps: Tensor) -> Tensor:
        check()
        return network(maps)

    return asking


def _check(should_stop: Callable[[], bool]) -> Callable[[], None]:
    """A function that raises RenderStopped when `should_stop` returns True."""

    def check() -> None:
        if should_stop():
            raise RenderStopped

    return check
