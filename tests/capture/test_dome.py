"""The dome as a map: means of texels, by closed forms."""

import numpy as np
from livehand.backend.capture.dome import GROUND, KEY, LOBES, SKY_SIZE, ZENITH, dome_sky, fine_directions, sky_of


def test_its_flux_is_that_of_its_parts():
    """A lobe of exponent e and radiance L sends 2 pi L / (e + 1), and the gradient its mean."""
    sky = dome_sky()
    assert sky.radiance.shape == (SKY_SIZE[1], SKY_SIZE[0], 3)
    lobes = sum(2 * np.pi / (lobe.exponent + 1) * np.array(lobe.radiance) for lobe in LOBES)
    expected = lobes + 2 * np.pi * (np.array(GROUND) + np.array(ZENITH))
    np.testing.assert_allclose((sky.radiance * sky.solid_angles[..., None]).sum((0, 1)), expected, rtol=2e-3)


def test_the_key_stands_where_it_should():
    sky = dome_sky()
    brightest = sky.directions.reshape(-1, 3)[sky.radiance[..., 0].argmax()]
    assert brightest @ np.array(KEY.towards) / np.linalg.norm(KEY.towards) > np.cos(np.deg2rad(5))


def test_a_texel_is_the_mean_over_its_solid_angle():
    height = fine_directions()[..., 2:]
    sky = sky_of(np.repeat(height + 1, 3, -1))
    edges = np.cos(np.arange(SKY_SIZE[1] + 1) * np.pi / SKY_SIZE[1])
    np.testing.assert_allclose(sky.radiance[:, 5, 1], 1 + (edges[1:] + edges[:-1]) / 2, atol=2e-3)
    np.testing.assert_array_equal(sky.radiance, sky.radiance.astype(np.float16))
