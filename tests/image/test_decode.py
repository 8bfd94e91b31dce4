"""The network's picture becomes the frame: by hand."""

import numpy as np
import torch
from livehand.backend.image.crop import Crop
from livehand.backend.image.decode import decode_frame
from livehand.backend.records.frame import DEPTH_BACKGROUND, empty_frame


def test_developing_by_hand():
    """Encoded 0.5 x alpha 0.5 -> linear(0.5) x 0.5; more colour than alpha, and less than nothing, are clamped."""
    image = torch.zeros(4, 2, 2)
    image[:, 0, 0] = torch.tensor([0.25, 0.5, 0.9, 0.5])
    image[:, 0, 1] = torch.tensor([-1.0, 2.0, 0.3, 1.7])
    image[:, 1, 0] = torch.tensor([0.3, 0.3, 0.3, -0.2])
    image[:, 1, 1] = torch.tensor([0.1, 0.1, 0.1, 0.4])
    depth = torch.tensor([[0.7, torch.inf], [0.7, 0.7]])
    frame = decode_frame(image, depth, Crop(0, 0, 1, 1), (2, 2))
    half = ((0.5 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(frame.rgb[0, 0], [half * 0.5, 0.5, 0.5], rtol=1e-5)
    np.testing.assert_allclose(frame.rgb[0, 1], [0, 1, ((0.3 + 0.055) / 1.055) ** 2.4], rtol=1e-5)
    np.testing.assert_array_equal(frame.rgb[1, 0], 0)
    np.testing.assert_allclose(frame.alpha, [[0.5, 1], [0, 0.4]])
    np.testing.assert_allclose(frame.depth, [[0.7, DEPTH_BACKGROUND], [DEPTH_BACKGROUND, DEPTH_BACKGROUND]])


def test_the_windows_place_in_the_frame():
    """A window that reaches past the upper left corner; what it does not cover is empty."""
    image, depth = torch.ones(4, 4, 4), torch.full((4, 4), 0.6)
    frame = decode_frame(image, depth, Crop(-1, -1, 2, 2), (5, 3))
    expected = np.zeros((3, 5))
    expected[:2, :2] = 1
    np.testing.assert_array_equal(frame.alpha, expected)
    np.testing.assert_array_equal(frame.depth, np.where(expected > 0, np.float32(0.6), np.float32(DEPTH_BACKGROUND)))


def test_an_empty_frame():
    frame = empty_frame((3, 2))
    assert frame.rgb.shape == (2, 3, 3)
    assert (frame.depth == DEPTH_BACKGROUND).all()
