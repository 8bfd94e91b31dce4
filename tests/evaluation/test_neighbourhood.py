"""Distances and blurs against direct sums over all pixels."""

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.neighbourhood import distance_px, masked_blur


def squared_distances(height, width):
    """[H, W, H, W] between all pairs of pixels."""
    rows, columns = np.mgrid[:height, :width].astype(float)
    return sum((x[:, :, None, None] - x) ** 2 for x in (rows, columns))


@pytest.mark.parametrize("reach_px", [0.0, 1.5, 4.0, 60.0])
def test_distances_within_reach_are_exact(reach_px):
    marked = np.random.default_rng(0).random((23, 37)) < 0.02
    expected = np.sqrt(squared_distances(23, 37)[:, :, marked].min(-1))
    expected[expected > reach_px] = np.inf
    np.testing.assert_allclose(distance_px(torch.as_tensor(marked), reach_px).numpy(), expected, atol=1e-6)


def test_without_marked_pixels_all_distances_are_infinite():
    assert distance_px(torch.zeros(4, 5, dtype=torch.bool), 3.0).isinf().all()


def test_a_blur_is_a_weighted_mean_within_three_sigma():
    rng, sigma_px = np.random.default_rng(1), 2.1
    values, weights = rng.random((2, 20, 31)), rng.random((20, 31))
    rows, columns = np.abs(np.mgrid[-30:31, -30:31])
    kernel = np.exp(-(rows**2 + columns**2) / (2 * sigma_px**2)) * (np.maximum(rows, columns) <= 7)
    kernel /= kernel.sum()
    expected_weight, expected = np.zeros((20, 31)), np.zeros((2, 20, 31))
    for y in range(20):
        for x in range(31):
            of_pixel = kernel[30 - y : 50 - y, 30 - x : 61 - x] * weights
            expected_weight[y, x] = of_pixel.sum()
            expected[:, y, x] = (values * of_pixel).sum((1, 2)) / of_pixel.sum()
    found, weight = masked_blur(torch.as_tensor(values), torch.as_tensor(weights), sigma_px)
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-12)
    np.testing.assert_allclose(weight.numpy(), expected_weight, atol=1e-12)


def test_pixels_without_weight_do_not_count():
    values = torch.full((1, 30, 30), 0.25)
    values[:, :, 15:] = 9.0
    weights = (torch.arange(30) < 15).float().expand(30, 30)
    found, weight = masked_blur(values, weights, 2.0)
    torch.testing.assert_close(found[:, :, :20], torch.full((1, 30, 20), 0.25))
    assert (found[:, :, 22:] == 0).all()  # over three sigma from every pixel with weight
    assert (weight[:, 22:] == 0).all()
