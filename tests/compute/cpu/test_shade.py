"""Shading by the kernels against the reference: values, and the gradient of every weight."""

import pytest
import torch
from livehand.backend.avatars.avatar import build_field
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.compute.cpu.shade import _CompositeAlongRays
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.rays import HandInView
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.field.trace import trace as trace_reference

pytestmark = pytest.mark.slow

CONFIG = SamplerConfig(5, 0.003)
FIELD = FieldConfig(width=24, density_width=12, planes=((32, 3, 4), (128, 2, 8), (200, 1, 3)), relief=64)


@pytest.fixture(scope="module")
def scene(posed, seen_from):
    """(rays, hand in view, conditions, shell): a fist, so that some rays end at the hand and some do not."""
    hand = posed("fist")
    view = seen_from(hand.mesh, (0.2, 1, 0.4), (22, 20))
    generator = torch.Generator().manual_seed(0)
    seen = HandInView(hand.mesh, hand.topology, view)
    rays = trace_reference(seen, CONFIG, generator)
    assert 0 < int(rays.is_stopped.sum()) < len(rays.pixel)
    return rays, seen, hand.conditions(), CONFIG.shell_m


@pytest.fixture
def field():
    """With weights large enough that densities, relief and light all matter."""
    torch.manual_seed(3)
    field = build_field(FIELD)
    for plane in (*field.planes, field.relief):
        torch.nn.init.normal_(plane.table)
    torch.nn.init.normal_(field.density.weight)
    return field


def seen_and_gradients(backend, field, scene, scales=(1.0, 1.0, 1.0)):
    """What `shade` returns, and gradients of all weights for random gradients of it."""
    seen = backend.shade(field, *scene)
    generator = torch.Generator().manual_seed(1)
    outward = [torch.randn(values.shape, generator=generator) for values in seen]
    learnt = zip(scales, seen, outward, strict=False)  # no loss uses the samples' weights
    loss = sum((scale * a.float() * b).sum() for scale, a, b in learnt)
    gradients = torch.autograd.grad(loss, list(field.parameters()), allow_unused=True)
    names = [name for name, _ in field.named_parameters()]
    return seen, {name: got for name, got in zip(names, gradients, strict=True) if got is not None}


@pytest.mark.parametrize("scales", [(1, 0, 0), (0, 1, 0), (0, 0, 30), (1, 1, 1)])
def test_values_and_gradients_are_torchs(field, scene, scales):
    """From the channels, from alpha, from depth, and from all of them."""
    ours, our_gradients = seen_and_gradients(NumbaBackend(), field, scene, scales)
    torchs, torch_gradients = seen_and_gradients(ReferenceBackend(), field, scene, scales)
    for got, expected in zip(ours, torchs, strict=True):
        torch.testing.assert_close(got, expected, atol=1e-5, rtol=1e-4)
    assert {"relief.table", "light.weight", "near.bias", "density.weight", "planes.2.table"} <= our_gradients.keys()
    for name, expected in torch_gradients.items():
        got, scale = our_gradients[name], expected.abs().max().clamp(min=1e-6)
        torch.testing.assert_close(got / scale, expected / scale, atol=2e-4, rtol=1e-3, msg=name)


def test_in_half_precision_gradients_are_off_by_as_little_as_torchs(field, scene):
    _, truth = seen_and_gradients(ReferenceBackend(), field, scene)
    with torch.autocast("cpu", torch.bfloat16):
        both = [seen_and_gradients(one, field, scene)[1] for one in (NumbaBackend(), ReferenceBackend())]
    ours, torchs = ({k: float((g[k] - v).norm() / v.norm()) for k, v in truth.items()} for g in both)
    assert max(torchs.values()) > 0.01
    assert all(error < torchs[name] + 0.06 for name, error in ours.items())


def test_twice_the_same_and_through_a_kept_graph(field, scene):
    def gradient():
        return torch.autograd.grad(seen.channels.square().sum() + seen.alpha.sum(), tables, retain_graph=True)

    tables = [plane.table for plane in (*field.planes, field.relief)]
    seen = NumbaBackend().shade(field, *scene)
    first, second = gradient(), gradient()
    seen = NumbaBackend().shade(field, *scene)
    assert all(torch.equal(a, b) and torch.equal(a, c) for a, b, c in zip(first, second, gradient(), strict=True))


def test_without_rays_nothing_is_seen(field, scene):
    rays, *rest = scene
    samples = type(rays.samples)(*(values[:0] for values in rays.samples))
    none = rays._replace(
        **{name: getattr(rays, name)[:0] for name in ("pixel", "directions", "t", "dt", "is_stopped")}, samples=samples
    )
    seen = NumbaBackend().shade(field, none, *rest)
    assert [len(values) for values in seen] == [0, 0, 0, 0]
    seen.channels.sum().backward()
    assert not field.planes[0].table.grad.any()


def test_geometry_that_is_learnt_goes_by_torch(monkeypatch, field, scene):
    rays, *rest = scene
    used = []
    original = _CompositeAlongRays.apply
    monkeypatch.setattr(_CompositeAlongRays, "apply", lambda *a: used.append(None) or original(*a))
    height = rays.samples.height_m.clone().requires_grad_()
    moving = rays._replace(samples=rays.samples._replace(height_m=height))
    NumbaBackend().shade(field, moving, *rest).alpha.sum().backward()
    assert height.grad.abs().max() > 0
    assert not used
    with torch.no_grad():
        NumbaBackend().shade(field, moving, *rest)
    NumbaBackend().shade(field, rays, *rest)
    assert len(used) == 2
