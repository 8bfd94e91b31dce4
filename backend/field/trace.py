"""Rays on the surface: which rays meet the shell, where each is sampled, and where its samples lie over the skin."""

from __future__ import annotations

import torch

from ..geometry.uvh import SurfaceSamples
from .rays import HandInView, SurfaceRays
from .sampler import SamplerConfig, sample_rays
from .surface_tracking import track


def trace(hand: HandInView, config: SamplerConfig, generator: torch.Generator | None = None) -> SurfaceRays:
    """Sample the rays that meet the shell and project the samples onto the surface.

    Args:
        hand: the posed hand and its camera.
        config: of the sampler.
        generator: jitters the samples within their strata; None puts them at the strata's centres.
    """
    rays, mesh = sample_rays(hand, config, generator), hand.mesh
    samples = track(rays.points, rays.entry_face, rays.is_open, hand.topology, mesh)
    samples = SurfaceSamples(samples.face, samples.barycentric, samples.height_m / mesh.scale)
    return SurfaceRays(rays.pixel, rays.directions, rays.t, rays.dt, rays.is_stopped, samples)
