"""Grain and sharpness are measured and given to renders."""

import numpy as np
import pytest
from livehand.backend.commands.reenact.film_texture import FilmTexture, blur_of, blurred, grain_of
from livehand.backend.records.frame import Frame

ROWS, COLUMNS = 120, 160


def skin(seed=0):
    """A picture uint8 with detail of all sizes."""
    rng = np.random.default_rng(seed)
    white = rng.normal(size=(3, ROWS, COLUMNS, 3)).astype(np.float32)
    values = sum(8 * size * blurred(one, size) for one, size in zip(white, (0.6, 2.0, 6.0), strict=True))
    return np.clip(128 + values, 0, 255).astype(np.uint8)


def test_a_blur_keeps_the_mean_and_has_its_deviation():
    point = np.zeros((41, 41), np.float32)
    point[20, 20] = 1
    spread = blurred(point, 2.0)
    across = np.arange(41) - 20
    assert spread.sum() == pytest.approx(1, abs=1e-5)
    assert np.sqrt((spread.sum(0) * across**2).sum()) == pytest.approx(2.0, abs=0.05)
    np.testing.assert_allclose(blurred(np.full((9, 7, 2), 3.0, np.float32), 1.5), 3.0, rtol=1e-5)


@pytest.mark.parametrize("coarse_px", [0.0, 1.0])
def test_grain_is_found_in_what_the_hand_does_not_cover(coarse_px):
    rng, covered = np.random.default_rng(1), np.zeros((ROWS, COLUMNS), bool)
    covered[30:90, 40:120] = True
    pairs = []
    for _ in range(3):
        frames = []
        for _ in range(2):
            noise = rng.normal(size=(ROWS, COLUMNS, 3)).astype(np.float32)
            noise = blurred(noise, coarse_px) if coarse_px else noise
            grained = skin() + 4 * noise / noise.std()
            grained[covered] += rng.normal(0, 30)
            frames.append(np.clip(np.rint(grained), 0, 255).astype(np.uint8))
        pairs.append(tuple(frames))
    grain, grain_px = grain_of(pairs, [covered] * 3)
    np.testing.assert_allclose(grain, 4, rtol=0.15)
    assert grain_px == pytest.approx(coarse_px, abs=0.25)


@pytest.mark.parametrize("blur_px", [0.0, 0.9, 2.2])
def test_a_render_gets_as_soft_as_the_film(blur_px):
    def render(softer_px):
        return blurred(skin().astype(np.float32), softer_px) if softer_px else skin()

    is_hand = np.zeros((ROWS, COLUMNS), bool)
    is_hand[20:100, 20:140] = True
    film = blurred(skin(1).astype(np.float32), blur_px) if blur_px else skin(1)  # of other skin
    assert blur_of(render, film, is_hand) == blur_px
    assert blur_of(render, film, np.zeros_like(is_hand)) is None


def test_grain_lies_on_the_avatar_alone():
    share = np.zeros((ROWS, COLUMNS), np.float32)
    share[:, 80:] = 1
    flat = np.full((ROWS, COLUMNS, 3), 100, np.uint8)
    shown = FilmTexture(0.0, np.array([2.0, 4, 6]), 0.8).grained(flat, share, seed=3)
    np.testing.assert_array_equal(shown[:, :80], 100)
    np.testing.assert_allclose(shown[:, 80:].reshape(-1, 3).astype(float).std(0), [2, 4, 6], rtol=0.08)
    np.testing.assert_array_equal(FilmTexture().grained(flat, share, 0), flat)


def test_a_softened_frame_keeps_its_light():
    alpha = np.zeros((40, 40), np.float32)
    alpha[10:30, 10:30] = 1
    frame = Frame(alpha[..., None] * np.array([0.5, 0.3, 0.2], np.float32), alpha, alpha)
    soft = FilmTexture(1.6).softened(frame)
    assert soft.rgb.sum() == pytest.approx(frame.rgb.sum(), rel=1e-4)
    assert 0.3 < soft.alpha[10, 20] < 0.7
    assert FilmTexture().softened(frame) is frame
