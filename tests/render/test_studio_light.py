"""A photographer's light: a key from the upper left of the camera, and a dim sky."""

import numpy as np
from livehand.backend.render.studio_light import studio_light


def test_the_key_shines_at_the_origin_from_the_upper_left_of_the_camera():
    (key,) = studio_light().lamps
    right, up, towards_camera = np.eye(3)[0], np.eye(3)[2], -np.eye(3)[1]
    assert key.position @ right < 0 < key.position @ up
    assert key.position @ towards_camera > 0
    shines = -key.rotation[:, 2]  # along its own -Z
    np.testing.assert_allclose(shines, -key.position / np.linalg.norm(key.position), atol=1e-12)


def test_the_sky_is_even_and_dim():
    light = studio_light()
    assert np.ptp(light.sky.radiance) == 0
    (key,) = light.lamps
    irradiance = key.rgb[0] / np.pi / (key.position @ key.position)  # of a Lambertian emitter, at the origin
    assert 4 < irradiance / (np.pi * light.sky.radiance.mean()) < 10
