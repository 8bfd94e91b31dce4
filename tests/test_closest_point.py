"""Closest points against brute force over all faces, and by hand on one triangle."""

import numpy as np
import pytest
import torch
from livehand.backend.camera import Camera, look_at
from livehand.backend.geometry.closest_point import closest_on_triangles, closest_points
from livehand.backend.geometry.mesh import Topology, posed_mesh, vertex_rings
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import SkinTensors, pose_hand
from livehand.backend.hand.model import load_default_hand
from livehand.backend.renderer import view_of
from livehand.backend.sampler import SamplerConfig, sample_rays

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


@pytest.fixture(scope="module")
def hand():
    return load_default_hand()


@pytest.fixture(scope="module")
def topology(hand):
    return Topology.of(hand)


def posed_in(hand, topology, gesture):
    theta = theta_of(GESTURES[gesture].angles_deg(), FingerAxes.of_default_hand())
    parameters = (torch.as_tensor(theta, dtype=torch.float32), torch.zeros(10), torch.zeros(3))
    return posed_mesh(topology, pose_hand(SkinTensors.of(hand), *parameters).vertices)


def seen_samples(topology, mesh):
    """Samples the renderer takes of the hand from four sides."""
    middle = mesh.vertices.mean(0).numpy().astype(np.float64)
    K = np.array([[72.0, 0, 15], [0, 72, 15], [0, 0, 1]])
    points = []
    for side in ([0, -1, 0.1], [0, 1, 0.2], [-0.3, 0.2, 1], [-1, -0.5, 0.3]):
        camera = Camera(K, look_at(middle + 0.6 * np.array(side), middle, np.array([1.0, 0, 0])), (30, 30))
        points.append(sample_rays(mesh, topology, view_of(camera, "cpu"), SamplerConfig()).points.reshape(-1, 3))
    return torch.cat(points)[::2]


def brute_force(points, vertices, faces):
    """Distance of float64 points to the nearest of all faces."""
    triangles = vertices.double()[faces]
    chunks = [closest_on_triangles(p[:, None], triangles)[1].amin(1) for p in points.double().split(64)]
    return torch.cat(chunks).sqrt()


@pytest.mark.parametrize(("gesture", "share"), [("rest", 0.005), ("fist", 0.03)])
def test_on_the_hand_the_distance_is_exact_but_for_a_few_samples(hand, topology, gesture, share):
    """In a fist, where skin lies on skin, the nearest vertex may be the other skin's."""
    mesh = posed_in(hand, topology, gesture)
    points = seen_samples(topology, mesh)
    assert len(points) > 1000
    found = closest_points(points, mesh.vertices, topology.faces, topology.ring)
    excess_mm = (found.distance - brute_force(points, mesh.vertices, topology.faces)) * 1000
    assert excess_mm.min() > -0.001
    assert (excess_mm > 0.1).double().mean() <= share
    at = (found.barycentric[:, :, None] * mesh.vertices[topology.faces[found.face]]).sum(1)
    torch.testing.assert_close((at - points).norm(dim=1), found.distance, atol=1e-6, rtol=0)


@pytest.fixture(scope="module")
def posed(hand, topology):
    return posed_in(hand, topology, "relaxed").vertices, topology


def test_no_points(posed):
    vertices, topology = posed
    found = closest_points(torch.zeros(0, 3), vertices, topology.faces, topology.ring)
    assert [tuple(value.shape) for value in found] == [(0,), (0, 3), (0,)]


def test_where_the_world_lies_does_not_matter(posed):
    """A hand ten metres away: float32 must not choose other vertices."""
    vertices, topology = posed
    points = vertices[::7] + 0.002
    here = closest_points(points, vertices, topology.faces, topology.ring)
    away = torch.tensor([10.0, -7.0, 3.0])
    there = closest_points(points + away, vertices + away, topology.faces, topology.ring)
    torch.testing.assert_close(there.distance, here.distance, atol=2e-5, rtol=0)


def test_rings_hold_the_faces_around_each_vertex():
    faces = torch.tensor([[0, 1, 2], [2, 1, 3], [3, 1, 4]])
    rings = vertex_rings(faces, 6)
    assert [sorted(set(ring)) for ring in rings.tolist()] == [[0], [0, 1, 2], [0, 1], [1, 2], [2], [0]]
