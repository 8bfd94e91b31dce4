"""Pairs of round lobes against the lobes they stand for: how much they reflect, from where, and how wide they are."""

from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.light.brdf import (
    AHEAD,
    COSINES,
    FACES_TURN,
    LEAST_ROUGHNESS,
    ROUGHNESSES,
    SHARE,
    UP,
    WIDTH,
    WIDTHS,
    ggx,
    hidden_bumps,
    isotropic_lobes,
    isotropic_weight,
    lobes_at,
    share_above,
)

pytestmark = pytest.mark.slow

DIRECTIONS = 200000
TABLE = torch.as_tensor(isotropic_lobes())
CASES = [(alpha, cosine) for alpha in (0.09, 0.3025, 0.6) for cosine in (0.1, 0.3, 0.6, 0.95)]


def everywhere():
    """Directions of equal solid angle (Fibonacci)."""
    index = torch.arange(DIRECTIONS, dtype=torch.float64)
    z, angle = 1 - 2 * (index + 0.5) / DIRECTIONS, index * pi * (3 - 5**0.5)
    across = (1 - z * z).sqrt()
    return torch.stack([across * angle.cos(), across * angle.sin(), z], -1).float()


def lobe(alpha, cosine):
    """[N] what a lobe reflects of each direction's light of 1; the eye's plane is x, z."""
    view = torch.tensor([(1 - cosine**2) ** 0.5, 0, -cosine])
    up, squared = torch.tensor([0.0, 0, 1]), torch.tensor(alpha**2)
    light = ggx(up, everywhere(), view, torch.zeros(()), broad_squared=squared, hidden=hidden_bumps(squared))
    return light[:, 1] * 4 / DIRECTIONS


def pair(alpha, cosine):
    return lobes_at(torch.tensor([cosine]), torch.tensor([alpha**2]), TABLE)[0]


def rounds(alpha, cosine):
    """[N] the same of its pair of round lobes."""
    towards, light = everywhere(), torch.zeros(DIRECTIONS)
    for one in pair(alpha, cosine):
        along = towards @ torch.tensor([one[AHEAD], 0, one[UP]])
        narrow = min(int(one[WIDTH]), len(WIDTHS) - 2)
        for place, share in ((narrow, 1 - one[WIDTH] + narrow), (narrow + 1, one[WIDTH] - narrow)):
            weight = isotropic_weight(along, WIDTHS[place])
            light += one[SHARE] * share * weight / weight.sum()
    return light


@pytest.mark.parametrize(("alpha", "cosine"), CASES)
def test_they_reflect_as_much_of_even_light(alpha, cosine):
    """Where bumps face light along the surface, sums over so few half vectors are coarser."""
    assert float(pair(alpha, cosine)[:, SHARE].sum()) == pytest.approx(float(lobe(alpha, cosine).sum()), rel=0.05)


@pytest.mark.parametrize(("alpha", "cosine"), CASES)
def test_their_light_comes_from_where_the_lobes_does(alpha, cosine):
    """The mean direction, and how far from it along the plane and across."""
    theirs, ours = (
        (light := one / one.sum(), light @ everywhere()) for one in (lobe(alpha, cosine), rounds(alpha, cosine))
    )
    middle = theirs[1] / theirs[1].norm()
    assert float(ours[1] @ middle / ours[1].norm()) > np.cos(0.12)
    upward = torch.stack([-middle[2], torch.zeros(()), middle[0]])
    for axis in (upward, torch.tensor([0.0, 1, 0])):
        expected, found = (float(light @ (everywhere() @ axis) ** 2) for light, _ in (theirs, ours))
        assert found**0.5 == pytest.approx(expected**0.5, rel=0.2, abs=0.02)


@pytest.mark.parametrize(("alpha", "cosine"), CASES)
def test_smooth_light_is_reflected_as_by_the_lobe(alpha, cosine):
    """From lamps of some width all around; the mirrored view alone would be off by half, seen from the side."""
    generator = torch.Generator().manual_seed(1)
    lamps = torch.nn.functional.normalize(torch.randn(100, 3, generator=generator), dim=-1)
    light = torch.exp(6 * (lamps @ everywhere().T - 1))
    exact, found = (light @ one for one in (lobe(alpha, cosine), rounds(alpha, cosine)))
    assert float((found - exact).norm() / exact.norm()) < 0.14


def test_a_lobe_seen_straight_on_is_round():
    for rough in range(ROUGHNESSES):
        first, second = TABLE[rough, 0]
        torch.testing.assert_close(first, second, rtol=0.02, atol=0.02)
        torch.testing.assert_close(first[[AHEAD, UP]], torch.tensor([0.0, 1]), rtol=0, atol=0.02)


