"""Rays through the shell: as `field.sampler.first_hit`, `field.surface_tracking.trace` and `field.rays`."""

from __future__ import annotations

import logging
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...field.rays import CameraTensors, HandInView, SurfaceRays
from ...field.sampler import BEFORE_M, BEHIND_M, LEAST_REACH_M, SamplerConfig, strata
from ...field.surface_tracking import trace as trace_reference
from ...geometry.rasterise import NearestFronts
from ...geometry.uvh import SurfaceSamples
from ...records.errors import LiveHandError
from ..reference import ReferenceBackend
from .kernels.compiled import INFINITE_BITS, lanes_of, launch
from .kernels.raster import find_fronts, prepare_view, project_vertices, ray_directions, read_words
from .kernels.raster import view_directions as fill_views
from .kernels.shell import face_corners, fill_intervals, find_crossings, trace_samples

LOGGER = logging.getLogger(__name__)

CAPACITY = 32
"""Crossings of the inflated mesh that a pixel's list holds; most that was seen: 6."""


class ShellLists(NamedTuple):
    """Crossings and intervals of the rays of P pixels, in lists of L entries.

    Attributes:
        counts: [P] of crossings that are kept.
        depth: [L, P] of crossings, nearest first, m.
        face: [L, P] of crossings; a back face f is -1 - f.
        start: [L, P] of intervals, m.
        end: [L, P] of intervals, m.
        since: [L, P] depth at which the ray enters the shell there, m.
        intervals: [P] their number.
        total: [P] their length, m.
        is_stopped: [P] as in `SurfaceRays`.
        is_live: [P] whether anything is inside.
        overflow: [1] 1 where a pixel has more crossings than its list holds.
    """

    counts: Tensor
    depth: Tensor
    face: Tensor
    start: Tensor
    end: Tensor
    since: Tensor
    intervals: Tensor
    total: Tensor
    is_stopped: Tensor
    is_live: Tensor
    overflow: Tensor

    @classmethod
    def empty(cls, pixels: int, device: torch.device) -> ShellLists:
        """Allocate lists without crossings."""

        def new(*shape: int, kind: torch.dtype = torch.float32) -> Tensor:
            return torch.empty(shape, dtype=kind, device=device)

        counts, overflow = torch.zeros(pixels + 1, dtype=torch.int32, device=device).split((pixels, 1))
        depth, start, end, since = (new(CAPACITY, pixels) for _ in range(4))
        face, intervals = new(CAPACITY, pixels, kind=torch.int32), new(pixels, kind=torch.int32)
        is_stopped, is_live = (new(pixels, kind=torch.bool) for _ in range(2))
        return cls(counts, depth, face, start, end, since, intervals, new(pixels), is_stopped, is_live, overflow)


def check_perspective(camera: CameraTensors) -> None:
    """Raise LiveHandError if the camera is orthographic, which these kernels do not know."""
    if camera.is_orthographic:
        raise LiveHandError(
            "a camera must be perspective to be rendered by a GPU's kernels, got an orthographic one; render on the CPU"
        )


def view_of(camera: CameraTensors) -> Float[Tensor, "4 3"]:
    """Return a camera's centre, m, and the directions of a column, of a row, and of pixel (0, 0), world."""
    check_perspective(camera)
    view = torch.empty(4, 3, device=camera.K.device)
    launch(prepare_view, 1, camera.K, camera.world2cam, view)
    return view


def projected(
    camera: CameraTensors, vertices: Float[Tensor, "V 3"], normals: Float[Tensor, "V 3"], lift_m: Tensor
) -> Float[Tensor, "V 3"]:
    """Project vertices that are raised along their normals: x and y, px, and depth, m."""
    check_perspective(camera)
    out = torch.empty_like(vertices, memory_format=torch.contiguous_format)
    launch(project_vertices, len(vertices), vertices, normals, lift_m.reshape(1), camera.K, camera.world2cam, out)
    return out


def shown_faces(
    at: Float[Tensor, "V 3"], faces: Int[Tensor, "F 3"], size_px: tuple[int, int], lanes: int
) -> Int[Tensor, " P"]:
    """Find the words of the nearest front faces of a projected mesh in pixels' centres."""
    width, height = size_px
    shown = torch.full((width * height,), -1, dtype=torch.int64, device=at.device)
    launch(find_fronts, (len(faces), lanes), at, faces, lanes, width, height, shown)
    return shown


