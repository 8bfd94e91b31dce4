"""Rays through the shell, by kernels: as `field.sampler.first_hit` and `field.surface_tracking`.

One rasterisation of the shell a frame, from which all samples are placed; and a mesh before a camera, as
`field.rays.project` and `geometry.rasterise.nearest_fronts`, which is worth its kernels where it is a detail surface.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...field.rays import CameraTensors, HandInView, SurfaceRays, project, ray_directions, ray_origins
from ...field.sampler import BEFORE_M, BEHIND_M, LEAST_REACH_M, SamplerConfig, strata
from ...geometry.mesh import PosedMesh, Topology
from ...geometry.rasterise import NearestFronts
from ...geometry.uvh import SurfaceSamples
from ..kernels.raster import ProjectedMesh, find_crossings, front_rows, nearest_depth, nearest_of_rows, project_vertices
from ..kernels.rays import (
    FACE_COLUMNS,
    Rays,
    ShellCrossings,
    SurfaceTables,
    TracedSamples,
    face_shapes,
    find_live,
    gather_shapes,
    trace_samples,
)
from ..reference import ReferenceBackend
from .arrays import as_arrays
from .threads import in_parallel


def projected_mesh(camera: CameraTensors, vertices: Float[Tensor, "V 3"], faces: Int[Tensor, "F 3"]) -> ProjectedMesh:
    """Project the mesh into the camera."""
    count = len(vertices)
    at, corners, *matrices = as_arrays(vertices, faces, camera.K, camera.world2cam)
    positions_px, depth, is_flat = np.empty((count, 2), np.float32), np.empty(count, np.float32), camera.is_orthographic
    in_parallel(lambda first, last: project_vertices(at, *matrices, is_flat, first, last, positions_px, depth), count)
    return ProjectedMesh(positions_px, depth, corners, is_flat)


class Fronts(NamedTuple):
    """What an image of P pixels shows of a mesh of M faces.

    Attributes:
        depth: [P] m; infinite for none.
        face: [P] -1 for none.
        rows: [M, 2] the first row of pixels that a front face touches, and the one after the last; equal for none.
    """

    depth: np.ndarray
    face: np.ndarray
    rows: np.ndarray


def find_fronts(mesh: ProjectedMesh, size_px: tuple[int, int]) -> Fronts:
    """Find the first front faces of a projected mesh."""
    width, height = size_px
    depth, face = np.full(width * height, np.inf, np.float32), np.full(width * height, -1, np.int32)
    rows = np.empty((len(mesh.faces), 2), np.int32)
    in_parallel(lambda first, last: front_rows(mesh, width, height, first, last, rows), len(rows))
    in_parallel(lambda first, last: nearest_of_rows(mesh, rows, width, first, last, depth, face), height)
    return Fronts(depth, face, rows)


def rasterise_shell(hand: HandInView, config: SamplerConfig) -> ShellCrossings:
    """Rasterise the crossings of the inflated mesh, and the first front face of the deflated one."""
    mesh, topology, camera, surface_depth = hand[:4]
    shell = config.shell_m * mesh.scale * mesh.normals
    faces, (width, height) = topology.faces.numpy(), camera.size_px
    outer, inner = (
        ProjectedMesh(positions_px.numpy(), depth.numpy(), faces, camera.is_orthographic)
        for positions_px, depth in (project(camera, mesh.vertices + shell), project(camera, mesh.vertices - shell))
    )
    pixels = width * height
    crossings = ShellCrossings(
        depth=np.empty((pixels, config.max_layers), np.float32),
        face=np.empty((pixels, config.max_layers), np.int32),
        counts=np.zeros(pixels, np.int32),
        inner=np.full(pixels, np.inf, np.float32),
        known=np.full(pixels, np.inf, np.float32) if surface_depth is None else surface_depth.numpy(),
        before=np.float32(BEFORE_M * mesh.scale),
        behind=np.float32(BEHIND_M * mesh.scale),
        least_reach=np.float32(LEAST_REACH_M * mesh.scale),
    )

    def rasterise_rows(first: int, last: int) -> None:
        find_crossings(outer, width, first, last, crossings)
        nearest_depth(inner, width, first, last, False, crossings.inner)

    in_parallel(rasterise_rows, height)
    return crossings


def first_hit(hand: HandInView) -> NearestFronts:
    """Compute `field.sampler.first_hit` by kernels."""
    positions_px, depth = project(hand.camera, hand.mesh.vertices)
    faces = hand.topology.faces.numpy()
    mesh = ProjectedMesh(positions_px.numpy(), depth.numpy(), faces, hand.camera.is_orthographic)
    fronts = find_fronts(mesh, hand.camera.size_px)
    return NearestFronts(torch.as_tensor(fronts.depth), torch.as_tensor(fronts.face))


def live_rays(crossings: ShellCrossings, hand: HandInView) -> tuple[Tensor, Tensor, Rays]:
    """Find pixels [R] and directions [R, 3] of the rays that have anything to sample, also as the kernels take them."""
    is_live = np.zeros(len(crossings.counts), np.bool_)
    in_parallel(lambda first, last: find_live(crossings, first, last, is_live), len(is_live))
    pixel = torch.as_tensor(is_live.nonzero()[0])
    directions = ray_directions(hand.camera, pixel)
    return pixel, directions, Rays(*as_arrays(pixel, directions, ray_origins(hand.camera, pixel)))


def surface_of(mesh: PosedMesh, topology: Topology) -> SurfaceTables:
    """Prepare the posed mesh for closest-point searches."""
    vertices, faces, neighbours = mesh.vertices.numpy(), topology.faces.numpy(), topology.neighbours.numpy()
    shapes = np.empty((len(faces), FACE_COLUMNS), np.float32)
    around = np.empty((len(faces), FACE_COLUMNS, neighbours.shape[1] - 1), np.float32)
    in_parallel(lambda first, last: face_shapes(vertices, faces, first, last, shapes), len(faces))
    in_parallel(lambda first, last: gather_shapes(shapes, neighbours, first, last, around), len(faces))
    return SurfaceTables(shapes, around, neighbours, faces, vertices, mesh.normals.numpy())


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


class RayKernels(ReferenceBackend):
    """Rays by kernels."""

    first_hit = staticmethod(first_hit)
    trace = staticmethod(trace)
