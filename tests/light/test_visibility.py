"""Self-shadowing from small shadow maps: spheres alone, and one in the other's shadow."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.light.visibility import DIRECTIONS, direction_frames

DIRECTION = direction_frames(DIRECTIONS, "cpu")[:, 2]


def test_directions_cover_the_sphere_in_orthonormal_frames():
    frames = direction_frames(DIRECTIONS, "cpu")
    torch.testing.assert_close(frames @ frames.mT, torch.eye(3).expand(DIRECTIONS, 3, 3), atol=1e-6, rtol=0)
    assert DIRECTION.mean(0).norm() < 0.05
    torch.testing.assert_close(DIRECTION.T @ DIRECTION / DIRECTIONS, torch.eye(3) / 3, atol=0.03, rtol=0)
    between = (DIRECTION @ DIRECTION.T).fill_diagonal_(-1).amax(1)
    assert (between < np.cos(0.45)).all()


@pytest.mark.slow
def test_a_lone_sphere_is_lit_by_the_cosine(spheres, backend):
    """Nothing convex shadows itself."""
    mesh, topology = spheres(((0.2, -0.1, 0.3), 0.05), subdivisions=3)
    lit = backend.visibility(mesh, topology)
    expected = (mesh.normals @ DIRECTION.T).clamp(min=0)
    assert lit.shape == (len(mesh.vertices), DIRECTIONS)
    clear = expected > 0.3  # towards the terminator the map's pixels shadow their own surface
    torch.testing.assert_close(lit[clear], expected[clear])
    assert (lit <= expected + 1e-6).all()
    assert (expected - lit).mean() < 0.01


@pytest.mark.parametrize("k", [0, 9, 20, 31])
def test_a_sphere_in_the_way_casts_its_shadow(spheres, backend, k):
    """The point that faces direction k looks straight at a small sphere 8 cm away; the side away does not."""
    towards = DIRECTION[k].numpy().astype(np.float64)
    mesh, topology = spheres(((0, 0, 0), 0.05), (tuple(0.08 * towards), 0.012), subdivisions=3)
    lit = backend.visibility(mesh, topology)
    count = len(mesh.vertices) // 2
    along = mesh.vertices[:count] @ DIRECTION[k]
    aside = (mesh.vertices[:count] - along[:, None] * DIRECTION[k]).norm(dim=-1)
    alone, _ = spheres(((0, 0, 0), 0.05), subdivisions=3)
    expected = (alone.normals @ DIRECTION[k]).clamp(min=0)
    under = (aside < 0.009) & (along > 0)
    beside = (aside > 0.016) & (aside < 0.04) & (along > 0)
    assert under.sum() > 3
    assert lit[:count, k][under].max() == 0
    torch.testing.assert_close(lit[:count, k][beside], expected[beside], atol=1e-5, rtol=0)


@pytest.mark.slow
def test_place_and_scale_of_the_world_do_not_matter(spheres, backend):
    mesh, topology = spheres(((0, 0, 0), 0.05), ((0.03, 0.02, 0.06), 0.012), subdivisions=3)
    lit = backend.visibility(mesh, topology)
    large = backend.visibility(posed_mesh(topology, mesh.vertices * 10), topology)
    moved = backend.visibility(posed_mesh(topology, mesh.vertices + torch.tensor([1.0, -2.0, 0.5])), topology)
    assert ((large - lit).abs() > 0.02).double().mean() < 0.01
    assert ((moved - lit).abs() > 0.02).double().mean() < 0.01
    assert (lit > 0.1).double().mean() > 0.2
