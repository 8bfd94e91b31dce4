"""Frames are chosen sharp, well fitted and spread over the turn; two stretches of it are held out."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.motion.motion import HandMotion
from livehand.backend.records.errors import LiveHandError
from livehand.backend.tracking.turning_hand.frame_choice import (
    LEAST_CHOSEN,
    MOST_CHOSEN,
    blur_of,
    chosen_frames,
    held_out,
)
from PIL import Image, ImageFilter


def turn(degrees):
    """A motion whose hand is turned by so much in each frame."""
    theta = np.zeros((len(degrees), 16, 3))
    theta[:, 0, 1] = np.deg2rad(degrees)
    return HandMotion(theta, np.zeros(10), np.zeros((len(degrees), 3)), 30.0)


def test_frames_are_spread_over_the_turn():
    """A hand that rests for half the film, and turns in the rest: the rest is chosen once."""
    degrees = np.r_[np.zeros(300), np.linspace(0, 170, 300)]
    same = np.full(600, 0.01)
    chosen = degrees[chosen_frames(turn(degrees), same, same)]
    assert (chosen < 1).sum() == 1
    steps = np.diff(np.sort(chosen))
    assert 2.4 < steps.min()
    assert np.median(steps) < 3.5


def test_there_are_at_most_so_many():
    """A whole turn with the fingers straight, and one with them bent."""
    motion, same = turn(np.tile(np.linspace(0, 350, 1000), 2)), np.full(2000, 0.01)
    theta = motion.theta.copy()
    theta[1000:, 1:, 2] = 0.8
    chosen = chosen_frames(replace(motion, theta=theta), same, same)
    assert 0.85 * MOST_CHOSEN < len(chosen) <= MOST_CHOSEN
    assert (np.diff(chosen) > 0).all()


@pytest.mark.parametrize("which", ["fit_error", "blur"])
def test_of_frames_of_one_pose_the_best_is_chosen(which):
    degrees = np.repeat(np.arange(0, 170, 5.0), 4)
    values = {name: np.full(len(degrees), 0.02) for name in ("fit_error", "blur")}
    values[which][2::4] = 0.01
    chosen = chosen_frames(turn(degrees), **values)
    assert len(chosen) >= 25
    assert (chosen % 4 == 2).all()


def test_fingers_count_as_well():
    motion = turn(np.zeros(80))
    theta = motion.theta.copy()
    theta[:, 1:, 2] = np.linspace(0, 1.5, 80)[:, None]
    same = np.full(80, 0.01)
    assert len(chosen_frames(replace(motion, theta=theta), same, same)) > LEAST_CHOSEN


def test_a_hand_that_rests_is_an_error():
    same = np.full(300, 0.01)
    with pytest.raises(
        LiveHandError, match=r"needs a hand that turns: at least 20 sharp frames .* got 1; turn the hand"
    ):
        chosen_frames(turn(np.zeros(300)), same, same)


def test_two_stretches_are_held_out():
    np.testing.assert_array_equal(np.flatnonzero(held_out(100)), [*range(22, 27), *range(72, 77)])
    assert held_out(20).sum() == 2


def test_blur_is_seen_along_either_axis_and_whatever_the_contrast():
    picture = np.random.default_rng(0).integers(0, 255, (60, 80, 3)).astype(np.uint8)
    soft = np.asarray(Image.fromarray(picture).filter(ImageFilter.GaussianBlur(2)))
    across = np.repeat(picture[:, ::8], 8, 1)  # changes along one axis are eight times as slow
    assert blur_of(picture) == pytest.approx(0.25, abs=0.02)
    assert blur_of(soft) > 2 * blur_of(picture)
    assert blur_of(across) > 2 * blur_of(picture)
    assert blur_of(picture // 4) == pytest.approx(blur_of(picture), abs=0.02)
    assert blur_of(picture[:3, :3]) == 1
