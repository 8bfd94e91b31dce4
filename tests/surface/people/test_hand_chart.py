"""The chart: joints, tips, sides and nails lie where the hand has them, also between vertices."""

import numpy as np
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.surface.people.hand_chart import THUMB, HandChart, chart_arrays

DIGITS = {"index": 0, "middle": 1, "pinky": 2, "ring": 3, "thumb": THUMB}


def test_vertices_of_joints_are_at_their_place_along_the_digit(template):
    hand, chart = load_default_hand(), HandChart.at_vertices(template)
    joints_mm = 1e3 * (hand.J_regressor @ hand.v_template)
    for digit in range(5):
        for order in (1, 2):
            joint = joints_mm[1 + 3 * digit + order]
            near = np.linalg.norm(chart.points_mm - joint, axis=1).argsort()[:8]
            assert (chart.digit[near] == digit).all()
            assert np.abs(chart.from_joint_mm[near, order]).max() < 8


def test_palm_back_and_arm_are_told_apart(chart):
    on_palm = np.linalg.norm(chart.points_mm - [45, -15, 0], axis=1) < 12
    on_back = np.linalg.norm(chart.points_mm - [45, 12, 0], axis=1) < 12
    assert chart.palm[on_palm].mean() > 0.9
    assert chart.palm[on_back].mean() < 0.1
    assert chart.on_digit[on_palm | on_back].max() < 0.2
    assert chart.arm[chart.points_mm[:, 0] > 200].mean() > 0.9


def test_what_lies_on_no_digit_is_near_no_joint(chart):
    assert np.abs(chart.from_joint_mm[chart.arm > 0.5]).min() > 50


def test_each_digit_has_a_nail_on_its_back(chart):
    for digit in DIGITS.values():
        is_nail = (chart.digit == digit) & (np.abs(chart.nail_along) < 0.6) & (np.abs(chart.nail_across) < 0.6)
        is_nail &= chart.height > 0.5
        assert is_nail.sum() > 40
        assert chart.palm[is_nail].mean() < 0.1


def test_the_file_has_a_row_for_every_vertex(template):
    arrays = chart_arrays()
    assert len(arrays["digit"]) == len(template.offset_m)
    assert arrays["joints_along"].shape == (5, 3)


def test_skin_between_two_fingers_is_of_both(template):
    """Along edges of the mesh that lead from one finger's skin to the next one's."""
    chart = HandChart.at_vertices(template)
    faces = template.faces.numpy()
    start, end = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]]).T
    between = (chart.digit[start] != chart.digit[end]) & ~(chart.is_thumb[start] | chart.is_thumb[end])
    step = np.abs(chart.on_digit[start] - chart.on_digit[end])[between]
    assert between.sum() > 200
    assert np.quantile(step, 0.95) < 0.2  # .49 if each vertex were of its nearest finger alone
