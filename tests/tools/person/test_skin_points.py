"""Texels of the atlas on the hand at rest."""

import numpy as np
import pytest
from livehand.tools.person.skin_points import skin_points

pytestmark = pytest.mark.slow


def test_texels_lie_on_both_sides_of_a_hand_of_usual_size():
    points = skin_points(96)
    assert np.linalg.norm(points.normals, axis=1) == pytest.approx(1)
    x, y, z = points.at_mm.T
    assert 175 < x.max() < 200  # the tip of the middle finger, from the wrist
    assert z[x < 90].max() > 40  # the thumb is radial
    back, palm = (np.abs(x - 60) < 8) & (np.abs(z) < 8) & (y > 0), (np.abs(x - 60) < 8) & (np.abs(z) < 8) & (y < 0)
    assert points.normals[back, 1].mean() > 0.8
    assert points.normals[palm, 1].mean() < -0.8
    assert (y[back].mean() - y[palm].mean()) == pytest.approx(27, abs=6)
