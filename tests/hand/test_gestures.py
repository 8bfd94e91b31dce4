"""Joint angles: rotations there and back, which way fingers bend, and reproducible sampling."""

import numpy as np
import pytest
import torch
from livehand.backend.hand.gestures import GESTURES, FingerAxes, Gesture, angles_of, sample_angles_deg, theta_of
from livehand.backend.hand.lbs import SkinTensors, pose_hand
from livehand.backend.hand.model_file import load_default_hand
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module")
def axes():
    return FingerAxes.of_default_hand()


def test_rest_is_zero_and_the_root_passes_through(axes):
    np.testing.assert_array_equal(theta_of(np.zeros((15, 3)), axes), np.zeros((16, 3)))
    root = np.array([0.1, -0.2, 0.3])
    np.testing.assert_array_equal(theta_of(np.zeros((15, 3)), axes, root)[0], root)


def test_angles_come_back_from_theta(axes):
    angles_deg = np.random.default_rng(0).uniform(-80, 80, (50, 15, 3))
    theta = theta_of(angles_deg, axes, np.array([0.4, 0.1, -0.2]))
    np.testing.assert_allclose(np.rad2deg(angles_of(theta, axes)), angles_deg, atol=1e-9)


def posed(theta):
    skin = SkinTensors.of(load_default_hand(), dtype=torch.float64)
    zero = torch.zeros(10, dtype=torch.float64)
    return pose_hand(skin, torch.as_tensor(theta), zero, zero[:3])


def fingertip(finger):
    """Index of the vertex farthest along a finger: fingers point along -X; the thumb's by its weight."""
    hand = load_default_hand()
    joint = {"index": 3, "middle": 6, "pinky": 9, "ring": 12, "thumb": 15}[finger]
    own = np.flatnonzero(hand.lbs_weights[:, joint] > 0.9)
    return own[np.linalg.norm(hand.v_template[own] - hand.joints[joint], axis=1).argmax()]


@pytest.mark.parametrize("finger", ["index", "middle", "ring", "pinky"])
def test_flexion_moves_the_fingertip_towards_the_palm(hand, axes, finger):
    """The back of the hand is +Y: a bent finger's tip goes to -Y and back towards the wrist, at +X."""
    tip = fingertip(finger)
    bent = posed(theta_of(Gesture({finger: (60, 0, 0)}).angles_deg(), axes)).vertices[tip]
    moved = bent.numpy() - hand.v_template[tip]
    assert moved[1] < -0.03
    assert moved[0] > 0.01
    assert abs(moved[2]) < 0.03


@pytest.mark.parametrize("finger", ["index", "middle", "ring", "pinky"])
def test_abduction_moves_the_fingertip_towards_the_thumb(hand, axes, finger):
    """The thumb is at +Z."""
    tip = fingertip(finger)
    turned = posed(theta_of(Gesture(abduction={finger: 15}).angles_deg(), axes)).vertices[tip]
    moved = turned.numpy() - hand.v_template[tip]
    assert moved[2] > 0.01
    assert abs(moved[1]) < 0.01


def test_flexion_of_the_whole_finger_adds_up(axes):
    """Bending all three joints turns the last bone by their sum."""
    transforms = posed(theta_of(Gesture({"middle": (30, 40, 20)}).angles_deg(), axes)).transforms
    angle = np.rad2deg(Rotation.from_matrix(transforms[6, :3, :3].numpy()).magnitude())
    assert angle == pytest.approx(90, abs=3)


@pytest.mark.slow
def test_a_fist_closes_and_spreading_opens(hand, axes):
    tips = [fingertip(finger) for finger in ("index", "middle", "ring", "pinky")]
    wrist = hand.joints[0]
    reach = {
        name: np.linalg.norm(posed(theta_of(GESTURES[name].angles_deg(), axes)).vertices[tips].numpy() - wrist, axis=1)
        for name in ("fist", "rest", "spread")
    }
    assert (reach["fist"] < 0.75 * reach["rest"]).all()
    between = {
        name: np.linalg.norm(np.diff(posed(theta_of(GESTURES[name].angles_deg(), axes)).vertices[tips].numpy(), axis=0))
        for name in ("rest", "spread")
    }
    assert between["spread"] > 1.1 * between["rest"]


def test_angles_go_to_the_fingers_joints_in_manos_order():
    angles = Gesture({"ring": (1, 2, 3)}, {"pinky": 4}, ((5, 6, 7), (8, 9, 10), (11, 12, 13))).angles_deg()
    np.testing.assert_array_equal(angles[9:12, 0], [1, 2, 3])
    assert angles[6, 1] == 4
    np.testing.assert_array_equal(angles[12:].ravel(), np.arange(5, 14))
    assert (angles != 0).sum() == 13


def test_samples_are_reproducible_natural_and_different():
    one, again, other = (sample_angles_deg(np.random.default_rng(seed), 40) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, again)
    assert not np.allclose(one, other)
    library = np.stack([gesture.angles_deg() for gesture in GESTURES.values()])
    assert (one[..., 0] > library[..., 0].min(0) - 20).all()
    assert (one[..., 0] < library[..., 0].max(0) + 20).all()
    assert one[:, :3, 0].std() > 10
