"""The cameras of a rig as tensors, each turned a little about its own centre and zoomed.

`turn` [4] is axis-angle in the camera's axes, rad (tilt about x, pan about y, roll about z), and the logarithm of a
factor on the focal lengths, 0 without one. World to camera becomes exp(turn) times what the calibration has; centres
and principal points stay.
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

TILT_PAN_RAD, ROLL_RAD, LOG_ZOOM = 0.0025, 0.0015, 0.004
"""Standard deviations of turns and zooms of cameras that are calibrated well."""
REDESCENDS_AT = 3.0
"""Deviations from which a camera counts as moved: its tilt, pan and zoom cost hardly more."""
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
        self, points: Float[Tensor, "N 3"], row: int, turn: Float[Tensor, " 4"]
    ) -> tuple[Float[Tensor, "N 2"], Float[Tensor, " N"]]:
        """Project world points, m, by one turned camera to px, with their depth, m."""
        rotation = turned_frames(turn[:3]) @ self.world2camera[row]
        in_camera = (points - self.origin[row]) @ rotation.T
        homogeneous = in_camera @ _zoomed(self.K[row], turn[3]).T
        return homogeneous[:, :2] / homogeneous[:, 2:].clamp(min=_NEAREST_M), in_camera[:, 2]

    def project_by_views(
        self, points: Float[Tensor, "O N 3"], rows: Int[Tensor, " O"], turns: Float[Tensor, "C 4"]
    ) -> Float[Tensor, "O N 2"]:
        """Project each view's world points, m, by the cameras of these rows, turned, to px."""
        rotation = (turned_frames(turns[:, :3]) @ self.world2camera)[rows]
        in_camera = (points - self.origin[rows][:, None]) @ rotation.transpose(1, 2)
        homogeneous = in_camera @ _zoomed(self.K[rows], turns[rows, 3]).transpose(1, 2)
        return homogeneous[..., :2] / homogeneous[..., 2:].clamp(min=_NEAREST_M)

    def px_per_m(self, row: int, points: Float[Tensor, "N 3"]) -> float:
        """Compute how large a metre is at the points' mean depth, px."""
        depth = ((points - self.origin[row]) @ self.world2camera[row].T)[:, 2].mean()
        return float(self.K[row].diagonal()[:2].mean() / depth.clamp(min=_NEAREST_M))


def turned(camera: Camera, turn: Float[np.ndarray, " 4"]) -> Camera:
    """Turn and zoom a camera by [4]."""
    cam2world, K = camera.cam2world.copy(), camera.K.copy()
    u, _, vt = np.linalg.svd(cam2world[:3, :3] @ axis_angle_to_matrix(turn[:3]).T)
    cam2world[:3, :3] = u @ vt
    K[[0, 1], [0, 1]] *= np.exp(turn[3])
    return Camera(K, cam2world, camera.size_px)


def turn_costs(turns: Float[Tensor, "C 4"]) -> Float[Tensor, " C"]:
    """Compute each camera's prior, half a square of deviations: redescending in tilt, pan and zoom, tight in roll."""
    loose = (turns[:, [0, 1, 3]] / turns.new_tensor((TILT_PAN_RAD, TILT_PAN_RAD, LOG_ZOOM))) ** 2
    roll = (turns[:, 2] / ROLL_RAD) ** 2
    return 0.5 * ((loose / (1 + loose / REDESCENDS_AT**2)).sum(1) + roll)


def _zoomed(K: Float[Tensor, "*b 3 3"], log_zoom: Float[Tensor, "*b"]) -> Float[Tensor, "*b 3 3"]:
    factor, one = log_zoom.exp(), torch.ones_like(log_zoom)
    columns = torch.stack([factor, factor, one], -1)  # no skew: the first two columns hold focal lengths alone
    return K * columns[..., None, :]
