"""The light of a film is found from how a hand is shaded in it."""

import numpy as np
import pytest
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.commands.reenact.film_light import ShadedHand, light_of, shaded_hand, sky_parts
from livehand.backend.geometry.framing import fitting_camera
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.frame import DEPTH_BACKGROUND, Frame
from livehand.backend.records.light import Light, Sky
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer

SIZE = 40


def shaded_by(weights, seed=0, beside=0.0):
    """A sphere's pixels in each part of the sky, unshadowed, and in the weighted sum; a share shows something else."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(900, 3))
    normals[:, 1] = -np.abs(normals[:, 1])  # those that the camera sees
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    parts = []
    for part in sky_parts():
        cosine = np.maximum(np.einsum("nc,hwc->nhw", normals, part.sky.directions), 0)
        parts.append(np.einsum("nhw,hw,hw->n", cosine, part.sky.radiance[..., 0], part.sky.solid_angles))
    table = np.stack(parts, 1)
    real = table @ weights
    real = np.where(rng.random(900) < beside, 3 * real.max(), real)
    return ShadedHand(real / table[:, 0], table / table[:, :1])


def radiance_of(weights):
    return sum(weight * part.sky.radiance for weight, part in zip(weights, sky_parts(), strict=True))


@pytest.mark.parametrize("beside", [0.0, 0.15])
def test_a_lamp_at_one_side_is_found_there(beside):
    weights = np.r_[0.3, np.zeros(12)]
    lit = int(np.argmax([np.sum(part.sky.radiance * part.sky.directions * [1, -1, 0]) for part in sky_parts()]))
    weights[lit] = 2.0
    found, wanted = light_of([shaded_by(weights, beside=beside)]), radiance_of(weights)
    towards = np.array([0.6, -0.8, 0])
    turned = np.abs(irradiance(found.sky.radiance) - irradiance(wanted)) / irradiance(wanted)
    assert turned.max() < (0.06 if beside == 0 else 0.15)
    assert brightest(found.sky.radiance) @ brightest(wanted) > 0.95
    assert brightest(wanted) @ towards > 0.7
    assert found.sky.radiance.min() >= 0


def irradiance(radiance):
    """Of [100] points that the camera sees."""
    normals = np.random.default_rng(9).normal(size=(100, 3))
    normals[:, 1] = -np.abs(normals[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sky = Sky(radiance)
    cosine = np.maximum(np.einsum("nc,hwc->nhw", normals, sky.directions), 0)
    return np.einsum("nhw,hw,hw->n", cosine, radiance[..., 0], sky.solid_angles)


def brightest(radiance):
    sky = Sky(radiance)
    return sky.directions.reshape(-1, 3)[radiance[..., 0].argmax()]


def test_even_light_is_even():
    found = light_of([shaded_by(np.r_[0.7, np.zeros(12)])])
    np.testing.assert_allclose(found.sky.radiance, 0.7, atol=0.02)
    assert light_of([]) is None


def test_only_what_the_film_shows_of_the_hand_counts():
    alpha = np.zeros((SIZE, SIZE), np.float32)
    alpha[5:35, 5:35] = 1
    frame = Frame(alpha[..., None].repeat(3, -1), alpha, np.where(alpha > 0, 0.5, DEPTH_BACKGROUND))
    shown = np.zeros((SIZE, SIZE), bool)
    shown[:, :20] = True
    picture = np.where(shown[..., None], 0.25, 9.0).repeat(3, -1)
    hand = shaded_hand([frame] * 13, picture, shown)
    np.testing.assert_allclose(hand.real, 0.25, rtol=1e-5)
    np.testing.assert_allclose(hand.parts, 1, rtol=1e-5)
    assert len(hand.real) == (20 - 5 - 4) * 26
    assert shaded_hand([frame] * 13, picture, np.zeros((SIZE, SIZE), bool)) is None


@pytest.mark.slow
def test_frames_are_linear_in_the_parts_of_their_light():
    hand = load_default_hand()
    renderer = Renderer(load_avatar(shipped_avatar_path("light")), hand)
    pose = HandPose.rest()
    vertices = posed_vertices(hand, pose)
    camera = fitting_camera(vertices, (0.0, -1.0, 0.0), (96, 96), 0.9)
    even, first, *_ = sky_parts()
    both = Light((), Sky(0.4 * even.sky.radiance + 2 * first.sky.radiance))
    one, other, sum_of = (renderer.render(Shot(pose, vertices, camera, light)).rgb for light in (even, first, both))
    assert np.quantile(np.abs(0.4 * one + 2 * other - sum_of), 0.998) < 0.02 * sum_of.max()
