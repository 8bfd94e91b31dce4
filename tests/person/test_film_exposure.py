"""Gains of a film's frames by the backdrop: automatic exposure is found, a backdrop that changes is refused."""

import numpy as np
import pytest
from livehand.backend.capture.picture import linear_to_srgb
from livehand.backend.person.film_exposure import backdrop_gains, backdrop_sample

pytest.importorskip("cv2")
SIZE, HAND_PX = (90, 160), np.array([50, 20, 110, 90])
RNG = np.random.default_rng(2)
WALL = 0.1 + 0.25 * RNG.random((9, 16, 3)).repeat(10, 0).repeat(10, 1)
GAINS = np.array([[0.0, 0, 0], [0.3, 0.3, 0.3], [-0.4, -0.3, -0.2]])


def frame(gain, wall=WALL, hand=0.5):
    linear = wall.copy()
    linear[20:90, 50:110] = hand
    return (255 * linear_to_srgb((linear * np.exp(gain)).clip(0, 1).astype(np.float32))).round().astype(np.uint8)


def test_exposure_and_white_balance_are_those_of_the_backdrop_whatever_the_hand():
    hands = (0.5, 0.2, 0.8)
    found = backdrop_gains([backdrop_sample(frame(g, hand=h), HAND_PX) for g, h in zip(GAINS, hands, strict=True)])
    np.testing.assert_allclose(found, GAINS - GAINS.mean(0), atol=0.02)


def shelf_before_a_wall(sway_px=(0, 0)):
    """A wall that a camera which exposes a deep skin clips, and a dark shelf; seen by a camera that sways."""
    wall = 0.35 + 0.1 * np.random.default_rng(7).random((18, 32, 3)).repeat(10, 0).repeat(10, 1)
    wall[90:106] *= 0.2
    row, column = 40 + sway_px[0], 60 + sway_px[1]
    return wall[row : row + 90, column : column + 160]


@pytest.mark.parametrize("brightest", [0.4, 1.3])
def test_a_swaying_camera_that_clips_the_backdrop_is_seen_through(brightest):
    """At 1.3 half of the frames show the shelf alone; what is clipped then still says that they are no darker."""
    gains = np.array([[-0.4, -0.3, -0.2], [0.0, 0, 0], [0.1, 0.1, 0], [0.9, 1, 1], [1, 1, 1], [1, 0.9, 1]]) * brightest
    sways = [(0, 0), (5, -10), (-10, 5), (10, 10), (-5, -15), (5, 5)]
    shown = [frame(gain, shelf_before_a_wall(sway)) for gain, sway in zip(gains, sways, strict=True)]
    if brightest > 1:
        assert (shown[4] == 255).mean() > 0.4
    found = backdrop_gains([backdrop_sample(each, HAND_PX) for each in shown])
    np.testing.assert_allclose(found, gains - gains.mean(0), atol=0.03)


def test_another_backdrop_in_every_frame_tells_nothing():
    walls = [0.05 + 0.9 * np.random.default_rng(k).random((9, 16, 3)).repeat(10, 0).repeat(10, 1) for k in range(5)]
    assert backdrop_gains([backdrop_sample(frame(np.zeros(3), wall), HAND_PX) for wall in walls]) is None


def test_a_hand_that_fills_the_frame_leaves_no_backdrop():
    samples = [backdrop_sample(frame(gain), np.array([0, 0, 160, 90])) for gain in GAINS]
    assert backdrop_gains(samples) is None
