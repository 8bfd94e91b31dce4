"""Rays on the surface: which rays meet the shell, where each is sampled, and where its samples lie over the skin."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from .device import has_kernels
from .geometry.mesh import PosedMesh, Topology
from .geometry.tracking import track
from .geometry.uvh import SurfaceSamples
from .rays import SurfaceRays, View
from .sampler import SamplerConfig, sample_rays


def trace(
    mesh: PosedMesh,
    topology: Topology,
    view: View,
    config: SamplerConfig,
    generator: torch.Generator | None = None,
    scene_depth: Float[Tensor, "H W"] | None = None,
) -> SurfaceRays:
    """Sample the rays that meet the shell and lay the samples on the surface.

    Args:
        mesh: the posed hand.
        topology: its topology.
        view: the (low-resolution) camera.
        config: how to sample.
        generator: jitters the samples within their strata; None puts them at the strata's centres.
        scene_depth: [H, W] depth of the scene, m: rays end there.
    """
    if has_kernels(mesh.vertices.device):
        from .cpu import tracing

        return tracing.trace(mesh, topology, view, config, generator, scene_depth)
    return trace_with_torch(mesh, topology, view, config, generator, scene_depth)


def trace_with_torch(
    mesh: PosedMesh,
    topology: Topology,
    view: View,
    config: SamplerConfig,
    generator: torch.Generator | None = None,
    scene_depth: Float[Tensor, "H W"] | None = None,
) -> SurfaceRays:
    """`trace` on any device, and the reference of the kernels."""
    rays = sample_rays(mesh, topology, view, config, generator, scene_depth)
    samples = track(rays.points, rays.entry_face, rays.is_open, topology, mesh)
    samples = SurfaceSamples(samples.face, samples.barycentric, samples.height_m / mesh.scale)
    return SurfaceRays(rays.pixel, rays.directions, rays.t, rays.dt, rays.is_stopped, samples)
