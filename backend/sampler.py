"""Mesh-guided sampling: where along each ray the radiance field is asked (paper section 3.3).

The field lives in a shell of thickness 2 x `shell_m` about the posed surface. A ray enters the shell at the front faces
of the mesh inflated by the shell; each entry opens an interval, which ends where the ray leaves the inflated mesh, or,
where it goes deeper than the shell (there the hand is opaque), one shell's crossing later; nothing behind that is
sampled. So a ray past a fingertip over the palm gets one short interval on each, and no samples in the gap between.

Along a ray, `t` is depth in metres along the optical axis (ray directions have depth 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from .geometry.mesh import PosedMesh, Topology
from .geometry.rasterise import Fragments, rasterise


@dataclass(frozen=True)
class SamplerConfig:
    """How the rays are sampled."""

    samples_per_ray: int = 8
    """N."""
    shell_m: float = 0.003
    """Half thickness of the shell, metres of the template."""
    max_layers: int = 8
    """Surface crossings (front and back) kept per ray; the farthest are dropped."""
    min_cosine: float = 0.15
    """Bounds the crossing of a grazing ray: the shell's thickness over this."""


class View(NamedTuple):
    """A camera as tensors: K [3, 3] px, world2cam [4, 4], (width, height) px."""

    K: Tensor
    world2cam: Tensor
    size_px: tuple[int, int]


class RaySamples(NamedTuple):
    """R rays of N samples.

    Attributes:
        pixel: [R] row * width + column.
        directions: [R, 3] world, depth 1.
        t: [R, N] depth of each sample, m.
        dt: [R] depth step of each ray's samples, m (its intervals' total length / N).
        points: [R, N, 3] world, m.
    """

    pixel: Tensor
    directions: Tensor
    t: Tensor
    dt: Tensor
    points: Tensor


class Intervals(NamedTuple):
    """Disjoint intervals in order, per ray: start and end [R, M] m; an empty one has end = start. pixel [R]."""

    pixel: Tensor
    start: Tensor
    end: Tensor


def sample_rays(
    mesh: PosedMesh,
    topology: Topology,
    view: View,
    config: SamplerConfig,
    generator: torch.Generator | None = None,
    scene_depth: Float[Tensor, "H W"] | None = None,
) -> RaySamples:
    """Samples of all rays that meet the shell.

    Args:
        mesh: the posed hand.
        topology: its topology.
        view: the (low-resolution) camera.
        config: how to sample.
        generator: jitters the samples within their strata; None puts them at the strata's centres.
        scene_depth: [H, W] depth of the scene, m: intervals end there.
    """
    intervals = shell_intervals(mesh, topology, view, config)
    if scene_depth is not None:
        intervals = _stop_at(intervals, scene_depth.reshape(-1)[intervals.pixel])
    directions = ray_directions(view, intervals.pixel)
    t, dt = _place_samples(intervals, config.samples_per_ray, generator)
    origin = -view.world2cam[:3, :3].T @ view.world2cam[:3, 3]
    return RaySamples(intervals.pixel, directions, t, dt, origin + t[..., None] * directions[:, None, :])


def shell_intervals(mesh: PosedMesh, topology: Topology, view: View, config: SamplerConfig) -> Intervals:
    """The intervals of every ray that meets the shell."""
    shell = config.shell_m * mesh.scale
    inflated = mesh.vertices + shell * mesh.normals
    positions_px, depth = project(view, inflated)
    fragments = rasterise(positions_px, depth, topology.faces, view.size_px)
    crossing = 2 * shell / _facing_cosine(inflated, topology, view, fragments).clamp(min=config.min_cosine)
    return _intervals_of(fragments, crossing, config.max_layers)


def project(view: View, points: Float[Tensor, "*n 3"]) -> tuple[Float[Tensor, "*n 2"], Float[Tensor, "*n"]]:
    """World points -> (px, depth m)."""
    in_camera = points @ view.world2cam[:3, :3].T + view.world2cam[:3, 3]
    homogeneous = in_camera @ view.K.T
    return homogeneous[..., :2] / homogeneous[..., 2:], in_camera[..., 2]


