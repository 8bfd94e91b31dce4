"""A finger that is bent where the pictures' are straight is found and bent back; good ones are left alone."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.person.fit.stray_fingers import finger_misses, without_stray_fingers
from livehand.backend.person.lit_model.illumination import Illumination, lobe_directions
from livehand.backend.person.lit_model.picture_lights import PictureIlluminations
from livehand.backend.records.hand_picture import UNKNOWN
from livehand.tests.person.conftest import VIEWS, middle_person, pictured

pytest.importorskip("cv2")
pytestmark = pytest.mark.slow
MIDDLE_FINGER, BEND_RAD = slice(4, 7), 0.9


@pytest.fixture(scope="module")
def shown():
    directions = lobe_directions()
    light = Illumination(0.1 + 0.4 * directions[:, 2].clip(0), np.ones(3))
    return pictured(middle_person(), light.light).pictures, PictureIlluminations({0: light})


def bent(picture):
    theta = picture.pose.theta.copy()
    theta[MIDDLE_FINGER, 2] += BEND_RAD
    return replace(picture, pose=replace(picture.pose, theta=theta))


def test_good_fingers_are_left_alone(shown):
    pictures, lights = shown
    mended, count = without_stray_fingers(middle_person(), pictures, lights)
    assert count == 0
    assert all(new is old for new, old in zip(mended, pictures, strict=True))


def test_a_stray_finger_is_bent_as_beside_and_nothing_else(shown):
    pictures, lights = shown
    stray = [bent(each) if index == 2 else each for index, each in enumerate(pictures)]
    misses = [finger_misses(middle_person(), each[2], lights.of_scene[0])[1] for each in (pictures, stray)]
    assert misses[1] > 3 * misses[0]
    mended, count = without_stray_fingers(middle_person(), stray, lights)
    assert count == 1
    np.testing.assert_allclose(mended[2].pose.theta, pictures[2].pose.theta, atol=1e-12)
    assert all(mended[index] is stray[index] for index in range(VIEWS) if index != 2)


def test_pictures_that_share_a_pose_and_few_pictures_are_left_alone(shown):
    pictures, lights = shown
    stray = [bent(each) if index == 2 else each for index, each in enumerate(pictures)]
    shared = [replace(each, moment=1) for each in stray]
    assert without_stray_fingers(middle_person(), shared, lights)[1] == 0
    assert without_stray_fingers(middle_person(), stray[:4], lights)[1] == 0


def test_what_hides_a_finger_says_nothing_of_its_bend(shown):
    """A thing that is painted over the middle of one picture: unknown pixels are not compared."""
    pictures, lights = shown
    rgb, labels = pictures[2].rgb.copy(), pictures[2].labels.copy()
    rgb[:], labels[:] = (0, 255, 0), UNKNOWN
    hidden = [replace(each, rgb=rgb, labels=labels) if index == 2 else each for index, each in enumerate(pictures)]
    assert np.isnan(finger_misses(middle_person(), hidden[2], lights.of_scene[0])).all()
    assert without_stray_fingers(middle_person(), hidden, lights)[1] == 0
