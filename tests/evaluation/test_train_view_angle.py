"""The angle from a view's camera to the nearest training camera, as the hand sees it."""

import numpy as np
import pytest
from livehand.backend.evaluation.figures import train_origins, train_view_angle_deg, train_view_angles_deg


@pytest.mark.parametrize("angle_deg", [0.0, 0.001, 24.9, 90.0, 180.0])
def test_the_angle_at_the_hand_does_not_depend_on_distance(angle_deg):
    hand = np.array([0.3, -0.2, 1.0])
    angle = np.radians(angle_deg)
    origin = hand + 2.5 * np.array([np.cos(angle), np.sin(angle), 0])
    assert train_view_angle_deg(origin, hand[None] + [[0.4, 0, 0]], hand) == pytest.approx(angle_deg, abs=1e-6)


def test_the_nearest_in_angle_counts_not_the_nearest_in_space():
    hand = np.zeros(3)
    beside = np.array([[1.0, 0.2, 0.0], [9.0, 0.0, 0.0]])
    assert train_view_angle_deg(np.array([1.0, 0.0, 0.0]), beside, hand) == pytest.approx(0, abs=1e-6)
    assert train_view_angle_deg(np.array([1.0, 0.0, 0.0]), beside[:1], hand) == pytest.approx(
        np.degrees(np.arctan(0.2))
    )


def test_without_training_cameras_the_angle_is_nan():
    assert np.isnan(train_view_angle_deg(np.ones(3), np.zeros((0, 3)), np.zeros(3)))


def test_each_training_camera_of_a_capture_counts_once(painted_capture):
    assert train_origins(painted_capture).shape == (3, 3)
    angles = train_view_angles_deg(painted_capture, painted_capture.views, np.zeros((2, 3)))
    held_out = np.array([0.2, 0.9, 0.4]) / np.linalg.norm([0.2, 0.9, 0.4])
    known = [np.array(d) / np.linalg.norm(d) for d in ([0, 1, 0.2], [0.1, 1, -0.6], [0.1, 0.7, 0.9])]
    expected = np.degrees(np.arccos(max(held_out @ direction for direction in known)))
    for view, angle in zip(painted_capture.views, angles, strict=True):
        assert angle == pytest.approx(expected if view.split == "test" else 0, abs=1e-4)


def test_the_angle_is_measured_at_each_poses_own_hand(painted_capture):
    test_views = painted_capture.of_split("test")
    near, far = train_view_angles_deg(painted_capture, test_views, np.array([[0, 0.2, 0.0], [0, -5.0, 0.0]]))
    assert near > 5 * far > 0  # the same cameras, from five metres behind the hand
