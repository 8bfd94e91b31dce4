"""Distances against scipy's transform, blurs against scipy's and closed forms."""

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.neighbourhood import distance_px, masked_blur
from scipy.ndimage import distance_transform_edt, gaussian_filter


@pytest.mark.parametrize("reach_px", [0.0, 1.5, 4.0, 60.0])
def test_distances_are_scipys_within_reach(reach_px):
    marked = np.random.default_rng(0).random((23, 37)) < 0.02
    expected = distance_transform_edt(~marked)
    expected[expected > reach_px] = np.inf
    np.testing.assert_allclose(distance_px(torch.as_tensor(marked), reach_px).numpy(), expected, atol=1e-6)


def test_nothing_marked_is_infinitely_far():
    assert distance_px(torch.zeros(4, 5, dtype=torch.bool), 3.0).isinf().all()


def test_the_blur_of_everything_is_a_gaussians():
    values = np.random.default_rng(1).random((2, 40, 31))
    found, weight = masked_blur(torch.as_tensor(values), torch.ones(40, 31, dtype=torch.float64), 2.0)
    ones = gaussian_filter(np.ones((40, 31)), 2.0, mode="constant", truncate=3.0)
    for channel, of_channel in zip(values, found.numpy(), strict=True):
        blurred = gaussian_filter(channel, 2.0, mode="constant", truncate=3.0)
        np.testing.assert_allclose(of_channel, blurred / ones, atol=1e-12)
    np.testing.assert_allclose(weight.numpy(), ones, atol=1e-12)


def test_what_weighs_nothing_is_not_heard():
    values = torch.full((1, 30, 30), 0.25)
    values[:, :, 15:] = 9.0
    weights = (torch.arange(30) < 15).float().expand(30, 30)
    found, weight = masked_blur(values, weights, 2.0)
    torch.testing.assert_close(found[:, :, :20], torch.full((1, 30, 20), 0.25))
    assert (found[:, :, 22:] == 0).all()  # beyond three sigma of everything known
    assert (weight[:, 22:] == 0).all()
