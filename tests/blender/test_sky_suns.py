"""Suns taken out of maps of the sky, against closed forms; no Blender scene is needed."""

import numpy as np
import pytest
from livehand.backend.records.light import Sky, sky_directions
from livehand.livehand_blender.light.sky_suns import CloseUp, extract_suns
from livehand.livehand_blender.light.world import smaller_map

SIZE = (256, 512)
ANGLE_RAD = np.deg2rad(9)


def disc_sky(directions, towards, angle_rad, radiance, around):
    inside = directions @ towards > np.cos(angle_rad / 2)
    return np.where(inside[..., None], radiance, around)


def close_up_of(sky, towards, count=192):
    """A pinhole view of a function of directions."""
    z = -towards
    x = np.cross([0.3, 0.2, 1.0], z)
    x /= np.linalg.norm(x)
    axes = np.stack([x, np.cross(z, x), z], 1)
    across = (np.arange(count) + 0.5 - count / 2) * 2 * np.tan(ANGLE_RAD / 2) / count
    u, v = np.meshgrid(across, -across)
    rays = np.stack([u, v, -np.ones_like(u)], -1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return CloseUp(sky(rays @ axes.T), axes, ANGLE_RAD)


def irradiance(radiance, normal):
    sky = Sky(radiance)
    cosine = np.maximum(sky.directions @ normal, 0)
    return (sky.radiance * (sky.solid_angles * cosine)[..., None]).sum((0, 1))


@pytest.mark.parametrize("towards", [(0.3, -0.6, 0.5), (0, 0, 1), (-1, 0.001, 0.02), (0.1, 0.2, -0.9)])
@pytest.mark.parametrize("angle_deg", [0.53, 2.5])
def test_energy_direction_and_angle_of_a_disc(towards, angle_deg):
    towards = np.array(towards) / np.linalg.norm(towards)
    radiance, around = np.array([8e4, 7e4, 5e4]) / angle_deg**2, np.array([0.2, 0.3, 0.5])

    def sky(directions):
        return disc_sky(directions, towards, np.deg2rad(angle_deg), radiance, around)

    aside = towards + 0.01 * np.cross(towards, [0.6, 0.5, 0.4])  # the close-up is not aimed well
    # The map's own rendering of the sun may be anything.
    texels = disc_sky(sky_directions(*SIZE), towards, np.deg2rad(angle_deg + 0.9), radiance * 0.37, around)
    without, (sun,) = extract_suns(texels, [close_up_of(sky, aside / np.linalg.norm(aside))])
    expected = (radiance - around) * np.pi * np.sin(np.deg2rad(angle_deg) / 2) ** 2
    np.testing.assert_allclose(sun.rgb, expected, rtol=0.015)  # one ray a pixel here; Cycles takes several
    assert -sun.direction @ towards > np.cos(np.deg2rad(0.03))
    assert np.rad2deg(sun.angle_rad) == pytest.approx(angle_deg, rel=0.03)
    np.testing.assert_allclose(without, np.broadcast_to(around, without.shape), rtol=1e-6)
    assert sun.casts_shadow


def test_a_lamp_of_ten_degrees_stays_in_the_map():
    towards = np.array([0.0, -0.8, 0.6])

    def sky(directions):
        return disc_sky(directions, towards, np.deg2rad(10), np.full(3, 500.0), np.full(3, 0.1))

    texels = sky(sky_directions(*SIZE))
    without, suns = extract_suns(texels, [close_up_of(sky, towards)])
    assert suns == []
    np.testing.assert_array_equal(without, texels)


def test_a_weak_glint_stays_in_the_map():
    towards = np.array([0.0, -0.8, 0.6])

    def sky(directions):
        return disc_sky(directions, towards, np.deg2rad(0.5), np.full(3, 300.0), np.full(3, 1.0))

    assert extract_suns(sky(sky_directions(*SIZE)), [close_up_of(sky, towards)])[1] == []


def test_two_suns():
    one, other = np.array([0.0, -0.8, 0.6]), np.array([0.6, 0.0, 0.8])

    def sky(directions):
        first = disc_sky(directions, one, np.deg2rad(1), np.array([900.0, 0, 0]), np.full(3, 0.01))
        return first + disc_sky(directions, other, np.deg2rad(1), np.array([0, 0, 900.0]), np.full(3, 0.01))

    close_ups = [close_up_of(sky, one), close_up_of(sky, other)]
    without, suns = extract_suns(sky(sky_directions(*SIZE)), close_ups)
    assert [sun.rgb.argmax() for sun in suns] == [0, 2]
    assert without.max() < 0.1


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 0, 0), (-0.6, 0.64, 0.48)])
def test_a_smaller_map_keeps_the_irradiance(normal):
    x, y, z = np.moveaxis(sky_directions(*SIZE), -1, 0)
    radiance = np.stack([1 + z, np.exp(2 * x), (y > 0.3) * 5.0], -1)
    small = smaller_map(radiance, 32, 64)
    assert small.shape == (32, 64, 3)
    normal = np.array(normal, float)
    np.testing.assert_allclose(irradiance(small, normal), irradiance(radiance, normal), rtol=0.01, atol=0.005)
    np.testing.assert_allclose(
        (small * Sky(small).solid_angles[..., None]).sum((0, 1)),
        (radiance * Sky(radiance).solid_angles[..., None]).sum((0, 1)),
        rtol=1e-9,
    )
