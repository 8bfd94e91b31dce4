"""A small capture of the built-in hand, drawn by the rasteriser with colours painted on the skin."""

from pathlib import Path

import numpy as np
import pytest
import torch
from livehand.backend.camera import Camera, look_at
from livehand.backend.capture import Capture, CaptureView, save_capture_index
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import SkinTensors, pose_hand
from livehand.backend.hand.model import load_default_hand
from livehand.backend.shot import HandPose
from PIL import Image

SIZE = (24, 32)


@pytest.fixture(scope="session")
def painted_capture(tmp_path_factory):
    """Two poses from four cameras, 24 x 32 px: 2 x 3 training views, and the fourth camera's held out."""
    hand = load_default_hand()
    folder = tmp_path_factory.mktemp("painted")
    poses = tuple(_pose(hand, gesture) for gesture in ("relaxed", "open"))
    views = []
    for pose_index in range(len(poses)):
        for camera_index, direction in enumerate(([0, 1, 0.2], [0.1, 1, -0.6], [0.1, 0.7, 0.9], [0.2, 0.9, 0.4])):
            split = "train" if camera_index < 3 else "test"
            name = f"{pose_index}_{camera_index}.png"
            views.append(CaptureView(name, _camera(np.array(direction)), camera_index, pose_index, split))
    capture = Capture(folder, hand.sha256, {"made_by": "test"}, poses, tuple(views))
    save_capture_index(capture)
    for view in views:
        _draw(hand, poses[view.pose_index], view.camera, folder / view.file)
    return capture


def _pose(hand, gesture):
    theta = theta_of(GESTURES[gesture].angles_deg(), FingerAxes.of_default_hand())
    return HandPose(theta, np.zeros(10), -hand.joints[4])


def _camera(direction, distance=0.6):
    focal_px = SIZE[1] * distance / 0.25
    K = np.array([[focal_px, 0, SIZE[0] / 2], [0, focal_px, SIZE[1] / 2], [0, 0, 1]])
    origin = distance * direction / np.linalg.norm(direction)
    return Camera(K, look_at(origin, np.zeros(3), np.array([-1.0, 0, 0])), SIZE)


def _draw(hand, pose, camera, path: Path, finer=4):
    """Area-averaged: drawn at four times the resolution."""
    vertices = pose_hand(
        SkinTensors.of(hand, dtype=torch.float64),
        *(torch.as_tensor(value) for value in (pose.theta, pose.beta, pose.transl)),
    ).vertices.numpy()
    large = camera.scaled(float(finer))
    positions_px, depth = large.project(vertices)
    fragments = rasterise(*(torch.as_tensor(value) for value in (positions_px, depth, hand.f)), large.size_px)
    width, height = large.size_px
    order = torch.argsort(fragments.depth, descending=True)
    image = np.zeros((height * width, 4))
    colour = 0.5 + 0.4 * np.sin(hand.v_template[hand.f].mean(1) * (40, 70, 60))
    for pixel, face in zip(fragments.pixel[order].tolist(), fragments.face[order].tolist(), strict=True):
        image[pixel] = (*colour[face], 1)
    small = image.reshape(height // finer, finer, width // finer, finer, 4).mean((1, 3))
    straight = np.concatenate([small[..., :3] / np.maximum(small[..., 3:], 1e-9), small[..., 3:]], -1)
    Image.fromarray((straight * 255).round().astype(np.uint8)).save(path)
