"""Single photographs: a hand is found at once in any view of them."""

import numpy as np
import pytest
from livehand.backend.tracking.stills import hands_of_still
from livehand.backend.tracking.tracker import HandTracker


@pytest.mark.parametrize("quarters", [0, 2])
def test_a_hand_that_fills_a_photograph_is_found_at_once(networks, shown, quarters):
    whole = shown("palm")
    tracker = HandTracker(networks, 2)
    (hand,) = hands_of_still(whole, tracker)
    low, high = hand.px.min(0).astype(int) - 18, hand.px.max(0).astype(int) + 18
    tight = np.ascontiguousarray(np.rot90(whole[low[1] : high[1], low[0] : high[0]], quarters))
    (found,) = hands_of_still(tight, tracker)
    px = found.px if quarters == 0 else np.array(tight.shape[1::-1]) - found.px
    assert np.linalg.norm(px + low - hand.px, axis=1).mean() < 0.06 * (high - low).max()


def test_what_was_followed_before_does_not_count(networks, shown):
    tracker = HandTracker(networks, 2)
    first = hands_of_still(shown("palm"), tracker)
    hands_of_still(shown("left"), tracker)
    again = hands_of_still(shown("palm"), tracker)
    np.testing.assert_allclose(again[0].px, first[0].px, atol=1e-6)


def test_noise_shows_no_hand(networks):
    noise = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    assert hands_of_still(noise, HandTracker(networks)) == []
