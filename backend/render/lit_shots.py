"""The short road of a frame: a shot becomes what a backend renders at once, and its pixels a frame.

It shows what `RelightablePipeline` does stage by stage, which takes over where it is asked for more.
"""

from __future__ import annotations

import logging
import threading
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from ..avatars.avatar import Avatar
from ..compute.lit_frames import FrameModel, LitFrameRenderer, LitShot
from ..compute.reference import ReferenceBackend
from ..field.conditions import joint_pose
from ..field.relightable import RelightableField
from ..geometry.mesh import PosedMesh
from ..hand.model import MIRROR_AXIS_ANGLE, HandModel
from ..hand.topology import Skinning, topology_of
from ..image.crop import Crop, crop_of
from ..image.kept_images import KeptImages
from ..image.superres import RelightableSuperRes
from ..light.indirect_diffuse import MOST_SURFELS
from ..light.kept_samples import KeptPatches, KeptSamples
from ..light.lamp_samples import LampSamples
from ..light.shadow_maps import Bounds
from ..records.frame import Frame, empty_frame
from ..records.light import Light
from ..records.shot import HandPose, Shot
from ..records.side import Side
from ..surface.blood import Blanching
from ..surface.detail_mesh import DetailTemplate
from ..surface.hair_growth import Hairs
from .albedo import vertex_albedo
from .avatar_surface import AvatarSurface, avatar_surface_of, hairs_on
from .backends import choose_backend
from .primary_hits import EDGE_M, STANDS_OUT_M

BUCKET_PX = 64
"""Sizes of rays' images are multiples of this: frames of one size share buffers, and a recorded sequence."""
LOGGER = logging.getLogger(__name__)


def reason_for_stages(shot: Shot) -> str | None:
    """Say what of a shot only stages know, as the end of "it is rendered stage by stage, because"; None: nothing.

    A shot that moves is rendered as one that is kept, which takes no longer here.
    """
    if shot.camera.is_orthographic:
        return "its camera is orthographic"
    if shot.light is not None and shot.light.measured is not None:
        return "its light was measured"
    return None


def reason_of_avatar(avatar: Avatar, hand: HandModel) -> str | None:
    """Say, as `reason_for_stages`, what of an avatar only stages know."""
    if not isinstance(avatar.field, RelightableField):
        return "its avatar has its capture's light baked in"
    if avatar.surface is None:
        return "its avatar has no surface of its own"
    if len(hand.v_template) > MOST_SURFELS:
        return f"its hand has more than {MOST_SURFELS} vertices"
    return None


