"""Pose correctives as shape keys: the keys add up to posedirs, and their drivers read quaternions."""

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix, axis_angle_to_quaternion
from livehand.backend.hand.corrective_keys import factor_correctives, quaternion_form


def test_the_keys_add_up_to_the_correctives():
    random = np.random.default_rng(0)
    posedirs = random.normal(size=(20, 3, 135))
    rotations = axis_angle_to_matrix(random.normal(size=(15, 3)))
    keys = factor_correctives(posedirs)
    assert len(keys) == 15 * 9
    total = sum(key.displacement * (key.form * (rotations[key.joint - 1] - np.eye(3))).sum() for key in keys)
    np.testing.assert_allclose(total, posedirs @ (rotations - np.eye(3)).ravel(), atol=1e-10)


@pytest.mark.slow
def test_the_built_in_hand_has_at_most_one_key_per_joint(hand):
    joints = [key.joint for key in factor_correctives(hand.posedirs)]
    assert len(set(joints)) == len(joints) == 14  # the thumb's first joint has none


def test_components_that_move_nothing_are_dropped():
    assert factor_correctives(np.zeros((20, 3, 135))) == []


@pytest.mark.parametrize("seed", range(5))
def test_the_quaternion_form_is_the_same_linear_form(seed):
    random = np.random.default_rng(seed)
    form, turn = random.normal(size=(3, 3)), random.normal(size=3)
    frame = axis_angle_to_matrix(random.normal(size=3))
    parts = dict(zip("wxyz", axis_angle_to_quaternion(turn), strict=True))
    value = sum(c * parts[product[0]] * parts[product[2]] for product, c in quaternion_form(form, frame).items())
    rotation = frame @ axis_angle_to_matrix(turn) @ frame.T
    np.testing.assert_allclose(value, (form * (rotation - np.eye(3))).sum(), atol=1e-12)
