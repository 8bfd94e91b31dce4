"""The recording of the walk-through: how it is interpreted, and that its script reproduces it."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from livehand.backend.motion.files.open_files import open_motion_file

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_it_is_two_seconds_of_a_left_hand_without_translation(hand):
    reading = open_motion_file(EXAMPLES / "take.json").info
    assert (reading.format, reading.side, reading.frames, reading.fps) == ("MediaPipe landmarks", "left", 24, 12)
    assert not reading.has_translation
    assert open_motion_file(EXAMPLES / "take.json").warning(hand) is None


def test_its_script_reproduces_it():
    made = runpy.run_path(str(EXAMPLES / "make_take.py"))["take"]()
    saved = json.loads((EXAMPLES / "take.json").read_text())
    np.testing.assert_allclose(made.pop("world_landmarks"), saved.pop("world_landmarks"), atol=1.5e-4)
    assert made == saved


def test_its_fingers_are_bent_as_the_numbers_say(hand):
    """Flexion of the knuckles and joints after it, summed over index to little finger, falls as fingers are put up."""
    motion = open_motion_file(EXAMPLES / "take.json").motion(hand)
    bend = np.linalg.norm(motion.theta[:, 1:13].reshape(-1, 4, 3, 3), axis=-1).sum(-1)  # index, middle, pinky, ring
    up = bend < 1.2
    assert up[0].sum() == 0
    assert up[-1].all()
    assert [int(up[k].sum()) for k in (5, 9, 14, 18)] == [1, 2, 3, 4]
