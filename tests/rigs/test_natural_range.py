"""What a rig leads to is judged by what a hand can do."""

import numpy as np
import pytest
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.motion.motion import HandMotion
from livehand.backend.rigs.natural_range import is_natural, more_natural

AXES = FingerAxes.of_default_hand()


def bent(joint, flexion=0.0, abduction=0.0, twist=0.0):
    """Theta [1, 16, 3] with one joint at angles in degrees."""
    angles = np.zeros((15, 3))
    angles[joint - 1] = flexion, abduction, twist
    return theta_of(angles, AXES, np.array([0.3, -0.2, 0.1]))[None]


@pytest.mark.slow
def test_gestures_are_natural(hand):
    thetas = np.array([theta_of(gesture.angles_deg(), AXES) for gesture in GESTURES.values()])
    assert is_natural(hand, HandMotion(thetas, np.zeros(10), np.zeros((len(thetas), 3))))


def test_a_few_frames_do_not_make_a_motion_unnatural(hand):
    still, turned = bent(1), bent(2, twist=170.0)
    for count, expected in ((1, True), (5, False)):
        thetas = np.concatenate([still] * (40 - count) + [turned] * count)
        assert is_natural(hand, HandMotion(thetas, np.zeros(10), np.zeros((40, 3)))) == expected


def test_another_reading_is_taken_only_if_it_is_much_better(hand):
    good, bad, worse = (HandMotion(bent(2, twist=angle), np.zeros(10), np.zeros((1, 3))) for angle in (0, 100, 120))
    assert more_natural(hand, bad, lambda: good) is good
    assert more_natural(hand, worse, lambda: bad) is worse
    assert more_natural(hand, good, lambda: pytest.fail("not needed")) is good
