"""Closest points of triangles: by hand, and against a dense search."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.closest_point import closest_on_triangles

TRIANGLE = torch.tensor([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]], dtype=torch.float64)


@pytest.mark.parametrize(
    ("point", "closest"),
    [
        ((1, 1, 5), (1, 1, 0)),  # over the face
        ((1, 1, -2), (1, 1, 0)),
        ((-1, -2, 1), (0, 0, 0)),  # off each corner
        ((6, -1, 0), (4, 0, 0)),
        ((-1, 5, 2), (0, 3, 0)),
        ((2, -3, 1), (2, 0, 0)),  # off each edge
        ((-2, 1, 0), (0, 1, 0)),
        ((2 + 3, 1.5 + 4, 7), (2, 1.5, 0)),
        ((2, 1.5, 0), (2, 1.5, 0)),  # on it
    ],
)
def test_each_region_of_a_triangle(point, closest):
    point = torch.tensor(point, dtype=torch.float64)
    weights, squared = closest_on_triangles(point, TRIANGLE)
    closest = torch.tensor(closest, dtype=torch.float64)
    torch.testing.assert_close(weights @ TRIANGLE, closest)
    torch.testing.assert_close(squared, ((point - closest) ** 2).sum())
    torch.testing.assert_close(weights.sum(), torch.tensor(1.0, dtype=torch.float64))


def test_against_a_dense_search_over_random_triangles():
    rng = np.random.default_rng(0)
    share = np.array([(i, j, 40 - i - j) for i in range(41) for j in range(41 - i)]) / 40
    for _ in range(50):
        triangle, point = rng.normal(size=(3, 3)), rng.normal(size=3) * 1.5
        weights, squared = closest_on_triangles(torch.tensor(point), torch.tensor(triangle))
        assert weights.min() >= 0
        searched = (((share @ triangle - point) ** 2).sum(1)).min()
        assert squared <= searched + 1e-12
        assert squared.sqrt() >= np.sqrt(searched) - 0.1


@pytest.mark.parametrize("corners", [[[0, 0, 0]] * 3, [[0, 0, 0], [1, 0, 0], [2, 0, 0]]], ids=["point", "line"])
def test_degenerate_triangles_are_what_they_look_like(corners):
    triangle = torch.tensor(corners, dtype=torch.float32)
    weights, squared = closest_on_triangles(torch.tensor([1.0, 2.0, 0.0]), triangle)
    assert weights.isfinite().all()
    expected = 4.0 if corners[1] != corners[0] else 5.0
    assert float(squared) == pytest.approx(expected)


def test_many_points_against_many_triangles_and_none():
    generator = torch.Generator().manual_seed(1)
    points = torch.randn(7, 1, 3, generator=generator, dtype=torch.float64)
    triangles = torch.randn(5, 3, 3, generator=generator, dtype=torch.float64)
    weights, squared = closest_on_triangles(points, triangles)
    assert (weights.shape, squared.shape) == ((7, 5, 3), (7, 5))
    one, only = closest_on_triangles(points[3, 0], triangles[2])
    torch.testing.assert_close(weights[3, 2], one)
    torch.testing.assert_close(squared[3, 2], only)
    assert closest_on_triangles(points[:0], triangles)[0].shape == (0, 5, 3)
