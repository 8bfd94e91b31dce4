"""A person's skin as maps: slopes of known waves, and what rays pass over from afar."""

from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.surface.detail_maps import (
    BLURRED_LEVEL,
    DEEPEST,
    REACH_MM,
    RESOLVED_BETWEEN,
    RESOLVED_PX,
    SHADE_OF_SLOPE,
    SHARPNESS,
    DetailMaps,
    SkinLook,
    furrow_shade,
)
from livehand.backend.surface.detail_maps_file import ATLAS_MM, COARSEST_MM, SkinFlexion, SkinMaps, SurfaceDetail

N = 64
TEXEL_MM = ATLAS_MM / N


def skin_maps(side, **maps):
    flat = dict.fromkeys(SkinMaps.__dataclass_fields__, np.zeros((side, side), np.float32))
    return SkinMaps(**{**flat, **maps})


def maps_of(fine, coarse):
    bend = SkinFlexion(np.zeros(4, int), np.zeros((16, 3)))
    return DetailMaps.of(
        SurfaceDetail(
            fine,
            coarse,
            np.zeros((16, 16), np.float32),
            np.full((16, 16), 0.5, np.float32),
            np.zeros((2, 16, 16), np.float32),
            bend,
        ),
        SkinLook(0.0, 1.0, 0.0),
    )


@pytest.mark.parametrize(("texels", "share"), [(16, 0.999), (8, 0.988), (4, 0.849)])
def test_slopes_of_short_waves_are_hardly_less_than_they_are(texels, share):
    """Differences of fourth order tell (8 sin w - sin 2 w) / 6 w of a wave of w a texel; second: 0.97, 0.90, 0.64."""
    wave = 2 * pi / texels
    heights = np.tile(0.05 * np.sin(wave * np.arange(N)), (N, 1)).astype(np.float32)
    maps = maps_of(skin_maps(N, relief_mm=heights), skin_maps(16))
    slopes = maps.table[: N * N, 0].reshape(N, N)[:, 2:-2] * 0.001
    expected = share * wave * 0.05 * torch.cos(wave * torch.arange(N)[2:-2])
    torch.testing.assert_close(slopes, expected.expand_as(slopes), atol=6e-4, rtol=0)


def seen_tint(texels_a_pixel, wave_texels):
    """What is seen of waves of coarse pigment, as a share of them."""
    wave = 0.3 * np.sin(2 * pi * (np.arange(16) + 0.5) / wave_texels)
    coarse = skin_maps(16, pigment_light=np.tile(wave, (16, 1)).astype(np.float32))
    maps = maps_of(skin_maps(N), coarse)
    at_texels = torch.stack([(torch.arange(16) + 0.5) / 16, torch.full((16,), 0.5)], -1)
    seen = maps.sample(at_texels, torch.full((16,), float(np.log2(texels_a_pixel))))[:, 6].numpy()
    inner = slice(4, 12)  # nothing is known beyond the borders
    return (seen[inner] * wave[inner]).sum() / (wave[inner] ** 2).sum()


def test_rays_pass_over_what_is_coarse_from_afar_only():
    assert RESOLVED_PX * TEXEL_MM > COARSEST_MM  # even the finest of these maps is coarser than the planes
    assert seen_tint(1, 4) == seen_tint(2, 4) == 0.0  # pixels finer than the coarse maps
    passed_over = 1 - np.exp(-0.5 * (2 * pi / 4 * RESOLVED_PX) ** 2)
    assert seen_tint(4, 4) == pytest.approx(passed_over, rel=0.1)
    assert 0 < seen_tint(4, 16) < 0.5 * passed_over


@pytest.mark.parametrize(("level", "share"), [(0, 0.0), (2, 1.0)])
def test_slopes_that_a_level_does_not_show_widen_the_gloss_by_their_variance(level, share):
    """Waves of four texels are gone at a level of four."""
    heights = np.tile(0.5 * np.sin(pi / 2 * np.arange(N)), (N, 1)).astype(np.float32)
    maps = maps_of(skin_maps(N, relief_mm=heights), skin_maps(16))
    first, size = maps.levels[level]
    squared = maps.table[first : first + size**2, 10].reshape(size, size)[2:-2, 2:-2] * 0.002
    slope = 0.849 * pi / 2 * 0.5 / TEXEL_MM
    expected = torch.tensor(0.5**4 + share * slope**2 / 2).expand_as(squared)
    torch.testing.assert_close(squared, expected, atol=3e-3, rtol=0)
    assert slope**2 / 2 > 0.01


