"""A capture's training views as windows at full resolution, without the shell's samples; and shots as meshes."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...capture.capture import Capture
from ...field.rays import CameraTensors, camera_tensors
from ...field.sampler import SamplerConfig
from ...geometry.mesh import PosedMesh, Topology, posed_mesh
from ...hand.model import HandModel
from ...hand.posed_bones import bone_frames
from ...hand.topology import topology_of
from ...image.crop import Crop, crop_of
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.shot import Shot
from ...records.side import Side
from ...training.views import TrainingViews

REACH = SamplerConfig(shell_m=0.01)
"""Windows reach 10 mm past the hand."""


class PosedWindow(NamedTuple):
    """One training image around the hand.

    Attributes:
        file: of the image.
        camera: at full resolution.
        target: [4, H, W] sRGB-encoded colour times alpha, and alpha.
        is_inside: [H, W] whether the pixel lies in the image.
        mesh: of the pose.
        bones: [16, 4, 4] bone frames to the world.
        theta: [16, 3] rad.
        pose_index: of the capture.
    """

    file: str
    camera: CameraTensors
    target: Tensor
    is_inside: Tensor
    mesh: PosedMesh
    bones: Tensor
    theta: Tensor
    pose_index: int


class PosedViews(TrainingViews):
    """The training views of a capture that show the hand."""

    def __init__(self, capture: Capture, hand: HandModel, device: torch.device, seed: int = 0):
        super().__init__(capture, capture.of_split("train"), hand, REACH, device, seed)
        if not len(self):
            raise LiveHandError(f"capture {capture.folder} must have training images that show the hand, got none")

    def window(self, index: int) -> PosedWindow:
        """Return the window of view `index`."""
        view, crop = self.views[index], self._crops[index]
        mesh, _ = self._poses[view.pose_index]
        camera = camera_tensors(crop.camera_of(view.camera).scaled(2.0), self.device)
        theta = self._tensor(self.capture.poses[view.pose_index].theta)
        bones = self._bones[view.pose_index]
        target, is_inside = self._target(index), self._inside(index, crop)
        return PosedWindow(view.file, camera, target, is_inside, mesh, bones, theta, view.pose_index)

    def low_camera(self, index: int) -> Camera:
        """Return the camera of view `index`'s window at half resolution."""
        return self._crops[index].camera_of(self.views[index].camera)

    @cached_property
    def _bones(self) -> list[Tensor]:
        return [self._tensor(bone_frames(self.hand, pose)) for pose in self.capture.poses]

    def _tensor(self, values: np.ndarray) -> Tensor:
        return torch.as_tensor(values, dtype=torch.float32, device=self.device)

    def _visibility(self, mesh: PosedMesh) -> Tensor:
        """Return None: no baseline knows of shadows."""
        return mesh.vertices.new_zeros(len(mesh.vertices), 0)


class ShotMeshes:
    """The meshes of shots of one hand model, of either side.

    Args:
        hand: the model.
        device: of the tensors.
    """

    def __init__(self, hand: HandModel, device: torch.device):
        self._hand, self._device = hand, device
        self._topologies: dict[Side, Topology] = {}

    def mesh(self, shot: Shot) -> tuple[PosedMesh, Topology]:
        """Build the shot's mesh.

        Raises:
            LiveHandError: it is not of the model.
        """
        if len(shot.vertices) != len(self._hand.v_template):
            raise LiveHandError(
                f"the hand's mesh must have the {len(self._hand.v_template)} vertices of '{self._hand.name}', "
                f"got {len(shot.vertices)}; remove modifiers that add or drop vertices"
            )
        side = shot.pose.side
        if side not in self._topologies:
            self._topologies[side] = topology_of(self._hand.for_side(side), self._device, self._hand.side)
        vertices = torch.as_tensor(np.ascontiguousarray(shot.vertices), dtype=torch.float32, device=self._device)
        return posed_mesh(self._topologies[side], vertices), self._topologies[side]

    def window(self, shot: Shot, mesh: PosedMesh) -> tuple[Crop, CameraTensors] | None:
        """Find the window around the hand and its camera at full resolution; None: nothing is in view."""
        crop = crop_of(mesh, shot.camera, REACH)
        if crop is None:
            return None
        return crop, camera_tensors(crop.camera_of(shot.camera).scaled(2.0), self._device)
