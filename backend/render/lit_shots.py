"""The short road of a frame: a shot becomes what a backend renders at once, and its pixels a frame.

It shows what pipelines do stage by stage, which take over where it is asked for more. `baked.BakedShots` are the same
for avatars in the light of their capture.
"""

from __future__ import annotations

import logging
import threading
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..avatars.avatar import Avatar
from ..compute.reference import ReferenceBackend
from ..compute.whole_frames import LitFrameRenderer, LitModel, LitShot
from ..field.field import BakedField, PlaneField
from ..field.rays import CameraTensors, camera_tensors
from ..field.relightable import RelightableField
from ..geometry.mesh import Topology
from ..hand.model import MIRROR_AXIS_ANGLE, HandModel
from ..hand.topology import Skinning, topology_of
from ..image.crop import Crop
from ..image.kept_images import KeptImages
from ..image.superres import RelightableSuperRes, ResidualSuperRes
from ..light.indirect_diffuse import MOST_SURFELS
from ..light.kept_samples import KeptPatches, KeptSamples
from ..light.lamp_samples import HARD_RAD, LampSamples
from ..light.shadow_maps import Bounds
from ..records.frame import Frame, empty_frame
from ..records.light import Light, Sky
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
_OVERFLOW = "a GPU's lists hold fewer edges or layers, its memory is full, or it failed; stages render this frame"
_EVEN_SKY = Sky(np.ones((1, 1, 3)))


def light_of(shot: Shot, avatar: Avatar) -> Light:
    """Return the shot's light, or the avatar's own."""
    return shot.light or Light(sky=avatar.sky or _EVEN_SKY)


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
    if not isinstance(avatar.field, PlaneField):
        return "its avatar's field is a network alone"
    if not isinstance(avatar.superres, ResidualSuperRes):
        return "its avatar enlarges its rays in another way"
    if isinstance(avatar.field, BakedField):
        return None
    if avatar.surface is None:
        return "its avatar has no surface of its own"
    if len(hand.v_template) > MOST_SURFELS:
        return f"its hand has more than {MOST_SURFELS} vertices"
    return None


class HandInCrop(NamedTuple):
    """A shot's hand on the host, and where its image is.

    Attributes:
        vertices: [V, 3] m, world.
        scale: against its template.
        bounds: of its vertices.
        crop: of the image, of a size that many frames share.
        shared: the crop, enlarged so that many frames have its size.
        camera: of the rays of that.
    """

    vertices: Tensor
    scale: float
    bounds: Bounds
    crop: Crop
    shared: Crop
    camera: CameraTensors

    @property
    def window_px(self) -> tuple[int, int]:
        """Columns and rows of rays that hold the hand."""
        return self.crop.width, self.crop.height


