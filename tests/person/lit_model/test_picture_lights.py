"""The light of each picture: as it differs from its scene's, but for its strength, which exposure and skin explain."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.person.lit_model.illumination import (
    Illumination,
    LitPixels,
    LitStrengths,
    error_of,
    fitted_light,
    lobe_directions,
    pixels_of_scenes,
)
from livehand.backend.person.lit_model.picture_lights import PictureIlluminations, fitted_lights, pixels_of_each
from livehand.backend.records.light import Light, Sky
from livehand.tests.person.conftest import middle_person, pictured

PIXELS = 1200
ABOVE = lobe_directions()[:, 2].clip(0)
BELOW = 0.5 * (-lobe_directions()[:, 2]).clip(0)
SCENE = LitStrengths(ABOVE, np.zeros(3), 0.0)


def even_skin(each):
    """Its albedo is the one that pixels are rendered with."""
    return [np.ones_like(pixels.shown) for pixels in each]


def seen_in(lobes, noise=0.02, exposure=1.0):
    """Pixels of a round hand, as every lobe lights it, in a sum of them."""
    rng = np.random.default_rng(4)
    normals = rng.normal(size=(PIXELS, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    facing = (normals @ lobe_directions().T).clip(0)[:, None]
    diffuse = np.repeat(0.4 * facing, 3, 1)
    shown = exposure * (diffuse @ lobes) * np.exp(rng.normal(0, noise, (PIXELS, 3)))
    lights = (Light(),) * len(lobes)
    return LitPixels(lights, diffuse, np.full_like(diffuse, 1e-4), shown, np.zeros((PIXELS, 2)))


def fitted(*pictures):
    pixels = {(0, str(index)): one for index, one in enumerate(pictures)}
    return fitted_lights({0: pictures[0]}, {0: SCENE}, pixels, even_skin)


def own_lobes(pixels):
    return fitted_light(pixels, np.ones_like(pixels.shown), SCENE).strengths


def test_a_light_that_moves_is_each_pictures_own():
    lights = fitted(seen_in(ABOVE), seen_in(ABOVE + BELOW), seen_in(ABOVE + BELOW, exposure=0.8))
    np.testing.assert_array_equal(lights.of_scene[0].lobes, ABOVE)
    sums = [lights.of_picture[0, name].lobes[lobe_directions()[:, 2] < -0.4].sum() for name in "012"]
    assert sums[0] < 0.1 * sums[1]
    assert sums[2] == pytest.approx(sums[1], rel=0.05)


def test_a_light_that_rests_is_the_scenes():
    """What skin leaves unexplained, here a tenth of noise, is no light's to explain."""
    assert not fitted(*(seen_in(ABOVE, 0.1, exposure) for exposure in (0.8, 1.0, 1.2))).of_picture


def test_errors_are_those_after_the_pictures_gain():
    pixels, ratio = seen_in(ABOVE, 0.1), np.ones((PIXELS, 3))
    brighter = replace(pixels, shown=1.5 * pixels.shown)
    errors = [error_of(SCENE, each, ratio) for each in (pixels, brighter, seen_in(ABOVE + BELOW, 0.1))]
    assert 0.002 < errors[0] < 0.01  # a tenth, squared, and less where pixels are dark
    assert errors[1] == pytest.approx(errors[0], rel=0.1)
    assert errors[2] > 2 * errors[0]


def test_light_from_below_is_the_pictures_own():
    pixels = seen_in(ABOVE + BELOW)
    found = own_lobes(pixels)
    uneven = [np.log((pixels.diffuse @ lobes + 0.02) / (pixels.shown + 0.02)).std() for lobes in (ABOVE, found)]
    assert uneven[1] < uneven[0] / 3
    is_below = lobe_directions()[:, 2] < -0.4
    assert found[is_below].sum() / found.sum() > 0.7 * BELOW[is_below].sum() / (ABOVE + BELOW).sum()


@pytest.mark.parametrize("exposure", [0.7, 1.4])
def test_a_brighter_picture_has_the_light_of_its_scene(exposure):
    """How bright a palm is beside the back of a hand is not the light's to say."""
    np.testing.assert_allclose(own_lobes(seen_in(ABOVE, exposure=exposure)), ABOVE, atol=0.08)
    assert own_lobes(seen_in(ABOVE, exposure=exposure)).sum() == pytest.approx(ABOVE.sum(), rel=0.05)


def test_what_pixels_do_not_tell_is_as_in_the_scene():
    """Two lobes that light the hand alike share as they do there."""
    pixels = seen_in(ABOVE)
    diffuse = pixels.diffuse.copy()
    one, other = np.flatnonzero(ABOVE > 0.5)[:2]
    diffuse[..., other] = diffuse[..., one]
    near = LitStrengths(np.where(np.arange(len(ABOVE)) == one, 3 * ABOVE, ABOVE), np.zeros(3), 0.0)
    alike = replace(pixels, diffuse=diffuse, shown=diffuse @ near.strengths)
    found = fitted_light(alike, np.ones((PIXELS, 3)), near).strengths
    np.testing.assert_allclose(found[[one, other]], near.strengths[[one, other]], rtol=0.02)


def test_the_tint_is_the_scenes():
    warm = LitStrengths(ABOVE, np.array([0.1, 0.0, -0.1]), 0.0)
    fit = fitted_light(seen_in(ABOVE), np.ones((PIXELS, 3)), warm)
    np.testing.assert_array_equal(fit.log_tint, warm.log_tint)


@pytest.fixture(scope="module")
def filmed():
    sky = Light(sky=Sky(np.full((4, 8, 3), 0.3)))
    return pictured(middle_person(), sky, 3).pictures


@pytest.mark.slow
def test_a_picture_has_its_own_light_and_another_that_of_its_scene(filmed):
    of_scene, own = (Illumination(np.full(32, value), np.ones(3)) for value in (0.1, 0.2))
    lights = PictureIlluminations({0: of_scene}, {(0, filmed[1].name): own}).stronger(np.log(2), np.full(3, 0.9))
    for picture, lobe in zip(filmed, (0.2, 0.4, 0.2), strict=True):
        np.testing.assert_allclose(lights.at(picture).lobes, lobe)
        np.testing.assert_allclose(lights.at(picture).tint, 0.9)
    assert lights.at(replace(filmed[1], rgb=filmed[1].rgb + 1)) is lights.of_picture[0, filmed[1].name]


@pytest.mark.slow
def test_pixels_of_every_picture_are_rendered_once_and_a_lone_pictures_not(filmed):
    pytest.importorskip("cv2")
    alone = replace(filmed[2], scene=1)
    pictures = [*filmed[:2], alone]
    of_scenes = pixels_of_scenes(middle_person(), pictures, 1)
    each = pixels_of_each(middle_person(), pictures, of_scenes)
    assert set(each) == {(0, filmed[0].name), (0, filmed[1].name)}
    np.testing.assert_array_equal(each[0, filmed[0].name].diffuse, of_scenes[0].diffuse)
    both = pixels_of_scenes(middle_person(), pictures[:2], 2)[0].by_picture()
    for picture, whole in zip(filmed, both, strict=False):
        own = each[0, picture.name]
        np.testing.assert_array_equal(own.shown, whole.shown)
        np.testing.assert_allclose(own.diffuse, whole.diffuse, rtol=1e-5)
        assert [part.picture.name for part in whole.parts] == [picture.name]
