"""What no hand can do is named with joints and degrees, whatever road a motion comes in by."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.hand.bones import rest_forearm
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.motion.gate import bends_backwards, excess_rad, motion_doubts, pose_doubts
from livehand.backend.motion.motion import HandMotion, mirrored

AXES = FingerAxes.of_default_hand()


def bent(joint, flexion=0.0, abduction=0.0, twist=0.0):
    """Theta [1, 16, 3] with one joint at angles in degrees."""
    angles = np.zeros((15, 3))
    angles[joint - 1] = flexion, abduction, twist
    return theta_of(angles, AXES, np.array([0.3, -0.2, 0.1]))[None]


def motion_of(thetas, **changes):
    count = len(thetas)
    return replace(HandMotion(thetas, np.zeros(10), np.zeros((count, 3)), 30.0), **changes)


def closing(count=40, most=1.0):
    """A right hand [count, 16, 3] that closes from flat, by a share of a fist at most."""
    fist = GESTURES["fist"].angles_deg()
    return np.array([theta_of(share * fist, AXES) for share in np.linspace(0, most, count)])


@pytest.mark.parametrize(
    ("joint", "angles", "excess_deg"),
    [
        (1, {"flexion": 100.0}, 0),
        (1, {"flexion": 150.0}, 50),
        (4, {"flexion": -90.0}, 50),
        (7, {"abduction": 45.0}, 15),
        (2, {"flexion": 60.0, "twist": 179.0}, 149),
        (13, {"twist": 70.0}, 20),
        (15, {"abduction": -50.0}, 20),
    ],
)
@pytest.mark.parametrize("side", ["right", "left"])
def test_the_worst_angle_beyond_the_limits(hand, side, joint, angles, excess_deg):
    theta = bent(joint, **angles) * (1 if side == "right" else MIRROR_AXIS_ANGLE)
    excess = np.rad2deg(excess_rad(hand.for_side(side), theta))[0]
    assert excess[joint - 1] == pytest.approx(excess_deg, abs=0.1)
    assert np.delete(excess, joint - 1).max() < 1e-6


@pytest.mark.parametrize("side", ["right", "left"])
def test_natural_motions_pass_without_a_word(hand, side):
    gestures = motion_of(np.array([theta_of(one.angles_deg(), AXES) for one in GESTURES.values()]), fps=1.0)
    for motion in (gestures, motion_of(closing())):
        assert motion_doubts(hand, motion if side == "right" else mirrored(motion)) == []


def test_a_joint_beyond_its_limits_is_named_even_in_one_frame(hand):
    thetas = np.concatenate([bent(1)] * 19 + [bent(2, flexion=-60.0)] + [bent(1)] * 20)
    (said,) = motion_doubts(hand, motion_of(thetas))
    assert said == "index2 bend up to 35 degrees beyond what a hand can, in 1 of 40 frames, first in its frame 20"
    (always,) = motion_doubts(hand, motion_of(np.concatenate([bent(2, twist=60.0)] * 3)))
    assert always == "index2 bend up to 30 degrees beyond what a hand can"


@pytest.mark.slow
@pytest.mark.parametrize("side", ["right", "left"])
def test_a_mirrored_hand_bends_backwards(hand, side):
    own = closing() * (1 if side == "right" else MIRROR_AXIS_ANGLE)
    assert not bends_backwards(own, side)
    assert bends_backwards(own * MIRROR_AXIS_ANGLE, side)
    assert not bends_backwards(closing(most=0.05) * MIRROR_AXIS_ANGLE, side)  # nearly flat: it cannot be told
    backwards, beyond, *_ = motion_doubts(hand, motion_of(own * MIRROR_AXIS_ANGLE, side=side))
    assert backwards.startswith("the fingers bend 67 degrees backwards on average")
    assert "index1, index2, index3" in beyond


def test_a_jump_is_told_and_single_pictures_are_another_matter(hand):
    thetas = np.concatenate([closing(20), closing(20)])
    thetas[30:, 0] = [0.0, 0.0, 2.0]
    said = motion_doubts(hand, motion_of(thetas))
    assert said == ["wrist turns by 115 degrees from its frame 30 to the next, one of 2 such jumps"]
    fist, flat = closing()[-1], closing()[0]
    assert motion_doubts(hand, motion_of(np.array([fist, flat] * 5))) == [
        "9 of 10 frames do not follow the one before: they may be single pictures"
    ]
    assert motion_doubts(hand, motion_of(np.array([fist, flat] * 5), fps=10.0)) == []


def test_a_place_a_shape_or_angles_in_another_unit(hand):
    still = np.repeat(closing()[-1:], 20, 0)
    far = motion_of(still, transl=np.full((20, 3), 400.0))
    assert motion_doubts(hand, far) == ["the wrist is up to 693 m away: the unit may be another"]
    fast = motion_of(still, transl=np.arange(20.0)[:, None] * [2.0, 0, 0])
    assert motion_doubts(hand, fast) == ["the wrist moves at 60 m/s: the unit or the rate may be another"]
    odd = motion_of(still, beta=np.r_[40.0, np.zeros(9)])
    assert motion_doubts(hand, odd) == ["a shape of 40 standard deviations is no hand's"]
    degrees = motion_doubts(hand, motion_of(np.rad2deg(still)))
    assert degrees[0] == "angles of up to 92 rad: they may be in degrees"


def test_a_joint_slightly_beyond_its_limits_is_named_too(hand):
    thetas = np.concatenate([bent(1)] * 7 + [bent(2, flexion=-32.0)] + [bent(1)] * 2)
    assert motion_doubts(hand, motion_of(thetas)) == [
        "index2 bend up to 7 degrees beyond a hand's usual limits, in 1 of 10 frames, first in its frame 8"
    ]
    both = np.concatenate([bent(2, flexion=-60.0), bent(14, flexion=78.0)])
    assert motion_doubts(hand, motion_of(both)) == [
        "index2 bend up to 35 degrees beyond what a hand can, in 1 of 2 frames, first in its frame 1",
        "thumb2 bend up to 3 degrees beyond a hand's usual limits, in 1 of 2 frames, first in its frame 2",
    ]
    assert motion_doubts(hand, motion_of(bent(2, flexion=-25.5))) == []  # rounding


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_wrist_bent_as_none_can(hand, side):
    flexion = rest_forearm(hand.for_side(side)).frame[:, 0]
    for degrees, said in ((60, []), (120, ["the wrist bends by up to 120 degrees against the forearm"])):
        arm = np.deg2rad(degrees) * flexion
        motion = motion_of(np.zeros((1, 16, 3)), forearm=arm, side=side)
        assert motion_doubts(hand, motion) == said


def test_poses_in_no_order_are_not_said_to_jump_and_name_no_frames(hand):
    fist, flat = closing()[-1], closing()[0]
    motion = motion_of(np.array([flat, fist] * 4 + [bent(2, flexion=-60.0)[0]]))
    assert pose_doubts(hand, motion, counted=None) == ["index2 bend up to 35 degrees beyond what a hand can"]
