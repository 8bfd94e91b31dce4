"""Melanin from pixels in a made light: told from the light's strength and white balance by what is not pigmented."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.person.lit_model.illumination import LitPixels, fitted_light
from livehand.backend.person.lit_model.numbers import PixelTones, fitted_melanin

PIXELS, LOBES = 900, 6
LIGHT_SKIN, PER_MELANIN = np.log([0.6, 0.35, 0.25]), np.log([0.25, 0.17, 0.12])


def made_tones(melanin, strength=1.0, tint=(0.0, 0.0, 0.0)):
    """Pixels of a skin with this melanin, which is paler on a part of the hand; highlights are where lobes mirror."""
    rng = np.random.default_rng(3)
    facing = rng.uniform(0.1, 1, (PIXELS, 1, LOBES))
    specular = np.repeat(0.3 * rng.uniform(0, 1, (PIXELS, 1, LOBES)) ** 8 + 0.01, 3, 1)
    per_melanin = np.where(np.arange(PIXELS)[:, None] < 300, 0.6, 1.0) * PER_MELANIN
    bare = np.broadcast_to(LIGHT_SKIN, (PIXELS, 3))
    pixels = LitPixels((), np.repeat(facing, 3, 1), specular, np.zeros((PIXELS, 3)), np.zeros((PIXELS, 2)))
    lobes = strength * np.array([0.0, 0.5, 0.0, 1.2, 0.2, 0.0])
    albedo = np.exp(bare + melanin * per_melanin)
    shown = pixels.basis(albedo) @ lobes * np.exp(tint) * np.exp(rng.normal(0, 0.03, (PIXELS, 3)))
    return PixelTones(replace(pixels, shown=shown), bare, per_melanin)


@pytest.mark.parametrize("strength", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("melanin", [0.0, 0.42, 1.0])
def test_melanin_is_told_from_the_strength_of_the_light(melanin, strength):
    assert fitted_melanin([made_tones(melanin, strength)]) == pytest.approx(melanin, abs=0.05)


@pytest.mark.parametrize("tint", [(0.1, 0.0, -0.1), (-0.1, 0.0, 0.1)])
@pytest.mark.parametrize("melanin", [0.0, 0.42, 1.0])
def test_a_wrong_white_balance_moves_melanin_little(tint, melanin):
    assert abs(fitted_melanin([made_tones(melanin, tint=tint)]) - melanin) <= 0.08


def test_scenes_share_the_melanin():
    scenes = [made_tones(0.6), made_tones(0.6, 1.7, (0.05, 0, -0.05))]
    assert fitted_melanin(scenes) == pytest.approx(0.6, abs=0.05)


def test_the_light_comes_back_in_the_true_albedo():
    tones = made_tones(0.42, 1.3, (0.06, -0.02, -0.04))
    fit = fitted_light(tones.pixels, tones.ratio(0.42))
    np.testing.assert_allclose(fit.strengths, 1.3 * np.array([0.0, 0.5, 0.0, 1.2, 0.2, 0.0]), atol=0.05)
    np.testing.assert_allclose(fit.log_tint, (0.06, -0.02, -0.04), atol=0.01)
    assert fit.error > fitted_light(made_tones(0.42).pixels, made_tones(0.42).ratio(0.42)).error  # the tint's cost


def test_stains_move_the_light_little():
    tones = made_tones(0.42)
    stained = tones.pixels.shown.copy()
    stained[::9] *= 0.2
    fit = fitted_light(replace(tones.pixels, shown=stained), tones.ratio(0.42))
    np.testing.assert_allclose(fit.strengths.sum(), 1.9, rtol=0.05)
