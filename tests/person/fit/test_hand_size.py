"""The hand's length: pictures look the same, the shape has it, and a fit that is pulled away keeps it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.measurements import length_and_breadth_m
from livehand.backend.motion.spaces import rest_wrists
from livehand.backend.person.fit.hand_size import LengthPrior, check_length, sized, with_mean_proportions
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.hand_picture import HandPicture, PicturedHand
from livehand.backend.records.shot import HandPose

SIZE = 64
CAMERA = Camera(np.array([[300.0, 0, 32], [0, 300, 32], [0, 0, 1]]), np.eye(4), (SIZE, SIZE))
BETA = np.array([0.5, -0.8, 0.3, 0, 0.2, 0, 0, 0, 0, 0])


@pytest.fixture
def pictured():
    theta = np.zeros((16, 3))
    theta[0] = 0.4, 0.2, -0.3
    pose = HandPose(theta, BETA, np.array([0.02, -0.05, 0.6]))
    picture = HandPicture("a", np.zeros((SIZE, SIZE, 3), np.uint8), np.zeros((SIZE, SIZE), np.uint8), CAMERA, pose)
    return PicturedHand((picture,), "right", "test")


def test_the_hand_has_its_length_and_looks_the_same(hand, pictured):
    wanted_m = 1.06 * length_and_breadth_m(hand, BETA)[0]
    pose = sized(pictured, hand, wanted_m).pictures[0].pose
    length_m, breadth_m = length_and_breadth_m(hand, pose.beta)
    assert length_m == pytest.approx(wanted_m, abs=1e-4)
    assert breadth_m == pytest.approx(1.06 * length_and_breadth_m(hand, BETA)[1], abs=2e-4)
    before, after = (CAMERA.project(posed_vertices(hand, each))[0] for each in (pictured.pictures[0].pose, pose))
    assert np.abs(after - before).max() < 1.2  # of a hand of 90 px: shapes only nearly scale
    assert np.abs(after - before).mean() < 0.4


def test_the_length_it_has_changes_nothing(hand, pictured):
    pose = sized(pictured, hand, length_and_breadth_m(hand, BETA)[0]).pictures[0].pose
    np.testing.assert_allclose(pose.beta, BETA, atol=1e-6)
    np.testing.assert_allclose(pose.transl, pictured.pictures[0].pose.transl, atol=1e-8)


def test_mean_proportions_keep_length_breadth_and_the_wrists_place(hand, pictured):
    before, after = pictured.pictures[0].pose, with_mean_proportions(pictured, hand).pictures[0].pose
    sizes_m = [length_and_breadth_m(hand, beta) for beta in (BETA, after.beta)]
    np.testing.assert_allclose(*sizes_m, atol=2e-4)
    assert np.linalg.norm(after.beta) < 0.8 * np.linalg.norm(BETA)
    wrists = [rest_wrists(hand, pose.beta) + pose.transl for pose in (before, after)]
    np.testing.assert_allclose(*wrists, atol=1e-9)


def test_proportions_that_cameras_measured_stay(hand, pictured):
    calibrated = replace(pictured, is_calibrated=True)
    assert with_mean_proportions(calibrated, hand) is calibrated


def test_the_prior_is_nought_at_the_length_and_half_a_millimetre_away_an_eighth(hand):
    length_m = length_and_breadth_m(hand, BETA)[0]
    beta = torch.as_tensor(BETA, dtype=torch.float32)
    assert float(LengthPrior.of(hand, BETA, length_m).loss(beta)) == pytest.approx(0, abs=1e-4)
    assert float(LengthPrior.of(hand, BETA, length_m + 0.0005).loss(beta)) == pytest.approx(0.125, rel=0.01)


def test_the_prior_knows_what_lengthens_a_hand(hand):
    wider = BETA + 0.3 * np.eye(10)[0]
    prior = LengthPrior.of(hand, BETA, length_and_breadth_m(hand, wider)[0])
    assert float(prior.loss(torch.as_tensor(wider, dtype=torch.float32))) < 0.02
    assert float(prior.loss(torch.as_tensor(BETA, dtype=torch.float32))) > 2


@pytest.mark.parametrize("length_m", [0.02, 188.0, float("nan")])
def test_a_length_that_no_hand_has_is_refused(length_m):
    with pytest.raises(LiveHandError, match=r"must be from 100 to 250 mm, got .*; measure"):
        check_length(length_m)


def test_calibrated_cameras_know_better(hand, pictured):
    with pytest.raises(LiveHandError, match="calibrated cameras"):
        sized(replace(pictured, is_calibrated=True), hand, 0.19)
    at_a_moment = tuple(replace(one, moment=3) for one in pictured.pictures)
    with pytest.raises(LiveHandError, match="calibrated cameras"):
        sized(replace(pictured, pictures=at_a_moment), hand, 0.19)