@dataclass(frozen=True)
class LitShots:
    """Renders shots of one avatar by a backend's whole frames.

    Attributes:
        avatar: relightable, with a surface.
        hand: of its meshes.
        surface: the avatar's, on the host.
        backend: renders.
    """

    avatar: Avatar
    hand: HandModel
    surface: AvatarSurface
    backend: ReferenceBackend
    _lock: AbstractContextManager = field(default_factory=threading.Lock, compare=False, repr=False)

    @classmethod
    def of(cls, avatar: Avatar, hand: HandModel, backend: ReferenceBackend) -> LitShots | None:
        """Prepare an avatar; None: `reason_of_avatar` says why not, or the backend renders no whole frames."""
        if not backend.renders_lit_frames or reason_of_avatar(avatar, hand) is not None:
            return None
        surface = avatar_surface_of(avatar, torch.device("cpu"))
        return None if surface is None else cls(avatar, hand, surface, backend)

    def render(self, shot: Shot, light: Light) -> Frame | None:
        """Render a shot in a light; None: it has more of something than there is room for."""
        with self._lock:  # a frame's pixels are valid until the next
            return self._rendered(shot, light)

    def _rendered(self, shot: Shot, light: Light) -> Frame | None:
        topology = self._model(shot.pose.side).topology
        mesh = self._of_host.posed_mesh(topology, torch.as_tensor(np.asarray(shot.vertices), dtype=torch.float32))
        crop = crop_of(mesh, shot.camera, self.avatar.config.sampler, self.avatar.config.superres.scale)
        if crop is None:
            return empty_frame(shot.camera.size_px)
        window_px = crop.width, crop.height
        width, height = (-(-size // BUCKET_PX) * BUCKET_PX for size in window_px)
        crop = replace(crop, width=width, height=height)
        pixels = self._renderer(shot.pose.side).render(self._lit_shot(shot, light, mesh, crop, window_px))
        if pixels is None:
            LOGGER.warning("a GPU's lists hold fewer edges or layers, or its memory is full; stages render this frame")
            return None
        return self._images.frame(pixels, crop, shot.camera.size_px, shot.light is not None)

    def _lit_shot(self, shot: Shot, light: Light, mesh: PosedMesh, crop: Crop, window_px: tuple[int, int]) -> LitShot:
        model, pose, bounds = self._model(shot.pose.side), shot.pose, Bounds.of(mesh)
        samples, is_fine = self._light.samples(light, bounds), light.shadow_quality == "fine"
        theta, forearm = (values * self._mirror_to("right", pose.side) for values in (pose.theta, pose.forearm))
        pressed = None if shot.pressed_m is None else Blanching.of(shot.pressed_m, model.template).both.numpy()
        return LitShot(
            pose=pose,
            vertices=mesh.vertices.numpy(),
            joint_pose=self._joint_pose(pose).numpy(),
            height_m=1e-3 * self.surface.surface.raised.height_mm(theta, self.surface.veins_mm, forearm),
            flex=self.surface.bend.flex(theta),
            camera=crop.tensors_of(shot.camera),
            window_px=window_px,
            scale=float(mesh.scale),
            bounds=bounds,
            light=samples,
            at_surfels=LampSamples.of(light.lamps, bounds) if is_fine else samples.lamps,
            has_fine_shadows=is_fine,
            occluders=np.asarray(light.occluders, np.float32),
            patches=self._patches.around(light, mesh.vertices),
            hairs=round(shot.hair * len(model.hairs.radius_m)) if shot.hair > 0 else 0,
            pressed=pressed,
        )

    def _joint_pose(self, pose: HandPose) -> Tensor:
        theta = pose.theta * self._mirror_to(self.hand.side, pose.side)
        skinning = self._model(pose.side).skinning
        return joint_pose(torch.as_tensor(theta, dtype=torch.float32), skinning.parents)

    @staticmethod
    def _mirror_to(side: Side, of: Side) -> np.ndarray:
        return np.ones(3) if side == of else MIRROR_AXIS_ANGLE

    def _renderer(self, side: Side) -> LitFrameRenderer:
        if side not in self._renderers:
            self._renderers[side] = self.backend.lit_frames(self._model(side))
        return self._renderers[side]

    def _model(self, side: Side) -> FrameModel:
        if side not in self._models:
            self._models[side] = self._model_of(side)
        return self._models[side]

    def _model_of(self, side: Side) -> FrameModel:
        model, config = self.hand.for_side(side), self.avatar.config
        planes, superres = self.avatar.field, self.avatar.superres
        assert isinstance(planes, RelightableField)
        assert isinstance(superres, RelightableSuperRes)
        return FrameModel(
            field=planes,
            superres=superres,
            topology=topology_of(model, "cpu", self.hand.side),
            skinning=Skinning.of(self.hand),
            template=DetailTemplate.of(self.surface.surface, model),
            maps=self.surface.maps_of(side),
            joint_blood=self.surface.joint_blood,
            albedo=torch.as_tensor(vertex_albedo(self.avatar, self.hand), dtype=torch.float32),
            sampler=config.sampler.at_surface,
            stands_out_m=STANDS_OUT_M,
            edge_m=EDGE_M,
            grow_hairs=lambda: self._hairs,
            hair_albedo=self.surface.hair_albedo,
        )

    @cached_property
    def _of_host(self) -> ReferenceBackend:
        return choose_backend(torch.device("cpu"))

    @cached_property
    def _hairs(self) -> Hairs:
        """Of either hand."""
        return hairs_on(self.surface, self._model("right").template)

    @cached_property
    def _images(self) -> KeptImages:
        return KeptImages()

    @cached_property
    def _light(self) -> KeptSamples:
        return KeptSamples()

    @cached_property
    def _patches(self) -> KeptPatches:
        return KeptPatches()

    @cached_property
    def _models(self) -> dict[Side, FrameModel]:
        return {}

    @cached_property
    def _renderers(self) -> dict[Side, LitFrameRenderer]:
        return {}
