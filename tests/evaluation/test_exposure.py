"""The exposure of lit pictures by their truth, by value."""

import numpy as np
import pytest
from livehand.backend.evaluation.exposure import LEAST_LIT, exposed, exposure_gain, is_reached
from livehand.backend.records.light import Lamp, Light


def test_the_brightest_hundredth_of_the_hand_becomes_nine_tenths():
    pixels = np.zeros((20, 50, 4), np.float32)
    pixels[:10, :, 3] = 1
    pixels[:10, :, :3] = np.linspace(0, 40, 1500).reshape(10, 50, 3)
    pixels[10:] = [500, 500, 500, 0.4]  # not of the hand
    gain = exposure_gain(pixels)
    assert gain == pytest.approx(0.9 / 39.6, rel=1e-3)
    assert exposure_gain(pixels * np.array([7, 7, 7, 1], np.float32)) == pytest.approx(gain / 7, rel=1e-5)


@pytest.mark.parametrize(("share", "reached"), [(1.1, True), (0.9, False), (0.0, False)])
def test_a_light_reaches_a_view_if_its_brightest_skin_sheds_a_thousandth_of_it(share, reached):
    sun = Light((Lamp("sun", np.full(3, 5 * np.pi)),))  # 5 from a white surface
    pixels = np.full((6, 7, 4), 5 * LEAST_LIT * share, np.float32)
    pixels[..., 3] = 1
    assert is_reached(pixels, sun, np.eye(3)) == reached


def test_colours_are_encoded_on_black_and_alpha_stays():
    pixels = np.array([[[0.09, 0.25, 9, 0.5], [0, 0, 0, 0]]], np.float32)
    # sRGB encodes 0.18 as 0.4614 and 0.5 as 0.7354.
    np.testing.assert_allclose(exposed(pixels, 2.0), [[[0.4614, 0.7354, 1, 0.5], [0, 0, 0, 0]]], atol=1e-4)


def test_a_black_hand_has_a_gain():
    assert np.isfinite(exposure_gain(np.array([[[0, 0, 0, 1.0]]], np.float32)))
