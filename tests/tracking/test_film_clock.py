"""The times of frames: increasing from 0, whatever the file says."""

import numpy as np
import pytest
from livehand.backend.tracking.video import LONGEST_STEP_S, FilmClock

FPS = 25.0
WRAP_S = 2**33 / 90000  # of an MPEG transport stream's clock, 26.5 hours


def times(given, **choices):
    clock = FilmClock(FPS, **choices)
    return [clock.time_s(one) for one in given], clock


@pytest.mark.parametrize("jump_s", [WRAP_S, -WRAP_S, 10.0, -10.0])
def test_a_jump_counts_as_one_frame(jump_s):
    given = 7.0 + np.arange(8) / FPS + np.where(np.arange(8) >= 3, jump_s, 0)
    got, clock = times(given)
    np.testing.assert_allclose(got, np.arange(8) / FPS, atol=1e-9)
    assert clock.jumps == 1
    assert clock.jump_s == pytest.approx(jump_s + 1 / FPS)


def test_every_jump_counts():
    got, clock = times([0.0, 1e5, 0.0, 1e9, 1e9 + 0.2])
    np.testing.assert_allclose(got, [0, 0.04, 0.08, 0.12, 0.32], atol=1e-6)
    assert clock.jumps == 3


def test_uneven_times_and_pauses_are_kept():
    given = [3.0, 3.017, 3.137, 3.137 + 0.9 * LONGEST_STEP_S]
    got, clock = times(given)
    np.testing.assert_allclose(got, np.array(given) - 3)
    assert clock.jumps == 0


def test_times_that_repeat_or_are_missing_increase():
    got, _ = times([0.0, 0.04, 0.04, 0.02, 0.16])
    np.testing.assert_allclose(got, [0, 0.04, 0.08, 0.12, 0.16])
    got, _ = times([None, None, None])
    np.testing.assert_allclose(got, [0, 0.04, 0.08])


def test_a_camera_that_pauses_has_paused():
    assert times([0.0, 20.0], has_jumps=False)[0] == [0, 20]
