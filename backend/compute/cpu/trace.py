"""`field.trace.trace` on the CPU, by the kernels."""

from __future__ import annotations

import torch

from ...field.rays import HandInView, SurfaceRays
from ...field.sampler import SamplerConfig, strata
from ...geometry.uvh import SurfaceSamples
from ..kernels.rays import trace_samples
from ..kernels.records import TracedSamples
from .shell import live_rays, rasterise_shell, surface_of
from .threads import in_parallel


def trace(hand: HandInView, config: SamplerConfig, generator: torch.Generator | None = None) -> SurfaceRays:
    """Sample the rays that meet the shell and project the samples onto the surface."""
    crossings = rasterise_shell(hand, config)
    pixel, directions, rays = live_rays(crossings, hand)
    surface, shape = surface_of(hand.mesh, hand.topology), (len(pixel), config.samples_along(hand))
    offsets = strata(*shape, directions, generator).numpy()
    t, height, barycentric = torch.empty(shape), torch.empty(shape), torch.empty(*shape, 3)
    dt, is_stopped = torch.empty(shape[0]), torch.empty(shape[0], dtype=torch.bool)
    face = torch.empty(shape, dtype=torch.long)
    out = TracedSamples(*(values.numpy() for values in (t, dt, is_stopped, face, barycentric, height)))
    in_parallel(lambda first, last: trace_samples(rays, offsets, crossings, surface, first, last, out), len(pixel))
    samples = SurfaceSamples(face.flatten(), barycentric.flatten(0, 1), height.flatten() / hand.mesh.scale)
    return SurfaceRays(pixel, directions, t, dt, is_stopped, samples)
