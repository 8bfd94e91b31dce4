"""Closest points of one finger: against a search of all its faces."""

import numpy as np
import torch
from livehand.backend.geometry.closest_point import closest_on_triangles
from livehand.backend.rigs.model_transfer.region_mesh import PALM, RegionMesh, vertex_regions


def test_the_closest_point_is_that_of_a_search_of_all_faces(hand):
    mesh, rng = RegionMesh.of(hand, hand.v_template), np.random.default_rng(0)
    vertex = rng.choice(np.flatnonzero(hand.framed_vertices), 200)
    points = hand.v_template[vertex] + rng.normal(0, 0.003, (200, 3))
    regions = vertex_regions(hand)[vertex]
    found = mesh.nearest(points, regions)
    for region in np.unique(regions):
        faces = np.flatnonzero(np.isin(mesh.face_regions, (region, PALM)) | (region == PALM))
        rows = regions == region
        corners = torch.as_tensor(hand.v_template[hand.f[faces]])
        _, squared = closest_on_triangles(torch.as_tensor(points[rows])[:, None], corners)
        np.testing.assert_allclose(found.distance_m[rows], squared.min(1).values.sqrt(), atol=1e-5)
    at = found.blended(hand.v_template[hand.f])
    np.testing.assert_allclose(np.linalg.norm(at - points, axis=1), found.distance_m, atol=1e-9)


def test_a_finger_is_not_found_on_its_neighbour(hand):
    mesh, regions = RegionMesh.of(hand, hand.v_template), vertex_regions(hand)
    middle = np.flatnonzero((regions == 2) & (hand.v_template[:, 0] < hand.joints[5, 0]))
    found = mesh.nearest(hand.v_template[middle], np.full(len(middle), 1))
    assert len(middle) > 20
    assert set(mesh.face_regions[found.face]) == {1}
    assert found.distance_m.min() > 0.0005
