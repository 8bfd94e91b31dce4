"""The albedo on the mesh: what the field's coefficients are there."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.light.lighting import DIFFUSE, SCATTERED, UNUSED
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.albedo import atlas_albedo, baked_colors, vertex_albedo
from livehand.backend.surface.albedo_ratio import RATIO_ARRAY, RATIO_STEP
from PIL import Image

PLANES = {"width": 8, "planes": ((16, 1, 4),), "relief": 8}


def avatar_of(hand, light, kind):
    config = AvatarConfig(
        FieldConfig(**PLANES, light=light), SuperResConfig(kind=kind, width=4), SamplerConfig(3, 0.003)
    )
    return new_avatar("a", hand.name, hand.sha256, config)


@pytest.mark.slow
def test_albedo_is_diffuse_and_scattered_light_together(hand):
    avatar = avatar_of(hand, "linear", "lit")
    values = torch.tensor([0.1, 0.2, 0.3])
    with torch.no_grad():
        avatar.field.channels.weight.zero_()
        bias = avatar.field.channels.bias
        bias[DIFFUSE] = torch.log(torch.expm1(values))  # the inverse of softplus
        bias[SCATTERED] = torch.log(torch.expm1(values / 4)).repeat(2)
        bias[UNUSED] = 5
    found = vertex_albedo(avatar, hand)
    assert found.shape == hand.v_template.shape
    assert found == pytest.approx(np.tile(1.5 * values.numpy(), (len(found), 1)), rel=1e-4)
    assert vertex_albedo(avatar, hand).mean(0) == pytest.approx([0.15, 0.3, 0.45], rel=1e-4)


def test_albedo_follows_the_atlas(hand):
    """A plane that is bright on one side of the atlas."""
    avatar = avatar_of(hand, "linear", "lit")
    with torch.no_grad():
        for layer in (*avatar.field.trunk, avatar.field.channels):
            layer.weight.zero_()
            layer.bias.zero_()
        table = avatar.field.planes[0].table.zero_()
        table.view(16, 16, 4)[:, 8:, 0] = 1
        avatar.field.trunk[0].weight[0, 0] = avatar.field.trunk[1].weight[0, 0] = 1
        avatar.field.channels.weight[DIFFUSE, 0] = 1
        avatar.field.channels.bias[:] = -3
    found = vertex_albedo(avatar, hand)[:, 0]
    lowest, highest = np.ones(len(found)), np.zeros(len(found))  # on a seam a vertex has several places
    corner_u = hand.vt[hand.ft.ravel()][:, 0]
    np.minimum.at(lowest, hand.f.ravel(), corner_u)
    np.maximum.at(highest, hand.f.ravel(), corner_u)
    assert found[lowest > 0.6].min() > found[highest < 0.4].max()


def test_only_relightable_avatars_have_one(hand):
    with pytest.raises(LiveHandError, match="relightable"):
        vertex_albedo(avatar_of(hand, "baked", "light"), hand)


@pytest.mark.slow
def test_it_is_the_same_every_time(hand):
    """On the atlas' seams vertices have several places, of different colours: always the same one is read."""
    avatar = load_avatar()
    first, *others = (vertex_albedo(avatar, hand) for _ in range(4))
    assert all(np.array_equal(first, other) for other in others)


@pytest.mark.slow
def test_the_atlas_has_the_albedo_of_the_vertices_and_finer_detail(tmp_path):
    hand, path = load_default_hand(), shipped_avatar_path("middle")
    avatar, size = load_avatar(path), 128
    image, at_vertices = atlas_albedo(avatar, hand, size), vertex_albedo(avatar, hand)
    uv = hand.vt[hand.ft].reshape(-1, 2)
    column, row = (uv * size).astype(int).clip(0, size - 1).T
    vertices = at_vertices[hand.f.reshape(-1)]
    assert np.median(np.abs(np.log(image[row, column].clip(1e-3) / vertices.clip(1e-3)))) < 0.08
    assert image.min() >= 0
    assert image.max() <= 1


@pytest.mark.nightly  # builds a surface three times
def test_a_persons_factor_is_in_the_colors_and_their_file_is_made_once(tmp_path):
    hand, path = load_default_hand(), tmp_path / "darker.safetensors"
    avatar = load_avatar(shipped_avatar_path("middle"))
    arrays = {**avatar.surface.arrays, RATIO_ARRAY: np.full((64, 64, 3), -20, np.int8)}
    darker = replace(avatar, surface=replace(avatar.surface, arrays=arrays))
    plain, dark = (atlas_albedo(one, hand, 64) for one in (avatar, darker))
    np.testing.assert_allclose(dark, plain * np.exp(-20 * RATIO_STEP), rtol=1e-3)
    save_avatar(darker, path)
    colors = baked_colors(path, hand, tmp_path / "colors", "right", 64)
    written = colors.stat().st_mtime_ns
    with Image.open(colors) as picture:
        assert picture.size == (64, 64)
    assert baked_colors(path, hand, tmp_path / "colors", "right", 64).stat().st_mtime_ns == written
