"""Self-shadowing from small shadow maps: spheres alone, and one in the other's shadow."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.light.visibility import DIRECTIONS, direction_frames, lit_share_reference, visibility_transfer

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


def shares(backends, mesh, topology):
    """The lit shares [K, V] by each backend, of the points of `visibility_transfer`."""
    calls = []

    def record(points, topology):
        calls.append(points)
        return lit_share_reference(points, topology)

    visibility_transfer(mesh, topology, record)
    return [backend.lit_share(calls[0], topology) for backend in backends]


@pytest.mark.slow
@pytest.mark.parametrize(("gesture", "side"), [("open", "right"), ("fist", "right"), ("pinch", "left")])
@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_the_light_is_the_references(backend_pair, posed, gesture, side, scale):
    hand = posed(gesture, side)
    ours, theirs = shares(backend_pair, posed_mesh(hand.topology, hand.mesh.vertices * scale), hand.topology)
    assert ours.shape == (DIRECTIONS, len(hand.mesh.vertices))
    flips = (ours - theirs).abs() > 1e-6  # depths that are equal but for rounding
    assert flips.double().mean() < 1e-4
    assert 0.2 < ours.mean() < 0.9
    assert (ours.min(), ours.max()) == (0, 1)


@pytest.mark.slow
def test_faces_without_area_and_a_mesh_that_is_a_point(backend_pair, posed):
    hand = posed("open")
    vertices = hand.mesh.vertices.clone()
    vertices[:400] = vertices[0]
    ours, theirs = shares(backend_pair, posed_mesh(hand.topology, vertices), hand.topology)
    assert ((ours - theirs).abs() > 1e-6).double().mean() < 1e-4
    assert ours.isfinite().all()


@pytest.mark.slow
def test_the_number_of_threads_does_not_matter(backend, posed):
    hand, before = posed("fist"), torch.get_num_threads()
    try:
        results = []
        for count in (1, 2):
            torch.set_num_threads(count)
            results.append(shares([backend], hand.mesh, hand.topology)[0])
    finally:
        torch.set_num_threads(before)
    assert torch.equal(*results)
