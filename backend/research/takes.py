"""Takes of our own hand with known poses, as an ordinary camera would see them: what trackers and fits are measured by.

Axes are the camera's (OpenCV's), whose optical centre is the origin.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ..hand.gestures import FingerAxes, sample_angles_deg, theta_of
from ..hand.lbs import posed_vertices
from ..hand.model import HandModel
from ..hand.poses import POSES
from ..image.decode import straight_srgb
from ..motion.landmarks.skeleton import landmarks_of
from ..motion.motion import HandMotion, mirrored
from ..motion.spaces import rest_wrists
from ..records.camera import Camera
from ..records.light import Light, Sky
from ..records.shot import Shot
from ..records.side import Side
from ..render.renderer import Renderer

TakePoses = Literal["library", "mixes", "single"]
TakeView = Literal["palm", "back", "side"]

_SIZE_PX, _FOCAL_PX = (640, 480), 620.0
_KEY_EVERY = 16  # frames
_PALM_TO_CAMERA = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # fingers up, palm towards the camera
_YAW_DEG: dict[TakeView, float] = {"palm": 0, "back": 180, "side": 80}
_TILT_DEG, _TURN_DEG = 20.0, 20.0
_DISTANCE_M, _PATH_M = (0.38, 0.55), 0.05
_SHAPE_SPREAD = 0.7
_GREY, _NOISE = (0.25, 0.6), 0.012


@dataclass(frozen=True)
class MadeTake:
    """A take: the true motion in the camera's axes, and its camera."""

    motion: HandMotion
    camera: Camera
    grey: float


def made_take(
    rng: np.random.Generator,
    model: HandModel,
    poses: TakePoses,
    view: TakeView,
    frames: int = 48,
    side: Side = "right",
    size_px: tuple[int, int] = _SIZE_PX,
) -> MadeTake:
    """Make a hand of random shape that goes through random poses, moves and turns; 30 frames a second.

    Poses are of the library, mixes of gestures, or `single`, in which each finger bends by itself, as no hand does.
    """
    keys = frames // _KEY_EVERY + 2
    if poses == "library":
        named = rng.choice(sorted(POSES), keys, replace=False)
        angles = np.stack([POSES[name].gesture.angles_deg() for name in named])
    elif poses == "mixes":
        angles = sample_angles_deg(rng, keys)
    else:
        angles = np.stack([single_fingers_deg(rng) for _ in range(keys)])
    t = np.arange(frames) / _KEY_EVERY
    left, share = t.astype(int), t % 1
    share = (share * share * (3 - 2 * share))[:, None, None]
    angles = (1 - share) * angles[left] + share * angles[left + 1]
    axes = FingerAxes.of_default_hand()
    theta = np.stack([theta_of(each, axes) for each in angles])
    theta[:, 0] = matrix_to_axis_angle(_roots(rng, view, frames))
    beta = rng.normal(0, _SHAPE_SPREAD, 10)
    model = model.for_side("right")
    wrists = _path(rng, frames) - 0.09 * (axis_angle_to_matrix(theta[:, 0]) @ [-1.0, 0, 0])
    motion = HandMotion(theta, beta, wrists - rest_wrists(model, beta), 30.0, "right")
    scale = size_px[0] / _SIZE_PX[0]
    K = np.array([[_FOCAL_PX * scale, 0, size_px[0] / 2], [0, _FOCAL_PX * scale, size_px[1] / 2], [0, 0, 1]])
    return MadeTake(
        motion if side == "right" else mirrored(motion), Camera(K, np.eye(4), size_px), float(rng.uniform(*_GREY))
    )


def single_fingers_deg(rng: np.random.Generator) -> np.ndarray:
    """Return [15, 3] random angles of each finger by itself; the thumb's are of the library, with noise."""
    angles = np.zeros((15, 3))
    for finger in range(4):
        pip = rng.uniform(0, 100)
        dip = np.clip(pip / 2 + rng.normal(0, 8), 0, 75)
        angles[3 * finger : 3 * finger + 3, 0] = rng.uniform(-10, 85), pip, dip
        angles[3 * finger, 1] = rng.uniform(-8, 8)
    angles[12:] = POSES[rng.choice(sorted(POSES))].gesture.angles_deg()[12:]
    angles[12:, 0] += rng.normal(0, 8, 3)
    angles[12, 1:] += rng.normal(0, 8, 2)
    return angles


def pictures(take: MadeTake, renderer: Renderer, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Draw the take's frames, uint8 [H, W, 3] sRGB: the hand before a noisy grey ground."""
    light = Light((), Sky(np.ones((2, 4, 3))))
    for index in range(len(take.motion)):
        pose = take.motion.pose(index)
        vertices = posed_vertices(renderer.hand, pose)
        rgba = straight_srgb(renderer.render(Shot(pose, vertices, take.camera, light)))
        shown = rgba[..., :3] * rgba[..., 3:] + take.grey * (1 - rgba[..., 3:])
        shown = shown + rng.normal(0, _NOISE, shown.shape)
        yield (np.clip(shown, 0, 1) * 255).round().astype(np.uint8)


def true_landmarks(take: MadeTake, model: HandModel) -> np.ndarray:
    """Return [T, 21, 3] m, the hand's joints and fingertips in the camera's axes, in MediaPipe's order."""
    return np.stack([landmarks_of(model, take.motion.pose(index)) for index in range(len(take.motion))])


def _roots(rng: np.random.Generator, view: TakeView, frames: int) -> np.ndarray:
    """Turn the hand slowly about all axes: [T, 3, 3]."""
    yaw = _YAW_DEG[view] * (rng.choice([-1, 1]) if view == "side" else 1)
    start = np.array([0, yaw, 0]) + rng.uniform(-_TILT_DEG, _TILT_DEG, 3) * (1, 1, 2)
    turned = start + _wave(rng, frames, 3) * _TURN_DEG
    x, y, z = (axis_angle_to_matrix(np.deg2rad(turned[:, [k]]) * np.eye(3)[k]) for k in range(3))
    return z @ x @ y @ _PALM_TO_CAMERA


def _path(rng: np.random.Generator, frames: int) -> np.ndarray:
    """Move the middle of the hand: [T, 3] m."""
    centre = np.array([rng.uniform(-0.04, 0.04), rng.uniform(-0.02, 0.02), rng.uniform(*_DISTANCE_M)])
    return centre + _wave(rng, frames, 3) * _PATH_M * (1, 0.6, 0.8)


def _wave(rng: np.random.Generator, frames: int, count: int) -> np.ndarray:
    """Draw smooth waves [T, count] within about -1..1."""
    rate, phase = rng.uniform(0.5, 1.1, count), rng.uniform(0, 2 * np.pi, count)
    return np.sin(2 * np.pi * rate * np.arange(frames)[:, None] / 48 + phase)
