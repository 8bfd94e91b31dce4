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
    smear_of,
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
    chosen = degrees[chosen_frames(turn(degrees), same, same, 0 * same)]
    assert (chosen < 1).sum() == 1
    steps = np.diff(np.sort(chosen))
    assert 2.4 < steps.min()
    assert np.median(steps) < 3.5


def test_there_are_at_most_so_many():
    """A whole turn with the fingers straight, and one with them bent."""
    motion, same = turn(np.tile(np.linspace(0, 350, 1000), 2)), np.full(2000, 0.01)
    theta = motion.theta.copy()
    theta[1000:, 1:, 2] = 0.8
    chosen = chosen_frames(replace(motion, theta=theta), same, same, 0 * same)
    assert 0.85 * MOST_CHOSEN < len(chosen) <= MOST_CHOSEN
    assert (np.diff(chosen) > 0).all()


@pytest.mark.parametrize("which", ["fit_error", "blur", "smear"])
def test_of_frames_of_one_pose_the_best_is_chosen(which):
    degrees = np.repeat(np.arange(0, 170, 5.0), 4)
    values = {name: np.full(len(degrees), 0.02) for name in ("fit_error", "blur", "smear")}
    values[which][2::4] = 0.01
    chosen = chosen_frames(turn(degrees), **values)
    assert len(chosen) >= 25
    assert (chosen % 4 == 2).all()


def test_where_enough_frames_rest_none_is_chosen_that_moves():
    """Half of the turn is fast; with more frames wanted than rest, it is used."""
    degrees, same = np.linspace(0, 350, 600), np.full(600, 0.01)
    smear = np.where(np.arange(600) % 100 < 50, 0.01, 0.05)
    few = chosen_frames(turn(degrees), same, same, smear, most=40)
    assert len(few) > 30
    assert (smear[few] == 0.01).all()
    assert (smear[chosen_frames(turn(degrees), same, same, smear, most=400)] == 0.05).any()


def test_a_smear_is_the_way_in_a_sixtieth_of_a_second_over_the_hands_size():
    """A hand of 200 px at 240 px/s, of which two joints are faster; the frames before and after tell it."""
    px = np.random.default_rng(0).uniform(0, 200, (21, 2))
    px[:2] = [[0, 0], [200, 200]]
    times_s = np.array([0.0, 0.1, 0.3, 0.4, 9.0])
    moved = px + 240 * np.array([0.0, 0.1, 0.1, 0.2, 0.2])[:, None, None] * [1, 0]
    np.testing.assert_allclose(smear_of(moved, times_s), [4 / 200, 2 / 200, 2 / 200, 4 / 200, 0], atol=1e-9)
    moved[:, 5:7, 1] += 1000 * times_s[:, None]
    np.testing.assert_allclose(smear_of(moved, times_s)[0] * np.ptp(moved[0], axis=0).max(), 4, atol=1e-9)
    np.testing.assert_array_equal(smear_of(px[None], np.zeros(1)), [0])


def test_fingers_count_as_well():
    motion = turn(np.zeros(80))
    theta = motion.theta.copy()
    theta[:, 1:, 2] = np.linspace(0, 1.5, 80)[:, None]
    same = np.full(80, 0.01)
    assert len(chosen_frames(replace(motion, theta=theta), same, same, 0 * same)) > LEAST_CHOSEN


def test_a_hand_that_rests_is_an_error():
    same = np.full(300, 0.01)
    with pytest.raises(
        LiveHandError, match=r"needs a hand that turns: at least 20 sharp frames .* got 1; turn the hand"
    ):
        chosen_frames(turn(np.zeros(300)), same, same, same)


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
