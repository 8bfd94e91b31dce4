"""A hand's outline in the model's picture is matched to the mask's, where the mask is sure."""

import numpy as np
import pytest
import torch
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.joint_limits import FREE
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.person.model import GeometryMaps
from livehand.backend.person.refit import HingeTurns, OutlineTargets, PoseTargets, made_smaller, outline_targets
from livehand.backend.records.camera import Camera
from livehand.backend.records.hand_picture import BACKGROUND, HAND, UNKNOWN, HandPicture
from livehand.backend.records.shot import HandPose

MIDDLE_PX, RADIUS_PX = 50.0, 30.0


@pytest.fixture
def shown():
    """A disc in the model's picture, 4 px left of the mask's, and points along its rim as if they were vertices."""
    disc = _disc(MIDDLE_PX - 4)
    maps = GeometryMaps(None, disc, np.zeros((100, 100, 2)), disc.astype(float), np.where(disc, 0.5, np.inf))
    angle = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    rim_px = RADIUS_PX * np.stack([np.cos(angle), np.sin(angle)], 1) + (MIDDLE_PX - 4, MIDDLE_PX)
    return maps, rim_px


def _disc(column_px):
    rows, columns = np.mgrid[:100, :100] + 0.5
    return (rows - MIDDLE_PX) ** 2 + (columns - column_px) ** 2 < RADIUS_PX**2


def test_vertices_of_the_outline_go_to_the_masks(shown):
    maps, rim_px = shown
    targets = outline_targets(maps, np.where(_disc(MIDDLE_PX), HAND, BACKGROUND).astype(np.uint8), rim_px)
    assert len(targets.vertex) > 300
    assert np.median(np.linalg.norm(targets.px - MIDDLE_PX, axis=1)) == pytest.approx(RADIUS_PX, abs=0.15)
    inward = (MIDDLE_PX - targets.px) / RADIUS_PX
    assert (targets.normal * inward).sum(1).min() > 0.9


def test_the_outline_beside_what_is_unknown_is_no_target(shown):
    maps, rim_px = shown
    labels = np.where(_disc(MIDDLE_PX), HAND, BACKGROUND).astype(np.uint8)
    labels[:, 60:] = UNKNOWN
    targets = outline_targets(maps, labels, rim_px)
    assert len(targets.vertex) > 150
    assert targets.px[:, 0].max() < 56.5
    assert not len(outline_targets(maps, np.full_like(labels, UNKNOWN), rim_px).vertex)


def test_a_smaller_picture_shows_the_same_and_its_targets_are_enlarged_back():
    size_px, camera = (90, 120), Camera(np.array([[200.0, 0, 45], [0, 200, 60], [0, 0, 1]]), np.eye(4), (90, 120))
    rgb = np.repeat(np.linspace(0, 255, size_px[0]).astype(np.uint8)[None, :, None], 120, 0).repeat(3, 2)
    picture = HandPicture("one", rgb, np.full((120, 90), HAND, np.uint8), camera, HandPose.rest())
    assert made_smaller(picture, 120) is picture
    small = made_smaller(picture, 40)
    assert small.camera.size_px == (30, 40)
    point = np.array([[0.02, -0.03, 0.4]])
    larger_by = np.divide(size_px, small.camera.size_px)
    np.testing.assert_allclose(small.camera.project(point)[0] * larger_by, camera.project(point)[0])
    np.testing.assert_allclose(small.rgb[5, :, 0], rgb[5, 1::3, 0], atol=1)
    outline = OutlineTargets(np.array([3]), np.array([[1.0, 2.0]]), np.array([[0.0, 1.0]]))
    targets = PoseTargets(np.array([[4.0, 5.0]]), np.ones(1), outline, 1.5, 0.9).enlarged(larger_by)
    np.testing.assert_allclose(targets.px, [[12, 15]])
    np.testing.assert_allclose(targets.outline.px, [[3, 6]])
    np.testing.assert_allclose(targets.outline.normal, [[0, 1]])
    assert (targets.flow_px, targets.overlap) == (4.5, 0.9)


def test_turns_that_hinges_do_not_allow_are_told_and_free_ones_are_not():
    hinges = HingeTurns.of(load_default_hand())
    free, stiff = np.zeros((2, 45))
    free[FREE] = 20.0
    stiff[np.setdiff1d(np.arange(45), FREE)] = 4.0
    angles_deg = np.stack([free, stiff]).reshape(2, 15, 3)
    theta = theta_of(angles_deg, FingerAxes.of_default_hand(), np.array([0.5, 0.2, -0.3]))
    turns_deg = np.rad2deg(hinges(torch.as_tensor(theta, dtype=torch.float32)).numpy())
    # Turns about several axes at once differ from their sum by half of their products: .5 x 20 x 20 deg at a knuckle.
    assert np.abs(turns_deg[0]).max() < 0.5 * np.rad2deg(np.deg2rad(20) ** 2) + 0.2
    np.testing.assert_allclose(turns_deg[1], 4.0, atol=0.5 * np.rad2deg(np.deg2rad(4) ** 2) + 0.02)
