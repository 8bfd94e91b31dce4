"""The share of the skin that pictures show: two opposite sides are nearly all, one is less than a half."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.tracking.turning_hand.coverage import covered_share


@pytest.fixture(scope="module")
def sides(turning):
    """Poses of a palm and of a back, and their camera."""
    film = turning(draws=False)
    palm = film.motion.pose(0)
    root = axis_angle_to_matrix(np.array([[0, np.pi, 0.0]]))[0] @ axis_angle_to_matrix(palm.theta[:1])[0]
    theta = palm.theta.copy()
    theta[0] = matrix_to_axis_angle(root[None])[0]
    return palm, replace(palm, theta=theta), film.camera


def test_one_side_is_less_than_a_half_and_both_are_nearly_all(sides, hand):
    palm, back, camera = sides
    of_palm, of_back = (covered_share([pose], [camera], hand) for pose in (palm, back))
    assert 0.3 < of_palm < 0.5
    assert 0.3 < of_back < 0.5
    both = covered_share([palm, back], [camera, camera], hand)
    assert 0.75 < both <= of_palm + of_back + 1e-9
    assert covered_share([palm, palm], [camera, camera], hand) == of_palm


def test_no_picture_and_a_hand_out_of_the_picture_show_nothing(sides, hand):
    palm, _, camera = sides
    assert covered_share([], [], hand) == 0
    assert covered_share([replace(palm, transl=palm.transl + np.array([5.0, 0, 0]))], [camera], hand) == 0
