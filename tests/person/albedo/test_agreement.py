"""What pictures say about texels is averaged: outliers, exposures and clipped channels do no harm."""

import numpy as np
import pytest
from livehand.backend.person.albedo.agreement import TexelSighting, agreed_ratio

TEXELS = 400
TRUE = np.array([-0.3, -0.5, -0.7], np.float32)
NONE = np.zeros((TEXELS, 3), bool)


def sighting(log_ratio, is_bound=NONE, weight=1.0):
    every = np.broadcast_to(np.asarray(log_ratio, np.float32), (TEXELS, 3)).copy()
    return TexelSighting(np.full(TEXELS, weight, np.float32), every, every, is_bound.copy(), 0.0)


def bounds(channel):
    is_bound = NONE.copy()
    is_bound[:, channel] = True
    return is_bound


def agreed(sightings, guess=(0, 0, 0)):
    return agreed_ratio(sightings, np.broadcast_to(np.asarray(guess, np.float32), (TEXELS, 3)).copy())


def test_one_that_contradicts_the_others_hardly_counts():
    found = agreed([sighting(TRUE)] * 4 + [sighting(TRUE + np.linspace(-1, 1, TEXELS)[:, None])])
    assert found.mean == pytest.approx(np.tile(TRUE, (TEXELS, 1)), abs=0.03)


def test_a_picture_s_own_white_balance_is_divided_out():
    tint = np.array([0.3, 0.0, -0.3], np.float32)
    found = agreed([sighting(TRUE)] * 4 + [sighting(TRUE + tint)])
    assert found.log_gain[4] - found.log_gain[0] == pytest.approx(tint, abs=0.3 * 0.3 + 1e-3)  # .7 of it is believed
    assert found.mean.mean(0) == pytest.approx(TRUE + tint / 5, abs=0.3 * 0.3 / 5 + 1e-3)  # the mean of gains is none


def test_a_clipped_channel_that_others_measure_does_not_count():
    clipped = sighting(TRUE - (0.4, 0, 0), bounds(0), weight=10)
    found = agreed([sighting(TRUE), clipped])
    assert found.mean == pytest.approx(np.tile(TRUE, (TEXELS, 1)), abs=1e-3)
    assert found.weight == pytest.approx((1 + 11 + 11) / 3)


def test_a_bound_above_what_was_guessed_counts():
    brighter = TRUE + np.float32([0.2, 0, 0])
    found = agreed([sighting(brighter, bounds(0))], guess=TRUE)
    assert found.mean[0] == pytest.approx(brighter, abs=1e-3)


def test_a_channel_clipped_everywhere_is_as_far_from_the_guess_as_the_others():
    darker = np.float32(-0.25)
    found = agreed([sighting(TRUE + darker - (0.5, 0, 0), bounds(0))] * 2, guess=TRUE)
    assert found.mean[0] == pytest.approx(TRUE + darker, abs=1e-3)
    assert found.weight == pytest.approx(4 / 3)


def test_what_no_picture_shows_has_no_weight():
    found = agreed([sighting(TRUE, weight=0.0)] * 2, guess=TRUE)
    assert not found.weight.any()
    assert np.isfinite(found.mean).all()
