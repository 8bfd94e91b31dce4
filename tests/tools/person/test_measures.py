"""Gates' measures: closed forms of errors, contrast and likeness."""

import numpy as np
import pytest
from livehand.tools.person.measures import (
    PictureFigures,
    band_passed,
    contrast_ratios,
    correlation,
    likeness,
    mean_figures,
    picture_figures,
)

MM_PER_PX = 0.25


def waves(wavelength_mm, size=256, amplitude=1.0):
    places_mm = MM_PER_PX * np.arange(size)
    return amplitude * np.sin(2 * np.pi * places_mm / wavelength_mm)[None, :, None] * np.ones((size, 1, 3))


def test_errors_count_on_the_hand_alone():
    true = np.full((64, 64, 4), 0.5, np.float32)
    true[..., 3] = 1
    ours, hand = true.copy(), np.zeros((64, 64), bool)
    hand[16:48, 16:48] = True
    ours[~hand, :3] = 0
    assert picture_figures(ours, true, hand) == pytest.approx((100, 0, 1))
    ours[hand, :3] += 0.1
    figures = picture_figures(ours, true, hand)
    assert figures.psnr_db == pytest.approx(20, abs=1e-3)
    assert figures.flip > 0.01
    ours[:32, :, 3] = 0
    assert picture_figures(ours, true, hand).iou == pytest.approx(0.5)


def test_figures_are_averaged_each_by_itself():
    one, other = ((20.0, 0.1, 1.0), (30.0, 0.3, 0.5))
    assert mean_figures([PictureFigures(*one), PictureFigures(*other)]) == pytest.approx((25, 0.2, 0.75))


def test_half_the_waves_are_half_the_contrast_in_their_band():
    true, ours = 0.5 + waves(3, amplitude=0.02), 0.5 + waves(3, amplitude=0.01)
    everywhere = np.ones((256, 256), bool)
    assert contrast_ratios(ours, true, everywhere, MM_PER_PX)["l_2_4"] == pytest.approx(0.5, abs=0.01)
    assert contrast_ratios(ours, true, np.zeros((256, 256), bool), MM_PER_PX) == {}


@pytest.mark.parametrize(("wavelength_mm", "passes"), [(2.5, True), (60.0, False)])
def test_a_band_keeps_its_waves(wavelength_mm, passes):
    everywhere = np.ones((256, 256), bool)
    image = waves(wavelength_mm)
    kept = band_passed(image, everywhere, MM_PER_PX, (0.5, 8.0))[64:192, 64:192]
    # A blur of deviation s keeps exp(-(2 pi s / wavelength)^2 / 2) of a wave.
    share = np.exp(-2 * (0.5 / wavelength_mm) ** 2) - np.exp(-2 * (8 / wavelength_mm) ** 2)
    np.testing.assert_allclose(kept, share * image[64:192, 64:192], atol=0.02)
    assert (share > 0.8) == passes


def test_likeness_knows_neither_strength_nor_what_is_coarser_than_the_band():
    rng = np.random.default_rng(0)
    everywhere = np.ones((256, 256), bool)
    ink = (rng.uniform(size=(32, 32, 1)) > 0.5).repeat(8, 0).repeat(8, 1) * np.array([1.6, 1.2, 0.7])
    shading = waves(200, amplitude=3)
    assert likeness(0.5 * ink + shading, ink, everywhere, MM_PER_PX) == pytest.approx(1, abs=0.03)
    assert likeness(-ink, ink, everywhere, MM_PER_PX) == pytest.approx(-1)
    assert abs(likeness(rng.normal(size=ink.shape), ink, everywhere, MM_PER_PX)) < 0.1


def test_likeness_does_not_see_beyond_the_region():
    rng = np.random.default_rng(1)
    region = np.zeros((128, 128), bool)
    region[32:96, 32:96] = True
    image = rng.normal(size=(128, 128, 3))
    other = np.where(region[..., None], image, 100)
    assert likeness(other, image, region, MM_PER_PX) == pytest.approx(1)


def test_correlation_is_the_cosine():
    assert correlation(np.array([1.0, 0]), np.array([1.0, 1])) == pytest.approx(0.5**0.5)
    assert np.isnan(correlation(np.zeros(2), np.ones(2)))
