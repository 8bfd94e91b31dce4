"""Rays on the surface, by the kernels: `tracing.trace` on the CPU."""

from __future__ import annotations

import torch

from ..geometry.uvh import SurfaceSamples
from ..nerf.rays import HandInView, SurfaceRays, ray_directions, ray_origin
from ..nerf.sampler import SamplerConfig, strata
from .kernels.compiled import in_parallel
from .kernels.rays import lay_samples
from .shell import live_pixels, rasterise_shell, surface_arrays


def trace(hand: HandInView, config: SamplerConfig, generator: torch.Generator | None = None) -> SurfaceRays:
    """Sample the rays that meet the shell and lay the samples on the surface."""
    layers = rasterise_shell(hand, config)
    mesh, topology, view = hand
    pixel = torch.as_tensor(live_pixels(layers))
    directions, shape = ray_directions(view, pixel), (len(pixel), config.samples_per_ray)
    t, height, barycentric = torch.empty(shape), torch.empty(shape), torch.empty(*shape, 3)
    dt, is_stopped = torch.empty(shape[0]), torch.empty(shape[0], dtype=torch.bool)
    face = torch.empty(shape, dtype=torch.long)
    rays = (pixel, directions, ray_origin(view), strata(*shape, directions, generator))
    inputs = (*(values.numpy() for values in rays), tuple(layers), surface_arrays(mesh, topology))
    out = [values.numpy() for values in (t, dt, is_stopped, face, barycentric, height)]
    in_parallel(lambda first, last: lay_samples(*inputs, first, last, *out), len(pixel), torch.get_num_threads())
    samples = SurfaceSamples(face.flatten(), barycentric.flatten(0, 1), height.flatten() / mesh.scale)
    return SurfaceRays(pixel, directions, t, dt, is_stopped, samples)
