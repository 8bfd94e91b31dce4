"""Cameras that were moved are found by the hands that they show; the others rest."""

import numpy as np
import pytest
from livehand.backend.person.rig.rig_cameras import turned
from livehand.backend.person.rig.self_calibration import calibrated, cameras_off_px


def test_exact_landmarks_move_nothing(made_rig):
    found = calibrated(made_rig.found(), made_rig.cameras)
    assert found.turns == pytest.approx(np.zeros((8, 3)), abs=1e-6)
    assert found.points == pytest.approx(made_rig.points, abs=1e-6)
    assert found.error_px == pytest.approx(np.zeros(8), abs=1e-3)
    assert cameras_off_px(found.turns, made_rig.cameras) == {}


def test_moved_cameras_are_found_and_named(made_rig):
    wrong = list(made_rig.cameras)
    wrong[2] = turned(wrong[2], np.array([0.0, 0.03, 0.0]))
    wrong[5] = turned(wrong[5], np.array([-0.02, -0.01, 0.0]))
    found = calibrated(made_rig.found(0.7), wrong)
    off = cameras_off_px(found.turns, wrong)
    assert set(off) == {2, 5}
    assert found.turns[2] == pytest.approx((0, -0.03, 0), abs=2.5e-3)
    assert found.turns[5] == pytest.approx((0.02, 0.01, 0), abs=2.5e-3)
    assert off[2] == pytest.approx(0.03 * 520, abs=1.5)
    assert np.linalg.norm(found.points - made_rig.points, axis=-1).mean() < 1.5e-3


def test_a_camera_held_out_moves_no_landmark_and_is_turned_to_them(made_rig):
    wrong = list(made_rig.cameras)
    wrong[4] = turned(wrong[4], np.array([0.0, 0.04, 0.0]))
    hands = made_rig.found(0.7)
    found, others = calibrated(hands, wrong, held_out=[4]), calibrated(hands, made_rig.cameras, held_out=[4])
    assert found.points == pytest.approx(others.points, abs=1e-9)
    assert found.turns[4] == pytest.approx((0, -0.04, 0), abs=2.5e-3)
    assert np.delete(found.turns, 4, 0) == pytest.approx(np.delete(others.turns, 4, 0), abs=1e-9)


def test_a_camera_without_finds_rests(made_rig):
    hands = [hand.__class__(hand.side, hand.finds[1:], hand.points) for hand in made_rig.found(0.5)]
    found = calibrated(hands, made_rig.cameras)
    assert found.turns[0] == pytest.approx(np.zeros(3))
    assert np.isnan(found.error_px[0])
