"""The skin's detail on the CPU: as `nerf.skin_detail`, by the kernels."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..nerf.rays import HandInView, project
from ..nerf.relighting import LitImage
from ..nerf.skin_detail import (
    BUMP,
    DEEPENED_BY,
    DEEPENED_FROM,
    FLATTENED,
    FOLD_LOG_ALBEDO,
    FOLDS,
    LEAST_COSINE,
    SHADE_STEP,
    SLOPE_STEP_MM,
    TINT,
    DetailMaps,
    face_gradients,
)
from .kernels.compiled import in_parallel
from .kernels.detail import add_detail
from .kernels.raster import nearest_faces
from .kernels.records import (
    DetailConstants,
    DetailedArrays,
    DetailedSkin,
    DetailTable,
    ProjectedMesh,
    SeenFaces,
)


def detailed_image(image: LitImage, hand: HandInView, maps: DetailMaps, flex: Float[Tensor, " V"]) -> LitImage:
    """The image with the skin's detail."""
    mesh, topology, camera = hand
    positions_px, depth = (values.contiguous().numpy() for values in project(camera, mesh.vertices))
    projected, (width, height) = ProjectedMesh(positions_px, depth, topology.faces.numpy()), camera.size_px
    seen = SeenFaces(np.full(width * height, -1, np.int32), np.full(width * height, np.inf, np.float32), width)
    threads = torch.get_num_threads()
    in_parallel(
        lambda first, last: nearest_faces(projected, width, first, last, seen.depth, seen.face), height, threads
    )
    gradients = face_gradients(mesh, topology).numpy()
    skin = DetailedSkin(topology.corner_uv.numpy(), gradients, flex.contiguous().numpy())
    first_rows = np.array([first for first, _ in maps.levels])
    table = DetailTable(maps.table.numpy(), first_rows, maps.resolution, maps.offset.numpy())
    copies = (_copy(values) for values in (image.coefficients, image.normal, image.nail))
    changed = image._replace(**dict(zip(("coefficients", "normal", "nail"), copies, strict=True)))
    seen_by_kernel = (changed.pixel, changed.coefficients, changed.normal, changed.view, changed.nail)
    arrays = DetailedArrays(*(values.contiguous().numpy() for values in seen_by_kernel))
    constants = _constants(hand, maps)
    in_parallel(
        lambda first, last: add_detail(seen, projected, skin, table, constants, first, last, arrays),
        len(image.pixel),
        threads,
    )
    return changed


def _copy(values: Tensor) -> Tensor:
    return values.clone(memory_format=torch.contiguous_format)


def _constants(hand: HandInView, maps: DetailMaps) -> DetailConstants:
    mesh, camera = hand.mesh, hand.camera
    texels = 1 / (float(camera.focal_px) * float(mesh.scale) * maps.texel_m)
    bump = -BUMP * 1e-3 * maps.resolution * float(mesh.scale) * SLOPE_STEP_MM
    folds = FOLDS, FOLDS * FLATTENED, FOLDS * DEEPENED_FROM, FOLDS * DEEPENED_BY
    numbers = texels, LEAST_COSINE, float(mesh.scale), *folds, bump, TINT * SHADE_STEP, SHADE_STEP
    return DetailConstants._make((*(np.float32(value) for value in numbers), np.array(FOLD_LOG_ALBEDO, np.float32)))