def ray_directions(view: View, pixel: Tensor) -> Float[Tensor, "R 3"]:
    """World directions of depth 1 through pixel centres."""
    width = view.size_px[0]
    ones = torch.ones_like(pixel, dtype=view.K.dtype)
    centre = torch.stack([pixel % width + 0.5, pixel // width + 0.5, ones], -1).to(view.K.dtype)
    return centre @ torch.linalg.inv(view.K).T @ view.world2cam[:3, :3]


def _facing_cosine(inflated: Tensor, topology: Topology, view: View, fragments: Fragments) -> Float[Tensor, " N"]:
    """|cosine| between ray and face, times the ray's length per depth: turns thickness into depth along the ray."""
    a, b, c = inflated[topology.faces].unbind(1)
    normals = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=-1)
    directions = ray_directions(view, fragments.pixel)
    return (normals[fragments.face] * directions).sum(-1).abs()


def _intervals_of(fragments: Fragments, crossing: Float[Tensor, " N"], max_layers: int) -> Intervals:
    """Sort each ray's crossings, open an interval at every front face, and stop behind the first solid one."""
    pixel, depth, is_front, crossing = _by_ray(fragments, crossing, max_layers)  # [R], [R, M] x 3
    is_hit = depth.isfinite()
    nesting = torch.where(is_hit, torch.where(is_front, 1, -1), 0).cumsum(1)
    exit_depth = _next_exit(depth, is_hit & (nesting <= 0))
    opens = is_hit & is_front
    start = torch.where(opens, depth, torch.zeros_like(depth))
    reach = start + crossing
    is_solid = opens & (reach < exit_depth)
    infinity = torch.full_like(depth, torch.inf)
    stop = torch.where(is_solid, reach, infinity).amin(1, keepdim=True)
    is_kept = opens & (start < stop)
    end = torch.where(is_kept, torch.minimum(reach, exit_depth), start)
    start, end = _disjoint(start, end, is_kept)
    return _without_empty(Intervals(pixel, start, end))


def _by_ray(fragments: Fragments, crossing: Tensor, max_layers: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Fragments as a table of one row per ray, sorted by depth, padded with infinite depth."""
    order = torch.argsort(fragments.depth)
    order = order[torch.argsort(fragments.pixel[order], stable=True)]
    pixel, row, count = torch.unique_consecutive(fragments.pixel[order], return_inverse=True, return_counts=True)
    column = torch.arange(len(row), device=row.device) - (torch.cumsum(count, 0) - count)[row]
    fits = column < max_layers
    row, column, order = row[fits], column[fits], order[fits]
    shape = (len(pixel), max_layers)
    depth = crossing.new_full(shape, torch.inf).index_put((row, column), fragments.depth[order])
    is_front = torch.zeros(shape, dtype=torch.bool, device=row.device).index_put(
        (row, column), fragments.is_front[order]
    )
    return pixel, depth, is_front, crossing.new_zeros(shape).index_put((row, column), crossing[order])


def _next_exit(depth: Tensor, is_exit: Tensor) -> Tensor:
    """Depth of the first exit at or after each crossing; infinite where none was kept."""
    exits = torch.where(is_exit, depth, torch.full_like(depth, torch.inf))
    return exits.flip(1).cummin(1).values.flip(1)


def _disjoint(start: Tensor, end: Tensor, is_kept: Tensor) -> tuple[Tensor, Tensor]:
    """Start each interval no earlier than all before it have ended."""
    reached = torch.where(is_kept, end, torch.zeros_like(end)).cummax(1).values
    before = torch.nn.functional.pad(reached[:, :-1], (1, 0))
    start = torch.maximum(start, before)
    return start, torch.maximum(start, torch.where(is_kept, end, start))


def _stop_at(intervals: Intervals, depth: Tensor) -> Intervals:
    end = torch.minimum(intervals.end, depth[:, None])
    return _without_empty(Intervals(intervals.pixel, torch.minimum(intervals.start, end), end))


def _without_empty(intervals: Intervals) -> Intervals:
    is_live = (intervals.end - intervals.start).sum(1) > 0
    return Intervals(*(values[is_live] for values in intervals))


def _place_samples(
    intervals: Intervals, count: int, generator: torch.Generator | None
) -> tuple[Float[Tensor, "R N"], Float[Tensor, " R"]]:
    """Equal strata over the union of each ray's intervals: sample depths and their common step."""
    length = intervals.end - intervals.start
    filled = length.cumsum(1)
    total = filled[:, -1]
    offset = _strata(len(total), count, length, generator) * total[:, None]
    index = torch.searchsorted(filled, offset.contiguous()).clamp(max=length.shape[1] - 1)
    before = (filled - length).gather(1, index)
    return intervals.start.gather(1, index) + offset - before, total / count


def _strata(rays: int, count: int, like: Tensor, generator: torch.Generator | None) -> Float[Tensor, "R N"]:
    if generator is None:
        jitter = like.new_full((rays, count), 0.5)
    else:
        jitter = torch.rand((rays, count), generator=generator, device=like.device, dtype=like.dtype)
    return (torch.arange(count, device=like.device) + jitter) / count