@pytest.mark.parametrize("along", ["u", "v"])
@pytest.mark.parametrize(("slope", "widened"), [(0.9, 0.0), (2.0, 0.0486 * 4 - RESOLVED_BETWEEN)])
def test_steep_walls_of_a_texel_widen_the_gloss_and_gentle_ones_do_not(slope, widened, along):
    """Differences of fourth order spread a step over four texels: -1/12, 7/12, 7/12 and -1/12 of it."""
    heights = np.zeros((N, N), np.float32)
    heights[:, N // 2 :] = slope * TEXEL_MM
    wall = heights if along == "u" else heights.T
    squared = maps_of(skin_maps(N, relief_mm=wall), skin_maps(16)).table[: N * N, 10].reshape(N, N) * 0.002
    squared = squared if along == "u" else squared.T
    beside = squared[:, N // 2 - 1 : N // 2 + 1]
    torch.testing.assert_close(beside, torch.full((N, 2), 0.5**4 + widened), atol=2e-3, rtol=0)
    torch.testing.assert_close(squared[:, : N // 2 - 4], torch.full((N, N // 2 - 4), 0.5**4), atol=2e-3, rtol=0)


def flat_detail(unresolved=0.0):
    """Even skin, whose fine surface lacks this slope everywhere."""
    nail, rough = np.zeros((16, 16), np.float32), np.full((16, 16), 0.5, np.float32)
    slopes = np.full((2, 16, 16), unresolved, np.float32)
    return SurfaceDetail(
        skin_maps(N), skin_maps(16), nail, rough, slopes, SkinFlexion(np.zeros(4, int), np.zeros((16, 3)))
    )


@pytest.mark.parametrize("slope", [0.0, 0.1, 0.2])
def test_slopes_of_steep_walls_vary_as_much_as_they_are(slope):
    maps = DetailMaps.of(flat_detail(slope), SkinLook(0.5, 1.0, 0.0))
    for first, size in maps.levels[:3]:
        squared = maps.table[first : first + size**2, 10] * 0.002
        torch.testing.assert_close(squared, torch.full((size**2,), 0.5**4 + 2 * slope**2), atol=2e-3, rtol=0)


def test_furrows_of_the_fine_relief_are_dark_close_up():
    side = 512
    relief = np.zeros((side, side), np.float32)
    relief[:, side // 2] = -0.05
    pigment = maps_of(skin_maps(side, relief_mm=relief), skin_maps(16)).table[: side**2, 6].reshape(side, side) * 0.01
    expected = torch.from_numpy(furrow_shade(relief, ATLAS_MM / side))
    torch.testing.assert_close(pigment, expected, atol=0.006, rtol=0)
    assert pigment[side // 2, side // 2] < -0.05


def test_deep_skin_shows_relief_more_sharply():
    detail = flat_detail()
    light, half, deep = (DetailMaps.of(detail, SkinLook(melanin, 1.0, 0.0)) for melanin in (0.0, 0.5, 1.0))
    assert (light.blurred_level, deep.blurred_level) == BLURRED_LEVEL
    assert (light.sharpness, deep.sharpness) == SHARPNESS
    assert half.blurred_level == pytest.approx(sum(BLURRED_LEVEL) / 2)
    assert half.sharpness == pytest.approx(np.mean(SHARPNESS, 0))


@pytest.mark.parametrize("level", [1, 3])
def test_levels_do_not_alias_and_keep_what_is_even(level):
    """A wave of three texels, longer than two, would show as one of three halves; a constant stays to the border."""
    wave = np.tile(0.3 * np.sin(2 * pi / 3 * np.arange(N)), (N, 1)).astype(np.float32)
    maps = maps_of(skin_maps(N, pigment_light=0.5 + wave), skin_maps(16))
    first, size = maps.levels[level]
    seen = maps.table[first : first + size**2, 6].reshape(size, size) * 0.01
    assert (seen - 0.5).abs()[:, 1:-1].max() < 0.06
    even = maps_of(skin_maps(N, pigment_light=np.full((N, N), 0.5, np.float32)), skin_maps(16))
    torch.testing.assert_close(even.table[first : first + size**2, 6] * 0.01, torch.full((size**2,), 0.5))


RELIEF_TEXEL_MM = 0.13


def line(height_mm):
    """Return the shade across a line of this height, a texel wide."""
    relief = np.zeros((N, N), np.float32)
    relief[:, N // 2] = height_mm
    return furrow_shade(relief, RELIEF_TEXEL_MM)[N // 2]


@pytest.mark.parametrize("deep_mm", [0.01, 0.03])
def test_a_furrow_is_dark_by_its_depth(deep_mm):
    """A third of what is around a line, by windows of 3 texels taken twice, is the line itself."""
    assert line(-deep_mm)[N // 2] == pytest.approx(-SHADE_OF_SLOPE * deep_mm * (2 / 3) / REACH_MM, abs=0.003)


def test_no_furrow_is_darker_than_the_deepest_and_crests_are_hardly_brighter():
    assert line(-0.5)[N // 2] == pytest.approx(-DEEPEST, abs=0.04)
    assert 0 < line(0.02)[N // 2] < 0.05


def test_the_tone_of_rough_skin_stays():
    relief = np.random.default_rng(1).normal(0, 0.02, (N, N)).astype(np.float32)
    shade = furrow_shade(relief, RELIEF_TEXEL_MM)
    assert shade.std() > 0.05
    assert abs(shade.mean()) < 0.003
    np.testing.assert_allclose(furrow_shade(np.full((N, N), 0.3, np.float32), RELIEF_TEXEL_MM), 0, atol=1e-5)
