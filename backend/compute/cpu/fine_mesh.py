"""The fine surface on the CPU: as `surface.fine_mesh`, by the kernels."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...field.rays import CameraTensors
from ...hand.lbs import SkinMotion
from ...surface.fine_mesh import SAMPLES, FineMesh, FinerField, FineTemplate, PixelSurface
from ...surface.part_edges import SPREAD, STEP_M, STEP_PX, PartEdges
from ..kernels.fine_mesh import face_normals, fine_vertices, finer_field, vertex_normals
from ..kernels.outline import (
    depth_at_rim,
    edge_shares,
    mark_outline,
    mark_parts,
    pixel_squares,
    sample_faces,
    spread_coverage,
)
from ..kernels.records import EdgeSamples, FinerRows, PartMarks
from .arrays import as_arrays
from .fronts import find_fronts
from .projection import projected_mesh
from .threads import in_parallel

_SAMPLES, _SPREAD = np.array(SAMPLES, np.float32).T.copy(), np.array(SPREAD, np.float32)


def fine_mesh(
    template: FineTemplate,
    motion: SkinMotion,
    height_m: Float[Tensor, " N"],
    flex: Float[Tensor, " V"],
    scale: Float[Tensor, ""],
) -> FineMesh:
    """As `surface.fine_mesh.fine_mesh`."""
    count = len(template.offset_m)
    values = torch.cat([motion.rest, motion.transforms.flatten(1), flex[:, None]], 1).numpy()
    for level in template.levels:
        values = _finer(level, values)
    vertices, normals, of_faces = torch.empty(count, 3), torch.empty(count, 3), torch.empty(len(template.faces), 3)
    placed, unit, long, faces = as_arrays(vertices, normals, of_faces, template.faces)
    at_rest = as_arrays(template.offset_m, template.normals, height_m)
    in_parallel(lambda first, last: fine_vertices(values, *at_rest, first, last, placed), count)
    in_parallel(lambda first, last: face_normals(placed, faces, first, last, long), len(faces))
    start, around = as_arrays(*template.around)
    in_parallel(lambda first, last: vertex_normals(long, start, around, first, last, unit), count)
    bend = torch.as_tensor(values[:, -1])
    shared = template.bones, template.coarse_faces
    return FineMesh(vertices, normals, template.faces, template.corner_uv, bend, scale, *shared)


def _finer(level: FinerField, values: np.ndarray) -> np.ndarray:
    rows = FinerRows(*as_arrays(level.start, level.column, level.weight))
    finer = np.empty((len(rows.start) - 1, values.shape[1]), np.float32)
    in_parallel(lambda first, last: finer_field(rows, values, first, last, finer), len(finer))
    return finer


def seen_surface(mesh: FineMesh, camera: CameraTensors) -> PixelSurface:
    """As `surface.fine_mesh.seen_surface`."""
    width, height = camera.size_px
    projected, pixels = projected_mesh(camera, mesh.vertices, mesh.faces), width * height
    nearest, face_at, rows = find_fronts(projected, camera.size_px)
    on_outline, bits = np.empty(pixels, np.bool_), np.zeros(pixels, np.uint16)
    covered, coverage, deep = np.empty((3, pixels), np.float32)
    bone_of_face, apart = as_arrays(*mesh.bones)
    marks = PartMarks(np.empty(pixels, np.float32), np.empty(pixels, np.int8), bone_of_face, apart)
    step_m, step_per_m = np.float32(STEP_M * mesh.scale), np.float32(STEP_PX / camera.focal_px)

    def mark_rows(first: int, last: int) -> None:
        mark_outline(face_at, width, height, first, last, on_outline)
        mark_parts(nearest, face_at, width, height, step_m, step_per_m, first, last, marks)

    def spread_rows(first: int, last: int) -> None:
        spread_coverage(covered, on_outline, _SPREAD, width, height, first, last, coverage)
        depth_at_rim(nearest, coverage, width, height, first, last, deep)

    in_parallel(mark_rows, height)
    pixel, slot = np.flatnonzero((marks.between > 0) | (marks.part >= 0)), np.full(pixels, -1, np.int32)
    slot[pixel] = np.arange(len(pixel))
    shape = len(pixel), len(SAMPLES)
    samples = EdgeSamples(slot, np.full(shape, np.inf, np.float32), np.full(shape, -1, np.int32))

    def sample_rows(first: int, last: int) -> None:
        sample_faces(projected, rows, _SAMPLES, width, first, last, on_outline, bits, samples)
        pixel_squares(face_at, on_outline, bits, width * first, width * last, covered)

    for run in (sample_rows, spread_rows):
        in_parallel(run, height)
    share, shows_first = np.empty(len(pixel), np.float32), np.empty((9, len(pixel)), np.bool_)
    seen = nearest, face_at, width, height
    in_parallel(
        lambda first, last: edge_shares(pixel, seen, marks, samples, _SPREAD, first, last, share, shows_first),
        len(pixel),
    )
    edges = PartEdges(*(torch.as_tensor(values) for values in (pixel, shows_first, share)))
    return PixelSurface(torch.as_tensor(face_at), torch.as_tensor(deep), torch.as_tensor(coverage), edges)
