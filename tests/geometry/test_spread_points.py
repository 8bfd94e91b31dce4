"""Points spread over a mesh."""

import numpy as np
from livehand.backend.geometry.spread_points import spread_points
from scipy.spatial import KDTree
from trimesh.creation import icosphere


def test_points_lie_evenly_on_the_mesh():
    ball = icosphere(subdivisions=4)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    points = spread_points(vertices, faces, 2000)
    positions = points.at(vertices[faces])
    assert abs(len(positions) - 2000) < 300
    np.testing.assert_allclose(np.linalg.norm(positions, axis=1), 1, atol=2e-3)
    nearest = KDTree(positions).query(positions, k=2)[0][:, 1]
    assert nearest.min() >= points.spacing_m
    farthest = KDTree(positions).query(np.asarray(icosphere(subdivisions=5).vertices))[0]
    assert farthest.max() < 1.5 * points.spacing_m  # no hole


def test_two_sides_of_a_thin_sheet_do_not_keep_each_other_off():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    front = np.array([[0, 1, 2], [0, 2, 3]])
    vertices = np.concatenate([square, square - [0, 0, 1e-4]])
    points = spread_points(vertices, np.concatenate([front, front[:, ::-1] + 4]), 600)
    on_front = (points.face < 2).sum()
    assert min(on_front, len(points.face) - on_front) > 240
