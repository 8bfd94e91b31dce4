"""A film of a hand of known poses that turns before a resting camera: flat skin before a wall.

It shows the arm as well, whose wrist bends; the fit, as any, does not know of that.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand, load_hand_model
from livehand.backend.motion.landmarks.skeleton import landmarks_of
from livehand.backend.motion.landmarks.take_file import FilmedTake
from livehand.backend.motion.landmarks.take_fit import FilmCamera, FilmedHand, TakeFit
from livehand.backend.motion.motion import HandMotion, mirrored
from livehand.backend.motion.spaces import rest_wrists
from livehand.backend.records.camera import Camera
from livehand.tools.builtin_hand import TEMPLATE

HAND, HAND_ALONE = load_default_hand(), load_hand_model(TEMPLATE)
BEND_RAD = 0.2
SIZE_PX, FOCAL_PX, COUNT = (160, 120), 155.0, 40
FACING = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # fingers up, palm to the camera


@pytest.fixture(scope="session")
def turning():
    """A function (turn_deg=160, side="right", beta=0) -> the true motion, camera, take, fit, and pictures of a film."""
    return _film


@pytest.fixture(scope="session")
def film(turning):
    """The film of a right hand."""
    return turning()


def _film(turn_deg=160.0, side="right", beta=None, draws=True):
    beta = np.zeros(10) if beta is None else beta
    yaw = np.deg2rad(np.linspace(0, turn_deg, COUNT))[:, None] * [0.0, 1, 0]
    theta = np.zeros((COUNT, 16, 3))
    theta[:, 1:, 2] = -0.15 - 0.1 * np.sin(np.linspace(0, 6, COUNT))[:, None]
    root = axis_angle_to_matrix(yaw) @ FACING
    theta[:, 0] = matrix_to_axis_angle(root)
    wrist = [0.0, 0, 0.45] - 0.08 * (root @ [-1.0, 0, 0])
    motion = HandMotion(theta, beta, wrist - rest_wrists(HAND, beta), 30.0)
    motion = motion if side == "right" else mirrored(motion)
    model = HAND.for_side(side)
    K = np.array([[FOCAL_PX, 0, SIZE_PX[0] / 2], [0, FOCAL_PX, SIZE_PX[1] / 2], [0, 0, 1]])
    camera = Camera(K, np.eye(4), SIZE_PX)
    poses = [motion.pose(index) for index in range(COUNT)]
    points = np.stack([landmarks_of(model, pose) for pose in poses])
    seen = FilmedHand(np.arange(COUNT), camera.project(points)[0], points - points.mean(1, keepdims=True))
    take = FilmedTake(FilmCamera(SIZE_PX, FOCAL_PX), np.arange(COUNT) / 30, 30.0, {side: seen})
    fit = TakeFit(motion, 0.0, np.ones(COUNT, bool), np.full(COUNT, 0.01), 0)
    if not draws:
        return SimpleNamespace(motion=motion, camera=camera, take=take, fit=fit, model=model)
    turns = BEND_RAD * np.sin(np.linspace(0, 5, COUNT))[:, None] * [0.0, 1, 0.5]
    bent = [replace(pose, forearm=turn) for pose, turn in zip(poses, turns, strict=True)]
    masks = [drawn(HAND_ALONE, pose, camera) for pose in bent]
    pictures = [photograph(drawn(HAND, pose, camera)) for pose in bent]
    return SimpleNamespace(
        motion=motion, camera=camera, take=take, fit=fit, model=model, masks=masks, pictures=pictures
    )


def drawn(model, pose, camera):
    """Bool [H, W], the silhouette of a posed hand."""
    vertices = posed_vertices(model.for_side(pose.side), pose)
    positions_px, depth = (torch.as_tensor(values) for values in camera.project(vertices))
    mask = np.zeros(SIZE_PX[0] * SIZE_PX[1], bool)
    mask[rasterise(positions_px, depth, torch.as_tensor(model.f), SIZE_PX).pixel.numpy()] = True
    return mask.reshape(SIZE_PX[::-1])


def photograph(mask):
    """Skin before an uneven, noisy wall, uint8 [H, W, 3]; the same wall in every picture."""
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[: SIZE_PX[1], : SIZE_PX[0]]
    ground = np.stack([40 + rows / 4, 70 + columns / 5, 60 + 15 * np.sin(rows / 9)], -1)
    skin = np.array([205, 150, 125]) + 20 * np.sin(columns / 7)[..., None]
    return (np.where(mask[..., None], skin, ground) + rng.normal(0, 5, (*mask.shape, 3))).clip(0, 255).astype(np.uint8)
