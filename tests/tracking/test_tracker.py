"""The tracker against MediaPipe's own results, and what it does with hands that move, leave, or are not there."""

import numpy as np
import pytest
import torch
from livehand.backend.tracking import tracker as tracker_module
from livehand.backend.tracking.crop import HandRegion, cropped, region_of_landmarks, upward_angle
from livehand.backend.tracking.networks import TorchNetwork
from livehand.backend.tracking.palm_search import find_hands, merged
from livehand.backend.tracking.takes import by_side
from livehand.backend.tracking.tracked_hand import TrackedHand
from livehand.backend.tracking.tracker import HandTracker

pytestmark = pytest.mark.slow

NAMES = ("palm", "back", "left")


@pytest.mark.slow
def test_it_finds_what_mediapipe_finds_at_720p(networks, shown, reference):
    """Measured 0.1 px and 0.07 mm; networks amplify the last digit of what they see."""
    off_px, off_mm = [], []
    for name in NAMES:
        (hand,) = HandTracker(networks, 1).track(shown(name))
        off_px.append(np.linalg.norm(hand.px - reference[name]["px"][0], axis=-1))
        off_mm.append(np.linalg.norm(1000 * hand.world - reference[name]["world_mm"][0], axis=-1))
    assert np.median(off_px) < 0.5
    assert np.median(off_mm) < 0.3


@pytest.mark.slow
def test_it_follows_as_mediapipe_follows(networks, shown, reference):
    """Each frame's crop is the last frame's answer, and small differences grow: measured 1.4 px of a hand of 400 px."""
    off_px = []
    for name in NAMES:
        tracker = HandTracker(networks, 1)
        for _ in range(8):
            (hand,) = tracker.track(shown(name))
        off_px.append(np.linalg.norm(hand.px - reference[name]["px"][1], axis=-1))
    assert np.median(off_px) < 2.5


@pytest.mark.slow
def test_sides_are_those_of_an_unmirrored_picture(networks, shown):
    sides = {name: HandTracker(networks, 1).track(shown(name))[0].right for name in NAMES}
    assert sides["palm"] > 0.9
    assert sides["back"] > 0.9
    assert sides["left"] < 0.3
    mirrored = HandTracker(networks, 1).track(np.ascontiguousarray(shown("palm")[:, ::-1]))
    assert mirrored[0].right < 0.3


@pytest.mark.slow
def test_two_hands_keep_their_tracks(tracker, two_hands):
    seen = [{hand.track: hand.right > 0.5 for hand in tracker.track(two_hands)} for _ in range(3)]
    assert [len(each) for each in seen] == [2, 2, 2]
    assert sorted(seen[0].values()) == [False, True]
    assert seen[0] == seen[2]


def test_a_hand_that_was_covered_is_found_again_at_once(tracker, shown):
    picture, covered = shown("palm"), np.full((720, 1280, 3), 90, np.uint8)
    first = tracker.track(picture)[0]
    assert tracker.track(covered) == []
    again = tracker.track(picture)[0]
    assert again.track != first.track
    np.testing.assert_allclose(again.px, first.px, atol=1e-3)


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_a_hand_that_fills_the_picture_is_found(networks, shown, quarters):
    """The ordinary search does not find it: its palm is larger than any that the detector knows."""
    (whole,) = HandTracker(networks, 1).track(shown("palm"))
    low, high = whole.px.min(0).astype(int) - 40, whole.px.max(0).astype(int) + 40
    tight = np.ascontiguousarray(np.rot90(shown("palm")[low[1] : high[1], low[0] : high[0]], quarters))
    assert find_hands(tight, TorchNetwork(networks.palm)) == []
    tracker = HandTracker(networks, 2)
    seen = [hands for _ in range(16) if (hands := tracker.track(tight))]
    assert seen
    (hand,) = seen[-1]
    height, width = tight.shape[:2]
    px = hand.px
    for _ in range(quarters):  # back: a quarter is anticlockwise, so up becomes left
        px, height, width = np.stack([height - px[:, 1], px[:, 0]], 1), width, height
    assert np.linalg.norm(px + low - whole.px, axis=1).mean() < 0.06 * (high - low).max()  # its edge is all there is


def test_noise_costs_two_searches_a_frame(networks, shown, monkeypatch):
    searches = []
    monkeypatch.setattr(tracker_module, "find_hands", lambda *args: searches.append(args) or find_hands(*args))
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    tracker = HandTracker(networks)
    assert [tracker.track(noise) for _ in range(5)] == [[]] * 5
    assert len(searches) == 10


