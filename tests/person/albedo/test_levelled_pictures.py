"""Light that a picture shows and the model does not is taken out where it is coarse; what is fine stays."""

import numpy as np
import pytest
import torch
from livehand.backend.person.albedo.agreement import TexelSighting, agreed_ratio, levelled
from livehand.backend.surface.atlas_texels import AtlasTexels

SIDE, ATLAS_PX = 40, 80


@pytest.fixture(scope="module")
def sheet():
    """A flat square of 40 x 40 vertices, two texels an edge."""
    rows, columns = np.mgrid[:SIDE, :SIDE]
    uv = torch.as_tensor(np.stack([columns, rows], -1).reshape(-1, 2) / (SIDE - 1), dtype=torch.float32)
    corner = (rows[:-1, :-1] * SIDE + columns[:-1, :-1]).reshape(-1, 1)
    faces = torch.as_tensor(np.concatenate([corner + np.array(each) for each in ((0, 1, SIDE), (1, SIDE + 1, SIDE))]))
    return AtlasTexels.of(uv[faces], faces, ATLAS_PX)


def _sighting(coarse, fine=0.0, weight=1.0):
    ratio = (coarse + fine).astype(np.float32)
    return TexelSighting(np.full(len(ratio), weight, np.float32), ratio, coarse, np.zeros(ratio.shape, bool), 0.0)


def _across(texels):
    return (texels.pixel % ATLAS_PX / ATLAS_PX)[:, None].astype(np.float32)


def test_a_picture_in_another_light_shows_what_the_others_do(sheet):
    count = len(sheet.pixel)
    fine = np.random.default_rng(1).normal(0, 0.1, (count, 3)).astype(np.float32)
    even = np.zeros((count, 3), np.float32)
    shaded = 0.4 * np.cos(2 * np.pi * _across(sheet)) + even
    given = [_sighting(even, fine)] * 4 + [_sighting(shaded, fine)]
    found = levelled(given)
    off = [one.log_ratio.astype(np.float32) - fine for one in found]
    assert np.abs(off[4]).max() < 0.1 * 0.4 + 0.05  # a tenth is left; the agreed level leans to it by .4 / 5 at most
    assert np.abs(off[0] - off[4]).max() < 0.1 * 0.4 + 1e-3
    assert np.abs(off[0]).max() < 0.05


def test_texels_side_by_side_do_not_believe_different_pictures(sheet):
    """Half of the pictures are darker in one light: noise decides which of them a texel alone believes."""
    rng, count = np.random.default_rng(2), len(sheet.pixel)
    even = np.zeros((count, 3), np.float32)
    ramp = (_across(sheet) - 0.5) + even
    fine = [rng.normal(0, 0.08, (count, 3)).astype(np.float32) for _ in range(6)]
    given = [_sighting(sign * ramp, each) for sign, each in zip((1, 1, 1, -1, -1, -1), fine, strict=True)]
    is_edge = np.abs(_across(sheet)[:, 0] - 0.9) < 0.1
    before, after = (agreed_ratio(some, even).mean[is_edge].std() for some in (given, levelled(given)))
    assert before > 0.12
    assert after < 0.08 / np.sqrt(6) + 0.03


def test_what_a_picture_does_not_measure_stays_and_one_alone_is_believed(sheet):
    even = np.zeros((len(sheet.pixel), 3), np.float32)
    clipped = _sighting(even + np.nan)._replace(log_ratio=even + 0.7)
    found = levelled([_sighting(even - 0.2), clipped])
    np.testing.assert_allclose(found[1].log_ratio, 0.7, atol=1e-3)
    alone = levelled([_sighting(even - 0.2, 0.1)])
    np.testing.assert_allclose(alone[0].log_ratio, -0.1, atol=2e-3)
