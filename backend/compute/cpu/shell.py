"""The rasterised shell: one rasterisation per frame, from which all samples are placed."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ...field.rays import HandInView, project, ray_directions, ray_origin
from ...field.sampler import BEFORE_M, BEHIND_M, LEAST_REACH_M, SamplerConfig
from ...geometry.mesh import PosedMesh, Topology
from ...geometry.rasterise import NearestFronts
from ..kernels.raster import find_crossings, nearest_depth
from ..kernels.rays import find_live
from ..kernels.records import ProjectedMesh, Rays, ShellCrossings, SurfaceTables
from ..kernels.surface import FACE_COLUMNS, face_shapes, gather_shapes
from .fronts import find_fronts
from .threads import in_parallel


def rasterise_shell(hand: HandInView, config: SamplerConfig) -> ShellCrossings:
    """The crossings of the inflated mesh, and the first front face of the deflated one."""
    mesh, topology, camera, known_depth = hand[:4]
    shell = config.shell_m * mesh.scale * mesh.normals
    faces, (width, height) = topology.faces.numpy(), camera.size_px
    outer, inner = (
        ProjectedMesh(positions_px.numpy(), depth.numpy(), faces)
        for positions_px, depth in (project(camera, mesh.vertices + shell), project(camera, mesh.vertices - shell))
    )
    pixels = width * height
    crossings = ShellCrossings(
        depth=np.empty((pixels, config.max_layers), np.float32),
        face=np.empty((pixels, config.max_layers), np.int32),
        counts=np.zeros(pixels, np.int32),
        inner=np.full(pixels, np.inf, np.float32),
        known=np.full(pixels, np.inf, np.float32) if known_depth is None else known_depth.numpy(),
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
    """`field.sampler.first_hit` by kernels."""
    positions_px, depth = project(hand.camera, hand.mesh.vertices)
    mesh = ProjectedMesh(positions_px.numpy(), depth.numpy(), hand.topology.faces.numpy())
    fronts = find_fronts(mesh, hand.camera.size_px)
    return NearestFronts(torch.as_tensor(fronts.depth), torch.as_tensor(fronts.face))


def live_rays(crossings: ShellCrossings, hand: HandInView) -> tuple[Tensor, Tensor, Rays]:
    """Pixels [R] and directions [R, 3] of the rays that have anything to sample, also as the kernels take them."""
    is_live = np.zeros(len(crossings.counts), np.bool_)
    in_parallel(lambda first, last: find_live(crossings, first, last, is_live), len(is_live))
    pixel = torch.as_tensor(is_live.nonzero()[0])
    directions = ray_directions(hand.camera, pixel)
    return pixel, directions, Rays(pixel.numpy(), directions.numpy(), ray_origin(hand.camera).numpy())


def surface_of(mesh: PosedMesh, topology: Topology) -> SurfaceTables:
    """The posed mesh prepared for closest-point searches."""
    vertices, faces, neighbours = mesh.vertices.numpy(), topology.faces.numpy(), topology.neighbours.numpy()
    shapes = np.empty((len(faces), FACE_COLUMNS), np.float32)
    around = np.empty((len(faces), FACE_COLUMNS, neighbours.shape[1] - 1), np.float32)
    in_parallel(lambda first, last: face_shapes(vertices, faces, first, last, shapes), len(faces))
    in_parallel(lambda first, last: gather_shapes(shapes, neighbours, first, last, around), len(faces))
    return SurfaceTables(shapes, around, neighbours, faces, vertices, mesh.normals.numpy())