@pytest.mark.parametrize(("search_every", "count"), [(10, 3), (5, 5)])
def test_another_hand_is_searched_for_every_few_pictures(networks, shown, monkeypatch, search_every, count):
    """The first picture has one search, later ones two: their find is taken for another hand until it is looked at."""
    searches = []
    monkeypatch.setattr(tracker_module, "find_hands", lambda *args: searches.append(args) or find_hands(*args))
    tracker = HandTracker(networks, 2, search_every)
    for _ in range(11):
        assert len(tracker.track(shown("palm"))) == 1
    assert len(searches) == count


def test_one_hand_is_not_two(networks, shown):
    """A second region of the same hand, turned, would be followed beside the first."""
    tracker = HandTracker(networks, 2)
    (hand,) = tracker.track(shown("palm"))
    region = region_of_landmarks(hand.px)
    centre = region.centre_px + 0.35 * region.side_px
    tracker._follow(HandRegion(centre, region.side_px, region.angle_rad + 0.6))
    assert len(tracker._followed) == 2
    for _ in range(4):
        assert len(tracker.track(shown("palm"))) == 1


def test_noise_is_no_hand(tracker):
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    assert [tracker.track(noise) for _ in range(3)] == [[], [], []]


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(1, 1, 3), (1, 400, 3), (300, 2, 3)])
def test_the_smallest_pictures_have_no_hand(tracker, shape):
    assert tracker.track(np.zeros(shape, np.uint8)) == []


def test_a_crop_shows_the_pictures_own_pixels():
    picture = np.random.default_rng(0).integers(0, 256, (40, 60, 3), dtype=np.uint8)
    square = HandRegion(np.array([20.0, 15.0]), 16.0, 0.0)
    crop = cropped(picture, square, 16, repeats_edge=True)
    expected = torch.from_numpy(picture[7:23, 12:28].copy()).permute(2, 0, 1)[None] / 255
    torch.testing.assert_close(crop, expected.float())
    quarter = cropped(picture, HandRegion(np.array([20.0, 15.0]), 16.0, np.pi / 2), 16, repeats_edge=True)
    # Turned clockwise, the crop's right is the picture's down.
    torch.testing.assert_close(quarter[0, :, 0, :], torch.from_numpy(picture[7:23, 28].copy()).T / 255)


@pytest.mark.parametrize(("repeats", "beyond"), [(True, 1.0), (False, 0.0)])
def test_beyond_the_picture(repeats, beyond):
    white = np.full((10, 10, 3), 255, np.uint8)
    crop = cropped(white, HandRegion(np.array([5.0, 5.0]), 40.0, 0.3), 8, repeats)
    assert float(crop[0, 0, 0, 0]) == beyond
    assert float(crop[0, 0, 4, 4]) == 1.0


def test_regions_turn_with_the_hand():
    rng = np.random.default_rng(1)
    px = rng.uniform(100, 300, (21, 2))
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    one, other = region_of_landmarks(px), region_of_landmarks(px @ turn.T)
    np.testing.assert_allclose(other.centre_px, turn @ one.centre_px)
    np.testing.assert_allclose(other.side_px, one.side_px)
    assert np.isclose((other.angle_rad - one.angle_rad - angle + np.pi) % (2 * np.pi), np.pi)
    assert upward_angle(np.zeros(2), np.array([0.0, -1.0])) == pytest.approx(0)
    assert upward_angle(np.zeros(2), np.array([1.0, 0.0])) == pytest.approx(np.pi / 2)


def test_overlapping_finds_become_their_weighted_mean():
    box = np.array([[0.1, 0.1], [0.3, 0.3], *np.full((7, 2), 0.2)])
    found = merged(np.stack([box, box + 0.5, box + 0.02]), np.array([0.9, 0.7, 0.6]))
    assert len(found) == 2
    np.testing.assert_allclose(found[0], box + 0.02 * 0.6 / 1.5)
    np.testing.assert_allclose(found[1], box + 0.5)
    assert merged(np.zeros((0, 9, 2)), np.zeros(0)) == []


def test_tracks_of_one_hand_are_one_whatever_their_labels():
    """Of two tracks on one hand the longer stays; a hand beside it is another's."""
    px = np.random.default_rng(2).uniform(0, 100, (21, 2))
    seen = lambda track, frames, right, shift: [  # noqa: E731
        (frame, TrackedHand(track, px + shift, np.zeros((21, 3)), 1.0, right)) for frame in frames
    ]
    long, short, beside = seen(0, range(9), 0.6, 0.0), seen(1, range(2, 8), 0.0, 3.0), seen(2, range(9), 0.7, 60.0)
    assert {side: len(hand.frames) for side, hand in by_side([short, long]).items()} == {"right": 9}
    both = by_side([short, long, beside])
    assert {side: round(hand.px[0, 0, 0] - px[0, 0]) for side, hand in both.items()} == {"right": 60, "left": 0}
