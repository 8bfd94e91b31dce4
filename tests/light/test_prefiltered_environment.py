"""Gloss of the sky, against the integral over all of it: even skies, bright spots, nails, views from the side."""

from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.light.brdf import alphas, fresnel, ggx, hidden_bumps
from livehand.backend.light.prefiltered_environment import PrefilteredEnvironment
from livehand.backend.light.sky_samples import SkySamples
from livehand.backend.records.light import Sky, sky_directions
from torch.nn.functional import normalize

DIRECTIONS = 400000
UP = torch.tensor([[0.0, 0, 1]])


def everywhere(count=DIRECTIONS):
    """Directions of equal solid angle (Fibonacci)."""
    index = torch.arange(count, dtype=torch.float64)
    z, angle = 1 - 2 * (index + 0.5) / count, index * pi * (3 - 5**0.5)
    across = (1 - z * z).sqrt()
    return torch.stack([across * angle.cos(), across * angle.sin(), z], -1).float()


def integral(radiance, normal, view, nail=0.0):
    """[2, 3] reflected by both lobes, of what `radiance` [N, 3] arrives from `everywhere`; in our units."""
    broad = torch.tensor(alphas(None)[1] ** 2)
    lobes = ggx(normal, everywhere(), view, torch.zeros(()), torch.tensor(nail), broad, hidden_bumps(broad))
    return torch.einsum("kg,kc->gc", lobes, radiance) * 4 / DIRECTIONS


def lobes(nail):
    """[P, 2] squared alphas of both lobes on P points of a nail, by its shares, or of skin."""
    tight, broad = alphas(nail)
    return torch.stack([tight, torch.full_like(tight, broad)], 1) ** 2


def on_skin(count):
    return lobes(torch.zeros(count))


def view_at(cosine):
    return -torch.tensor([[(1 - cosine**2) ** 0.5, 0.0, cosine]])


def some_pixels(count, seed=0):
    generator = torch.Generator().manual_seed(seed)
    normal = normalize(torch.randn(count, 3, generator=generator), dim=-1)
    return normal, normalize(torch.randn(count, 3, generator=generator) - 2 * normal, dim=-1)


