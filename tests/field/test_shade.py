"""The field along traced rays: chunks, and what a step and a pixel measure."""

import pytest
import torch
from livehand.backend.avatars.avatar import build_field
from livehand.backend.compute.backend import RenderHooks
from livehand.backend.compute.reference import ChunkedRayRenderer, ReferenceBackend
from livehand.backend.field.field import FieldConfig, PaperField
from livehand.backend.field.rays import HandInView, split_rays
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.field.shade import shade
from livehand.backend.field.trace import trace as trace_reference
from livehand.backend.field.volume import Composite
from livehand.backend.geometry.mesh import posed_mesh

CONFIG = SamplerConfig(4, 0.003)
FIELDS = {"paper": FieldConfig(kind="paper"), "planes": FieldConfig(planes=((32, 3, 4), (128, 1, 4)), relief=8)}


class Recorder(PaperField):
    """A field that keeps its inputs."""

    def forward(self, inputs, steps, read_plane):
        self.inputs, self.steps = inputs, steps
        rays = len(steps.t)
        return Composite(torch.zeros(rays, 32), torch.zeros(rays), torch.zeros(rays), torch.zeros_like(steps.t))


@pytest.fixture(scope="module")
def scene(posed, seen_from):
    """(rays, hand in view, conditions)."""
    hand = posed("relaxed")
    seen = HandInView(hand.mesh, hand.topology, seen_from(hand.mesh, (0.2, 1, 0.4), (20, 22)))
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
