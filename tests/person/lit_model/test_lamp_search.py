"""A lamp beside the sky is found where it stands; a sky alone has none."""

import numpy as np
import pytest
from livehand.backend.person.lit_model.illumination import Illumination, fitted_light, lit_pixels
from livehand.backend.person.lit_model.lamp_search import with_lamp
from livehand.backend.person.lit_model.numbers import PixelTones
from livehand.backend.records.light import Lamp, Light, Sky, rotation_facing, sky_directions
from livehand.tests.person.conftest import middle_person, pictured

pytest.importorskip("cv2")
pytestmark = pytest.mark.slow
EVEN = Sky(np.full((4, 8, 3), 0.08))
TOWARDS = np.array([0.4, 0.8, 0.45]) / np.linalg.norm([0.4, 0.8, 0.45])


@pytest.fixture(scope="module")
def base():
    return middle_person()


def tones_in(base, light):
    pixels = lit_pixels(base, pictured(base, light, 2).pictures)
    return PixelTones(pixels, np.zeros_like(pixels.shown), np.zeros_like(pixels.shown))


def test_a_lamp_is_found_where_it_stands(base):
    lamp = Lamp("area", np.full(3, 2.0), 0.8 * TOWARDS, rotation_facing(TOWARDS), size_m=(0.2, 0.2))
    tones = with_lamp(base, tones_in(base, Light((lamp,), EVEN)), 0.42)
    (found,) = tones.pixels.sources[-1].lamps
    pose = tones.pixels.parts[0].picture.pose
    direction = found.position - pose.transl
    wanted = lamp.position - pose.transl
    cosine = direction @ wanted / np.linalg.norm(direction) / np.linalg.norm(wanted)
    assert np.rad2deg(np.arccos(cosine)) < 12
    fit = fitted_light(tones.pixels, np.ones_like(tones.pixels.shown))
    (strong,) = Illumination.of(fit, tones.pixels.sources).stronger(np.log(2), np.ones(3)).lamps
    np.testing.assert_allclose(strong.rgb, 2 * fit.strengths[-1] * found.rgb)


@pytest.mark.nightly
def test_a_sky_alone_has_no_lamp(base):
    up = sky_directions(16, 32)[..., 2:]
    tones = tones_in(base, Light(sky=Sky(np.repeat(0.25 + 0.2 * up.clip(0), 3, 2))))
    assert len(with_lamp(base, tones, 0.42).pixels.sources) == len(tones.pixels.sources)
