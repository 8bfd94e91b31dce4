"""Lifted landmarks: the view that the network knows, the network against torch, and pictures whose truth is known."""

from pathlib import Path

import numpy as np
import pytest
import torch
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.landmarks.camera_fit import at_nodes
from livehand.backend.motion.landmarks.lifting import CanonicalView, LiftingNetwork, UsualAngles, mediapipe_lifting
from livehand.backend.motion.landmarks.online_fit import OnlineFit
from livehand.backend.motion.landmarks.take_fit import FilmCamera
from livehand.tests.builders import joints_as_tracked
from torch import nn

pytestmark = pytest.mark.slow

WRIST, KNUCKLES = 0, [1, 5, 13]


@pytest.fixture(scope="module")
def sights():
    """60 made pictures as the tracker saw them, which training never saw (`examples/learn_landmarks.py sights`)."""
    with np.load(Path(__file__).parent / "sights.npz") as arrays:
        focal_px = arrays["focal_px"][:, None, None]
        joints = at_nodes(arrays["joints"])
        return {
            "places": at_nodes((arrays["px"] - [320, 240]) / focal_px),
            "world": at_nodes(arrays["world"]),
            "true": joints[..., :2] / joints[..., 2:],
            "free": arrays["free"],
        }


def turned(picture_points, degrees):
    """Places of the same hand before a camera that is turned about its axis."""
    matrix = axis_angle_to_matrix(np.deg2rad([0, 0, degrees]))
    return picture_points @ matrix[:2, :2].T, matrix


def test_in_its_view_a_hand_is_in_the_middle_upright_and_of_unit_size(sights):
    view = CanonicalView.of(sights["places"])
    shown = view.shown(sights["places"])
    np.testing.assert_allclose(shown.mean(1), 0, atol=1e-12)
    np.testing.assert_allclose((shown**2).sum(-1).mean(1), 1)
    up = shown[:, KNUCKLES].mean(1) - shown[:, WRIST]
    np.testing.assert_allclose(up[:, 0], 0, atol=1e-12)
    assert (up[:, 1] < 0).all()
    np.testing.assert_allclose(view.back(shown), sights["places"], atol=1e-12)


def test_the_view_looks_along_the_ray_through_the_hand(sights):
    view = CanonicalView.of(sights["places"])
    middle = np.concatenate([sights["places"].mean(1), np.ones((60, 1))], 1)
    along = np.einsum("tij,tj->ti", view.rotation, middle / np.linalg.norm(middle, axis=1, keepdims=True))
    np.testing.assert_allclose(along, np.tile([0, 0, 1], (60, 1)), atol=1e-12)
    np.testing.assert_allclose(view.rotation @ view.rotation.swapaxes(1, 2), np.tile(np.eye(3), (60, 1, 1)), atol=1e-12)
    assert (np.linalg.det(view.rotation) > 0).all()


def test_a_turned_camera_changes_nothing_but_the_places(sights):
    usual = mediapipe_lifting(sights["places"], sights["world"])
    picture_points, matrix = turned(sights["places"], 130)
    other = mediapipe_lifting(picture_points, sights["world"] @ matrix.T)
    np.testing.assert_allclose(other.picture_points, turned(usual.picture_points, 130)[0], atol=1e-7)
    for name in ("free", "free_sd", "points_sd"):
        np.testing.assert_allclose(getattr(other, name), getattr(usual, name), atol=1e-6)


def test_the_network_is_torchs():
    rng = np.random.default_rng(0)
    layers = [nn.Linear(6, 8), nn.Linear(8, 8), nn.Linear(8, 10)]
    network = LiftingNetwork(
        rng.normal(size=6),
        rng.uniform(0.5, 2, 6),
        tuple(layer.weight.detach().double().numpy() for layer in layers),
        tuple(layer.bias.detach().double().numpy() for layer in layers),
    )
    features = rng.normal(size=(7, 6))
    given = torch.from_numpy((features - network.centre) / network.spread).float()
    expected = nn.Sequential(layers[0], nn.SiLU(), layers[1], nn.SiLU(), layers[2])(given).detach().numpy()
    mean, log_sd = network(features)
    np.testing.assert_allclose(np.concatenate([mean, log_sd], 1), expected, atol=1e-5)


def test_inputs_that_training_never_saw_are_clipped():
    network = LiftingNetwork(np.zeros(1), np.ones(1), (np.array([[1.0], [0.0]]),), (np.zeros(2),))
    assert network(np.array([[3.0], [5.0], [-1e9]]))[0].ravel().tolist() == [3.0, 4.0, -4.0]


def test_what_is_usual_is_taken_out_of_an_estimate():
    """A measurement that was joined to what is usual comes back out of the estimate; an empty one stays wide."""
    usual = UsualAngles(np.full(21, 0.4), np.full(21, 0.5))
    measured, deviation = np.random.default_rng(0).normal(0.4, 0.7, (9, 21)), 0.2
    precision = 1 / deviation**2 + 1 / usual.sd**2
    estimate = (measured / deviation**2 + usual.mean / usual.sd**2) / precision
    free, free_sd = usual.taken_out(estimate, np.broadcast_to(precision**-0.5, (9, 21)))
    np.testing.assert_allclose(free, measured)
    np.testing.assert_allclose(free_sd, deviation)
    free, free_sd = usual.taken_out(np.full((1, 21), 0.5), usual.sd[None])
    np.testing.assert_allclose(free, 0.6)
    np.testing.assert_allclose(free_sd, 0.5 / np.sqrt(0.5))


def test_joints_that_are_seen_stay_where_they_are(sights):
    lifted = joints_as_tracked(sights["places"], sights["world"], deviation=0.01)
    np.testing.assert_array_equal(lifted.picture_points, sights["places"])
    np.testing.assert_allclose(lifted.points_sd[:, 3], 0.01 * np.ptp(sights["places"], axis=1).max(-1))
    assert np.isinf(lifted.free_sd).all()


def test_lifted_joints_are_nearer_to_the_truth_than_landmarks_and_know_how_near(sights):
    """Measured on these 60: 0.64 of the landmarks' distance; angles 8 degrees off; deviations right within a third."""
    lifted = mediapipe_lifting(sights["places"], sights["world"])
    size = CanonicalView.of(sights["places"]).size[:, None]

    def distance(picture_points):
        return (np.linalg.norm(picture_points - sights["true"], axis=-1) / size).mean()

    assert distance(lifted.picture_points) < 0.75 * distance(sights["places"])
    off = lifted.free - sights["free"]
    assert np.rad2deg(np.abs(off)).mean() < 9
    spread = np.linalg.norm(lifted.picture_points - sights["true"], axis=-1) / lifted.points_sd / np.sqrt(2)
    for sure in (np.sqrt((spread**2).mean()), np.sqrt(((off / lifted.free_sd) ** 2).mean())):
        assert 0.6 < sure < 1.8
    doubtful = lifted.free_sd > np.median(lifted.free_sd, 0)
    assert np.abs(off[doubtful]).mean() > 1.3 * np.abs(off[~doubtful]).mean()


def test_lifting_makes_no_hand_of_points_that_are_none(sights):
    """Landmarks in another order: the network has never seen such a hand, and the fit does not believe it."""
    camera, hand, rng = FilmCamera((640, 480), 620.0), load_default_hand(), np.random.default_rng(0)
    places_px = camera.focal_px * sights["places"] + np.array(camera.size_px) / 2
    for px, world in zip(places_px[:20], sights["world"][:20], strict=True):
        assert OnlineFit(camera, hand, "right").follow(0.0, px[rng.permutation(21)], world) is None
