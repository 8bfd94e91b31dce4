"""Figures of a render against a picture, by hand."""

import numpy as np
import pytest
from livehand.backend.records.camera import Camera
from livehand.backend.records.hand_picture import BACKGROUND, HAND, UNKNOWN, HandPicture
from livehand.backend.records.shot import HandPose
from livehand.tools.person.held_out import best_gains, compared, psnr_db


def picture_of(rgb, labels):
    height, width = labels.shape
    camera = Camera(np.array([[100.0, 0, width / 2], [0, 100, height / 2], [0, 0, 1]]), np.eye(4), (width, height))
    return HandPicture("made", (255 * rgb).round().astype(np.uint8), labels, camera, HandPose.rest())


@pytest.fixture
def scene():
    """A picture whose middle is a hand of many values, the right of it unknown."""
    rng = np.random.default_rng(0)
    rgb = rng.uniform(0.2, 0.8, (40, 60, 3))
    labels = np.full((40, 60), BACKGROUND, np.uint8)
    labels[8:32, 10:40], labels[:, 45:] = HAND, UNKNOWN
    return rgb, labels


def test_gain_and_bias_are_found_though_the_camera_clips():
    rng = np.random.default_rng(1)
    rendered = rng.uniform(0.1, 0.8, (4000, 3))
    shown = (rendered * (1.6, 1.1, 0.9) + (0.05, -0.1, 0.0)).clip(0, 1)
    assert (shown[:, 0] == 1).mean() > 0.2
    assert best_gains(rendered, shown) == pytest.approx(np.array([(1.6, 0.05), (1.1, -0.1), (0.9, 0.0)]), abs=2e-3)


def test_the_same_hand_in_another_gain_is_the_same(scene):
    rgb, labels = scene
    alpha = (labels == HAND).astype(float)
    figures, _ = compared(rgb * 0.5 + 0.1, alpha, picture_of(rgb, labels))
    assert figures.mask_db > 45
    assert figures.inner_db > 45
    assert figures.iou == 1
    assert np.isnan(figures.lpips)


def test_a_hand_that_lacks_a_part_loses_what_is_shown_there(scene):
    rgb, labels = scene
    alpha = (labels == HAND).astype(float)
    alpha[:, 30:] = 0
    figures, image = compared(rgb, alpha, picture_of(rgb, labels), lambda one, other: float(np.abs(one - other).mean()))
    assert figures.iou == pytest.approx(20 / 30)
    shown = np.round(255 * rgb)[8:32, 30:40] / 255
    assert figures.mask_db == pytest.approx(-10 * np.log10((shown**2).sum() / (24 * 30 * 3)), abs=0.05)
    assert figures.lpips == pytest.approx(shown.sum() / (24 * 30 * 3), abs=5e-3)
    assert not image[:, 30:].any()


def test_what_is_not_known_does_not_count(scene):
    rgb, labels = scene
    alpha = ((labels == HAND) | (labels == UNKNOWN)).astype(float)
    assert compared(rgb, alpha, picture_of(rgb, labels))[0].iou == 1
    alpha[:4, :20] = 1
    assert compared(rgb, alpha, picture_of(rgb, labels))[0].iou == pytest.approx(720 / 800)


def test_psnr_of_a_tenth_is_20_db():
    one = np.zeros((4, 4, 3))
    assert psnr_db(one, one + 0.1, np.ones((4, 4), bool)) == pytest.approx(20)