def first_hit(hand: HandInView) -> NearestFronts:
    """Find the mesh's first front face per pixel."""
    vertices, normals = hand.mesh[:2]
    at = projected(hand.camera, vertices, normals, vertices.new_zeros(1))
    shown = shown_faces(at, hand.topology.faces, hand.camera.size_px, lanes_of(vertices.device))
    fronts = NearestFronts(torch.empty(len(shown), device=shown.device), torch.empty_like(shown))
    launch(read_words, len(shown), shown, *fronts)
    return fronts


def view_directions(camera: CameraTensors, pixel: Int[Tensor, " P"]) -> Float[Tensor, "P 3"]:
    """Compute unit world directions through pixel centres."""
    directions = torch.empty(len(pixel), 3, device=pixel.device)
    launch(fill_views, len(pixel), view_of(camera), pixel, camera.size_px[0], directions)
    return directions


def shell_lists(hand: HandInView, config: SamplerConfig) -> ShellLists:
    """Rasterise the shell and find the intervals of the rays of all pixels."""
    mesh, topology, camera, surface_depth = hand[:4]
    device, (width, height) = mesh.vertices.device, camera.size_px
    shell_m, lanes = config.shell_m * mesh.scale, lanes_of(device)
    outer, inner = (projected(camera, mesh.vertices, mesh.normals, lift_m) for lift_m in (shell_m, -shell_m))
    lists = ShellLists.empty(width * height, device)
    stop_bits = torch.full((width * height,), INFINITE_BITS, dtype=torch.int32, device=device)
    where = topology.faces, lanes, width, height
    launch(find_crossings, (len(topology.faces), lanes), outer, inner, *where, *lists[:3], stop_bits)
    if surface_depth is None:
        surface_depth = torch.full((width * height,), torch.inf, device=device)
    reaches_m = mesh.scale * mesh.vertices.new_tensor((BEFORE_M, BEHIND_M, LEAST_REACH_M))
    around = *lists[:3], stop_bits, surface_depth, reaches_m, config.max_layers
    launch(fill_intervals, width * height, *around, *lists[3:])
    return lists


def trace(hand: HandInView, config: SamplerConfig, generator: torch.Generator | None = None) -> SurfaceRays:
    """Sample the rays that meet the shell and project the samples onto the surface."""
    lists = shell_lists(hand, config)
    pixel = lists.is_live.nonzero()[:, 0]
    if bool(lists.overflow):
        LOGGER.warning("a ray crosses more than %d layers of the hand; torch traces this frame", CAPACITY)
        return trace_reference(hand, config, generator)
    mesh, topology, camera = hand[:3]
    view, count, samples = view_of(camera), len(pixel), config.samples_along(hand)
    directions = torch.empty(count, 3, device=pixel.device)
    launch(ray_directions, count, view, pixel, camera.size_px[0], directions)
    offsets = strata(count, samples, directions, generator)
    corners = mesh.vertices.new_empty(len(topology.faces), 3, 3)
    launch(face_corners, (len(topology.faces), 3), mesh.vertices, topology.faces, corners)
    t, height, dt = (
        directions.new_empty(count, samples),
        directions.new_empty(count, samples),
        directions.new_empty(count),
    )
    face, weights = pixel.new_empty(count, samples), directions.new_empty(count, samples, 3)
    surface = mesh.vertices, mesh.normals, topology.faces, topology.neighbours, corners, mesh.scale.reshape(1)
    out = t, dt, face, weights, height
    surface_m = lists.total if hand.surface_depth is None else hand.surface_depth
    launch(trace_samples, count, view, camera.size_px[0], pixel, offsets, surface_m, *lists[:8], *surface, *out)
    found = SurfaceSamples(face.flatten(), weights.flatten(0, 1), height.flatten())
    return SurfaceRays(pixel, directions, t, dt, lists.is_stopped[pixel], found)


class RayStages(ReferenceBackend):
    """Rays by Warp."""

    first_hit = staticmethod(first_hit)
    trace = staticmethod(trace)
    view_directions = staticmethod(view_directions)
