"""What the tests of persons share: the tracker, its pictures, and pictures of a painted hand with its arm."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from livehand.backend.capture.masks.mask import short_of_arm
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.spaces import rest_wrists, to_blender
from livehand.backend.records.camera import Camera
from livehand.backend.records.shot import HandPose
from livehand.tests.tracking.conftest import film, networks, shown  # noqa: F401

SIZE_PX, FOCAL_PX = (240, 200), 240.0
SKIN, GLOVE = (205, 150, 125), (70, 90, 190)


@dataclass(frozen=True)
class Painted:
    """A picture, its pose and camera, and where the hand without its arm truly is."""

    rgb: np.ndarray
    pose: HandPose
    camera: Camera
    is_hand: np.ndarray
    is_arm: np.ndarray


@pytest.fixture(scope="session")
def painted():
    """A function (skin=SKIN, bend_rad=0.3, off_m=0, roll_rad=0) -> `Painted`; its pose is off by a shift."""
    model = load_default_hand()

    def paint(skin=SKIN, bend_rad=0.3, off_m=0.0, roll_rad=0.0):
        camera = Camera(
            np.array([[FOCAL_PX, 0, SIZE_PX[0] / 2], [0, FOCAL_PX, SIZE_PX[1] / 2], [0, 0, 1]]),
            to_blender("opencv"),
            SIZE_PX,
        )
        theta = np.zeros((16, 3))
        theta[0] = [np.pi / 2 + roll_rad, 0, 0]  # along X, the back to the camera
        pose = HandPose(theta, np.zeros(10), np.array([0.05, 0.33, 0.0]) - rest_wrists(model, np.zeros(10)))
        bent = replace(pose, forearm=np.array([0.0, bend_rad, 0]))
        vertices = posed_vertices(model, bent)
        whole, hand = drawn(vertices, model.f, camera), drawn(*short_of_arm(vertices, model), camera)
        rng = np.random.default_rng(0)
        rows, columns = np.mgrid[: SIZE_PX[1], : SIZE_PX[0]]
        ground = np.stack([60 + rows / 4, 80 + columns / 6, 75 + 15 * np.sin(rows / 9)], -1)
        colour = np.array(skin) * (1 + 0.1 * np.sin(columns / 7))[..., None]
        rgb = np.where(whole[..., None], colour, ground) + rng.normal(0, 4, (*whole.shape, 3))
        shifted = replace(pose, transl=pose.transl + np.array([0, 0, off_m]))
        return Painted(rgb.clip(0, 255).astype(np.uint8), shifted, camera, hand, whole & ~hand)

    return paint


def drawn(vertices, faces, camera):
    """Bool [H, W], the silhouette of a mesh."""
    positions_px, depth = (torch.as_tensor(values) for values in camera.project(vertices))
    mask = np.zeros(camera.size_px[0] * camera.size_px[1], bool)
    mask[rasterise(positions_px, depth, torch.as_tensor(faces), camera.size_px).pixel.numpy()] = True
    return mask.reshape(camera.size_px[::-1])
