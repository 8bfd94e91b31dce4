"""What the tests of persons share: the tracker, its pictures, and pictures of a painted hand with its arm."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.capture.masks.mask import short_of_arm
from livehand.backend.capture.picture import linear_to_srgb
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.spaces import rest_wrists, to_blender
from livehand.backend.person.lit_model.model import PersonModel
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.hand_picture import HAND, HandPicture, PicturedHand
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
    """A function (skin=SKIN, bend_rad=0.3, off_m=0, roll_rad=0, is_shown=True) -> `Painted`; its pose is off."""
    model = load_default_hand()

    def paint(skin=SKIN, bend_rad=0.3, off_m=0.0, roll_rad=0.0, is_shown=True):
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
        rgb = np.where(whole[..., None] & is_shown, colour, ground) + rng.normal(0, 4, (*whole.shape, 3))
        shifted = replace(pose, transl=pose.transl + np.array([0, 0, off_m]))
        return Painted(rgb.clip(0, 255).astype(np.uint8), shifted, camera, hand, whole & ~hand)

    return paint


def drawn(vertices, faces, camera):
    """Bool [H, W], the silhouette of a mesh."""
    positions_px, depth = (torch.as_tensor(values) for values in camera.project(vertices))
    mask = np.zeros(camera.size_px[0] * camera.size_px[1], bool)
    mask[rasterise(positions_px, depth, torch.as_tensor(faces), camera.size_px).pixel.numpy()] = True
    return mask.reshape(camera.size_px[::-1])


@cache
def middle_person():
    """The avatar `middle`, ready to be rendered; loaded once."""
    return PersonModel.of(load_avatar(shipped_avatar_path("middle")), load_default_hand())


MADE_SIZE_PX, MADE_FOCAL_PX, VIEWS = (150, 190), 330.0, 6


def pictured(model, light, count=VIEWS):
    """The first pictures of a resting hand from all around, by our own renderer; the last of all is held out."""
    pose = HandPose.rest()
    middle = posed_vertices(model.hand, pose)[model.hand.framed_vertices].mean(0)
    K = np.array([[MADE_FOCAL_PX, 0, MADE_SIZE_PX[0] / 2], [0, MADE_FOCAL_PX, MADE_SIZE_PX[1] / 2], [0, 0, 1]])
    pictures = []
    for index in range(count):
        angle = 2 * np.pi * index / VIEWS
        eye = middle + 0.42 * np.array([0.15, np.cos(angle), np.sin(angle)])
        camera = Camera(K, look_at(eye, middle, np.array([-1.0, 0, 0])), MADE_SIZE_PX)
        frame = model.rendered(pose, camera, light)
        rgb = linear_to_srgb((frame.rgb / np.maximum(frame.alpha[..., None], 1e-3)).clip(0, 1))
        labels = np.where(frame.alpha > 0.5, HAND, 0).astype(np.uint8)
        encoded = (255 * rgb * (frame.alpha[..., None] > 0)).round().astype(np.uint8)
        pictures.append(HandPicture(str(index), encoded, labels, camera, pose, is_held_out=index == VIEWS - 1))
    return PicturedHand(tuple(pictures), "right", "made", is_calibrated=True)
