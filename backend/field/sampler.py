"""Mesh-guided sampling: where along each ray the radiance field is queried (paper section 3.3).

The field lives in the shell, a narrow band of half-width `shell_m` around the posed surface. A ray is sampled where it
is inside the mesh inflated by `shell_m`, up to where it first enters the mesh deflated by `shell_m`. There the hand is
opaque whatever the field returns: where two parts of the skin touch, a sample inside one lies just outside the other
and would count as air. So a ray past a fingertip over the palm gets one interval on each and no samples in the gap,
and a ray that only grazes the finger continues to what lies behind it.

Where there is an avatar's surface, a ray that meets it is sampled there alone: from `BEFORE_M` before it to
`BEHIND_M` behind it, where it ends opaque. Few samples then do what many did along the whole shell.

Along a ray, `t` is depth in metres along the optical axis (ray directions have depth 1).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ..geometry.mesh import Topology
from ..geometry.rasterise import Fragments, NearestFronts, nearest_fronts, rasterise
from .rays import CameraTensors, HandInView, project, ray_directions, ray_origins

BEFORE_M, BEHIND_M = 0.0015, 0.0025
"""How far before and behind an avatar's surface its rays are sampled: depth, template metres."""
LEAST_REACH_M = 0.0003
"""Rays with less of the shell there are sampled along all of it: the surface lies outside."""
SAMPLES_AT_SURFACE = 3
"""Samples per ray where there is an avatar's surface."""


@dataclass(frozen=True)
class SamplerConfig:
    """How the rays are sampled."""

    samples_per_ray: int = 8
    """N."""
    shell_m: float = 0.003
    """Half-width of the shell, metres of the template."""
    max_layers: int = 10
    """Surface crossings (front and back) kept per ray; the farthest are dropped."""

    def samples_along(self, hand: HandInView) -> int:
        """Return the N samples of rays in this view: fewer if it has an avatar's surface."""
        return self.samples_per_ray if hand.surface_depth is None else self.at_surface.samples_per_ray

    @property
    def at_surface(self) -> SamplerConfig:
        """How rays are sampled that meet an avatar's surface."""
        return replace(self, samples_per_ray=min(self.samples_per_ray, SAMPLES_AT_SURFACE))


class RaySamples(NamedTuple):
    """R rays of N samples.

    Attributes:
        pixel: [R] row * width + column.
        directions: [R, 3] world, depth 1.
        t: [R, N] depth of each sample, m.
        dt: [R] depth step of each ray's samples, m (its intervals' total length / N).
        points: [R, N, 3] world, m.
        is_stopped: [R] whether the ray ends opaque: at the deflated mesh, or behind an avatar's surface.
        entry_face: [R, L] faces whose inflated fronts the ray crosses, nearest first.
        is_open: [R, N, L] which of the crossings lie before each sample, in the sample's own interval.
    """

    pixel: Tensor
    directions: Tensor
    t: Tensor
    dt: Tensor
    points: Tensor
    is_stopped: Tensor
    entry_face: Tensor
    is_open: Tensor


class Intervals(NamedTuple):
    """Disjoint intervals in order, per ray.

    Attributes:
        pixel: [R].
        start: [R, M] m.
        end: [R, M] m; an empty interval has end = start.
        since: [R, M] depth at which the ray enters the shell there, m: `start` may lie behind it.
        is_stopped: [R] whether the ray ends opaque: at the deflated mesh, or behind an avatar's surface.
        entry: [R, L] depths of the inflated mesh's fronts, nearest first, infinite where there is none, m.
        entry_face: [R, L] the faces of those fronts.
    """

    pixel: Tensor
    start: Tensor
    end: Tensor
    since: Tensor
    is_stopped: Tensor
    entry: Tensor
    entry_face: Tensor


class Crossings(NamedTuple):
    """Crossings of the inflated mesh, one row per ray that has any, nearest first.

    Attributes:
        pixel: [R].
        depth: [R, L] m, padded with infinite depth.
        face: [R, L].
        is_front: [R, L].
    """

    pixel: Tensor
    depth: Tensor
    face: Tensor
    is_front: Tensor


def sample_rays(hand: HandInView, config: SamplerConfig, generator: torch.Generator | None = None) -> RaySamples:
    """Sample all rays that meet the shell.

    Args:
        hand: the posed hand and its camera.
        config: of the sampler.
        generator: jitters the samples within their strata; None puts them at the strata's centres.
    """
    intervals, camera = shell_intervals(hand, config), hand.camera
    directions = ray_directions(camera, intervals.pixel)
    t, dt, since = _place_samples(intervals, config.samples_along(hand), generator)
    points = ray_origins(camera, intervals.pixel)[:, None, :] + t[..., None] * directions[:, None, :]
    entry = intervals.entry[:, None, :]
    is_open = (entry <= t[..., None]) & (entry >= since[..., None])
    return RaySamples(intervals.pixel, directions, t, dt, points, intervals.is_stopped, intervals.entry_face, is_open)


def shell_intervals(hand: HandInView, config: SamplerConfig) -> Intervals:
    """Find the intervals of every ray that meets the shell."""
    mesh, topology, camera, surface_depth = hand[:4]
    shell = config.shell_m * mesh.scale * mesh.normals
    outer = _fragments_of(mesh.vertices + shell, topology, camera)
    inner = _fragments_of(mesh.vertices - shell, topology, camera)
    crossings = _by_ray(outer, config.max_layers)
    inside, pixel = _inside_intervals(crossings), crossings.pixel
    intervals = _stop_at(inside, nearest_fronts(inner, camera.size_px).depth[pixel])
    if surface_depth is not None:
        intervals = _about(intervals, surface_depth[pixel], mesh.scale)
    return _without_empty(intervals)


