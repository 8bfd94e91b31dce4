"""A hand that comes frame by frame passes the gate as a motion does: good ones without a word, faults in a second."""

import numpy as np
import pytest
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_POINT
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.landmarks.live_gate import LiveGate
from livehand.backend.motion.landmarks.online_fit import OnlineFit
from livehand.backend.motion.landmarks.skeleton import landmarks_of
from livehand.backend.motion.landmarks.take_file import take_doubts
from livehand.backend.motion.landmarks.take_fit import FilmedHand, fit_take
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.tests.builders import joints_as_tracked

HAND = load_default_hand()


@pytest.fixture(scope="module")
def filmed(made, seen):
    """1.5 s of a right hand, and its true poses."""
    motion, points = made(45)
    return seen(points), motion


def said(filmed, poses, side="right"):
    """What the gate says of poses at 30 a second, None where none was found."""
    gate = LiveGate(HAND, side)
    for index, pose in enumerate(poses):
        gate.saw(index / 30, filmed.world[index % len(filmed.world)], pose)
    return list(gate.doubts)


def poses_of(motion):
    return [motion.pose(index) for index in range(len(motion))]


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_natural_hand_passes_without_a_word(filmed, side):
    hand, motion = filmed
    if side == "left":
        hand = FilmedHand(hand.frames, hand.px, hand.world * MIRROR_POINT)
    poses = [pose if side == "right" else pose.mirrored() for pose in poses_of(motion)]
    assert said(hand, poses, side) == []


def test_a_mirrored_hand_bends_backwards(filmed):
    hand, motion = filmed
    (doubt,) = said(FilmedHand(hand.frames, hand.px, hand.world * MIRROR_POINT), poses_of(motion))
    assert doubt.endswith("degrees bent backwards, as in a mirrored picture")


@pytest.mark.parametrize("name", ["rest", "open", "spread"])
@pytest.mark.parametrize("side", ["right", "left"])
def test_a_mirrored_hand_that_is_flat_has_its_thumb_behind_the_palm(name, side):
    pose = HandPose(theta_of(GESTURES[name].angles_deg(), FingerAxes.of_default_hand()), np.zeros(10), np.zeros(3))
    flat = landmarks_of(HAND, pose) * (MIRROR_POINT if side == "left" else 1)
    shown = pose if side == "right" else pose.mirrored()
    for points, doubts in (
        (flat, []),
        (flat * MIRROR_POINT, ["the thumb is seen behind the palm, as in a mirrored picture"]),
    ):
        seen = FilmedHand(np.arange(45), np.zeros((45, 21, 2)), np.repeat(points[None], 45, 0))
        assert said(seen, [shown] * 45, side) == doubts


def test_a_hand_that_is_mostly_lost(filmed):
    hand, motion = filmed
    poses = [pose if index % 2 else None for index, pose in enumerate(poses_of(motion))]
    assert said(hand, poses)[0] == "the hand was not where it seemed in 52 % of the frames"
    assert said(hand, [None] * 40) == ["the hand was not where it seemed in 100 % of the frames"]


def test_a_jump_and_a_joint_beyond_its_limits(filmed):
    hand, motion = filmed
    poses = poses_of(motion)
    theta = poses[20].theta.copy()
    theta[0], theta[5] = -theta[0], [0, 0, 2.5]
    poses[20] = HandPose(theta, np.zeros(10), poses[20].transl)
    beyond, jump = said(hand, poses)
    assert beyond.startswith("middle2 bend up to")
    assert "in 1 of 31 frames, first in its frame 21" in beyond
    assert jump == "middle2 turns by 125 degrees from its frame 20 to the next, one of 2 such jumps"


def test_a_fault_is_forgotten_when_it_is_over(filmed):
    hand, motion = filmed
    good = poses_of(motion)
    assert said(hand, [None] * 40 + good + good + good[:40]) == []


def test_what_is_refused_is_told(filmed, film_camera):
    hand, _motion = filmed
    gate = LiveGate(HAND, "right")
    fit = OnlineFit(film_camera, HAND, "right", lifting=joints_as_tracked)
    for index in range(40):
        try:
            fit.follow(index / 30, hand.px[index], 1000 * hand.world[index])
        except LiveHandError as error:
            gate.refused(index / 30, str(error))
    assert "in metres, got one 1e+03 times as large" in gate.doubts[0]
    with pytest.raises(LiveHandError, match="must be finite, got NaN"):
        fit.follow(2.0, np.full((21, 2), np.nan), hand.world[0])


@pytest.mark.slow
def test_a_take_of_a_mirrored_hand(filmed, film_camera):
    hand, _motion = filmed
    times = np.arange(45) / 30
    good = fit_take(hand, times, film_camera, HAND, "right", 30.0, lifting=joints_as_tracked)
    assert take_doubts(good, HAND) is None
    wrong = fit_take(hand, times, film_camera, HAND, "left", 30.0, lifting=joints_as_tracked)
    assert "degrees bent backwards, as in a mirrored picture" in take_doubts(wrong, HAND)
    broken = FilmedHand(hand.frames, hand.px, np.where(np.arange(45)[:, None, None] == 7, np.nan, hand.world))
    with pytest.raises(LiveHandError, match="must be finite, got NaN"):
        fit_take(broken, times, film_camera, HAND, "right", 30.0)


def test_fingers_that_seem_to_bend_backwards_now_and_then_are_no_mirrored_hands(filmed):
    """A tracker errs so in frames here and there of real films, whose thumb lies where it should."""
    hand, motion = filmed
    world = hand.world.copy()
    palm = world[::6, [0, 5, 17]]
    inward = np.cross(palm[:, 1] - palm[:, 0], palm[:, 2] - palm[:, 0])
    inward /= np.linalg.norm(inward, axis=-1, keepdims=True)
    above = ((world[::6, 6:] - palm[:, :1]) * inward[:, None]).sum(-1, keepdims=True)
    world[::6, 6:] -= 2 * above * inward[:, None]
    assert said(FilmedHand(hand.frames, hand.px, world), poses_of(motion)) == []
