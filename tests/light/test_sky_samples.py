"""Sampled skies against closed forms of the irradiance, and their bright parts."""

from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.light.samples import LightSamples
from livehand.backend.light.shadow_maps import Bounds
from livehand.backend.light.sky_samples import SKY_DIRECTIONS, UNDIVIDED, SkySamples, division_of
from livehand.backend.records.light import Light, Sky, sky_directions

BOUNDS = Bounds(torch.zeros(3), torch.tensor(0.1))


@pytest.mark.parametrize("normal", [(0.0, 0, 1), (1.0, 0, 0), (-0.6, 0.8, 0), (0.5, 0.5, -0.7071)])
def test_a_sky_gives_its_irradiance_to_every_normal(normal):
    """A gradient in z: L = 1 + z; irradiance pi + (2 pi / 3) n_z."""
    directions = sky_directions(32, 64)
    samples = SkySamples.of(Sky((1 + directions[..., 2:]) * np.ones(3)), "cpu")
    assert len(samples.towards) == SKY_DIRECTIONS
    found = pi * (samples.flux * (samples.towards @ torch.tensor(normal)).clamp(min=0)[:, None]).sum(0)
    assert found.tolist() == pytest.approx([pi + 2 * pi / 3 * normal[2]] * 3, rel=0.02)


def window(half_angle=0.25, background=0.02):
    """A disc of radiance 1 around +X in a dim sky."""
    is_bright = sky_directions(64, 128) @ (1.0, 0, 0) > np.cos(half_angle)
    return Sky(np.where(is_bright, 1.0, background)[..., None] * np.array([1.0, 0.8, 0.6]))


def test_bright_cells_of_a_sky_are_divided_and_nothing_of_it_is_lost():
    whole = SkySamples.of(window(), "cpu")
    counts = []
    for shadow_quality in ("none", "coarse", "fine"):
        division = division_of((window(),), shadow_quality)
        divided = SkySamples.of(window(), "cpu", division)
        is_whole = torch.tensor(division) == SKY_DIRECTIONS
        counts.append(len(divided.towards))
        torch.testing.assert_close(divided.flux[:SKY_DIRECTIONS][is_whole], whole.flux[is_whole])
        assert divided.flux[:SKY_DIRECTIONS][~is_whole].abs().sum() == 0
        assert (divided.share[:SKY_DIRECTIONS] == torch.where(is_whole, 1 / SKY_DIRECTIONS, 0)).all()
        assert (divided.share[SKY_DIRECTIONS:] > 0).all()
        torch.testing.assert_close(divided.share.sum(), torch.tensor(1.0))
        torch.testing.assert_close(divided.flux.sum(0), whole.flux.sum(0))
        torch.testing.assert_close(divided.brightness.sum() * divided.brightest, 16 * whole.flux.mean(1).sum())
    assert counts[0] == SKY_DIRECTIONS < counts[1] < counts[2] < 3 * SKY_DIRECTIONS


def test_parts_are_as_bright_as_the_sky_there():
    """Within the window every part has its radiance, for its share is of the same texels; whole cells but of some."""
    division = division_of((window(0.6),), "fine")
    sky = SkySamples.of(window(0.6), "cpu", division)
    is_within = sky.towards[:, 0] > np.cos(0.45)
    radiance = sky.flux / sky.share.clamp(min=1e-6)[:, None] / 4
    inside = radiance[SKY_DIRECTIONS:][is_within[SKY_DIRECTIONS:]]
    assert len(inside) > 12
    assert (inside.mean(0) / torch.tensor([1.0, 0.8, 0.6]) - 1).abs().max() < 0.05
    assert sky.brightest == pytest.approx(0.8, rel=0.35)


@pytest.mark.parametrize("rows", [2, 5, 32, 64])
def test_an_even_sky_is_not_divided(rows):
    """However few texels it has: a texel is not a bright direction."""
    sky = Sky(np.ones((rows, 2 * rows, 3)))
    even = SkySamples.of(sky, "cpu")
    assert division_of((sky,), "fine") == division_of((None,), "fine") == division_of((sky, None), "fine") == UNDIVIDED
    assert even.brightest == pytest.approx(1, rel=0.2)
    assert len(LightSamples.of(Light(sky=window(), shadow_quality="none"), BOUNDS).sky.share) == SKY_DIRECTIONS