def test_between_its_places_the_table_is_mixed():
    step = (1 - LEAST_ROUGHNESS) / (ROUGHNESSES - 1)
    rough = LEAST_ROUGHNESS + step * torch.tensor([0.0, 2, 2.5, ROUGHNESSES - 1, ROUGHNESSES + 5])
    column = torch.tensor([0.0, 10.5, 10, COSINES - 1, 2 * COSINES])
    found = lobes_at(1 - (column / (COSINES - 1)) ** 2, rough**4, TABLE)
    expected = torch.stack(
        [
            TABLE[0, 0],
            (TABLE[2, 10] + TABLE[2, 11]) / 2,
            (TABLE[2, 10] + TABLE[3, 10]) / 2,
            TABLE[-1, -1],
            TABLE[-1, -1],
        ]
    )
    torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-3)
    assert TABLE.isfinite().all()


UP_TO_LIGHT = torch.tensor([0.0, 0, 1])


def at_once_and_one_by_one(variance, to_light, to_eye):
    """What bumps of Gaussian slopes mirror of light from before the eye: hidden in a pixel, and their mean."""
    squared, nothing = 0.07, torch.zeros(())
    towards, view = (torch.tensor([(1 - cosine**2) ** 0.5, 0, cosine]) for cosine in (to_light, to_eye))
    view = view * torch.tensor([1.0, 1, -1])
    slopes = torch.linspace(-4, 4, 81) * (variance / 2) ** 0.5
    u, v = torch.meshgrid(slopes, slopes, indexing="ij")
    normal = torch.nn.functional.normalize(torch.stack([-u, -v, torch.ones_like(u)], -1), dim=-1).reshape(-1, 3)
    often = torch.exp(-(u * u + v * v) / variance).flatten()
    one_by_one = ggx(normal, towards, view, nothing, broad_squared=torch.tensor(squared))[:, 1]
    # The surface faces the light, so that nothing but the bumps decides.
    hidden = {"broad_squared": torch.tensor(squared + variance), "hidden": torch.tensor(variance)}
    at_once = ggx(UP_TO_LIGHT, towards, view, nothing, **hidden, surface_normal=towards)[1]
    return float(at_once), float((often * one_by_one).sum() / often.sum())


@pytest.mark.parametrize("variance", [0.02, 0.04, 0.08])
@pytest.mark.parametrize(("to_light", "to_eye"), [(0.2, 0.7), (0.1, 0.7), (0.4, 0.4), (0.8, 0.8), (0.2, 0.3)])
def test_hidden_bumps_mirror_as_much_as_bumps_one_by_one(variance, to_light, to_eye):
    """Flat and rougher, they would be half as bright at worst."""
    at_once, one_by_one = at_once_and_one_by_one(variance, to_light, to_eye)
    assert at_once == pytest.approx(one_by_one, rel=0.25)


@pytest.mark.parametrize("variance", [0.02, 0.04, 0.08])
@pytest.mark.parametrize(("to_light", "to_eye"), [(0.02, 0.7), (0.02, 0.4), (-0.03, 0.7), (-0.03, 0.4)])
def test_some_bumps_are_lit_where_their_mean_is_not(variance, to_light, to_eye):
    """If all were lit as their mean is, light would begin with a step: pixels beside would be dotted."""
    at_once, one_by_one = at_once_and_one_by_one(variance, to_light, to_eye)
    assert at_once == pytest.approx(one_by_one, rel=0.35)


@pytest.mark.parametrize("radius_rad", [0.0, 0.01, 0.2])
def test_a_light_rises_over_its_disc_and_over_faces_that_turn(radius_rad):
    """As often as it stands above them are faces lit, which turn by any angle between."""
    cosines = torch.linspace(-0.4, 0.4, 33)
    reach = FACES_TURN + radius_rad
    turned = torch.linspace(-reach, reach, 20001)
    lit = (cosines[:, None] + turned > 0).float().mean(1)
    torch.testing.assert_close(share_above(cosines, torch.tensor(radius_rad)), lit, rtol=0, atol=1e-4)


def test_no_bump_is_lit_from_below_the_surface():
    """What faces the light beyond the edge of the surface's own shadow lies in it."""
    towards, view, bent = torch.eye(3)[0], -torch.eye(3)[2], torch.tensor([0.6, 0.0, 0.8])
    away = torch.tensor([-0.1, 0.0, 0.99])
    given = bent, towards, view, torch.zeros(()), None, torch.tensor(0.1), torch.tensor(0.03)
    assert float(ggx(*given)[1]) > 0.01
    assert ggx(*given, surface_normal=away).tolist() == [0, 0]
