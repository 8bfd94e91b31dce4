"""The paper's renderer as published: its search is exact, and its picture agrees with our renderer's."""

import importlib.util

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import PRESETS, new_avatar
from livehand.backend.field.rays import camera_tensors
from livehand.backend.geometry.closest_point import closest_on_triangles
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.hand.topology import topology_of
from livehand.backend.records.frame import DEPTH_BACKGROUND
from livehand.backend.render.renderer import Renderer
from livehand.backend.research.benchmark import brute_force
from livehand.backend.research.benchmark.brute_force import FaceTable, dense_search, nearest_faces
from livehand.backend.research.benchmark.motion import MovingHand
from livehand.backend.research.benchmark.published import PublishedRenderer, whole_rays

SIZE = (66, 100)


@pytest.fixture(scope="module")
def shot(hand):
    motion = MovingHand(hand, SIZE)
    return motion.shot(motion.frames(4)[1])  # a pinch: skin near other skin


@pytest.fixture(scope="module")
def avatar(hand):
    return new_avatar("untrained", hand.name, hand.sha256, PRESETS["paper"])


@pytest.fixture(scope="module")
def points(hand, shot):
    """300 points within 5 mm of the posed surface, and their exact distances in double precision."""
    rng = np.random.default_rng(0)
    corners = shot.vertices[hand.f[rng.integers(0, len(hand.f), 300)]].astype(np.float64)
    weights = rng.dirichlet(np.ones(3), 300)
    near = (weights[..., None] * corners).sum(1) + rng.uniform(-0.003, 0.003, (300, 3))
    triangles = torch.as_tensor(shot.vertices[hand.f], dtype=torch.float64)
    _, squared = closest_on_triangles(torch.as_tensor(near)[:, None], triangles[None])
    return torch.as_tensor(near, dtype=torch.float32), squared.amin(1).sqrt()


def distance_of(points, triangles, face):
    _, squared = closest_on_triangles(points.double(), triangles[face].double())
    return squared.sqrt()


def test_the_dense_search_is_exact(hand, shot, points):
    triangles = torch.as_tensor(shot.vertices[hand.f], dtype=torch.float32)
    face = dense_search(points[0], FaceTable.of(triangles))
    assert (distance_of(points[0], triangles, face) - points[1]).abs().max() < 1e-5


def test_without_numba_samples_are_searched_in_chunks(hand, shot, points, monkeypatch):
    monkeypatch.setattr(brute_force, "has_numba", lambda: False)
    triangles = torch.as_tensor(shot.vertices[hand.f], dtype=torch.float32)
    face = nearest_faces(points[0], triangles)
    assert len(face) == 300
    assert (distance_of(points[0], triangles, face) - points[1]).abs().max() < 1e-5


@pytest.mark.skipif(importlib.util.find_spec("numba") is None, reason="numba is not installed")
def test_the_compiled_search_is_exact(hand, shot, points):
    triangles = torch.as_tensor(shot.vertices[hand.f], dtype=torch.float32)
    face = nearest_faces(points[0], triangles)
    assert (distance_of(points[0], triangles, face) - points[1]).abs().max() < 1e-6


def test_every_ray_has_one_interval_from_the_first_to_the_last_surface(hand, shot):
    topology = topology_of(hand)
    mesh = posed_mesh(topology, torch.as_tensor(shot.vertices, dtype=torch.float32))
    view = camera_tensors(shot.camera.scaled(0.5), "cpu")
    rays = whole_rays(mesh, topology, view, 0.005, 16)
    assert rays.t.shape == (len(rays.pixel), 16)
    assert len(rays.pixel.unique()) == len(rays.pixel)
    np.testing.assert_allclose(rays.t.diff(dim=1), rays.dt[:, None].expand(-1, 15), atol=1e-6)
    depth = shot.camera.project(shot.vertices)[1]
    assert rays.t.min() > depth.min() - 0.006
    assert rays.t.max() < depth.max() + 0.006
    assert (16 * rays.dt).max() > 0.03  # from the thumb to the palm's other side
    assert (rays.dt > 0).all()


def test_the_picture_agrees_with_our_renderer(hand, shot, avatar):
    """Where the surface is simple; elsewhere the single interval of the published sampler is coarser."""
    published = PublishedRenderer(avatar, hand, torch.device("cpu")).render(shot)
    ours = Renderer(avatar, hand, "cpu").render(shot)
    one, other = published.alpha > 0.5, ours.alpha > 0.5
    assert one.sum() > 1000
    assert (one & other).sum() / (one | other).sum() > 0.95
    inside = (published.alpha > 0.9) & (ours.alpha > 0.9)
    assert inside.sum() > 800
    assert np.abs(published.rgb - ours.rgb)[inside].mean() < 0.01
    assert np.median(np.abs(published.depth - ours.depth)[inside]) < 0.002
    assert (published.depth[published.alpha < 0.5] == DEPTH_BACKGROUND).all()


def test_all_stages_are_reported_in_order(hand, shot, avatar):
    stages = []
    PublishedRenderer(avatar, hand, torch.device("cpu")).render(shot, stages.append)
    assert stages == ["pose", "rasterise", "sample", "field", "superres", "decode"]


def test_the_callers_networks_are_left_as_they_are(hand, shot, avatar):
    avatar.field.train()
    try:
        PublishedRenderer(avatar, hand, torch.device("cpu")).render(shot)
        assert avatar.field.training
    finally:
        avatar.field.eval()
