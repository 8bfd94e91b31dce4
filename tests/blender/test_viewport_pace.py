"""The pace of moving pictures: as large as time allows, and steady."""

from itertools import pairwise

import pytest
from livehand.livehand_blender.render.viewport import Pace

WANTED_S = 0.04


def settled(seconds_of, pictures=40):
    """The sides of so many pictures that take the time which a function of their side gives."""
    pace, sides = Pace(WANTED_S), []
    for _ in range(pictures):
        sides.append(pace.side_px)
        pace.record(pace.side_px, seconds_of(pace.side_px))
    return sides


def by_pixels(side_px, at_256_px_s):
    return at_256_px_s * (side_px / 256) ** 2


@pytest.mark.parametrize(
    ("at_256_px_s", "side_px"), [(0.004, 512), (0.016, 320), (0.025, 256), (0.039, 256), (0.05, 192), (1.0, 128)]
)
def test_the_largest_side_that_keeps_pace_is_found_and_kept(at_256_px_s, side_px):
    sides = settled(lambda side: by_pixels(side, at_256_px_s))
    assert sides[0] == 256
    assert set(sides[10:]) == {side_px}


def test_a_constant_part_of_the_time_makes_it_smaller_step_by_step():
    sides = settled(lambda side: 0.03 + by_pixels(side, 0.03))
    assert sorted(set(sides), reverse=True) == list(dict.fromkeys(sides)) == [256, 160, 128]


@pytest.mark.parametrize("share", [0.7, 0.85, 0.95])
def test_times_that_vary_by_a_tenth_do_not_change_it_again_and_again(share):
    factors = [0.9, 1.1, 1.0, 0.95, 1.05]
    pace, sides = Pace(WANTED_S), []
    for number in range(200):
        sides.append(pace.side_px)
        pace.record(pace.side_px, by_pixels(pace.side_px, share * WANTED_S) * factors[number % 5])
    assert sum(one != other for one, other in pairwise(sides)) <= 1


def test_one_slow_picture_changes_nothing():
    pace = Pace(WANTED_S)
    for seconds in (5.0, 0.035, 0.035, 0.035, 2.0, 0.035):
        pace.record(256, seconds)
        assert pace.side_px == 256


def test_pictures_of_an_earlier_choice_do_not_count():
    pace = Pace(WANTED_S)
    for _ in range(3):
        pace.record(256, 0.25)
    assert pace.side_px == 128
    for _ in range(5):
        pace.record(256, 1e-4)
    assert pace.side_px == 128
    for _ in range(3):
        pace.record(128, 1e-3)
    assert pace.side_px == 512
