"""Stages 1 to 4 of a frame, which both pipelines share: pose, crop, rays, field.

    1 pose       `posed`                 the mesh of the shot, its normals
    2 crop       `posed`                 the window that holds the hand, at the rays' size
    3 rays       `rays`                  where each ray is sampled in the shell
    4 field      `rays`                  density and channels along the rays, composited

What follows differs: `baked.BakedPipeline`, `relightable.RelightablePipeline`.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from ..avatars.avatar import Avatar
from ..compute.precision import Precision
from ..compute.reference import RayRenderer, ReferenceBackend
from ..field.conditions import FrameConditions
from ..field.field import MlpField, PlaneField
from ..field.rays import HandInView, RenderedRays, camera_tensors
from ..geometry.mesh import PosedMesh, Topology
from ..hand.model import MIRROR_AXIS_ANGLE, HandModel
from ..hand.topology import Skinning, topology_of
from ..image.crop import Crop, crop_of
from ..light.samples import FINAL, PREVIEW
from ..records.errors import LiveHandError
from ..records.frame import Frame
from ..records.shot import HandPose, Shot
from ..records.side import Side
from .lit_shots import ShotsAtOnce
from .progress import RenderProgress

Network = TypeVar("Network", bound=nn.Module)


class PosedShot(NamedTuple):
    """A shot's hand in the view of its crop.

    Attributes:
        shot: as given.
        crop: of its image.
        hand: posed, in the crop's low-resolution view.
    """

    shot: Shot
    crop: Crop
    hand: HandInView


@dataclass(frozen=True)
class Pipeline:
    """The way from a shot to a frame of one avatar.

    It copies the avatar's networks at its first frame and uses the copies. Any number of threads may render.

    Attributes:
        avatar: the trained appearance.
        hand: the model of the meshes to render, of either side.
        device: where it computes.
        precision: of the networks; geometry is always fp32. What moves needs no more than bf16.
        backend: computes the costly stages.
    """

    avatar: Avatar
    hand: HandModel
    device: torch.device
    precision: Precision
    backend: ReferenceBackend

    @property
    def renders_at_once(self) -> bool:
        """As in `HandRenderer`."""
        return self._shots is not None

    def at_once(self, shot: Shot) -> Frame | None:
        """Render a frame as one; None: stages must render it, as avatar or shot ask for, or a warning says why.

        Raises:
            LiveHandError: the shot's mesh is not of this hand model.
        """
        if self._shots is None or not self._shots.knows(shot):
            return None
        self.topology_of(shot)
        return self._shots.render(shot)

    @cached_property
    def _shots(self) -> ShotsAtOnce | None:
        raise NotImplementedError

    def posed(self, shot: Shot) -> PosedShot | None:
        """Pose the shot's mesh and find its crop; None if nothing of it is in view."""
        with self.backend.threads_of_frame(0):  # a mesh is small
            topology, mesh = self.topology_of(shot), self.mesh(shot)
            crop = crop_of(mesh, shot.camera, self.avatar.config.sampler, self.avatar.config.superres.scale)
        if crop is None:
            return None
        camera = camera_tensors(crop.camera_of(shot.camera), self.device)
        light_quality = PREVIEW if shot.quality == "preview" else FINAL
        return PosedShot(shot, crop, HandInView(mesh, topology, camera, light_quality=light_quality))

    def mesh(self, shot: Shot) -> PosedMesh:
        """Return the shot's mesh with its normals."""
        return self.backend.posed_mesh(self.topology_of(shot), self.tensor(shot.vertices))

    def topology_of(self, shot: Shot) -> Topology:
        """Return the topology of the shot's side.

        Raises:
            LiveHandError: the shot's mesh is not of this hand model.
        """
        expected = len(self.hand.v_template)
        if len(shot.vertices) != expected:
            raise LiveHandError(
                f"the hand's mesh must have the {expected} vertices of '{self.hand.name}', got {len(shot.vertices)}; "
                "remove modifiers that add or drop vertices"
            )
        return self._topologies[shot.pose.side]

    def conditions(self, posed: PosedShot, visibility: Tensor) -> FrameConditions:
        """Return the field's conditions for the pose; `visibility` [V, K] of the mesh's vertices."""
        hand, theta = posed.hand, self.tensor(self.canonical_theta(posed.shot.pose))
        return FrameConditions.of(
            theta, self.skinning, hand.topology, hand.mesh, visibility, self.backend.local_rotations
        )

    def canonical_theta(self, pose: HandPose) -> np.ndarray:
        """Return the pose [16, 3], rad, mirrored to the avatar's own side."""
        return pose.theta if pose.side == self.hand.side else pose.theta * MIRROR_AXIS_ANGLE

    def rays(self, met: HandInView, conditions: FrameConditions, progress: RenderProgress) -> RenderedRays:
        """Sample the field along the rays that meet the hand's shell, and composite."""
        return self._render_rays(met, conditions, progress.of_rays)

    def precision_of(self, shot: Shot) -> Precision:
        """Return the precision of the networks that a shot needs."""
        return "bf16" if shot.quality == "preview" else self.precision

    @cached_property
    def field(self) -> MlpField | PlaneField:
        """The avatar's field, copied."""
        return self.copied(self.avatar.field)

    @cached_property
    def skinning(self) -> Skinning:
        """Of the hand."""
        return Skinning.of(self.hand, self.device)

    def tensor(self, array: np.ndarray) -> Tensor:
        """Return the array on the device, in single precision."""
        return torch.as_tensor(np.ascontiguousarray(array), dtype=torch.float32, device=self.device)

    def copied(self, network: Network) -> Network:
        """Return a copy of a network for inference on this device; the avatar's own is not changed."""
        return deepcopy(network).to(self.device).eval()

    @cached_property
    def _render_rays(self) -> RayRenderer:
        return self.backend.ray_renderer(self.field, self.avatar.config.sampler, self.precision)

    @cached_property
    def _topologies(self) -> dict[Side, Topology]:
        sides: tuple[Side, ...] = ("right", "left")
        return {side: topology_of(self.hand.for_side(side), self.device, self.hand.side) for side in sides}
