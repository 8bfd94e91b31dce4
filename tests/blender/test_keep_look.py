"""Keep Look: colours saved through AgX and Filmic to an 8-bit PNG look as Standard shows them."""

import bpy
import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.frame import Frame
from livehand.livehand_blender.render import keep_look
from livehand.livehand_blender.render.keep_look import frame_with_kept_look, kept_look
from PIL import Image

# sRGB levels between deep shade and highlight of skin, nails and palms, light to deep.
SKIN_LEVELS = [(250, 225, 210), (240, 200, 180), (225, 172, 150), (198, 134, 105), (170, 90, 80), (141, 85, 60)]
SKIN_LEVELS += [(90, 52, 38), (60, 35, 26), (30, 16, 12)]


def linear(srgb):
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


@pytest.fixture
def skin():
    """[32, 32, 3] linear: mixtures of skin colours, in more and less light."""
    rng = np.random.default_rng(0)
    mixed = rng.dirichlet(np.ones(len(SKIN_LEVELS)) * 0.3, (32, 32)) @ linear(np.array(SKIN_LEVELS) / 255)
    return np.clip(mixed * np.exp2(rng.uniform(-2, 0.3, (32, 32, 1))), 0, 1)


def shown(rgb, scene, path):
    """[H, W, 3] levels of the PNG that Blender saves in the scene's view; alpha is a half everywhere."""
    alpha = np.full(rgb.shape[:2], 0.5, np.float32)
    frame = Frame((rgb * 0.5).astype(np.float32), alpha, alpha)
    image = bpy.data.images.new("frame", rgb.shape[1], rgb.shape[0], alpha=True, float_buffer=True)
    image.alpha_mode = "PREMUL"
    rgba = np.concatenate([frame.rgb, frame.alpha[..., None]], -1)
    image.pixels.foreach_set(np.ascontiguousarray(rgba[::-1]).ravel())
    scene.render.dither_intensity = 0
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    image.save_render(str(path), scene=scene)
    return np.array(Image.open(path)).astype(int)[..., :3]


def in_view(transform, view_look="None"):
    scene = bpy.context.scene
    scene.view_settings.view_transform, scene.view_settings.look = transform, view_look
    return scene


@pytest.mark.parametrize(
    ("view", "least_change"),
    [(("AgX", "None"), 20), (("Filmic", "None"), 20), (("AgX", "AgX - Medium High Contrast"), 8)],
)
def test_skin_is_shown_as_in_standard(skin, tmp_path, view, least_change):
    expected = shown(skin, in_view("Standard"), tmp_path / "standard.png")
    scene = in_view(*view)
    assert np.abs(shown(skin, scene, tmp_path / "changed.png") - expected).max() > least_change
    assert np.abs(shown(kept_look(skin, scene), scene, tmp_path / "kept.png") - expected).max() <= 1


def test_black_and_white_do_not_change(tmp_path):
    ends = np.array([[[0, 0, 0], [1, 1, 1], [2, 2, 2], [-1, -1, -1]]], np.float64)
    for transform in ("AgX", "Filmic"):
        scene = in_view(transform)
        levels = shown(kept_look(ends, scene), scene, tmp_path / "ends.png")
        assert np.abs(levels[0, :, 0] - [0, 255, 255, 0]).max() <= 1


def test_a_frame_keeps_its_look_through_soft_edges(skin):
    scene = in_view("AgX")
    alpha = np.linspace(0, 1, 32, dtype=np.float32)[None].repeat(32, 0)
    frame = Frame((skin * alpha[..., None]).astype(np.float32), alpha, alpha)
    kept = frame_with_kept_look(frame, scene)
    np.testing.assert_allclose(kept.rgb, kept_look(skin, scene) * alpha[..., None], rtol=1e-4, atol=1e-6)
    assert kept.alpha is alpha
    assert kept.rgb.dtype == np.float32


def test_standard_returns_the_same_colours(skin):
    assert kept_look(skin, in_view("Standard")) is skin


def test_exposure_is_not_inverted(skin):
    scene = in_view("AgX")
    kept = kept_look(skin, scene)
    scene.view_settings.exposure = -1
    np.testing.assert_array_equal(kept_look(skin, scene), kept)


def test_type_and_shape_are_kept(skin):
    kept = kept_look(skin[0].astype(np.float32), in_view("AgX"))
    assert kept.dtype == np.float32
    assert kept.shape == (32, 3)


def test_the_open_file_does_not_change(skin):
    before = [(kind, len(getattr(bpy.data, kind))) for kind in ("images", "scenes", "worlds", "node_groups")]
    keep_look._inverse.cache_clear()
    kept_look(skin, in_view("AgX"))
    assert [(kind, len(getattr(bpy.data, kind))) for kind in ("images", "scenes", "worlds", "node_groups")] == before


def test_a_view_is_solved_once(skin, monkeypatch):
    scene = in_view("AgX")
    kept_look(skin, scene)
    monkeypatch.setattr(keep_look, "_shown", None)
    kept_look(skin, scene)


def test_a_view_without_an_inverse_is_an_error(skin):
    with pytest.raises(LiveHandError, match=r"'False Color' is .* choose Standard, AgX or Filmic"):
        kept_look(skin, in_view("False Color"))
