"""How the maps of the skin's fine detail are made: nothing coarse is in them, and nothing from beside the skin."""

import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.surface.detail_maps_file import ATLAS_MM, COARSEST_MM, FOLD_STEP, PIGMENT_STEP, RELIEF_STEP_MM
from livehand.tools.builtin_hand.detail_maps import (
    COARSER,
    NAIL_RIM,
    coarse_part,
    fine_part,
    nail_part,
    roughness_part,
    skin_detail_arrays,
)

N = 512
EVERYWHERE = np.ones((N, N), bool)
TEXEL_MM = ATLAS_MM / N


def waves(length_texels):
    return np.tile(np.sin(2 * np.pi * np.arange(N) / length_texels), (N, 1))


@pytest.mark.parametrize(("length", "left"), [(4, 1.0), (200, 0.0)])
def test_short_waves_stay_and_long_ones_go(length, left):
    found = fine_part(waves(length), EVERYWHERE, 3.0)
    inner = found[N // 4 : -N // 4, N // 4 : -N // 4]
    assert inner.max() == pytest.approx(left, abs=0.02)


@pytest.mark.parametrize(("length", "left"), [(8, 0.06), (60, 0.9), (500, 0.03)])
def test_waves_between_both_stay_in_the_coarse_part(length, left):
    found = coarse_part(waves(length), EVERYWHERE, 3.0, 22.0)
    inner = found[N // 16 : -N // 16, N // 16 : -N // 16]
    sigma = 2 * np.pi / length
    expected = np.exp(-((sigma * 3) ** 2) / 2) * (1 - np.exp(-((sigma * 22) ** 2) / 2))
    assert inner.max() == pytest.approx(expected, abs=0.03)
    assert expected == pytest.approx(left, abs=0.05)


def test_skin_beside_an_empty_place_has_no_edge():
    is_skin = EVERYWHERE.copy()
    is_skin[:, 100:] = False
    found = fine_part(np.where(is_skin, 5.0, 0.0), is_skin, 3.0)
    assert np.abs(found).max() < 1e-5


def test_the_arrays_hold_whole_steps_of_height_and_of_the_logarithm_of_albedo():
    hand = load_default_hand()
    height = np.stack([0.05 * waves(3), 0.5 * waves(3), 0.3 * waves(3)], -1)
    masks = {"vein": 0.6 * waves(3)[..., None], "nailrim": np.full((N, N, 1), 3.0), "mask": np.full((N, N, 3), 0.53)}
    maps = [{**masks, "height": height, "albedo": np.exp(k * waves(3))[..., None].repeat(3, -1)} for k in (0.2, 0.4)]
    arrays, coarse = skin_detail_arrays(hand, *maps)
    sigma = 2 * np.pi / 3 * COARSEST_MM / TEXEL_MM
    kept = 1 - np.exp(-(sigma**2) / 2)
    middle = slice(N // 4, -N // 4)
    for name, amplitude, step in (
        ("relief", 0.05, RELIEF_STEP_MM),
        ("dorsal", 0.5, FOLD_STEP),
        ("palmar", 0.3, FOLD_STEP),
        ("pigment_light", 0.2, PIGMENT_STEP),
        ("pigment_deep", 0.4, PIGMENT_STEP),
    ):
        assert arrays[name].dtype == np.int8
        expected = amplitude * np.sin(2 * np.pi / 3) * kept
        assert arrays[name][middle, middle].max() * step == pytest.approx(expected, rel=0.05)
        assert coarse[name].shape == (N // COARSER, N // COARSER)
    assert arrays["joint"].shape == (len(hand.v_template),)
    assert coarse["nail"].max() == 0
    assert (coarse["roughness"] == 106).all()  # 0.53


def test_the_roughness_beside_the_skin_is_the_skins_mean():
    is_skin = EVERYWHERE.copy()
    is_skin[:, N // 2 :] = False
    roughness = np.where(is_skin, np.linspace(0.4, 0.6, N)[:, None], 0.0)
    found = roughness_part(roughness, is_skin)
    assert found[:, -1] == pytest.approx(0.5)
    assert found[:, 0] == pytest.approx(np.linspace(0.4, 0.6, N).reshape(-1, COARSER).mean(1))


def test_nails_lie_within_their_rim():
    outer, inner = NAIL_RIM
    rim = np.tile(np.repeat([3.0, outer, (outer + inner) / 2, inner, 0.2], N // 4), (N, 1))[:, :N]
    found = nail_part(rim, EVERYWHERE)[0, :: N // COARSER // 4]
    assert found == pytest.approx([0, 0, 0.5, 1])
    assert nail_part(rim, ~EVERYWHERE).max() == 0
