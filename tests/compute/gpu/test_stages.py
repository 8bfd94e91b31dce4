"""Every stage in Warp, on its CPU device, against the reference: by what frames of several kinds give it."""

from typing import NamedTuple

import pytest
import torch
from livehand.backend.compute.gpu import ray_stages
from livehand.backend.compute.gpu.backend import WarpBackend
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.rays import HandInView
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.geometry.uvh import interpolate
from livehand.backend.light.visibility import visibility_transfer

pytestmark = pytest.mark.slow

EPS = 2.0**-23


class Bound(NamedTuple):
    """How far values may lie off, as a share of the largest, and how many of them farther, as a share of all.

    Sums of n products are off by at most n EPS of the largest, whatever their order.
    """

    off: float = 16 * EPS
    beyond: float = 0.0


BOUNDS = {
    "first_hit": Bound(beyond=1e-3),  # a centre on an edge of two faces
    "view_directions": Bound(),
    # Depths of parallel light count from 1000 radii, where EPS is 6e-5 of one. An edge may miss a pixel's centre.
    "look_up": Bound(4e-3, 2e-3),
    "ambient_occlusion": Bound(64 * EPS),
    "light_features": Bound(128 * EPS),
    "indirect_diffuse": Bound(2048 * EPS),
    "smooth_enlarged_rays": Bound(64 * EPS),
    "shares_of_rays": Bound(1e-4),  # exp(-gap^2) of depths that differ by an EPS, over an edge of some millimetres
    "normals_at_steps": Bound(64 * EPS),
    "shade_image": Bound(1e-4),
    "edge_avoiding_mean": Bound(64 * EPS),
    "detail_mesh": Bound(64 * EPS),
    "ray_hits": Bound(1e-3, 1e-3),
    "blended": Bound(64 * EPS),
    "detailed_image": Bound(1e-4, 1e-3),
}


def tensors_of(value):
    """The tensors in nested tuples, in order; numbers and None are left out."""
    if isinstance(value, torch.Tensor):
        yield value
    elif isinstance(value, tuple):
        for one in value:
            yield from tensors_of(one)


def assert_close(ours, theirs, bound):
    """Nested tuples of tensors of one shape and kind, and nearly the same values."""
    pairs = list(zip(tensors_of(ours), tensors_of(theirs), strict=True))
    assert pairs
    for one, other in pairs:
        assert (one.shape, one.dtype) == (other.shape, other.dtype)
        if not other.numel():
            continue
        one, other = one.double(), other.double()
        off = torch.where(one == other, 0.0, (one - other).abs())
        assert not off.isnan().any()
        largest = other[other.isfinite()].abs().max() if other.isfinite().any() else 1.0
        assert (off > bound.off * max(float(largest), 1e-6)).double().mean() <= bound.beyond


def stages():
    """The names that the backend overrides."""
    above = WarpBackend.__mro__[: WarpBackend.__mro__.index(ReferenceBackend)]
    return sorted({name for one in above for name in vars(one) if not name.startswith("_")})


OTHERWISE = {"trace", "lit_share", "visible_surface"}
"""Which have tests of their own below."""


def test_every_stage_has_a_bound_and_is_met_in_frames(calls):
    assert set(stages()) == BOUNDS.keys() | OTHERWISE
    for name in BOUNDS:
        assert len(calls[name]) >= 1, name


@pytest.mark.parametrize("name", BOUNDS)
def test_a_stage_is_the_references(calls, name):
    ours, theirs = WarpBackend(), ReferenceBackend()
    with torch.inference_mode():
        for given, named in calls[name]:
            assert_close(getattr(ours, name)(*given, **named), getattr(theirs, name)(*given, **named), BOUNDS[name])


def assert_same_rays(ours, theirs, hand):
    """Rays of the same pixels, their samples at the same points of the surface; on an edge maybe of another face."""
    assert torch.equal(ours.pixel, theirs.pixel)
    assert torch.equal(ours.is_stopped, theirs.is_stopped)
    scale = float(hand.mesh.scale)
    torch.testing.assert_close(ours.directions, theirs.directions, atol=4 * EPS, rtol=0)
    for name in ("t", "dt"):
        torch.testing.assert_close(getattr(ours, name), getattr(theirs, name), atol=1e-6 * scale, rtol=0)
    at = [interpolate(hand.mesh.vertices, hand.topology, rays.samples) for rays in (ours, theirs)]
    apart = (at[0] - at[1]).norm(dim=1) > 2e-5 * scale
    higher = (ours.samples.height_m - theirs.samples.height_m).abs() > 1e-6
    for off in (apart, higher):
        assert off.double().mean() < 2e-4 + 1.5 / max(len(off), 1)  # as in `test_rays`
    for one, other in zip(ours.samples, theirs.samples, strict=True):
        assert (one.shape, one.dtype) == (other.shape, other.dtype)


