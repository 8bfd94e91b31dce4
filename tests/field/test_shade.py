"""The field along traced rays: chunks, what a step and a pixel measure; values and the gradient of every weight."""

import pytest
import torch
from livehand.backend.avatars.avatar import build_field
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.compute.cpu.gradients import _CompositeAlongRays
from livehand.backend.compute.reference import ChunkedRayRenderer, ReferenceBackend
from livehand.backend.field.field import FieldConfig, PaperField
from livehand.backend.field.rays import HandInView, split_rays
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.field.shade import shade
from livehand.backend.field.surface_tracking import trace as trace_reference
from livehand.backend.field.volume import Composite
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.records.render_hooks import RenderHooks

CONFIG = SamplerConfig(4, 0.003)
FIELDS = {"paper": FieldConfig(kind="paper"), "planes": FieldConfig(planes=((32, 3, 4), (128, 1, 4)), relief=8)}


class Recorder(PaperField):
    """A field that keeps its inputs."""

    def forward(self, inputs, steps, read_plane):
        self.inputs, self.steps = inputs, steps
        rays = len(steps.t)
        return Composite(torch.zeros(rays, 32), torch.zeros(rays), torch.zeros(rays), torch.zeros_like(steps.t))


@pytest.fixture(scope="module")
def scene(posed, view_from):
    """(rays, hand in view, conditions)."""
    hand = posed("relaxed")
    seen = HandInView(hand.mesh, hand.topology, view_from(hand.mesh, (0.2, 1, 0.4), (20, 22)))
    return trace_reference(seen, CONFIG), seen, hand.conditions()


