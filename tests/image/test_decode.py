"""The network's picture becomes the frame: by hand."""

import numpy as np
import pytest
import torch
from livehand.backend.image.crop import Crop
from livehand.backend.image.decode import decode_frame, linear_frame, srgb_pixels, straight_srgb
from livehand.backend.image.srgb import linear_to_srgb
from livehand.backend.records.frame import DEPTH_BACKGROUND, Frame, empty_frame


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


def test_what_is_hidden_leaves_no_trace_in_the_frame():
    """Colours where alpha is next to nothing may be anything, and depth where it is less than half."""
    colours, alpha = torch.full((3, 4, 4), torch.nan), torch.zeros(4, 4)
    alpha[1, 1], alpha[1, 2], alpha[2, 2], alpha[3, 3] = 0.7, 0.3, 1.5, 0.5 / 255 - 1e-4
    colours[:, alpha > 0.1] = torch.tensor([0.5, 4.0, 0.25])[:, None]
    depth = torch.full((4, 4), torch.inf)
    depth[1:3, 1:3] = 0.6
    frame = linear_frame(colours, alpha, depth, Crop(1, 0, 2, 2), (7, 5), None)
    expected = np.zeros((5, 7))
    expected[1, 3], expected[1, 4], expected[2, 4] = 0.7, 0.3, 1
    np.testing.assert_allclose(frame.alpha, expected, rtol=1e-6)
    np.testing.assert_array_equal(frame.rgb, (expected > 0)[..., None] * np.array([0.5, 4, 0.25], np.float32))
    np.testing.assert_array_equal(frame.depth == np.float32(0.6), expected >= 0.5)
    assert (frame.depth[expected < 0.5] == DEPTH_BACKGROUND).all()


@pytest.mark.parametrize("window", [np.s_[3:9, 2:11], np.s_[0:1, 12:13], np.s_[:, :], np.s_[0:0, 0:0]])
def test_a_picture_is_encoded_as_a_whole_image_would_be(window):
    """By the definition, over all pixels; only those that are seen are computed."""
    random = np.random.default_rng(1)
    alpha = np.zeros((10, 13), np.float32)
    alpha[window] = random.uniform(0, 1, alpha[window].shape)
    alpha[window][::2] = 0
    frame = Frame(random.uniform(0, 1.5, (10, 13, 3)).astype(np.float32) * alpha[..., None], alpha, alpha)
    straight = torch.as_tensor(frame.rgb / np.where(alpha > 0, alpha, 1)[..., None]).clamp(0, 1)
    expected = np.concatenate([linear_to_srgb(straight).numpy(), alpha[..., None]], -1)
    np.testing.assert_allclose(straight_srgb(frame), expected, rtol=3e-7)  # torch's powers depend on their places
    pixels = srgb_pixels(frame)
    assert (pixels.dtype, pixels.shape) == (np.uint8, (10, 13, 4))
    np.testing.assert_allclose(pixels, expected * 255, atol=0.5001)
