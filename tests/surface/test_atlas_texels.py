"""Texels of an atlas on a mesh: where they lie, fields to vertices and back, and the map beyond the charts."""

import numpy as np
import pytest
import torch
from livehand.backend.surface.atlas_texels import AtlasTexels, nearest_inside
from scipy import ndimage

# A square of two faces that fills the lower left quarter of the atlas.
FACES = torch.tensor([[0, 1, 2], [0, 2, 3]])
CORNERS = torch.tensor([[0.0, 0], [0.5, 0], [0.5, 0.5], [0, 0.5]])
POSITIONS = np.array([[0.0, 0, 1], [2, 0, 1], [2, 2, 1], [0, 2, 1]])
A = 16


@pytest.fixture(scope="module")
def texels():
    return AtlasTexels.of(CORNERS[FACES], FACES, A)


def test_texels_lie_where_their_centres_do(texels):
    assert len(texels.pixel) == (A // 2) ** 2
    row, column = np.divmod(texels.pixel, A)
    wanted = np.stack([(column + 0.5) / A * 4, (row + 0.5) / A * 4, np.ones(len(row))], 1)
    np.testing.assert_allclose(texels.at_texels(POSITIONS), wanted, atol=1e-5)


def test_an_even_field_stays_even_at_the_vertices(texels):
    values = np.full((len(texels.pixel), 3), 0.7)
    found, weight = texels.at_vertices(values, np.ones(len(values)))
    np.testing.assert_allclose(found, 0.7)
    assert weight.sum() == pytest.approx(len(values))


def test_texels_without_weight_do_not_count(texels):
    values = np.where((texels.pixel % A < 4)[:, None], 1.0, 5.0)
    found, _ = texels.at_vertices(values, (texels.pixel % A < 4).astype(float))
    np.testing.assert_allclose(found, 1.0)


def test_beyond_the_charts_lies_the_nearest_texel(texels):
    values = np.arange(len(texels.pixel), dtype=float)[:, None]
    image = texels.as_map(values)
    assert image[0, A - 1, 0] == image[0, A // 2 - 1, 0]
    assert image[A - 1, 0, 0] == image[A // 2 - 1, 0, 0]
    np.testing.assert_array_equal(texels.from_map(image), values)


def test_the_laplacian_of_an_even_field_is_zero(texels):
    np.testing.assert_allclose(texels.laplacian @ np.ones(4), 0)
    assert texels.laplacian[0, 2] == -1
    assert texels.laplacian[1, 3] == 0


@pytest.mark.parametrize("size", [1, 2, 37, 256])
def test_beyond_the_charts_the_nearest_texel_is_found(size):
    """Against an exact transform; jump flooding may take one in ten thousand's second nearest."""
    row, column = np.mgrid[:size, :size]
    random = np.random.default_rng(size)
    is_inside = np.zeros((size, size), bool)
    for center in random.uniform(0, size, (6, 2)):
        is_inside |= np.hypot(row - center[0], column - center[1]) < max(size / 12, 1)
    found = nearest_inside(is_inside)
    assert is_inside[found[0], found[1]].all()
    off_px = np.hypot(found[0] - row, found[1] - column) - ndimage.distance_transform_edt(~is_inside)
    assert (np.abs(off_px) > 1e-6).mean() < 1e-4
    assert np.abs(off_px).max() < 0.5
