"""Joint angles beyond what a hand can do are measured and named."""

import numpy as np
import pytest
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.motion.motion import HandMotion
from livehand.backend.rigs.natural_range import excess_rad, more_natural, unnatural_joints

AXES = FingerAxes.of_default_hand()


def bent(joint, flexion=0.0, abduction=0.0, twist=0.0):
    """Theta [1, 16, 3] with one joint at angles in degrees."""
    angles = np.zeros((15, 3))
    angles[joint - 1] = flexion, abduction, twist
    return theta_of(angles, AXES, np.array([0.3, -0.2, 0.1]))[None]


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


def test_gestures_are_natural(hand):
    thetas = np.array([theta_of(gesture.angles_deg(), AXES) for gesture in GESTURES.values()])
    assert unnatural_joints(hand, HandMotion(thetas, np.zeros(10), np.zeros((len(thetas), 3)))) is None


def test_joints_that_are_beyond_in_more_than_a_few_frames_are_named(hand):
    still, turned = bent(1), bent(2, twist=170.0)
    for count, said in ((1, None), (5, "index2 bend up to 140 degrees beyond what a hand can")):
        thetas = np.concatenate([still] * (40 - count) + [turned] * count)
        motion = HandMotion(thetas, np.zeros(10), np.zeros((40, 3)))
        assert unnatural_joints(hand, motion) == said


def test_another_reading_is_taken_only_if_it_is_much_better(hand):
    good, bad, worse = (HandMotion(bent(2, twist=angle), np.zeros(10), np.zeros((1, 3))) for angle in (0, 100, 120))
    assert more_natural(hand, bad, lambda: good) is good
    assert more_natural(hand, worse, lambda: bad) is worse
    assert more_natural(hand, good, lambda: pytest.fail("not needed")) is good
