"""The drawn relief: nothing is shared between seeds but where joints fold, and each place has what it should."""

import numpy as np
import pytest
from livehand.backend.surface.people.drawn_relief import drawn_relief, leather, nail_shape
from livehand.backend.surface.people.hand_chart import THUMB
from livehand.tests.surface.people.conftest import RESOLUTION
from scipy.ndimage import gaussian_filter

pytestmark = pytest.mark.slow


def high_pass(texels, values, deviation=4.0):
    """Subtract a blur over the skin."""
    image, weight = (np.zeros(RESOLUTION**2, np.float32) for _ in range(2))
    image[texels.pixel], weight[texels.pixel] = values, 1
    blurred, share = (gaussian_filter(one.reshape(RESOLUTION, -1), deviation) for one in (image, weight))
    return values - (blurred / np.maximum(share, 1e-6)).ravel()[texels.pixel]


def shared(first, second):
    return np.corrcoef(first, second)[0, 1]


def free_of_joints(chart):
    """Where no joint folds, no nail ends and no palm begins: what is there is a person's own."""
    joint, is_border = np.abs(chart.from_joint_mm).min(1), (chart.palm > 0.05) & (chart.palm < 0.95)
    return ~((chart.on_digit > 0.05) & (joint < 6)) & ~is_border & (nail_shape(chart).rim > 1.4)


def test_two_people_share_no_relief(chart, texels, people):
    own = free_of_joints(chart)
    first, second = (high_pass(texels, one.relief.relief_mm)[own] for one in people)
    assert abs(shared(first, second)) < 0.2


def test_two_people_share_no_whorl_and_no_crease(chart, texels, people):
    on_joint = (chart.from_joint_mm[:, 1] ** 2 < 16) & (chart.height > 0.6) & (chart.on_digit > 0.9)
    first, second = (high_pass(texels, one.relief.dorsal, 2.0)[on_joint] for one in people)
    assert abs(shared(first, second)) < 0.2
    palm = (chart.palm > 0.9) & (chart.on_digit < 0.05)
    first, second = (one.relief.palmar[palm] for one in people)
    assert abs(shared(first, second)) < 0.2


def test_a_person_is_the_same_each_time(chart, people):
    np.testing.assert_array_equal(drawn_relief(chart, people[0].look).relief_mm, people[0].relief.relief_mm)


def test_whorls_lie_on_the_dorsal_third_alone(chart, people):
    whorl = people[0].relief.dorsal
    at_pip = (np.abs(chart.from_joint_mm[:, 1]) < 3) & (chart.on_digit > 0.9) & (chart.digit != THUMB)
    assert whorl[at_pip & (chart.height > 0.8)].mean() > 0.15
    assert whorl[at_pip & (chart.height < 0.2)].max() < 0.01


def test_leather_is_shallow_on_the_young_phalanx_and_not_on_the_palm(chart):
    between = (chart.on_digit > 0.9) & (np.abs(chart.from_joint_mm) > 9).all(1) & (chart.height > 0.7)
    back = (chart.palm < 0.02) & (chart.on_digit < 0.02) & (chart.arm < 0.02)
    young, old = leather(chart, 0.0), leather(chart, 1.0)
    assert young[between].mean() < 0.55 * young[back].mean()
    assert old[between].mean() > 1.5 * young[between].mean()
    assert young[chart.palm > 0.95].max() < 0.01


def test_nails_are_smooth_but_for_their_grain(people):
    for one in people:
        plate = one.relief.nail_rim < 0.8
        assert np.abs(one.relief.relief_mm[plate]).max() < 0.01
        assert one.relief.dorsal[plate].max() < 1e-3


def test_pads_have_ridges_whose_crests_are_paler(chart, texels, people):
    pad = (chart.palm > 0.95) & (chart.on_digit > 0.9) & (chart.length[chart.digit] - chart.along < 14)
    for one in people:
        relief, pigment = (high_pass(texels, of)[pad] for of in (one.relief.relief_mm, one.relief.fine_pigment))
        assert relief.std() > 0.006
        assert shared(relief, pigment) > 0.3


def test_a_dark_line_goes_round_the_plate_but_not_its_free_end(chart, people):
    near = (np.abs(people[0].relief.nail_rim - 1.005) < 0.01) & (chart.height > 0.5)
    for one in people:
        assert one.relief.fine_pigment[near & (chart.nail_along < 0.5)].mean() < -0.2
        assert one.relief.fine_pigment[near & (chart.nail_along > 0.97)].mean() > -0.1
