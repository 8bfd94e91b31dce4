from math import pi

import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.light import Lamp, Light, MeasuredLight, Sky, rotation_facing, sky_directions


@pytest.mark.parametrize("towards", [(0, 0, 1), (0, 0, -1), (0.6, 0, 0.8), (0, -1, 0)])
def test_a_lamp_that_faces_shines_back(towards):
    rotation = rotation_facing(np.array(towards, float))
    assert Lamp("sun", np.ones(3), rotation=rotation).direction == pytest.approx(-np.array(towards))
    assert np.linalg.det(rotation) == pytest.approx(1)


@pytest.mark.parametrize(
    ("light", "is_dark"),
    [
        (Light(), True),
        (Light((Lamp("sun", np.zeros(3)),), Sky(np.zeros((1, 2, 3)))), True),
        (Light((Lamp("sun", np.zeros(3)), Lamp("point", np.array([0, 0, 0.1])))), False),
        (Light(sky=Sky(np.full((1, 2, 3), 0.1))), False),
    ],
)
def test_a_light_is_dark_if_nothing_shines(light, is_dark):
    assert light.is_dark == is_dark


def test_texels_cover_the_sphere_once():
    sky = Sky(np.ones((8, 16, 3)))
    assert sky.solid_angles.sum() == pytest.approx(4 * pi)
    assert np.linalg.norm(sky.directions, axis=-1) == pytest.approx(1)
    assert (sky.solid_angles[..., None] * sky.directions).sum((0, 1)) == pytest.approx(0, abs=1e-12)


def test_the_centre_is_x_and_columns_run_clockwise():
    directions = sky_directions(101, 400)
    assert directions[0, 0][2] > 0.99  # the top row is up
    assert directions[50, 199:201].mean(0) == pytest.approx([1, 0, 0], abs=1e-3)
    assert directions[50, 299:301].mean(0) == pytest.approx([0, -1, 0], abs=1e-3)


def test_groups_divide_the_light():
    lamps = (Lamp("sun", np.ones(3), group="key"), Lamp("point", np.ones(3)), Lamp("sun", np.ones(3), group="key"))
    light = Light(lamps, Sky(np.ones((2, 4, 3)), "sky"), np.zeros((5, 3, 3)))
    assert light.groups == ("key", "", "sky")
    parts = [light.of_group(name) for name in light.groups]
    assert [len(part.lamps) for part in parts] == [2, 1, 0]
    assert [part.sky is not None for part in parts] == [False, False, True]
    assert all(len(part.occluders) == 5 for part in parts)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Lamp("sun", np.array([1, np.nan, 1])), "finite"),
        (lambda: Lamp("sun", np.array([1, -1, 1])), "negative"),
        (lambda: Lamp("sun", np.ones(3), rotation=2 * np.eye(3)), "rotation"),
        (lambda: Lamp("point", np.ones(3), radius_m=-1.0), "sizes"),
        (lambda: Sky(np.ones((4, 8))), r"\[H, W, 3\]"),
        (lambda: Sky(np.full((4, 8, 3), np.inf)), "finite"),
        (lambda: MeasuredLight(np.zeros((2, 3, 3)), np.zeros((2, 3, 3)), np.zeros(6)), "alpha"),
        (lambda: MeasuredLight(np.zeros((2, 3)), np.zeros((2, 3, 3)), np.zeros((2, 3))), "direct"),
        (lambda: MeasuredLight(np.zeros((2, 3, 3)), np.full((2, 3, 3), np.nan), np.zeros((2, 3))), "indirect"),
        (lambda: Light(occluders=np.zeros((4, 3))), "triangles"),
        (lambda: Light(occluders=np.full((1, 3, 3), np.nan)), "finite"),
    ],
)
def test_what_cannot_be_light_is_refused(make, message):
    with pytest.raises(LiveHandError, match=message):
        make()
