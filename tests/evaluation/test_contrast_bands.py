"""Contrast by scale: a sinusoid's deviation in each band by its closed form, and the span by value."""

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.contrast_bands import (
    BANDS_MM,
    CONTRAST_KEYS,
    SPAN,
    SPREAD_KEYS,
    band_key,
    colour_spread,
    contrast,
    contrast_figures,
)
from livehand.backend.evaluation.skin_colours import lab
from livehand.backend.evaluation.visible_surface import VisibleSurface
from livehand.backend.image.srgb import linear_to_srgb, srgb_to_linear

MM_PER_PX = 0.25


def picture_of(l_star):
    """A grey picture of this lightness."""
    y = ((l_star + 16) / 116) ** 3
    return linear_to_srgb(y)[..., None].expand(*l_star.shape, 3)


def waves(wavelength_mm, amplitude):
    """[20, 4000] px, so long that its ends hardly count."""
    phase = 2 * np.pi * torch.arange(4000) * MM_PER_PX / wavelength_mm
    return picture_of((50 + amplitude * phase.sin()).expand(20, 4000))


def kept(sigma_mm, wavelength_mm):
    """What a Gaussian blur keeps of a wave."""
    return np.exp(-((2 * np.pi * sigma_mm / wavelength_mm) ** 2) / 2)


@pytest.mark.slow
@pytest.mark.parametrize("wavelength_mm", [1.5, 3.0, 6.0, 12.0])
def test_a_wave_deviates_as_its_bands_let_it(wavelength_mm):
    figures = contrast(waves(wavelength_mm, 6.0), torch.ones(20, 4000, dtype=torch.bool), MM_PER_PX)
    for fine, coarse in BANDS_MM:
        share = kept(fine / np.pi, wavelength_mm) - kept(coarse / np.pi, wavelength_mm)
        assert figures[band_key((fine, coarse))] == pytest.approx(6 / np.sqrt(2) * share, rel=0.03, abs=0.08)


@pytest.mark.slow
def test_the_span_leaves_out_two_percent_at_either_end():
    ramp = picture_of(torch.linspace(20, 80, 4000).expand(20, 4000))
    assert contrast(ramp, torch.ones(20, 4000, dtype=torch.bool), MM_PER_PX)[SPAN] == pytest.approx(57.6, abs=0.05)


def test_a_flat_hand_has_no_contrast_whatever_lies_around_it():
    hand = torch.zeros(120, 120, dtype=torch.bool)
    hand[20:100, 30:90] = True
    image = torch.rand(120, 120, 3) * ~hand[..., None] + 0.4 * hand[..., None]
    figures = contrast(image, hand, MM_PER_PX)
    assert max(figures.values()) < 1e-3
    image[20:100, 30:33] = 1.0  # within 1 mm of the outline
    assert max(contrast(image, hand, MM_PER_PX).values()) < 1e-3
    image[20:100, 30:40] = 1.0
    assert contrast(image, hand, MM_PER_PX)["l_2_4"] > 1


def test_what_cannot_be_measured_is_nan():
    hand = torch.ones(40, 40, dtype=torch.bool)
    image = torch.rand(40, 40, 3)
    assert np.isnan(list(contrast(image, torch.zeros_like(hand), 0.5).values())).all()
    assert np.isnan(list(contrast(image, hand, np.nan).values())).all()
    coarse = contrast(image, hand, 1.2)
    assert np.isnan(coarse["l_1_2"])
    assert np.isfinite(coarse["l_4_8"])


def test_the_truth_has_keys_of_its_own():
    """At 0.25 mm a pixel by the mesh's footprint."""
    alpha = torch.ones(20, 4000, 1)
    image, truth = (torch.cat([waves(3.0, size), alpha], -1).numpy() for size in (3.0, 6.0))
    depth = torch.full((20, 4000), 0.5)
    depth[:5] = torch.inf
    surface = VisibleSurface(depth, torch.ones(20, 4000), depth * 0.0005, torch.tensor(1.0))
    figures = contrast_figures(image, truth, surface)
    assert set(figures) == {*CONTRAST_KEYS, *(f"{key}_truth" for key in CONTRAST_KEYS)}
    assert figures["l_2_4"] / figures["l_2_4_truth"] == pytest.approx(0.5, rel=0.01)
    assert figures["l_2_4_truth"] == pytest.approx(6 / np.sqrt(2) * (kept(2 / np.pi, 3) - kept(4 / np.pi, 3)), rel=0.03)


def test_the_spread_of_colour_is_that_of_the_hand_alone():
    red, pale = (torch.tensor(rgb).expand(40, 20, 3) for rgb in ((0.8, 0.5, 0.45), (0.7, 0.6, 0.5)))
    image, hand = torch.cat([red, pale, torch.zeros(40, 40, 3)], 1), torch.zeros(40, 80, dtype=torch.bool)
    hand[:, :40] = True
    spread = colour_spread(image, hand, MM_PER_PX)
    first, second = (lab(srgb_to_linear(one[0, 0])) for one in (red, pale))
    for key, channel in zip(SPREAD_KEYS, (1, 2), strict=True):
        assert spread[key] == pytest.approx(abs(float(first[channel] - second[channel])) / 2, rel=0.15)
    assert np.isnan(colour_spread(image, torch.zeros(40, 80, dtype=torch.bool), MM_PER_PX)[SPREAD_KEYS[0]])
