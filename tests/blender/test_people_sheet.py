"""The sheet of people: a tile's size, its grey beside the hand, and the exposure of deep skin."""

from types import SimpleNamespace

import numpy as np
import pytest
from livehand.backend.capture.picture import linear_to_srgb
from livehand.tools.avatars import sheet

LINEAR = np.array([0.05])


def tile_of(melanin):
    """Of a picture whose upper half is a hand of one grey, the lower half clear."""

    def picture(view, size_px):
        alpha = np.zeros((size_px, size_px, 1))
        alpha[: size_px // 2] = 1
        return np.concatenate([np.repeat(linear_to_srgb(LINEAR) * alpha, 3, -1), alpha], -1)

    person = SimpleNamespace(surface=SimpleNamespace(person=SimpleNamespace(melanin=melanin)))
    return sheet._tile(SimpleNamespace(picture=picture, renderer=SimpleNamespace(avatar=person)), "fist, back")


@pytest.mark.parametrize(("melanin", "gain"), [(0.0, 1.0), (0.5, 1.6), (1.0, 2.2), (1.2, 2.2)])
def test_a_tile_is_exposed_for_its_person_on_one_grey(melanin, gain):
    tile = tile_of(melanin)
    assert tile.shape == (180, 180, 3)
    np.testing.assert_allclose(tile[:90], linear_to_srgb(gain * LINEAR).item(), atol=1e-6)
    np.testing.assert_allclose(tile[90:], linear_to_srgb(np.array([0.12])).item(), atol=1e-6)
