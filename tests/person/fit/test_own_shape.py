"""Offsets of a hand that its ten numbers cannot say are found by outlines; where there are none, nothing is."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.person.fit.own_shape import neighbours_mean, own_offsets
from livehand.backend.person.fit.pose_targets import pose_targets
from livehand.backend.person.lit_model.illumination import Illumination, lobe_directions
from livehand.tests.person.conftest import middle_person, pictured

pytest.importorskip("cv2")
pytestmark = pytest.mark.slow
RAISED_M = 0.004


@pytest.fixture(scope="module")
def light():
    directions = lobe_directions()
    return Illumination(0.1 + 0.4 * directions[:, 2].clip(0), np.ones(3))


def _found(pictures, light):
    model = middle_person()
    return own_offsets(model, pictures, [pose_targets(model, each, light) for each in pictures])


def _bump():
    """4 mm about the middle knuckle, 0 at the arm and at the fingers' tips."""
    hand = middle_person().hand
    distance_m = np.linalg.norm(hand.v_template - hand.joints[4], axis=1)
    return RAISED_M * np.exp(-((distance_m / 0.04) ** 2))


def test_a_raised_hand_is_raised_and_a_good_one_stays(light):
    model, wanted = middle_person(), _bump()
    same = _found(pictured(model, light.light).pictures, light)
    assert np.abs(same).max() < 0.0005
    found = _found(pictured(model.with_offset(wanted), light.light).pictures, light)
    is_raised = wanted > 0.003
    assert is_raised.sum() > 30
    assert found[is_raised].mean() == pytest.approx(wanted[is_raised].mean(), rel=0.4)  # its prior holds it back
    assert np.corrcoef(found, wanted)[0, 1] > 0.8
    assert np.abs(found[model.hand.arm_weights > 0.5]).max() < 0.0005


def test_what_is_held_out_does_not_move_the_shape(light):
    model = middle_person()
    good, raised = (pictured(each, light.light).pictures for each in (model, model.with_offset(_bump())))
    mixed = [
        replace(other, is_held_out=True) if index % 2 else one
        for index, (one, other) in enumerate(zip(good, raised, strict=True))
    ]
    alone = _found([each for each in mixed if not each.is_held_out], light)
    np.testing.assert_allclose(_found(mixed, light), alone, atol=1e-9)


def test_neighbours_means_leave_what_is_even(light):
    hand = middle_person().hand
    np.testing.assert_allclose(neighbours_mean(hand) @ np.full(len(hand.v_template), 2.5), 2.5)
    first = hand.f[0, 0]
    around = set(hand.f[(hand.f == first).any(1)].ravel()) - {first}
    assert set(neighbours_mean(hand)[first].indices) == around
