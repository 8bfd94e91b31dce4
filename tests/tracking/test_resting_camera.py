"""Whether a camera rests, seen where no hand may be."""

import numpy as np
import pytest
from livehand.backend.tracking.resting_camera import MOST_CHANGE, ground_change

GROUND = np.random.default_rng(0).integers(0, 255, (20, 30, 3)).astype(np.uint8)
NOWHERE = np.zeros((20, 30), bool)


def test_a_resting_camera_shows_the_same_ground():
    noisy = (GROUND + np.random.default_rng(1).normal(0, 2, GROUND.shape)).clip(0, 255).astype(np.uint8)
    change = ground_change([GROUND, noisy], [NOWHERE, NOWHERE])
    assert change is not None
    assert 0 < change < MOST_CHANGE


def test_one_frame_that_moved_is_enough():
    change = ground_change([GROUND, GROUND, np.roll(GROUND, 3, 1)], [NOWHERE] * 3)
    assert change is not None
    assert change > MOST_CHANGE


def test_what_the_hand_covers_does_not_count():
    other, covered = GROUND.copy(), NOWHERE.copy()
    other[:, :20], covered[:, :20] = 255, True
    assert ground_change([GROUND, other], [NOWHERE, covered]) == 0


@pytest.mark.parametrize("count", [0, 1, 2])
def test_nothing_to_compare(count):
    assert ground_change([GROUND] * count, [~NOWHERE] * count) is None
