"""The shadow kernel against `geometry.visibility` in torch."""

from importlib.util import find_spec

import pytest
import torch
from livehand.backend.geometry import visibility
from livehand.backend.geometry.mesh import posed_mesh

if find_spec("numba") is None:
    pytest.skip("numba is not installed", allow_module_level=True)


def shares(mesh, topology, monkeypatch):
    """What `visibility_transfer` asks of both, as both answer: [K, V] each."""
    told = []
    monkeypatch.setattr(visibility, "_lit_share_by_kernel", lambda *told_now: told.append(told_now) or LIT(*told_now))
    monkeypatch.setattr(visibility, "has_kernels", lambda device: True)
    visibility.visibility_transfer(mesh, topology)
    return LIT(*told[0]), visibility._lit_share(*told[0])


LIT = visibility._lit_share_by_kernel


@pytest.mark.parametrize(("gesture", "side"), [("open", "right"), ("fist", "right"), ("pinch", "left")])
@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_the_light_is_that_of_torch(posed, monkeypatch, gesture, side, scale):
    hand = posed(gesture, side)
    ours, theirs = shares(posed_mesh(hand.topology, hand.mesh.vertices * scale), hand.topology, monkeypatch)
    assert ours.shape == (visibility.DIRECTIONS, len(hand.mesh.vertices))
    flips = (ours - theirs).abs() > 1e-6  # a verdict about a depth that is the same but for rounding
    assert flips.double().mean() < 1e-4
    assert 0.2 < ours.mean() < 0.9
    assert (ours.min(), ours.max()) == (0, 1)


def test_faces_without_area_and_a_mesh_that_is_a_point(posed, monkeypatch):
    hand = posed("open")
    vertices = hand.mesh.vertices.clone()
    vertices[:400] = vertices[0]
    ours, theirs = shares(posed_mesh(hand.topology, vertices), hand.topology, monkeypatch)
    assert ((ours - theirs).abs() > 1e-6).double().mean() < 1e-4
    assert ours.isfinite().all()


def test_the_number_of_threads_does_not_matter(posed, monkeypatch):
    hand, before = posed("fist"), torch.get_num_threads()
    try:
        results = []
        for count in (1, 2):
            torch.set_num_threads(count)
            results.append(shares(hand.mesh, hand.topology, monkeypatch)[0])
    finally:
        torch.set_num_threads(before)
    assert torch.equal(*results)
