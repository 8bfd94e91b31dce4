"""The exposure of lit pictures by their truth, by value."""

import numpy as np
import pytest
from livehand.backend.evaluation.exposure import exposed, exposure_gain


def test_the_brightest_hundredth_of_the_hand_becomes_nine_tenths():
    pixels = np.zeros((20, 50, 4), np.float32)
    pixels[:10, :, 3] = 1
    pixels[:10, :, :3] = np.linspace(0, 40, 1500).reshape(10, 50, 3)
    pixels[10:] = [500, 500, 500, 0.4]  # not of the hand
    gain = exposure_gain(pixels)
    assert gain == pytest.approx(0.9 / 39.6, rel=1e-3)
    assert exposure_gain(pixels * np.array([7, 7, 7, 1], np.float32)) == pytest.approx(gain / 7, rel=1e-5)


def test_colours_are_encoded_on_black_and_alpha_stays():
    pixels = np.array([[[0.09, 0.25, 9, 0.5], [0, 0, 0, 0]]], np.float32)
    # sRGB encodes 0.18 as 0.4614 and 0.5 as 0.7354.
    np.testing.assert_allclose(exposed(pixels, 2.0), [[[0.4614, 0.7354, 1, 0.5], [0, 0, 0, 0]]], atol=1e-4)


def test_a_black_hand_has_a_gain():
    assert np.isfinite(exposure_gain(np.array([[[0, 0, 0, 1.0]]], np.float32)))
