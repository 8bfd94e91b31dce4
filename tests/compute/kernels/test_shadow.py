"""The shadow kernel against `light.visibility` in torch."""

import pytest
import torch
from livehand.backend.compute.cpu.backend import lit_share_by_kernel
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.light.visibility import DIRECTIONS, lit_share_reference, visibility_transfer

pytestmark = pytest.mark.slow


def shares(mesh, topology):
    """The lit shares [K, V] by the kernel and by the reference, of the points of `visibility_transfer`."""
    calls = []

    def record(points, topology):
        calls.append(points)
        return lit_share_by_kernel(points, topology)

    visibility_transfer(mesh, topology, record)
    return lit_share_by_kernel(calls[0], topology), lit_share_reference(calls[0], topology)


@pytest.mark.parametrize(("gesture", "side"), [("open", "right"), ("fist", "right"), ("pinch", "left")])
@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_the_light_is_that_of_torch(posed, gesture, side, scale):
    hand = posed(gesture, side)
    ours, theirs = shares(posed_mesh(hand.topology, hand.mesh.vertices * scale), hand.topology)
    assert ours.shape == (DIRECTIONS, len(hand.mesh.vertices))
    flips = (ours - theirs).abs() > 1e-6  # depths that are equal but for rounding
    assert flips.double().mean() < 1e-4
    assert 0.2 < ours.mean() < 0.9
    assert (ours.min(), ours.max()) == (0, 1)


def test_faces_without_area_and_a_mesh_that_is_a_point(posed):
    hand = posed("open")
    vertices = hand.mesh.vertices.clone()
    vertices[:400] = vertices[0]
    ours, theirs = shares(posed_mesh(hand.topology, vertices), hand.topology)
    assert ((ours - theirs).abs() > 1e-6).double().mean() < 1e-4
    assert ours.isfinite().all()


def test_the_number_of_threads_does_not_matter(posed):
    hand, before = posed("fist"), torch.get_num_threads()
    try:
        results = []
        for count in (1, 2):
            torch.set_num_threads(count)
            results.append(shares(hand.mesh, hand.topology)[0])
    finally:
        torch.set_num_threads(before)
    assert torch.equal(*results)