def test_rays_are_the_references(calls):
    assert {given[0].surface_depth is not None for given, _ in calls["trace"]} == {True}
    for (hand, *config), _ in calls["trace"]:
        ours, theirs = (one.trace(hand, *config) for one in (WarpBackend(), ReferenceBackend()))
        assert len(ours.pixel) > 200
        assert_same_rays(ours, theirs, hand)


@pytest.mark.parametrize(("gesture", "side"), [("fist", "right"), ("pinch", "left")])
@pytest.mark.parametrize("layers", [2, 10])
def test_rays_without_a_surface_of_few_layers_and_jittered_are_the_references(posed, view_from, gesture, side, layers):
    hand = posed(gesture, side)
    view = HandInView(hand.mesh, hand.topology, view_from(hand.mesh, (-1, -0.5, 0.3)))
    config = SamplerConfig(8, 0.003, layers)
    ours, theirs = (
        one.trace(view, config, torch.Generator().manual_seed(5)) for one in (WarpBackend(), ReferenceBackend())
    )
    assert_same_rays(ours, theirs, view)


def test_a_list_that_overflows_is_traced_by_the_reference_and_said(posed, view_from, monkeypatch, caplog):
    monkeypatch.setattr(ray_stages, "CAPACITY", 3)
    hand = posed("fist")
    view, config = HandInView(hand.mesh, hand.topology, view_from(hand.mesh, (0.3, 0.8, -0.6))), SamplerConfig(4, 0.003)
    ours, theirs = WarpBackend().trace(view, config), ReferenceBackend().trace(view, config)
    for one, other in zip(tensors_of(ours), tensors_of(theirs), strict=True):
        assert torch.equal(one, other)
    assert "more than 3 layers" in caplog.text


def test_nothing_in_view_has_no_rays(posed, view_from):
    hand = posed("open")
    view = view_from(hand.mesh, (0.1, 1, 0.3))
    turned = view._replace(world2cam=torch.diag(torch.tensor([1.0, -1, -1, 1])) @ view.world2cam)
    rays = WarpBackend().trace(HandInView(hand.mesh, hand.topology, turned), SamplerConfig())
    assert rays.t.shape == (0, 8)


@pytest.mark.parametrize("side", ["right", "left"])
def test_visibility_is_the_references(posed, side):
    hand = posed("fist", side)
    ours, theirs = WarpBackend().visibility(hand.mesh, hand.topology), visibility_transfer(hand.mesh, hand.topology)
    assert_close(ours, theirs, Bound(1e-3, 1e-3))
    assert 0.1 < float((theirs > 0).double().mean()) < 0.9


def test_what_pixels_show_is_the_references(calls):
    for (mesh, camera), _ in calls["visible_surface"]:
        ours, theirs = (one.visible_surface(mesh, camera) for one in (WarpBackend(), ReferenceBackend()))
        assert_close(ours[:3], theirs[:3], Bound(64 * EPS, 1e-3))
        assert torch.equal(ours.edges.pixel, theirs.edges.pixel)
        assert_close(ours.edges.share, theirs.edges.share, Bound(64 * EPS, 1e-3))
        is_seen = theirs.face[around(theirs.edges.pixel, camera.size_px)] >= 0  # beside the surface it is undefined
        assert len(is_seen[0]) > 5
        assert torch.equal(ours.edges.shows_first & is_seen, theirs.edges.shows_first & is_seen)


def around(pixel, size_px):
    """The nine pixels around each, within the image."""
    width, height = size_px
    steps = (-1, 0, 1)
    rows, columns = pixel // width, pixel % width
    return torch.stack(
        [(rows + y).clamp(0, height - 1) * width + (columns + x).clamp(0, width - 1) for y in steps for x in steps]
    )
