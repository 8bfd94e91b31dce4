"""CIE Lab by published values."""

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.skin_colours import lab, lightness
from livehand.backend.image.srgb import srgb_to_linear


@pytest.mark.parametrize(
    ("rgb", "expected"),
    [
        ((1, 1, 1), (100, 0, 0)),
        ((0, 0, 0), (0, 0, 0)),
        ((1, 0, 0), (53.24, 80.09, 67.20)),
        ((0, 1, 0), (87.73, -86.18, 83.18)),
        ((0, 0, 1), (32.30, 79.19, -107.86)),
        ((0.18, 0.18, 0.18), (49.50, 0, 0)),
        ((0.005, 0.005, 0.005), (4.52, 0, 0)),
    ],
)
def test_primaries_and_greys_have_their_published_lab(rgb, expected):
    np.testing.assert_allclose(lab(torch.tensor(rgb, dtype=torch.float64)), expected, atol=0.03)


def test_lightness_of_encoded_greys():
    greys = torch.tensor([0.0, 0.5, 1.0])[:, None].expand(3, 3)[None]
    np.testing.assert_allclose(lightness(srgb_to_linear(greys))[0], [0, 53.39, 100], atol=0.01)


def test_lightness_is_the_first_of_lab():
    rgb = torch.rand(50, 3, generator=torch.Generator().manual_seed(0)) ** 4
    np.testing.assert_allclose(lightness(rgb), lab(rgb)[:, 0], atol=1e-4)
