"""The drawn albedo, by Lab in places: photographs' ranges, nails with their parts, and seeds that differ."""

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.skin_colours import LIGHT_SKIN, lab
from livehand.backend.surface.people.hand_chart import THUMB
from livehand.backend.surface.people.look import PersonLook
from livehand.tests.surface.people.conftest import drawn
from livehand.tests.surface.people.test_drawn_relief import free_of_joints, high_pass, shared

pytestmark = pytest.mark.slow


def colours(one, where):
    return lab(torch.as_tensor(np.exp(one.log_albedo[where])).double()).numpy()


def on_back(chart):
    return (chart.palm < 0.05) & (chart.arm < 0.02) & (chart.on_digit < 0.02) & (chart.points_mm[:, 0] < 95)


def on_palm(chart):
    return (chart.palm > 0.95) & (chart.on_digit < 0.02) & (chart.points_mm[:, 0] < 90)


def test_red_and_yellow_vary_as_in_photographs(chart, people):
    back = (chart.palm < 0.3) & (chart.arm < 0.05)
    palm = (chart.palm > 0.7) & (chart.arm < 0.05)
    for one in people:
        assert 3.5 < colours(one, back)[:, 1].std() < 6.8
        assert 3.5 < colours(one, palm)[:, 1].std() < 5.8
        assert 2.0 < colours(one, palm)[:, 2].std() < 5.5


def test_red_varies_from_millimetre_to_millimetre(chart, texels, people):
    """Skin is mottled, the palm most: what is coarser than 6 mm is no more than twice as strong as that."""
    for one in people:
        red = lab(torch.as_tensor(np.exp(one.log_albedo)).double())[:, 1].numpy()
        fine = high_pass(texels, red)
        for where in (on_back(chart), on_palm(chart)):
            assert 0.8 < fine[where].std() < 3
            assert fine[where].std() > 0.4 * (red - fine)[where].std()


@pytest.mark.parametrize(("place", "order"), [("knuckles", 0), ("middle joints", 1)])
def test_joints_of_a_light_hand_are_little_redder_than_its_back(chart, people, place, order):
    """By at most 4 more than photographs' ranges, which are of single skins; and no more yellow."""
    near = (np.abs(chart.from_joint_mm[:, order]) < 4) & (np.abs(chart.lateral) < 4) & (chart.height > 0.6)
    near &= (chart.digit != THUMB) & ((chart.on_digit > 0.9) == (order > 0))
    off = np.mean([colours(one, near).mean(0) - colours(one, on_back(chart)).mean(0) for one in people], 0)
    least, most = LIGHT_SKIN[place].a_star
    assert least <= off[1] <= most + 4
    assert off[2] < 2


def test_the_back_of_a_light_hand_is_usual(chart, people):
    usual = LIGHT_SKIN["back"]
    mean = np.mean([colours(one, on_back(chart)).mean(0) for one in people], 0)
    for value, (low, high) in zip(mean, (usual.l_star, usual.a_star, usual.b_star), strict=True):
        assert low - 2 <= value <= high + 2


@pytest.mark.parametrize("tone", [0.05, 1.0])
def test_nails_have_a_pink_bed_a_pale_moon_and_an_edge_that_flesh_is_seen_through(chart, tone):
    one = drawn(chart, PersonLook.of(5, {"tone": tone, "nails": 1.5, "age": 25.0}))
    thumb = (chart.digit == THUMB) & (one.relief.nail_rim < 0.96) & (np.abs(chart.nail_across) < 0.4)
    along = chart.nail_along
    bed, moon, edge = (
        colours(one, thumb & where).mean(0)
        for where in (np.abs(along) < 0.2, (along > -0.85) & (along < -0.7), along > 0.86)
    )
    assert 11 < bed[1] < 19
    assert moon[0] > bed[0] + 3
    assert moon[1] < bed[1] - 3
    assert bed[0] + 3 < edge[0] < 80
    assert 4 < edge[1] < bed[1] - 5
    assert 9 < edge[2] < 16  # yellowish grey


def test_joints_tips_and_edges_are_redder(chart, people):
    between = (chart.on_digit > 0.9) & (np.abs(chart.from_joint_mm) > 9).all(1) & (chart.height > 0.6)
    between &= chart.length[chart.digit] - chart.along > 20
    joint = (chart.on_digit > 0.9) & (np.abs(chart.from_joint_mm[:, 1]) < 3) & (chart.height > 0.6)
    for one in people:
        assert colours(one, joint)[:, 1].mean() > colours(one, between)[:, 1].mean() + 1.5


def test_two_people_share_no_spot(chart, texels, people):
    own = free_of_joints(chart)
    for channel in range(3):
        first, second = (high_pass(texels, one.log_albedo[:, channel])[own] for one in people)
        assert abs(shared(first, second)) < 0.2


def test_freckles_darken_the_back_and_not_the_palm(chart):
    few, many = (drawn(chart, PersonLook.of(3, {"freckles": value, "tone": 0.1})) for value in (0.0, 3.0))
    darker = (few.log_albedo - many.log_albedo)[:, 1]
    assert (darker[on_back(chart)] > 0.2).mean() > 0.01
    assert (darker[on_palm(chart)] > 0.05).mean() < 0.001
