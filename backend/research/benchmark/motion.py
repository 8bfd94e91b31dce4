"""The benchmark's moving hand: a closed loop of poses and cameras, framed like `examples/wave.blend`.

World: Z up, metres. The hand stands upright with its back to the front (-Y), and the camera orbits it. The hand fills
the image's height as in the example, so its share of a wide image is smaller.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf, sqrt
from typing import NamedTuple

import numpy as np
import torch
from PIL import Image, ImageDraw

from ...geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ...hand.gestures import GESTURES, FingerAxes, theta_of
from ...hand.lbs import SkinTensors
from ...hand.model import UPRIGHT, HandModel
from ...records.camera import Camera, look_at
from ...records.shot import HandPose, Shot
from ...render.backends import choose_backend

_CPU = torch.device("cpu")
# The keys of the loop, evenly in time.
_GESTURES = ("open", "pinch", "point", "fist")
# Rotation of the wrist at each key: degrees about X, Y and Z of the upright hand.
_WRIST_DEG = np.array([[5.0, -4, -6], [-5, 4, 14], [5, 3, 10], [-4, 1, 24]])
# Orbit of the camera at each key: target x, y, z and distance in m; yaw and pitch in degrees.
_ORBIT = np.array(
    [
        [-0.020, 0.0, -0.027, 0.77, -16, 3],
        [-0.018, 0.0, -0.031, 0.76, -22, 5],
        [-0.017, 0.0, -0.036, 0.75, -29, 6],
        [-0.012, 0.0, -0.052, 0.69, -40, 11],
    ]
)
_FIELD_OF_VIEW_M = 0.272  # height of the image at this distance:
_FIELD_DISTANCE_M = 0.75
_COVERAGE_FRAMES = 8  # of the loop, over which the coverage is averaged
_ZOOM_STEPS, _COVERAGE_TOLERANCE = 4, 0.005


class MotionFrame(NamedTuple):
    """One frame of the motion: pose and camera, before the mesh is posed."""

    pose: HandPose
    camera: Camera


@dataclass(frozen=True)
class MovingHand:
    """The motion of a hand at one image size.

    Attributes:
        hand: the model.
        size_px: (width, height).
        coverage: mean share of the image that the hand is to cover; None keeps the example's framing.
    """

    hand: HandModel
    size_px: tuple[int, int]
    coverage: float | None = None

    def frames(self, count: int) -> list[MotionFrame]:
        """Pick `count` frames, evenly over the loop."""
        return [self._frame(k / count, self._zoom) for k in range(count)]

    def shot(self, frame: MotionFrame) -> Shot:
        """Make the shot with the posed mesh; part of the stage `pose`."""
        moved = choose_backend(_CPU).skin_motion(self._skin, frame.pose)
        return Shot(frame.pose, moved.vertices.numpy(), frame.camera)

    def covered(self, frame: MotionFrame) -> float:
        """Measure the share of the image that the mesh covers."""
        shot = self.shot(frame)
        return silhouette_px(shot.vertices, self.hand.f, shot.camera) / (self.size_px[0] * self.size_px[1])

    @cached_property
    def _skin(self) -> SkinTensors:
        return SkinTensors.of(self.hand)

    @cached_property
    def _axes(self) -> FingerAxes:
        return FingerAxes.of_default_hand()

    @cached_property
    def _zoom(self) -> float:
        """The enlargement with that mean coverage. An arm leaves the picture as it grows, so one step may not do."""
        zoom, off = 1.0, inf
        for _ in range(_ZOOM_STEPS):
            if self.coverage is None or abs(off - 1) < _COVERAGE_TOLERANCE:
                break
            frames = (self._frame(k / _COVERAGE_FRAMES, zoom) for k in range(_COVERAGE_FRAMES))
            off = float(self.coverage / np.mean([self.covered(frame) for frame in frames]))
            zoom *= sqrt(off)
        return zoom

    def _frame(self, phase: float, zoom: float) -> MotionFrame:
        angles = np.array([GESTURES[name].angles_deg() for name in _GESTURES])
        about_x, about_y, about_z = map(axis_angle_to_matrix, np.diag(np.deg2rad(_eased(phase, _WRIST_DEG))))
        theta = theta_of(_eased(phase, angles), self._axes, matrix_to_axis_angle(about_z @ about_y @ about_x @ UPRIGHT))
        joints = self.hand.joints
        knuckles = joints[0] + UPRIGHT @ (joints[4] - joints[0])
        return MotionFrame(HandPose(theta, np.zeros(10), -knuckles, self.hand.side), self._camera(phase, zoom))

    def _camera(self, phase: float, zoom: float) -> Camera:
        orbit = _eased(phase, _ORBIT)
        yaw, pitch = np.deg2rad(orbit[4:])
        towards = np.array([np.sin(yaw) * np.cos(pitch), -np.cos(yaw) * np.cos(pitch), np.sin(pitch)])
        width, height = self.size_px
        focal_px = zoom * height * _FIELD_DISTANCE_M / _FIELD_OF_VIEW_M
        K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1.0]])
        return Camera(K, look_at(orbit[:3] + orbit[3] * towards, orbit[:3], np.array([0, 0, 1.0])), self.size_px)


def silhouette_px(vertices: np.ndarray, faces: np.ndarray, camera: Camera) -> int:
    """Count the pixels that the mesh covers; all of it must lie in front of the camera."""
    positions_px, _ = camera.project(vertices)
    image = Image.new("1", camera.size_px)
    draw = ImageDraw.Draw(image)
    for corners in positions_px[faces]:
        draw.polygon([tuple(corner) for corner in (corners - 0.5).tolist()], fill=1)
    return int(np.count_nonzero(np.asarray(image)))


def _eased(phase: float, values: np.ndarray) -> np.ndarray:
    """Interpolate between the keys' values with minimum jerk; the last key leads back to the first."""
    first = int(phase * len(values)) % len(values)
    share = phase * len(values) % 1
    share = share**3 * (10 - 15 * share + 6 * share**2)
    return (1 - share) * values[first] + share * values[(first + 1) % len(values)]
