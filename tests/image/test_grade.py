"""Grades: exposure, gain and bias follow their formula."""

import numpy as np
import pytest
from livehand.backend.image.grade import Grade, graded
from livehand.backend.records.frame import Frame


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
    assert not after.rgb[0].any()  # bias adds nothing where there is no hand
    assert after.alpha is frame.alpha
    assert after.depth is frame.depth
    assert after.rgb.dtype == np.float32


def test_a_neutral_grade_returns_the_same_frame(frame):
    assert graded(frame, Grade()) is frame


def test_colour_is_clipped_at_black(frame):
    after = graded(frame, Grade(bias=(-0.5, 0.0, 0.0)))
    np.testing.assert_allclose(straight(after)[..., 0], np.maximum(straight(frame)[..., 0] - 0.5, 0), atol=1e-5)
