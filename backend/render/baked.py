"""The pipeline of an avatar whose capture's light is baked into its colours.

1 pose, 2 crop, 3 rays, 4 field    `pipeline`
5 visibility                       of the hand by itself, which is a condition of the field
7 image                            super-resolved colour and alpha
8 develop                          scene-linear, in the whole image
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from torch import Tensor

from ..compute.precision import Precision
from ..compute.whole_frames import BakedFrameRenderer, BakedModel, BakedShot
from ..field.conditions import FrameConditions
from ..field.field import BakedField, MlpField
from ..field.sampler import SamplerConfig
from ..hand.posed_bones import bone_frames, check_on_pose
from ..image.decode import decode_frame
from ..image.maps import depth_profile, image_of, rows_of_image
from ..image.superres import ResidualSuperRes
from ..records.depth_profile import DepthProfile
from ..records.frame import Frame, empty_frame
from ..records.shot import Shot, SurfaceMesh
from ..records.side import Side
from .lit_shots import HandInCrop, ShotsAtOnce, reason_of_avatar
from .pipeline import Pipeline, PosedShot
from .progress import RenderProgress


@dataclass(frozen=True)
class BakedPipeline(Pipeline):
    """Renders frames that show the capture's light, whatever the shot's is."""

    mean_albedo = None

    @property
    def sampler(self) -> SamplerConfig:
        """How rays that meet the hand are sampled."""
        return self.avatar.config.sampler

    def render(self, shot: Shot, progress: RenderProgress) -> Frame:
        """Render a frame; raises what `Renderer.render` raises."""
        progress.begin("pose")
        frame = self.at_once(shot)
        if frame is not None:
            return frame
        posed = self.posed(shot)
        if posed is None:
            return empty_frame(shot.camera.size_px)
        with self.backend.threads_of_frame(posed.crop.pixels):
            conditions = self.field_conditions(posed)
            progress.begin("rasterise")
            rays = self.rays(posed.hand, conditions, progress)
            progress.begin("superres")
            superres = progress.cancellable(self._superres(self.precision_of(shot)))
            size_px, crop = posed.hand.camera.size_px, posed.crop
            image, depth = image_of(superres, rays.composite, rays.pixel, size_px, crop.scale)
            progress.begin("decode")
            frame = decode_frame(image.float(), depth, crop, shot.camera.size_px)
            return replace(frame, profile=depth_profile(rays, crop, shot.camera.size_px)) if crop.scale == 2 else frame

    def field_conditions(self, posed: PosedShot) -> FrameConditions:
        """Return the field's conditions for the pose: its own shadows, and its bones if the field asks for them.

        Raises:
            LiveHandError: the field asks for bones, and the mesh is not that of the pose.
        """
        hand, shot = posed.hand, posed.shot
        conditions = self.conditions(posed, self.backend.visibility(hand.mesh, hand.topology))
        if not isinstance(self.field, MlpField) or self.field.asks != "bones":
            return conditions
        check_on_pose(shot, self.hand)
        bones = self.tensor(bone_frames(self.hand, shot.pose))
        return conditions._replace(bones=bones, bone_weights=self.skinning.lbs_weights)

    def posed_surface(self, shot: Shot) -> SurfaceMesh | None:
        """Return None: frames show the mesh."""
        return None

    def forget(self) -> None:
        """Do nothing: no frame is kept."""

    def _superres(self, precision: Precision) -> Callable[[Tensor], Tensor]:
        if precision not in self._networks:
            superres = self.copied(self.avatar.superres)
            self._networks[precision] = self.backend.superres(superres, self.device, precision)
        return self._networks[precision]

    @cached_property
    def _shots(self) -> BakedShots | None:
        """What renders frames at once; None: `reason_of_avatar` says why not, or the backend cannot."""
        if not self.backend.renders_whole_frames or reason_of_avatar(self.avatar, self.hand) is not None:
            return None
        return BakedShots(self.avatar, self.hand, self.backend)

    @cached_property
    def _networks(self) -> dict[Precision, Callable[[Tensor], Tensor]]:
        """In the precisions that have been asked for."""
        return {}


@dataclass(frozen=True)
class BakedShots(ShotsAtOnce):
    """Renders shots of one avatar in its capture's light by a backend's whole frames."""

    def _rendered(self, shot: Shot, of_hand: HandInCrop) -> Frame | None:
        given = of_hand.vertices.numpy(), self.joint_pose(shot.pose), of_hand.camera, of_hand.window_px
        found = self._renderer(shot.pose.side).render(BakedShot(*given, of_hand.scale, of_hand.bounds))
        if found is None:
            return None
        pixels, (row, *of_rays) = found
        frame = self.images.frame(pixels, of_hand.crop, shot.camera.size_px, is_lit=False)
        profile = DepthProfile(
            rows_of_image(row, of_hand.shared, shot.camera.size_px), *map(np.array, of_rays), ray_px=2
        )
        return replace(frame, profile=profile)

    def _renderer(self, side: Side) -> BakedFrameRenderer:
        if side not in self._renderers:
            planes, superres = self.avatar.field, self.avatar.superres
            assert isinstance(planes, BakedField)
            assert isinstance(superres, ResidualSuperRes)
            sampler = self.avatar.config.sampler
            model = BakedModel(planes, superres, self.topology(side), self.skinning, sampler)
            self._renderers[side] = self.backend.baked_frames(model)
        return self._renderers[side]

    @cached_property
    def _renderers(self) -> dict[Side, BakedFrameRenderer]:
        return {}
