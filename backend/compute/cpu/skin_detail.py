"""A known skin on the CPU: as `surface.skin_detail`, by the kernel."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ...field.rays import CameraTensors, ray_origin
from ...image.relighting import MIN_ALPHA, LitImage
from ...light.lighting import BumpedSkin
from ...surface.detail_maps import BUMP, GLOSS_STEP, SHADE_STEP, SLOPE_STEP_MM, DetailMaps
from ...surface.detail_maps_file import DEEPENED_BY, DEEPENED_FROM, FLATTENED
from ...surface.fine_mesh import FineMesh, PixelSurface
from ...surface.skin_detail import FOLD_LOG_ALBEDO, LEAST_COSINE, MOST_TAPS, ONE_TAP_MORE, SHARPER
from ..kernels.detail import add_skin
from ..kernels.records import DetailConstants, DetailedArrays, DetailTable, PosedSurface, SeenFaces
from .arrays import as_arrays
from .threads import in_parallel


def detailed_image(
    image: LitImage, seen: PixelSurface, mesh: FineMesh, camera: CameraTensors, maps: DetailMaps
) -> LitImage:
    """The image with the known skin."""
    surface = PosedSurface(*as_arrays(mesh.vertices, mesh.normals, mesh.faces, mesh.corner_uv, mesh.flex))
    faces = SeenFaces(*as_arrays(seen.face, seen.depth, seen.coverage, ray_origin(camera)))
    table = DetailTable(maps.table.numpy(), np.array([first for first, _ in maps.levels]), maps.resolution)
    changed = image._replace(**{name: _copy(getattr(image, name)) for name in ("coefficients", "normal", "alpha")})
    skin = _beside_the_surface(image.normal, maps)
    of_skin = skin.surface_normal, skin.blurred_normal, skin.alpha_squared, skin.nail
    filled = changed.coefficients, changed.normal, *of_skin, changed.alpha.flatten()
    arrays = DetailedArrays(*as_arrays(changed.pixel, changed.view, *filled))
    constants = _constants(mesh, camera, maps)
    in_parallel(lambda first, last: add_skin(faces, surface, table, constants, first, last, arrays), len(image.pixel))
    return changed._replace(depth=seen.depth.reshape(image.depth.shape), skin=skin)


def _beside_the_surface(normal: Tensor, maps: DetailMaps) -> BumpedSkin:
    """What the kernel fills where the surface is seen."""
    smooth = BumpedSkin.smooth(normal)
    return smooth._replace(
        surface_normal=_copy(smooth.surface_normal),
        blurred_normal=_copy(smooth.blurred_normal),
        sharpness=torch.tensor(maps.sharpness),
    )


def _copy(values: Tensor) -> Tensor:
    return values.clone(memory_format=torch.contiguous_format)


def _constants(mesh: FineMesh, camera: CameraTensors, maps: DetailMaps) -> DetailConstants:
    scale = float(mesh.scale)
    texel_m = scale * maps.texel_m
    texels = 1 / (float(camera.focal_px) * texel_m)
    bump = -BUMP * 1e-3 * maps.resolution * scale * SLOPE_STEP_MM
    folds = FLATTENED, DEEPENED_FROM, DEEPENED_BY
    numbers = MIN_ALPHA, texels, texel_m, LEAST_COSINE, ONE_TAP_MORE, SHARPER, maps.blurred_level, *folds, bump
    steps = SHADE_STEP, GLOSS_STEP, BUMP
    colours = (np.array(colour, np.float32) for colour in (maps.pigment_colour, FOLD_LOG_ALBEDO))
    return DetailConstants._make((*(np.float32(value) for value in (*numbers, *steps)), MOST_TAPS, *colours))
