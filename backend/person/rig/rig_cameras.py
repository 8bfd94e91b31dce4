"""The cameras of a rig as tensors, each turned a little about its own centre.

`turn` [3] rad is axis-angle in the camera's axes: tilt about x, pan about y, roll about z. World to camera becomes
exp(turn) times what the calibration has; centres and intrinsics stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...geometry.rotation import axis_angle_to_matrix
from ...geometry.torch_rotation import axis_angle_to_matrix as turned_frames
from ...records.camera import Camera

TILT_PAN_RAD, ROLL_RAD = 0.0025, 0.0015
"""Standard deviations of turns of cameras that are calibrated well."""
REDESCENDS_AT = 3.0
"""Deviations from which a camera counts as moved: its tilt and pan cost hardly more."""
_NEAREST_M = 1e-3


class RigCameras(NamedTuple):
    """C cameras: K [C, 3, 3] px, world2camera [C, 3, 3], origin [C, 3] m."""

    K: Tensor
    world2camera: Tensor
    origin: Tensor

    @classmethod
    def of(cls, cameras: Sequence[Camera], dtype: torch.dtype = torch.float32) -> RigCameras:
        """Stack cameras."""
        rotations = np.stack([camera.cam2world[:3, :3].T for camera in cameras])
        arrays = (np.stack([camera.K for camera in cameras]), rotations, np.stack([c.origin for c in cameras]))
        return cls(*(torch.as_tensor(array, dtype=dtype) for array in arrays))

    def project(
        self, points: Float[Tensor, "N 3"], row: int, turn: Float[Tensor, " 3"]
    ) -> tuple[Float[Tensor, "N 2"], Float[Tensor, " N"]]:
        """Project world points, m, by one turned camera to px, with their depth, m."""
        rotation = turned_frames(turn) @ self.world2camera[row]
        in_camera = (points - self.origin[row]) @ rotation.T
        homogeneous = in_camera @ self.K[row].T
        return homogeneous[:, :2] / homogeneous[:, 2:].clamp(min=_NEAREST_M), in_camera[:, 2]

    def project_by_views(
        self, points: Float[Tensor, "O N 3"], rows: Int[Tensor, " O"], turns: Float[Tensor, "C 3"]
    ) -> Float[Tensor, "O N 2"]:
        """Project each view's world points, m, by the cameras of these rows, turned, to px."""
        rotation = (turned_frames(turns) @ self.world2camera)[rows]
        in_camera = (points - self.origin[rows][:, None]) @ rotation.transpose(1, 2)
        homogeneous = in_camera @ self.K[rows].transpose(1, 2)
        return homogeneous[..., :2] / homogeneous[..., 2:].clamp(min=_NEAREST_M)

    def px_per_m(self, row: int, points: Float[Tensor, "N 3"]) -> float:
        """Compute how large a metre is at the points' mean depth, px."""
        depth = ((points - self.origin[row]) @ self.world2camera[row].T)[:, 2].mean()
        return float(self.K[row].diagonal()[:2].mean() / depth.clamp(min=_NEAREST_M))


def turned(camera: Camera, turn_rad: np.ndarray) -> Camera:
    """Turn a camera [3] rad about its own centre."""
    cam2world = camera.cam2world.copy()
    u, _, vt = np.linalg.svd(cam2world[:3, :3] @ axis_angle_to_matrix(turn_rad).T)
    cam2world[:3, :3] = u @ vt
    return Camera(camera.K, cam2world, camera.size_px)


def turn_costs(turns: Float[Tensor, "C 3"]) -> Float[Tensor, " C"]:
    """Compute each camera's prior, half a square of deviations: redescending in tilt and pan, tight in roll."""
    tilt_pan, roll = (turns[:, :2] / TILT_PAN_RAD) ** 2, (turns[:, 2] / ROLL_RAD) ** 2
    return 0.5 * ((tilt_pan / (1 + tilt_pan / REDESCENDS_AT**2)).sum(1) + roll)