@dataclass(frozen=True)
class ShotsAtOnce:
    """What shots of every avatar have to become on the host.

    Attributes:
        avatar: of fields of planes.
        hand: of its meshes.
        backend: renders whole frames.
    """

    avatar: Avatar
    hand: HandModel
    backend: ReferenceBackend
    _lock: AbstractContextManager = field(default_factory=threading.Lock, compare=False, repr=False)

    def knows(self, shot: Shot) -> bool:
        """Tell whether nothing of a shot asks for stages."""
        return not shot.camera.is_orthographic

    def render(self, shot: Shot) -> Frame | None:
        """Render a shot; None: it has more of something than there is room for, which a warning says."""
        with self._lock:  # a frame's pixels are valid until the next
            of_hand = self.in_crop(shot)
            if of_hand is None:
                return empty_frame(shot.camera.size_px)
            frame = self._rendered(shot, of_hand)
        if frame is None:
            LOGGER.warning(_OVERFLOW)
        return frame

    def _rendered(self, shot: Shot, of_hand: HandInCrop) -> Frame | None:
        raise NotImplementedError

    def in_crop(self, shot: Shot) -> HandInCrop | None:
        """Find a shot's crop; None: nothing of the hand is in view."""
        topology, config = self.topology(shot.pose.side), self.avatar.config
        vertices = torch.from_numpy(np.ascontiguousarray(shot.vertices, np.float32))
        tensors = camera_tensors(shot.camera, "cpu")
        extent = self._of_host.hand_extent(topology, vertices, tensors, config.sampler.shell_m)
        crop = extent.crop(shot.camera.size_px, config.superres.scale)
        if crop is None:
            return None
        width, height = (-(-size // BUCKET_PX) * BUCKET_PX for size in (crop.width, crop.height))
        bounds = Bounds(torch.from_numpy(extent.centre), torch.tensor(extent.radius))
        shared = Crop(crop.x0, crop.y0, width, height, crop.scale)
        return HandInCrop(vertices, extent.scale, bounds, crop, shared, shared.tensors_of(shot.camera, tensors))

    def joint_pose(self, pose: HandPose) -> np.ndarray:
        """Return what the field is told of a pose, as `field.conditions.joint_pose`."""
        fingers, parents = pose.theta * mirror_to(self.hand.side, pose.side), self._parents
        fingers[0] = 0
        of_child = np.zeros_like(fingers)
        np.add.at(of_child, parents[1:], fingers[1:])
        of_child[0] = 0
        return np.concatenate([fingers, fingers[parents], of_child], -1)

    def topology(self, side: Side) -> Topology:
        """Return that of a side's mesh."""
        if side not in self._topologies:
            self._topologies[side] = topology_of(self.hand.for_side(side), "cpu", self.hand.side)
        return self._topologies[side]

    @cached_property
    def skinning(self) -> Skinning:
        """Of the hand."""
        return Skinning.of(self.hand)

    @cached_property
    def _parents(self) -> np.ndarray:
        return self.skinning.parents.clamp(min=0).numpy()

    @cached_property
    def images(self) -> KeptImages:
        """Memory of the frames."""
        return KeptImages()

    @cached_property
    def _of_host(self) -> ReferenceBackend:
        return choose_backend(torch.device("cpu"))

    @cached_property
    def _topologies(self) -> dict[Side, Topology]:
        return {}


def mirror_to(side: Side, of: Side) -> np.ndarray:
    """Return the factors of rotations that turn the pose of a hand into that of one of another side."""
    return np.ones(3) if side == of else MIRROR_AXIS_ANGLE


@dataclass(frozen=True)
class LitShots(ShotsAtOnce):
    """Renders shots of one relightable avatar by a backend's whole frames, whose close-ups have no curved faces.

    Attributes:
        surface: the avatar's, on the host.
    """

    surface: AvatarSurface = field(kw_only=True)

    @classmethod
    def of(cls, avatar: Avatar, hand: HandModel, backend: ReferenceBackend) -> LitShots | None:
        """Prepare an avatar; None: `reason_of_avatar` says why not, or the backend renders no whole frames."""
        if not backend.renders_whole_frames or reason_of_avatar(avatar, hand) is not None:
            return None
        surface = avatar_surface_of(avatar, torch.device("cpu"))
        return None if surface is None else cls(avatar, hand, backend, surface=surface)

    def knows(self, shot: Shot) -> bool:
        """Tell whether nothing of a shot asks for stages, as `reason_for_stages` says."""
        return reason_for_stages(shot) is None

    def _rendered(self, shot: Shot, of_hand: HandInCrop) -> Frame | None:
        pixels = self._renderer(shot.pose.side).render(self._lit_shot(shot, light_of(shot, self.avatar), of_hand))
        if pixels is None:
            return None
        return self.images.frame(pixels, of_hand.crop, shot.camera.size_px, shot.light is not None)

    def _lit_shot(self, shot: Shot, light: Light, of_hand: HandInCrop) -> LitShot:
        model, pose, bounds = self._model(shot.pose.side), shot.pose, of_hand.bounds
        samples, is_fine = self._light.samples(light, bounds), light.shadow_quality == "fine"
        theta, forearm = (values * mirror_to("right", pose.side) for values in (pose.theta, pose.forearm))
        pressed = None if shot.pressed_m is None else Blanching.of(shot.pressed_m, model.template).both.numpy()
        return LitShot(
            pose=pose,
            vertices=of_hand.vertices.numpy(),
            joint_pose=self.joint_pose(pose),
            raised_shares=self.surface.surface.raised.shares(theta, forearm),
            flex=self.surface.bend.flex(theta),
            camera=of_hand.camera,
            window_px=of_hand.window_px,
            scale=of_hand.scale,
            bounds=bounds,
            light=samples,
            is_hard=(2 * samples.lamps.radius_rad.numpy() < HARD_RAD)[samples.lamps.lamp.numpy()],
            at_surfels=LampSamples.of(light.lamps, bounds) if is_fine else samples.lamps,
            has_fine_shadows=is_fine,
            occluders=np.asarray(light.occluders, np.float32),
            patches=self._patches.around(light, of_hand.vertices),
            hairs=round(shot.hair * len(model.hairs.radius_m)) if shot.hair > 0 else 0,
            pressed=pressed,
        )

    def _renderer(self, side: Side) -> LitFrameRenderer:
        if side not in self._renderers:
            self._renderers[side] = self.backend.lit_frames(self._model(side))
        return self._renderers[side]

    def _model(self, side: Side) -> LitModel:
        if side not in self._models:
            self._models[side] = self._model_of(side)
        return self._models[side]

    def _model_of(self, side: Side) -> LitModel:
        model, config = self.hand.for_side(side), self.avatar.config
        planes, superres = self.avatar.field, self.avatar.superres
        assert isinstance(planes, RelightableField)
        assert isinstance(superres, RelightableSuperRes)
        return LitModel(
            field=planes,
            superres=superres,
            topology=self.topology(side),
            skinning=self.skinning,
            template=DetailTemplate.of(self.surface.surface, model),
            raised=self.surface.surface.raised.parts_of_vertices(self.surface.veins_mm),
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
    def _hairs(self) -> Hairs:
        """Of either hand."""
        return hairs_on(self.surface, self._model("right").template)

    @cached_property
    def _light(self) -> KeptSamples:
        return KeptSamples()

    @cached_property
    def _patches(self) -> KeptPatches:
        return KeptPatches()

    @cached_property
    def _models(self) -> dict[Side, LitModel]:
        return {}

    @cached_property
    def _renderers(self) -> dict[Side, LitFrameRenderer]:
        return {}
