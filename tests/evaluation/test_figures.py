"""One view's metrics: those of the hand ignore the rest of the image."""

import math

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.figures import has_flip, view_figures
from livehand.backend.evaluation.visible_surface import VisibleSurface


def pair():
    """A square hand, and ours with a stray grey block far from it."""
    truth, image = np.zeros((2, 60, 120, 4), np.float32)
    truth[15:45, 15:45] = image[15:45, 15:45] = (0.6, 0.4, 0.3, 1)
    image[20:40, 90:110] = (0.4, 0.4, 0.4, 0.9)
    return image, truth


@pytest.fixture
def figures():
    image, truth = pair()
    plain = torch.full((60, 120), 0.5)
    return view_figures(image, truth, VisibleSurface(plain, plain + 0.5, plain / 1000, torch.tensor(1.0)))


def test_an_error_beside_the_hand_affects_only_the_full_metrics(figures):
    assert figures["psnr_hand"] == 100
    assert figures["psnr_full"] == pytest.approx(-10 * math.log10(0.16 * 400 / 7200))
    assert figures["ssim_hand"] == 1 > figures["ssim"]
    assert figures["alpha_iou"] == pytest.approx(900 / 1300)
    assert figures["psnr_true_alpha"] == 100
    assert figures["share_silhouette"] == 1


@pytest.mark.skipif(not has_flip(), reason="the extra `metrics` is not installed")
def test_flip_on_the_hand_is_the_mean_over_its_pixels(figures):
    assert figures["flip"] > 0.02
    assert figures["flip_hand"] == 0
