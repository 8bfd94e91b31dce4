"""Furrows of a map of heights are dark by what they lie below the skin around, and the skin keeps its tone."""

import numpy as np
import pytest
from livehand.backend.surface.furrow_shade import DEEPEST, REACH_MM, SHADE_OF_SLOPE, furrow_shade

N, TEXEL_MM = 64, 0.13
MIDDLE = N // 2


def line(height_mm):
    """Return the shade across a line of this height, a texel wide."""
    relief = np.zeros((N, N), np.float32)
    relief[:, MIDDLE] = height_mm
    return furrow_shade(relief, TEXEL_MM)[MIDDLE]


@pytest.mark.parametrize("deep_mm", [0.01, 0.03])
def test_a_furrow_is_dark_by_its_depth(deep_mm):
    """A third of what is around a line, by windows of 3 texels taken twice, is the line itself."""
    assert line(-deep_mm)[MIDDLE] == pytest.approx(-SHADE_OF_SLOPE * deep_mm * (2 / 3) / REACH_MM, abs=0.003)


def test_no_furrow_is_darker_than_the_deepest_and_crests_are_hardly_brighter():
    assert line(-0.5)[MIDDLE] == pytest.approx(-DEEPEST, abs=0.04)
    assert 0 < line(0.02)[MIDDLE] < 0.05


def test_the_tone_of_rough_skin_stays():
    relief = np.random.default_rng(1).normal(0, 0.02, (N, N)).astype(np.float32)
    shade = furrow_shade(relief, TEXEL_MM)
    assert shade.std() > 0.05
    assert abs(shade.mean()) < 0.003
    np.testing.assert_allclose(furrow_shade(np.full((N, N), 0.3, np.float32), TEXEL_MM), 0, atol=1e-5)
