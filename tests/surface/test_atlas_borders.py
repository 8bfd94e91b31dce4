"""Charts that meet at their borders: on a sphere of two charts whose maps are known, and on the hand's own atlas."""

import numpy as np
import pytest
import torch
import trimesh
from livehand.backend.surface.atlas_borders import RINGS, joined_borders, nearness_to_borders, split_atlas
from livehand.backend.surface.atlas_texels import AtlasTexels
from livehand.backend.surface.detail_mesh import DetailTemplate
from livehand.backend.surface.detail_surface import LEVELS, load_detail_surface

RESOLUTION = 256


@pytest.fixture(scope="module")
def sphere():
    """Faces, corners in the atlas and vertices: the upper half is a disc on the left, the lower one on the right."""
    mesh = trimesh.creation.icosphere(3)
    faces, place = np.array(mesh.faces), np.array(mesh.vertices)
    is_upper = place[faces, 2].mean(1) > 0
    middle = np.where(is_upper[:, None], (0.25, 0.5), (0.75, 0.5))
    flip = np.where(is_upper[:, None, None], (1, 1, 1), (1, -1, -1))
    x, y, z = np.moveaxis(flip * place[faces], -1, 0)
    angle = np.arctan2(np.hypot(x, y), z)  # from its pole, to which the distance in the atlas is proportional
    across = np.stack([x, y], -1) / np.hypot(x, y).clip(1e-9)[..., None]
    return faces, middle[:, None] + 0.12 * angle[..., None] * across, place


def texels_of(sphere):
    faces, corner_uv, _ = sphere
    return AtlasTexels.of(torch.as_tensor(corner_uv, dtype=torch.float32), torch.as_tensor(faces), RESOLUTION)


def test_two_charts_of_different_values_meet_between_them(sphere):
    """Both sides of an edge on the border differ by a texel of the nine of two rings; far from it nothing changes."""
    faces, corner_uv, place = sphere
    texels = texels_of(sphere)
    column = texels.pixel % RESOLUTION
    image = texels.as_map((column > RESOLUTION // 2).astype(np.float32)[:, None] * (1.0, 3.0))
    joined = joined_borders(image, faces, corner_uv)
    sides = np.concatenate([faces[:, pair] for pair in ((0, 1), (1, 2), (2, 0))])
    middles = np.concatenate([corner_uv[:, pair].mean(1) for pair in ((0, 1), (1, 2), (2, 0))])
    of_edge = middles[np.lexsort(np.sort(sides, 1).T)].reshape(-1, 2, 2)
    column_at, row_at = (RESOLUTION * of_edge[np.ptp(of_edge, 1).max(1) > 0.1]).astype(int).T
    assert column_at.shape[1] > 40
    before, after = (np.diff(each[row_at, column_at], axis=0)[0] for each in (image, joined))
    np.testing.assert_array_equal(np.abs(before), np.tile((1.0, 3.0), (len(before), 1)))
    assert (np.abs(after).mean(0) < np.array([1, 3]) * 1.2 / 9).all()
    values, height = texels.from_map(joined), np.abs(texels.at_texels(place[:, 2:])[:, 0])
    np.testing.assert_array_equal(values[height > 0.5], texels.from_map(image)[height > 0.5])
    assert ((values > -1e-6) & (values < (1.000001, 3.000001))).all()


def test_a_map_that_meets_already_stays(sphere):
    """Of a place along the sphere, to a tenth of an edge."""
    faces, corner_uv, place = sphere
    texels = texels_of(sphere)
    along = texels.at_texels(place)
    joined = texels.from_map(joined_borders(texels.as_map(along), faces, corner_uv))
    edge = np.linalg.norm(place[faces[:, 0]] - place[faces[:, 1]], axis=1).mean()
    assert np.abs(joined - along).max() < 0.25 * edge
    assert np.abs(joined - along).mean() < 0.01 * edge


def test_nearness_falls_ring_by_ring(sphere):
    """Of a cap that is a chart of its own: rings of vertices around its border, by steps through faces."""
    faces, corner_uv, place = sphere
    found = nearness_to_borders(faces, corner_uv)
    of_corner = {}
    for vertex, uv in zip(faces.ravel(), corner_uv.reshape(-1, 2), strict=True):
        of_corner.setdefault(vertex, []).append(uv)
    on_border = {vertex for vertex, all_uv in of_corner.items() if np.ptp(all_uv, 0).max() > 1e-6}
    expected, reached = np.zeros(len(place)), set(on_border)
    expected[list(on_border)] = 1
    for ring in range(1, RINGS):
        grown = set(faces[np.isin(faces, list(reached)).any(1)].ravel()) - reached
        expected[list(grown)] = 1 - ring / RINGS
        reached |= grown
    assert 20 < len(on_border) < 100
    np.testing.assert_allclose(found, expected)


def test_the_split_atlas_is_that_of_the_detail_surface(hand):
    template = DetailTemplate.of(load_detail_surface(hand.sha256), hand)
    faces, corner_uv = split_atlas(hand.f, hand.vt[hand.ft], LEVELS)
    np.testing.assert_array_equal(faces, template.faces)
    np.testing.assert_allclose(corner_uv, template.corner_uv, atol=1e-6)