@pytest.mark.slow
@torch.inference_mode()
@pytest.mark.parametrize("kind", FIELDS)
@pytest.mark.parametrize("size", [1, 70, 1000, 1 << 20])
def test_chunks_do_not_show(scene, kind, size):
    rays, hand, conditions = scene
    torch.manual_seed(0)
    field, few = build_field(FIELDS[kind]), split_rays(rays, 60)[0]
    calls = []
    in_chunks = ChunkedRayRenderer(ReferenceBackend(), field, CONFIG, samples_per_chunk=size)
    chunked = in_chunks.shade(few, hand, conditions, RenderHooks(before_chunk=lambda: calls.append(None)))
    whole = shade(field, few, hand, conditions, 0.003)
    for one, other in zip(chunked, whole, strict=True):
        torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-5)
    assert len(calls) == -(-60 // max(1, size // 4))


def test_what_is_raised_before_a_chunk_ends_it(scene):
    rays, hand, conditions = scene
    calls = []

    def before_chunk():
        calls.append(None)
        if len(calls) == 3:
            raise KeyError("stop")

    in_chunks = ChunkedRayRenderer(ReferenceBackend(), Recorder(), CONFIG, samples_per_chunk=100)
    with pytest.raises(KeyError, match="stop"):
        in_chunks.shade(rays, hand, conditions, RenderHooks(before_chunk=before_chunk))
    assert len(calls) == 3


@torch.inference_mode()
def test_steps_are_millimetres_of_the_template_and_footprints_pixels_of_it(scene):
    """The field gets the same inputs in a world ten times as large."""
    rays, hand, conditions = scene
    small, large = Recorder(), Recorder()
    mesh, topology, view = hand[:3]
    shade(small, rays, hand, conditions, 0.003)
    bigger = rays._replace(t=rays.t * 10, dt=rays.dt * 10)
    large_hand = hand._replace(mesh=posed_mesh(topology, mesh.vertices * 10))
    shade(large, bigger, large_hand, conditions, 0.003)
    length = rays.directions.norm(dim=-1)
    torch.testing.assert_close(small.steps.step_mm, rays.dt * length / mesh.scale * 1000)
    torch.testing.assert_close(large.steps.step_mm, small.steps.step_mm)
    pixel_m = rays.t / (view.K[0, 0] * view.K[1, 1]).sqrt()
    torch.testing.assert_close(small.inputs.footprint_m, (pixel_m / mesh.scale).flatten(), rtol=1e-5, atol=0)
    torch.testing.assert_close(large.inputs.footprint_m, small.inputs.footprint_m)
    torch.testing.assert_close(small.inputs.view.norm(dim=-1), torch.ones(len(rays.pixel)))
    torch.testing.assert_close(small.inputs.height, rays.samples.height_m / 0.003)
    assert torch.equal(small.steps.is_stopped, rays.is_stopped)


JITTERED = SamplerConfig(5, 0.003)
DENSE = FieldConfig(width=24, density_width=12, planes=((32, 3, 4), (128, 2, 8), (200, 1, 3)), relief=64)


@pytest.fixture(scope="module")
def fist(posed, view_from):
    """(rays, hand in view, conditions, shell): a fist, so that some rays end at the hand and some do not."""
    hand = posed("fist")
    view = view_from(hand.mesh, (0.2, 1, 0.4), (22, 20))
    generator = torch.Generator().manual_seed(0)
    seen = HandInView(hand.mesh, hand.topology, view)
    rays = trace_reference(seen, JITTERED, generator)
    assert 0 < int(rays.is_stopped.sum()) < len(rays.pixel)
    return rays, seen, hand.conditions(), JITTERED.shell_m


@pytest.fixture
def field():
    """With weights large enough that densities, relief and light all matter."""
    torch.manual_seed(3)
    field = build_field(DENSE)
    for plane in (*field.planes, field.relief):
        torch.nn.init.normal_(plane.table)
    torch.nn.init.normal_(field.density.weight)
    return field


def seen_and_gradients(backend, field, fist, scales=(1.0, 1.0, 1.0)):
    """What `shade` returns, and gradients of all weights for random gradients of it."""
    seen = backend.shade(field, *fist)
    generator = torch.Generator().manual_seed(1)
    outward = [torch.randn(values.shape, generator=generator) for values in seen]
    learnt = zip(scales, seen, outward, strict=False)  # no loss uses the samples' weights
    loss = sum((scale * a.float() * b).sum() for scale, a, b in learnt)
    gradients = torch.autograd.grad(loss, list(field.parameters()), allow_unused=True)
    names = [name for name, _ in field.named_parameters()]
    return seen, {name: got for name, got in zip(names, gradients, strict=True) if got is not None}


@pytest.mark.slow
@pytest.mark.parametrize("scales", [(1, 0, 0), (0, 1, 0), (0, 0, 30), (1, 1, 1)])
def test_values_and_gradients_are_the_references(backend_pair, field, fist, scales):
    """From the channels, from alpha, from depth, and from all of them."""
    (ours, our_gradients), (torchs, torch_gradients) = (
        seen_and_gradients(each, field, fist, scales) for each in backend_pair
    )
    for got, expected in zip(ours, torchs, strict=True):
        torch.testing.assert_close(got, expected, atol=1e-5, rtol=1e-4)
    assert {"relief.table", "light.weight", "near.bias", "density.weight", "planes.2.table"} <= our_gradients.keys()
    for name, expected in torch_gradients.items():
        got, scale = our_gradients[name], expected.abs().max().clamp(min=1e-6)
        torch.testing.assert_close(got / scale, expected / scale, atol=2e-4, rtol=1e-3, msg=name)


@pytest.mark.slow
def test_in_half_precision_gradients_are_off_by_as_little_as_the_references(backend_pair, field, fist):
    _, truth = seen_and_gradients(ReferenceBackend(), field, fist)
    with torch.autocast("cpu", torch.bfloat16):
        both = [seen_and_gradients(one, field, fist)[1] for one in backend_pair]
    ours, torchs = ({k: float((g[k] - v).norm() / v.norm()) for k, v in truth.items()} for g in both)
    assert max(torchs.values()) > 0.01
    # Input, weight and output of five layers are rounded on the way, and 13 gradients on the way back, each by 2^-9.
    assert all(error < torchs[name] + 28 * 2**-9 for name, error in ours.items())


@pytest.mark.slow
def test_twice_the_same_and_through_a_kept_graph(backend, field, fist):
    def gradient():
        return torch.autograd.grad(seen.channels.square().sum() + seen.alpha.sum(), tables, retain_graph=True)

    tables = [plane.table for plane in (*field.planes, field.relief)]
    seen = backend.shade(field, *fist)
    first, second = gradient(), gradient()
    seen = backend.shade(field, *fist)
    assert all(torch.equal(a, b) and torch.equal(a, c) for a, b, c in zip(first, second, gradient(), strict=True))


@pytest.mark.slow
def test_without_rays_nothing_is_seen(backend, field, fist):
    rays, *rest = fist
    samples = type(rays.samples)(*(values[:0] for values in rays.samples))
    none = rays._replace(
        **{name: getattr(rays, name)[:0] for name in ("pixel", "directions", "t", "dt", "is_stopped")}, samples=samples
    )
    seen = backend.shade(field, none, *rest)
    assert [len(values) for values in seen] == [0, 0, 0, 0]
    seen.channels.sum().backward()
    assert not field.planes[0].table.grad.any()


@pytest.mark.slow
def test_geometry_that_is_learnt_goes_by_torch(monkeypatch, field, fist):
    rays, *rest = fist
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