def _fragments_of(vertices: Tensor, topology: Topology, camera: CameraTensors) -> Fragments:
    positions_px, depth = project(camera, vertices)
    return rasterise(positions_px, depth, topology.faces, camera.size_px, camera.is_orthographic)


def first_hit(hand: HandInView) -> NearestFronts:
    """Find the mesh's first front face per pixel."""
    return nearest_fronts(_fragments_of(hand.mesh.vertices, hand.topology, hand.camera), hand.camera.size_px)


def _by_ray(fragments: Fragments, max_layers: int) -> Crossings:
    """Arrange fragments in tables of one row per ray, sorted by depth."""
    order = torch.argsort(fragments.depth)
    order = order[torch.argsort(fragments.pixel[order], stable=True)]
    pixel, row, count = torch.unique_consecutive(fragments.pixel[order], return_inverse=True, return_counts=True)
    column = torch.arange(len(row), device=row.device) - (torch.cumsum(count, 0) - count)[row]
    fits = column < max_layers
    at, order = (row[fits], column[fits]), order[fits]
    shape = (len(pixel), max_layers)
    depth = fragments.depth.new_full(shape, torch.inf).index_put(at, fragments.depth[order])
    face = torch.zeros(shape, dtype=torch.long, device=row.device).index_put(at, fragments.face[order])
    is_front = torch.zeros(shape, dtype=torch.bool, device=row.device).index_put(at, fragments.is_front[order])
    return Crossings(pixel, depth, face, is_front)


def _inside_intervals(crossings: Crossings) -> Intervals:
    """Find the intervals in which each ray is inside: from a crossing that raises its nesting to 1 to the next exit.

    A ray whose last exit is missing (clipped, or beyond the kept crossings) ends at its last crossing.
    """
    depth, is_front = crossings.depth, crossings.is_front
    is_hit = depth.isfinite()
    step = torch.where(is_hit, torch.where(is_front, 1, -1), 0)
    nesting = step.cumsum(1)
    opens = is_hit & is_front & (nesting - step <= 0)
    last = torch.where(is_hit, depth, torch.zeros_like(depth)).amax(1, keepdim=True)
    exits = torch.where(is_hit & (nesting <= 0), depth, last)
    exits = torch.where(is_hit, exits, last.expand_as(exits))
    next_exit = exits.flip(1).cummin(1).values.flip(1)
    start = torch.where(opens, depth, torch.zeros_like(depth))
    end = torch.where(opens, torch.maximum(next_exit, start), start)
    entry = torch.where(is_front, depth, torch.full_like(depth, torch.inf))
    is_stopped = torch.zeros_like(crossings.pixel, dtype=torch.bool)
    return Intervals(crossings.pixel, start, end, start, is_stopped, entry, crossings.face)


def _stop_at(intervals: Intervals, depth: Float[Tensor, " R"]) -> Intervals:
    """Clip the intervals at a depth; a ray that this shortens is stopped."""
    end = torch.minimum(intervals.end, depth[:, None])
    is_stopped = depth < intervals.end.amax(1)
    return intervals._replace(start=torch.minimum(intervals.start, end), end=end, is_stopped=is_stopped)


def _about(intervals: Intervals, depth: Float[Tensor, " R"], scale: Float[Tensor, ""]) -> Intervals:
    """Clip the intervals to what lies about a surface; where that leaves next to nothing, they stay."""
    near, far = (depth - BEFORE_M * scale)[:, None], (depth + BEHIND_M * scale)[:, None]
    start, end = (torch.minimum(torch.maximum(values, near), far) for values in (intervals.start, intervals.end))
    is_about = depth.isfinite() & ((end - start).sum(1) > LEAST_REACH_M * scale)
    return intervals._replace(
        start=torch.where(is_about[:, None], start, intervals.start),
        end=torch.where(is_about[:, None], end, intervals.end),
        is_stopped=intervals.is_stopped | (is_about & (intervals.end > far).any(1)),
    )


def _without_empty(intervals: Intervals) -> Intervals:
    is_live = (intervals.end - intervals.start).sum(1) > 0
    return Intervals(*(values[is_live] for values in intervals))


def _place_samples(
    intervals: Intervals, count: int, generator: torch.Generator | None
) -> tuple[Float[Tensor, "R N"], Float[Tensor, " R"], Float[Tensor, "R N"]]:
    """Place equal strata on the union of each ray's intervals: depths, their common step, the intervals' `since`."""
    length = intervals.end - intervals.start
    filled = length.cumsum(1)
    total = filled[:, -1]
    offset = strata(len(total), count, length, generator) * total[:, None]
    index = torch.searchsorted(filled, offset.contiguous()).clamp(max=length.shape[1] - 1)
    before = (filled - length).gather(1, index)
    start, since = (values.gather(1, index) for values in (intervals.start, intervals.since))
    return start + offset - before, total / count, since


def strata(rays: int, count: int, like: Tensor, generator: torch.Generator | None) -> Float[Tensor, "R N"]:
    """Draw one point in each of `count` equal parts of (0, 1) per ray: jittered, or their centres."""
    if generator is None:
        jitter = like.new_full((rays, count), 0.5)
    else:
        jitter = torch.rand((rays, count), generator=generator, device=like.device, dtype=like.dtype)
    return (torch.arange(count, device=like.device) + jitter) / count
