"""Confidence, reduced to means; and marks of one hand: what is long or large and stands out.

Spots, nails, stains and unsure skin are none.
"""

import numpy as np
import pytest
import torch
from livehand.backend.surface.atlas_masks import confidence_map, marks_map
from livehand.backend.surface.atlas_texels import AtlasTexels

SIZE = 256  # texels of 1.05 mm


@pytest.fixture(scope="module")
def texels():
    corner_uv = torch.tensor([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [[1.0, 1.0], [0.0, 1.0], [1.0, 0.0]]])
    return AtlasTexels.of(corner_uv, torch.tensor([[0, 1, 2], [3, 2, 1]]), SIZE)


def found(texels, image, confidence=1.0, nail=None):
    sure = np.full(len(texels.pixel), confidence, np.float32)
    nail = np.zeros((SIZE, SIZE), np.int8) if nail is None else nail
    return marks_map(texels, texels.from_map(image), sure, nail)


def skin_with(rows, columns, depth=-1.2):
    noise = np.random.default_rng(3).normal(0, 0.05, (SIZE, SIZE, 1))
    image = np.repeat(noise, 3, 2).astype(np.float32)
    image[rows, columns] += depth
    return image


LINE = slice(100, 102), slice(60, 90)


def test_a_tattoos_line_is_a_mark_and_the_skin_around_it_is_none(texels):
    marks = found(texels, skin_with(*LINE))
    assert (marks[LINE] == 255).all()
    assert (marks > 0).sum() < 34 * 8
    assert not marks[:90].any()
    assert not marks[112:].any()


def test_a_pale_scar_is_a_mark_too(texels):
    assert (found(texels, skin_with(*LINE, depth=0.9))[LINE] == 255).all()


def test_a_spot_is_none(texels):
    assert not found(texels, skin_with(slice(100, 102), slice(60, 62))).any()


def test_plain_skin_has_none(texels):
    assert not found(texels, skin_with(slice(0), slice(0))).any()


def test_a_soft_stain_is_none(texels):
    row, column = np.mgrid[:SIZE, :SIZE]
    stain = 0.8 * np.exp(-((row - 120) ** 2 + (column - 120) ** 2) / (2 * 40**2))
    assert not found(texels, skin_with(slice(0), slice(0)) - stain[..., None].astype(np.float32)).any()


def test_nails_and_unsure_skin_have_none(texels):
    nail = np.zeros((SIZE, SIZE), np.int8)
    nail[98:104, 58:92] = 100
    assert not found(texels, skin_with(*LINE), nail=nail).any()
    assert not found(texels, skin_with(*LINE), confidence=0.1).any()


def test_confidence_is_the_mean_over_finer_texels():
    corner_uv = torch.tensor([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [[1.0, 1.0], [0.0, 1.0], [1.0, 0.0]]])
    texels = AtlasTexels.of(corner_uv, torch.tensor([[0, 1, 2], [3, 2, 1]]), 2 * SIZE)
    every_other = (texels.pixel % 2).astype(np.float32)
    np.testing.assert_array_equal(confidence_map(texels, every_other), np.full((SIZE, SIZE), 128))
    np.testing.assert_array_equal(confidence_map(texels, np.ones_like(every_other)), np.full((SIZE, SIZE), 255))
