"""Every stage in Warp, on its CPU device and on a GPU if there is one, against the reference.

Stages are given what frames of several kinds give them.
"""

from copy import deepcopy
from typing import Any, NamedTuple

import pytest
import torch
from livehand.backend.compute.gpu import ray_stages
from livehand.backend.compute.gpu.backend import WarpBackend
from livehand.backend.compute.gpu.field_stages import PlaneRayRenderer
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.field import BakedField, FieldConfig
from livehand.backend.field.rays import HandInView
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.field.shade import shade
from livehand.backend.geometry.uvh import interpolate
from livehand.backend.light.visibility import visibility_transfer
from livehand.backend.records.render_hooks import RenderHooks

pytestmark = pytest.mark.slow

EPS = 2.0**-23
CONFIG = FieldConfig(width=16, planes=((32, 2, 4), (16, 1, 3)), relief=8)


class Bound(NamedTuple):
    """How far values may lie off, as a share of the largest, and how many of them farther, as a share of all.

    Sums of n products are off by at most n EPS of the largest, whatever their order.
    """

    off: float = 16 * EPS
    beyond: float = 0.0


BOUNDS = {
    "skin_motion": Bound(256 * EPS),  # sums of 145 products, and six rotations one after another
    "local_rotations": Bound(1e-4),  # tangents are differences of places, over some of a hand's 200 mm
    "first_hit": Bound(beyond=1e-3),  # a centre on an edge of two faces
    "view_directions": Bound(),
    # Depths of parallel light count from 1000 radii, where EPS is 6e-5 of one. An edge may miss a pixel's centre.
    "look_up": Bound(4e-3, 2e-3),
    "ambient_occlusion": Bound(64 * EPS),
    "light_features": Bound(128 * EPS),
    "indirect_diffuse": Bound(2048 * EPS),
    "mesh_points": Bound(1e-3, 1e-3),  # areas of slivers
    "near_field_light": Bound(1024 * EPS),
    "smooth_enlarged_rays": Bound(64 * EPS),
    "shares_of_rays": Bound(1e-4),  # exp(-gap^2) of depths that differ by an EPS, over an edge of some millimetres
    "normals_at_steps": Bound(64 * EPS),
    "coefficients_at_steps": Bound(64 * EPS),
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


def moved(value, device) -> Any:
    """The same, its tensors and networks on a device."""
    if isinstance(value, torch.nn.Module):
        return deepcopy(value).to(device)
    if isinstance(value, torch.Tensor):
        return value.to(device)
    if isinstance(value, tuple):
        return (
            type(value)._make(moved(one, device) for one in value)
            if hasattr(value, "_make")
            else tuple(moved(one, device) for one in value)
        )
    return value


def assert_close(ours, theirs, bound):
    """Nested tuples of tensors of one shape and kind, and nearly the same values."""
    pairs = list(zip(tensors_of(ours), tensors_of(theirs), strict=True))
    assert pairs
    for one, other in pairs:
        assert (one.shape, one.dtype) == (other.shape, other.dtype)
        if not other.numel():
            continue
        one, other = one.cpu().double(), other.double()
        off = torch.where(one == other, 0.0, (one - other).abs())
        assert not off.isnan().any()
        largest = other[other.isfinite()].abs().max() if other.isfinite().any() else 1.0
        assert (off > bound.off * max(float(largest), 1e-6)).double().mean() <= bound.beyond


def stages():
    """The names that the backend overrides."""
    above = WarpBackend.__mro__[: WarpBackend.__mro__.index(ReferenceBackend)]
    return sorted({name for one in above for name in vars(one) if not name.startswith("_")})


OTHERWISE = {"lit_frames", "baked_frames", "trace", "ray_renderer", "lit_share", "visible_surface"}
"""Which have tests of their own below."""


def test_every_stage_has_a_bound_and_is_met_in_frames(calls):
    assert set(stages()) == BOUNDS.keys() | OTHERWISE
    for name in BOUNDS:
        assert len(calls[name]) >= 1, name


@pytest.mark.parametrize("name", BOUNDS)
def test_a_stage_is_the_references(calls, device, name):
    ours, theirs = getattr(WarpBackend(), name), getattr(ReferenceBackend(), name)
    with torch.inference_mode():
        for given, named in calls[name]:
            assert named == {}
            assert_close(ours(*moved(given, device)), theirs(*given), BOUNDS[name])


def assert_same_rays(ours, theirs, hand):
    """Rays of the same pixels, their samples at the same points of the surface; on an edge maybe of another face."""
    ours = moved(ours, "cpu")
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


def test_rays_are_the_references(calls, device):
    assert {given[0].surface_depth is not None for given, _ in calls["trace"]} == {True}
    for (hand, *config), _ in calls["trace"]:
        ours, theirs = WarpBackend().trace(moved(hand, device), *config), ReferenceBackend().trace(hand, *config)
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
def test_visibility_is_the_references(posed, device, side):
    hand = posed("fist", side)
    ours = WarpBackend().visibility(*moved((hand.mesh, hand.topology), device))
    theirs = visibility_transfer(hand.mesh, hand.topology)
    assert_close(ours, theirs, Bound(1e-3, 1e-3))
    assert 0.1 < float((theirs > 0).double().mean()) < 0.9


GATHERED = Bound(1e-4)
"""Densities are exponentials of sums over some hundred products; opacity is one of densities."""


def test_what_rays_gather_is_the_references(calls, device):
    for (field, rays, hand, conditions, shell_m), _ in calls["shade"]:
        renderer = PlaneRayRenderer(moved(field, device), SamplerConfig(3, shell_m))
        channels = torch.cat([conditions.vertex_channels, field.light_code(conditions.visibility)], -1)
        with torch.inference_mode():
            ours = renderer.gathered(*moved((rays, hand, channels), device))
            theirs = shade(field, rays, hand, conditions, shell_m)
        assert_close(ours._replace(depth=ours.alpha), theirs._replace(depth=theirs.alpha), GATHERED)
        solid = theirs.alpha > 0.01  # the mean depth of less is one of rounding noise
        assert solid.any()
        assert_close(ours.depth.cpu()[solid], theirs.depth[solid], GATHERED)


@pytest.mark.parametrize("per_chunk", [1 << 19, 640])
def test_rays_of_baked_light_are_the_references_in_any_chunks(posed, view_from, per_chunk):
    hand, field, config = posed("fist"), BakedField(CONFIG), SamplerConfig(6, 0.003)
    with torch.no_grad():
        field.relief.table.mul_(20)
    view, stages = HandInView(hand.mesh, hand.topology, view_from(hand.mesh, (0.3, 0.8, -0.6))), []
    hooks = RenderHooks(on_stage=stages.append, before_chunk=lambda: stages.append("chunk"))
    with torch.inference_mode():
        ours = PlaneRayRenderer(field, config, samples_per_chunk=per_chunk)(view, hand.conditions(), hooks)
        theirs = ReferenceBackend().ray_renderer(field, config, "fp32")(view, hand.conditions(), hooks)
    solid = theirs.composite.alpha > 0.01
    assert torch.equal(ours.pixel, theirs.pixel)
    for one, other in zip(ours.composite, theirs.composite, strict=True):
        assert_close(one[solid], other[solid], GATHERED._replace(beyond=0.02))  # faces of either side of a seam
    assert stages[:3] == ["sample", "field", "chunk"]
    assert (stages.count("chunk") > 2) == (per_chunk == 640)  # one of the reference's among them


def test_what_pixels_show_is_the_references(calls, device):
    for (mesh, camera), _ in calls["visible_surface"]:
        ours = moved(WarpBackend().visible_surface(*moved((mesh, camera), device)), "cpu")
        theirs = ReferenceBackend().visible_surface(mesh, camera)
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
