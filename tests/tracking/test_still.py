"""Single photographs: each hand is found at once in any view, once, in the photograph's own pixels."""

import numpy as np
import pytest
from livehand.backend.tracking.still import StillTracker
from PIL import Image

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def still(networks):
    return StillTracker(networks)


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_a_hand_that_fills_a_photograph_is_found_at_once(still, shown, quarters):
    whole = shown("palm")
    (hand,) = still.hands(whole)
    low, high = hand.px.min(0).astype(int) - 18, hand.px.max(0).astype(int) + 18
    tight = np.ascontiguousarray(np.rot90(whole[low[1] : high[1], low[0] : high[0]], quarters))
    (found,) = still.hands(tight)
    px, (height, width) = found.px, tight.shape[:2]
    for _ in range(quarters):  # a quarter turned what was right up: back again, clockwise
        px, height, width = np.stack([height - px[:, 1], px[:, 0]], 1), width, height
    assert np.linalg.norm(px + low - hand.px, axis=1).mean() < 0.06 * (high - low).max()


def test_a_large_photograph_is_searched_small_and_answered_in_its_own_pixels(still, shown):
    (small,) = still.hands(shown("back"))
    large = np.asarray(Image.fromarray(shown("back")).resize((2560, 1440), Image.Resampling.BICUBIC))
    (hand,) = still.hands(large)
    np.testing.assert_allclose(hand.px, 2 * small.px, atol=6)
    assert hand.right > 0.9


def test_two_hands_are_two_and_noise_is_none(still, two_hands):
    assert sorted(hand.right > 0.5 for hand in still.hands(two_hands)) == [False, True]
    assert still.hands(np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)) == []
