"""The albedo of networks over the atlas: charts meet at their borders, and away from them it is what the field says."""

import numpy as np
import pytest
import torch
from livehand.backend.avatars import network_albedo as module
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.avatars.network_albedo import network_albedo
from livehand.backend.surface.atlas_borders import nearness_to_borders, split_atlas
from livehand.backend.surface.atlas_texels import AtlasTexels
from livehand.backend.surface.detail_surface import LEVELS

pytestmark = pytest.mark.slow

RESOLUTION = 512


def steps(image, faces, corner_uv):
    """Differences of logarithms between both sides of charts' borders, at the middles of edges that lie on them."""
    sides = np.concatenate([faces[:, pair] for pair in ((0, 1), (1, 2), (2, 0))])
    middle = np.concatenate([corner_uv[:, pair].mean(1) for pair in ((0, 1), (1, 2), (2, 0))])
    order = np.lexsort(np.sort(sides, 1).T)
    first, second = middle[order].reshape(-1, 2, 2).swapaxes(0, 1)
    is_apart = np.abs(first - second).max(1) > 1e-6
    at = [(RESOLUTION * uv[is_apart]).astype(int).clip(0, RESOLUTION - 1) for uv in (first, second)]
    one, other = (np.log(image[place[:, 1], place[:, 0]]) for place in at)
    return np.abs(one - other)


def test_charts_meet_and_away_from_their_borders_it_is_the_fields(hand, monkeypatch):
    avatar = load_avatar(shipped_avatar_path("light"))
    joined = network_albedo(avatar, hand, RESOLUTION)
    monkeypatch.setattr(module, "joined_borders", lambda image, *atlas: image)
    alone = network_albedo(avatar, hand, RESOLUTION)
    faces, corner_uv = split_atlas(hand.f, hand.vt[hand.ft], LEVELS)
    before, after = (steps(image, faces, corner_uv) for image in (alone, joined))
    assert len(before) > 1500
    assert np.median(before) > 0.03
    assert np.median(after) < 0.4 * np.median(before)
    assert np.quantile(after, 0.99) < 0.6 * np.quantile(before, 0.99)
    texels = AtlasTexels.of(torch.as_tensor(corner_uv, dtype=torch.float32), torch.as_tensor(faces), RESOLUTION)
    is_inside = texels.at_texels(nearness_to_borders(faces, corner_uv)[:, None])[:, 0] == 0
    assert 0.6 < is_inside.mean() < 0.95
    np.testing.assert_array_equal(texels.from_map(joined)[is_inside], texels.from_map(alone)[is_inside])
