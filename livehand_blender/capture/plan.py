"""What a capture will hold: poses, cameras and splits, all drawn from one seed, before anything is rendered.

World: Blender's, Z up; the light's front is -Y. Metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...backend.camera import Camera, look_at
from ...backend.capture import Capture, CaptureView, Split
from ...backend.hand.gestures import FingerAxes, axis_angle, rotation_matrix, sample_angles_deg, theta_of
from ...backend.hand.model import UPRIGHT, HandModel
from ...backend.shot import HandPose

DISTANCE_M = 0.75
WHOLE_HAND_M = 0.25  # height of the field of view at the hand: the whole of it, in any pose
CLOSE_UP_M = 0.14
CLOSE_UP_JITTER_M = 0.02
TILT_DEG = 25.0
YAW_DEG = 55.0


@dataclass(frozen=True)
class CapturePlan:
    """The size of a capture. The same plan gives the same poses, cameras and light.

    Attributes:
        seed: of every random choice.
        poses: how many; every 11th, counted from the 6th, is held out.
        cameras: how many; every 5th, counted from the 4th, is held out, every 3rd, counted from the 3rd, is a close-up.
        size_px: (width, height) of an image.
        samples: Cycles samples per pixel of training views.
        eval_samples: of held-out views, high enough that render noise does not hide progress.
        eval_views: how many views each held-out split gets at most.
    """

    seed: int = 0
    poses: int = 77
    cameras: int = 20
    size_px: tuple[int, int] = (167, 256)
    samples: int = 12
    eval_samples: int = 64
    eval_views: int = 24

    def make(self, folder: Path, model: HandModel, provenance: dict) -> Capture:
        """The capture's index."""
        rng = np.random.default_rng(self.seed)
        poses = _sample_poses(rng, self.poses, model)
        cameras = _sample_cameras(rng, self.cameras, self.size_px)
        views = _spread_views(self, cameras)
        return Capture(folder, model.sha256, provenance, poses, views)

    def is_held_out_pose(self, index: int) -> bool:
        """Whether no training view shows this pose."""
        return index % 11 == 5

    def is_held_out_camera(self, index: int) -> bool:
        """Whether no training view comes from this camera."""
        return index % 5 == 3


def _sample_poses(rng: np.random.Generator, count: int, model: HandModel) -> tuple[HandPose, ...]:
    """Poses whose middle (the knuckle of the middle finger) lies near the world's origin."""
    axes = FingerAxes.of_default_hand()
    poses = []
    for angles in sample_angles_deg(rng, count):
        root = rotation_matrix(np.array([0, 0, np.deg2rad(rng.normal(0, YAW_DEG))])) @ _random_tilt(rng) @ UPRIGHT
        middle = model.joints[0] + root @ (model.joints[4] - model.joints[0])
        transl = -middle + rng.normal(0, 0.006, 3)
        poses.append(HandPose(theta_of(angles, axes, axis_angle(root)), np.zeros(10), transl, "right"))
    return tuple(poses)


def _random_tilt(rng: np.random.Generator) -> np.ndarray:
    return rotation_matrix(np.deg2rad(rng.normal(0, TILT_DEG, 3)))


def _sample_cameras(rng: np.random.Generator, count: int, size_px: tuple[int, int]) -> list[Camera]:
    """A Fibonacci sphere of cameras in a random orientation, every third one close up on a part of the hand."""
    width, height = size_px
    turn = rotation_matrix(rng.normal(0, 1, 3))
    cameras = []
    for index, direction in enumerate(_fibonacci_sphere(count) @ turn.T):
        is_close = index % 3 == 2
        field_of_view_m = CLOSE_UP_M if is_close else WHOLE_HAND_M
        target = rng.normal(0, CLOSE_UP_JITTER_M, 3) if is_close else np.zeros(3)
        focal_px = max(size_px) * DISTANCE_M / field_of_view_m
        K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1.0]])
        up = np.array([0, 0, 1.0]) if abs(direction[2]) < 0.9 else np.array([0, 1.0, 0])
        cameras.append(Camera(K, look_at(target + DISTANCE_M * direction, target, up), size_px))
    return cameras


def _fibonacci_sphere(count: int) -> np.ndarray:
    z = 1 - 2 * (np.arange(count) + 0.5) / count
    longitude = np.arange(count) * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(longitude), radius * np.sin(longitude), z], -1)


def _spread_views(plan: CapturePlan, cameras: list[Camera]) -> tuple[CaptureView, ...]:
    """Every training pose from every training camera; of each held-out split, `eval_views` spread evenly."""
    by_split: dict[Split, list[CaptureView]] = {"train": [], "novel_pose": [], "novel_camera": [], "test": []}
    for pose in range(plan.poses):
        for index, camera in enumerate(cameras):
            split = _split(plan.is_held_out_pose(pose), plan.is_held_out_camera(index))
            view = CaptureView(f"images/pose{pose:03d}_cam{index:02d}.png", camera, index, pose, split)
            by_split[split].append(view)
    held_out = [_spread(by_split[split], plan.eval_views) for split in ("novel_pose", "novel_camera", "test")]
    chosen = sum(held_out, by_split["train"])
    return tuple(sorted(chosen, key=lambda view: view.file))


def _split(pose_held_out: bool, camera_held_out: bool) -> Split:
    if pose_held_out:
        return "test" if camera_held_out else "novel_pose"
    return "novel_camera" if camera_held_out else "train"


def _spread(views: list[CaptureView], count: int) -> list[CaptureView]:
    """At most `count` of the views; a stride prime to the number of cameras spreads them over poses and cameras."""
    if len(views) <= count:
        return views
    return [views[k] for k in np.linspace(0, len(views) - 1, count).round().astype(int)]
