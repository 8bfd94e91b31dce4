"""Asks the field along traced rays."""

from __future__ import annotations

from collections.abc import Callable

import torch

from ..rendering.device import has_kernels
from .conditions import FrameConditions, field_inputs
from .field import PaperField, PlaneField
from .rays import HandInView, SurfaceRays, split_rays
from .volume import Composite, Steps

# Samples the field is asked for at once: bounds memory.
_SAMPLES_AT_ONCE = 65536


def shade_in_chunks(
    field: PaperField | PlaneField,
    rays: SurfaceRays,
    hand: HandInView,
    conditions: FrameConditions,
    shell_m: float,
    before_chunk: Callable[[], None],
) -> Composite:
    """`shade`, in bounded memory; what `before_chunk` raises ends it."""
    parts = []
    for chunk in split_rays(rays, max(1, _SAMPLES_AT_ONCE // rays.t.shape[1])):
        before_chunk()
        parts.append(shade(field, chunk, hand, conditions, shell_m))
    return Composite(*(torch.cat(values) for values in zip(*parts, strict=True)))


def shade(
    field: PaperField | PlaneField,
    rays: SurfaceRays,
    hand: HandInView,
    conditions: FrameConditions,
    shell_m: float,
) -> Composite:
    """Ask the field at the samples and composite each ray."""
    topology, scale = hand.topology, hand.mesh.scale
    length = rays.directions.norm(dim=-1)
    footprint_m = (rays.t / (hand.view.focal_px * scale)).flatten()
    unit = rays.directions / length[:, None]
    steps = Steps(rays.t, rays.dt * length / scale * 1000, rays.is_stopped)
    if isinstance(field, PlaneField) and has_kernels(rays.t.device) and not _moves(rays, conditions, steps):
        from ..fast.shade import composite_gathered

        told = composite_gathered(field, rays.samples, topology, conditions, footprint_m, steps, shell_m)
        return field.decode(told, unit)
    exposure = field.exposure(conditions.visibility)
    inputs = field_inputs(rays.samples, topology, conditions, exposure, unit, footprint_m, shell_m)
    return field(inputs, steps)


def _moves(rays: SurfaceRays, conditions: FrameConditions, steps: Steps) -> bool:
    """Whether gradients are to reach the geometry, which the kernels take as given."""
    geometry = (*rays.samples, conditions.vertex_channels, conditions.visibility, rays.directions, *steps)
    return torch.is_grad_enabled() and any(values.requires_grad for values in geometry)
