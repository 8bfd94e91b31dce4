"""A filmed hand with known poses."""

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.gestures import FingerAxes, sample_angles_deg, theta_of
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.landmarks.skeleton import landmarks_of
from livehand.backend.motion.landmarks.take_fit import FilmCamera, FilmedHand
from livehand.backend.motion.motion import HandMotion
from livehand.backend.motion.spaces import rest_wrists

HAND = load_default_hand()
CAMERA = FilmCamera((640, 480), 620.0)
FACING = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # fingers up, palm to the camera


@pytest.fixture(scope="session")
def film_camera():
    return CAMERA


@pytest.fixture(scope="session")
def made():
    """A function (count=30, seed=0) -> motion of a right hand, and its true landmarks [T, 21, 3] m, camera's axes."""
    return _made


@pytest.fixture(scope="session")
def seen():
    """A function (points, frames=None) -> the filmed hand of such landmarks."""
    return _seen


def _made(count=30, seed=0, every=15):
    """A right hand that bends, turns and moves; its true landmarks [T, 21, 3] m in the camera's axes."""
    rng, axes = np.random.default_rng(seed), FingerAxes.of_default_hand()
    keys = sample_angles_deg(rng, count // every + 2)
    t = np.arange(count) / every
    share = (t % 1)[:, None, None]
    share = share * share * (3 - 2 * share)
    angles = (1 - share) * keys[t.astype(int)] + share * keys[t.astype(int) + 1]
    theta = np.array([theta_of(each, axes) for each in angles])
    turn = axis_angle_to_matrix(0.4 * np.sin(t[:, None] + rng.uniform(0, 6, 3)))
    theta[:, 0] = matrix_to_axis_angle(turn @ FACING)
    transl = np.array([0.0, 0.05, 0.45]) + 0.04 * np.sin(1.3 * t[:, None] + rng.uniform(0, 6, 3))
    motion = HandMotion(theta, np.zeros(10), transl - rest_wrists(HAND, np.zeros(10)), 30.0)
    return motion, _landmarks(motion)


def _landmarks(motion):
    return np.stack([landmarks_of(HAND, motion.pose(index)) for index in range(len(motion))])


def _seen(points, frames=None):
    frames = np.arange(len(points)) if frames is None else frames
    px = points[..., :2] / points[..., 2:] * CAMERA.focal_px + np.array(CAMERA.size_px) / 2
    return FilmedHand(frames, px[frames], (points - points.mean(1, keepdims=True))[frames])
