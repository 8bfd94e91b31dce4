"""Match Plate: exposure, gain and bias by their formula, from properties that can be keyed."""

import bpy
import numpy as np
import pytest
from livehand.backend.records.shot import Frame
from livehand.livehand_blender.rig.hand import find_hands
from livehand.livehand_blender.scene.grade import Grade, graded


@pytest.fixture
def frame():
    rng = np.random.default_rng(0)
    alpha = rng.uniform(0, 1, (5, 4)).astype(np.float32)
    alpha[0], alpha[1] = 0, 1
    return Frame(rng.uniform(0, 1, (5, 4, 3)).astype(np.float32) * alpha[..., None], alpha, 1 + alpha)


def straight(frame):
    return frame.rgb[1:] / frame.alpha[1:, :, None]


def test_straight_colour_follows_the_formula(frame):
    grade = Grade(1.5, (0.5, 1.0, 2.0), (0.1, 0.0, 0.02))
    expected = straight(frame) * 2**1.5 * [0.5, 1, 2] + [0.1, 0, 0.02]
    after = graded(frame, grade)
    np.testing.assert_allclose(straight(after), expected, rtol=1e-5)
    assert not after.rgb[0].any()  # where no hand is, bias adds nothing
    assert after.alpha is frame.alpha
    assert after.depth is frame.depth
    assert after.rgb.dtype == np.float32


def test_no_grade_costs_nothing(frame):
    assert graded(frame, Grade()) is frame


def test_colour_is_cut_off_at_black(frame):
    after = graded(frame, Grade(bias=(-0.5, 0.0, 0.0)))
    np.testing.assert_allclose(straight(after)[..., 0], np.maximum(straight(frame)[..., 0] - 0.5, 0), atol=1e-5)


def test_a_new_hand_has_no_grade(hand_scene):
    assert Grade.of_hand(find_hands(hand_scene)[0]) == Grade()


def test_keyed_settings_are_read_from_the_evaluated_hand(hand_scene):
    (hand,) = find_hands(hand_scene)
    for frame, stops in ((1, 0.0), (11, 2.0)):
        hand.livehand.exposure, hand.livehand.gain[1], hand.livehand.bias[2] = stops, 1 + stops, stops / 20
        for name in ("exposure", "gain", "bias"):
            hand.livehand.keyframe_insert(name, frame=frame)
    hand_scene.frame_set(6)
    evaluated = hand.evaluated_get(bpy.context.evaluated_depsgraph_get())
    grade = Grade.of_hand(evaluated)
    assert grade.exposure_stops == pytest.approx(1)
    assert grade.gain == pytest.approx((1, 2, 1))
    assert grade.bias == pytest.approx((0, 0, 0.05))