@pytest.mark.parametrize("cosine", [0.08, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("nail", [0.0, 1.0])
def test_an_even_sky_is_reflected_as_the_integral_says(cosine, nail):
    sky = PrefilteredEnvironment.of(Sky(np.full((8, 16, 3), [0.5, 1, 2])), "cpu")
    expected = integral(torch.tensor([0.5, 1, 2]).expand(DIRECTIONS, 3), UP, view_at(cosine), nail)
    found = sky.specular(UP, view_at(cosine), lobes(torch.tensor([nail])))[0]
    torch.testing.assert_close(found, expected, rtol=0.03, atol=0)


def test_even_light_is_reflected_whatever_the_sky():
    normal, view = some_pixels(50)
    nail = torch.rand(50, generator=torch.Generator().manual_seed(1))
    even, black = PrefilteredEnvironment.of(Sky(np.ones((4, 8, 3))), "cpu"), PrefilteredEnvironment.of(None, "cpu")
    found = black.of_even_light(normal, view, lobes(nail))
    torch.testing.assert_close(found, even.specular(normal, view, lobes(nail))[..., 2], rtol=1e-4, atol=1e-6)
    assert (found > 0.01).all()


def test_straight_on_it_reflects_what_fresnel_says_and_far_more_from_the_side():
    sky = PrefilteredEnvironment.of(Sky(np.ones((1, 1, 3))), "cpu")
    straight, side = (sky.specular(UP, view_at(cosine), on_skin(1))[0, :, 0] for cosine in (1.0, 0.1))
    assert float(straight[0]) == pytest.approx(float(fresnel(torch.tensor(1.0))), rel=0.03)
    assert (side > 5 * straight).all()


@pytest.mark.slow
def test_a_smooth_sky_is_reflected_as_the_integral_says():
    """Red from above, green from +X, blue from everywhere; from all sides."""

    def radiance(towards):
        return np.stack([1 + towards[..., 2], 1 + towards[..., 0], np.ones(towards.shape[:-1])], -1)

    sky, arriving = (
        PrefilteredEnvironment.of(Sky(radiance(sky_directions(32, 64))), "cpu"),
        radiance(everywhere().numpy()),
    )
    normal, view = some_pixels(400)
    to_eye = -(normal * view).sum(-1)
    order = to_eye.argsort()[(to_eye < 0.05).sum() :].tolist()
    assert to_eye[order[10]] < 0.35
    for one in [*order[:15], *order[15::25]]:
        expected = integral(torch.as_tensor(arriving, dtype=torch.float32), normal[one], view[one])
        found = sky.specular(normal[one, None], view[one, None], on_skin(1))[0]
        torch.testing.assert_close(found, expected, rtol=0.1, atol=1e-3)


@pytest.mark.parametrize("height", [0.7, 0.3, 0.0, -0.3])
def test_a_window_ahead_shines_along_the_skin_as_the_integral_says(height):
    """Low over it, and below its horizon but for a part: the mirrored view alone would be wrong by a factor of two."""
    ahead = np.array([-np.sqrt(1 - height**2), 0, height])
    sky = PrefilteredEnvironment.of(
        Sky(np.exp(6 * (sky_directions(32, 64) @ ahead - 1))[..., None].repeat(3, 2)), "cpu"
    )
    arriving = torch.exp(6 * (everywhere() @ torch.as_tensor(ahead, dtype=torch.float32) - 1))[:, None].expand(-1, 3)
    for cosine in (0.1, 0.2, 0.4):
        expected = integral(arriving, UP, view_at(cosine))[:, 0]
        found = sky.specular(UP, view_at(cosine), on_skin(1))[0, :, 0]
        torch.testing.assert_close(found, expected, rtol=0.2, atol=0)


def test_a_bright_spot_is_brightest_where_the_view_is_mirrored_to_it_and_sharper_on_nails():
    radiance = np.zeros((32, 64, 3))
    radiance[10, 20] = 100
    spot = torch.as_tensor(sky_directions(32, 64)[10, 20], dtype=torch.float32)
    sky, view = (
        PrefilteredEnvironment.of(Sky(radiance), "cpu"),
        -normalize(spot + torch.tensor([0.9, 0.2, -0.3]), dim=0),
    )
    half = normalize(spot - view, dim=0)
    normals = normalize(half + 0.5 * torch.randn(4000, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    views = view.expand_as(normals)
    skins, nails = (sky.specular(normals, views, lobes(torch.full((4000,), nail)))[:, 0, 0] for nail in (0.0, 1.0))
    for gloss in (skins, nails):
        assert float((normals[gloss.argmax()] * half).sum()) > np.cos(0.12)
    assert nails.max() > 1.5 * skins.max()
    off = (normals @ half) < np.cos(0.4)
    assert nails[off].mean() < skins[off].mean()


def test_nails_change_the_tight_lobe_alone():
    sky = PrefilteredEnvironment.of(Sky(np.random.default_rng(1).uniform(0, 1, (8, 16, 3))), "cpu")
    normal, view = some_pixels(20)
    skin, nail = (sky.specular(normal, view, lobes(torch.full((20,), share))) for share in (0.0, 1.0))
    assert torch.equal(skin[:, 1], nail[:, 1])
    assert not torch.allclose(skin[:, 0], nail[:, 0], rtol=0.05)


def test_the_map_has_no_seams():
    """Mirrored views a hair apart are as bright as each other, wherever they point."""
    sky = PrefilteredEnvironment.of(Sky(np.random.default_rng(2).uniform(0, 1, (32, 64, 3))), "cpu")
    normal = torch.cat([everywhere(20000), *(torch.eye(3) * sign for sign in (1, -1))])
    beside = normalize(normal + 1e-4 * torch.randn(normal.shape, generator=torch.Generator().manual_seed(3)), dim=-1)
    for view in (-normal, -normalize(normal + 0.5 * normal.roll(1, 1), dim=-1)):
        here, there = (sky.specular(one, view, on_skin(len(normal))) for one in (normal, beside))
        assert (here - there).abs().max() < 2e-3 * here.mean()


def test_what_is_turned_about_the_vertical_with_its_sky_looks_the_same():
    radiance = np.random.default_rng(4).uniform(0, 1, (16, 32, 3))
    normal, view = some_pixels(50)
    turned = [torch.stack([values[:, 1], -values[:, 0], values[:, 2]], -1) for values in (normal, view)]
    # Columns run clockwise seen from above: a quarter of them is a quarter turn to the right.
    before, after = (PrefilteredEnvironment.of(Sky(sky), "cpu") for sky in (radiance, np.roll(radiance, 8, 1)))
    of_both = [sky.specular(*pixels, on_skin(50)) for sky, pixels in ((after, turned), (before, (normal, view)))]
    torch.testing.assert_close(*of_both, rtol=0.03, atol=1e-4)


def test_a_fine_sky_counts_as_the_mean_of_its_cells():
    coarse = np.random.default_rng(5).uniform(0, 1, (32, 64, 3))
    fine = np.repeat(np.repeat(coarse, 3, 0), 3, 1)
    ours, theirs = (PrefilteredEnvironment.of(Sky(sky), "cpu").radiance for sky in (fine, coarse))
    torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-6)
    noise = np.random.default_rng(6).uniform(0, 1, (50, 90, 3))
    odd = PrefilteredEnvironment.of(Sky(noise), "cpu").radiance
    assert float(odd.mean()) == pytest.approx(0.5, abs=0.02)


def test_black_and_missing_skies_shed_nothing_and_extremes_stay_finite():
    normal = torch.cat([UP, UP, UP, torch.tensor([[1.0, 0, 0]])])
    view = torch.cat([UP, -UP, torch.tensor([[1.0, 0, 0], [0, 0, -1.0]])])
    for sky in (None, Sky(np.zeros((4, 8, 3)))):
        assert PrefilteredEnvironment.of(sky, "cpu").specular(normal, view, on_skin(4)).abs().max() == 0
    bright = PrefilteredEnvironment.of(Sky(np.full((2, 3, 3), 1e6)), "cpu")
    for squared in (0.0, 1e-4, 1.0):
        assert bright.specular(normal, view, torch.full((4, 2), squared)).isfinite().all()


def test_normals_get_no_gradients():
    sky, normal = PrefilteredEnvironment.of(Sky(np.ones((2, 4, 3))), "cpu"), UP.clone().requires_grad_()
    assert not sky.specular(normal, -UP, on_skin(1)).requires_grad


def test_mixed_skies_are_the_weighted_sum():
    skies = tuple(SkySamples.of(Sky(np.random.default_rng(k).uniform(0, 1, (4, 8, 3))), "cpu") for k in range(2))
    weights = torch.tensor([[1.0, 2, 3], [0.5, 0, 0.25]])
    found, (normal, view) = SkySamples.mixed(skies, weights), some_pixels(10)
    skin = on_skin(10)
    parts = [sky.mirrored.specular(normal, view, skin) * weight for sky, weight in zip(skies, weights, strict=True)]
    torch.testing.assert_close(found.mirrored.specular(normal, view, skin), sum(parts))
    torch.testing.assert_close(found.flux, sum(sky.flux * weight for sky, weight in zip(skies, weights, strict=True)))
