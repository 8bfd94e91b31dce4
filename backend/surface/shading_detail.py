"""The avatar's surface on an image: outline and normals of its detail mesh, with its detail (bump mapping, Blinn 1978).

The rays of a relightable field give colour, normal and opacity at half the image's size and to the resolution of its
planes and mesh. Where they meet the avatar's surface (`detail_mesh`), it gives the full-size image's coverage and the
normals in which lamps and gloss are evaluated; folds, lines and the rims of nails (`detail_maps_file`) bend these and
darken coefficients, by maps of images' own size (`detail_maps`). Light that is scattered far in the skin shows less of
them, so diffuse light has normals of its own (hybrid normals, Ma et al. 2007). Nails shine in the narrower lobe alone:
they are too small a part of a hand for training to see that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from ..field.rays import CameraTensors
from ..image.shading import MIN_ALPHA, ShadingInputs
from ..light.lighting import DIFFUSE, GLOSS, SCATTERED, BumpMapping
from .albedo_ratio import AlbedoRatio
from .detail_maps import BUMP, CHANNELS, GLOSS_STEP, DetailMaps
from .detail_maps_file import DEEPENED_BY, DEEPENED_FROM, FLATTENED
from .detail_mesh import DetailMesh, PixelSurface, barycentric, blend_corners

FOLD_LOG_ALBEDO = (-0.45, -0.65, -0.60)
"""Logarithm of the colour of folds over that of the skin around them."""
LEAST_COSINE = 0.25
"""Of face and view: flatter views are filtered as this one."""
MOST_TAPS = 4
"""Along what a pixel shows of a face that is seen from the side (anisotropic filtering)."""
ONE_TAP_MORE = 0.75
"""Of a pixel: a footprint of a quarter more than its taps gets another, so that they lie 1.25 pixels apart at most."""
SHARPER = 0.3
"""Levels finer than a pixel is wide: interpolation blurs, too."""
NAIL, SQUARED, HIDDEN_FOLDS = 9, 10, 11
"""Where these are among the channels of the maps."""
_TINY = 1e-12


class DetailPixels(NamedTuple):
    """What an avatar's surface gives to a lit image of P pixels, K of which see it in their centre.

    Attributes:
        coverage: [P] share of each pixel that shows the hand.
        depth: [P] m; infinite where none does.
        row: [K] of the pixels in the image.
        normal: [K, 3] unit, world, with the detail.
        surface_normal, blurred_normal, alpha_squared, nail: [K, ...] as in `BumpMapping`.
        albedo: [K, 3] factor of colours.
        sharpness: [3] as there.
    """

    coverage: Tensor
    depth: Tensor
    row: Tensor
    normal: Tensor
    surface_normal: Tensor
    blurred_normal: Tensor
    albedo: Tensor
    nail: Tensor
    alpha_squared: Tensor
    sharpness: Tensor


def detailed_image(
    image: ShadingInputs, seen: PixelSurface, mesh: DetailMesh, camera: CameraTensors, maps: DetailMaps
) -> ShadingInputs:
    """Replace the image's skin by the avatar's surface.

    Args:
        image: of the hand, at full size.
        seen: what the image shows of the surface.
        mesh: posed.
        camera: of the image.
        maps: of the person.
    """
    return with_detail(image, detail_pixels(image.pixel, image.view, seen, mesh, camera, maps))


def detail_pixels(
    pixel: Int[Tensor, " P"],
    view: Float[Tensor, "P 3"],
    seen: PixelSurface,
    mesh: DetailMesh,
    camera: CameraTensors,
    maps: DetailMaps,
) -> DetailPixels:
    """Compute what these pixels show; `view` as in `ShadingInputs`, others as in `detailed_image`."""
    row = (seen.face[pixel] >= 0).nonzero()[:, 0]
    face, depth = seen.face[pixel[row]].long(), seen.depth[pixel[row]]
    corners, weights = mesh.faces[face], barycentric(mesh, camera, face, pixel[row])
    gradients = atlas_gradients(mesh.vertices[corners], mesh.corner_uv[face])
    uv = blend_corners(mesh.corner_uv[face], weights)
    pixel_m = camera.divisor(depth) / camera.focal_px
    values, log_ratio = _sampled(maps, uv, gradients, view[row], pixel_m, mesh.scale)
    level = _level(maps, pixel_m, mesh.scale)
    blurred = values.clone()
    is_sharp = (level < maps.blurred_level).nonzero()[:, 0]
    blurred[is_sharp] = maps.sample(uv[is_sharp], torch.full_like(level[is_sharp], maps.blurred_level))
    flex = blend_corners(mesh.flex[corners][..., None], weights)
    dorsal, palmar = (1 - FLATTENED * flex).clamp(min=0), DEEPENED_FROM + DEEPENED_BY * flex
    folded = dorsal * values[:, 7:8] + palmar * values[:, 8:9]
    alpha_squared = values[:, SQUARED] + (BUMP * dorsal[:, 0]) ** 2 * values[:, HIDDEN_FOLDS]
    pigment = values[:, 6:7] * values.new_tensor(maps.pigment_colour)
    surface_normal = normalize(blend_corners(mesh.normals[corners], weights), dim=-1)

    def bent(values: Tensor) -> Tensor:
        slopes = values[:, 0:2] - dorsal * values[:, 2:4] - palmar * values[:, 4:6]
        aside = BUMP * 1e-3 * maps.resolution * mesh.scale * (slopes[:, :, None] * gradients).sum(1)
        return normalize(surface_normal - aside, dim=-1)

    return DetailPixels(
        coverage=seen.coverage[pixel],
        depth=seen.depth[pixel],
        row=row,
        normal=bent(values),
        surface_normal=surface_normal,
        blurred_normal=bent(blurred),
        albedo=torch.exp(pigment + log_ratio + folded * values.new_tensor(FOLD_LOG_ALBEDO)),
        nail=values[:, NAIL],
        alpha_squared=alpha_squared.clamp(min=GLOSS_STEP),
        sharpness=values.new_tensor(maps.sharpness),
    )


def with_detail(image: ShadingInputs, skin: DetailPixels) -> ShadingInputs:
    """Write this skin into the image, with gradients to its colours; normals beside the surface stay.

    Its gloss is known as its shape is: all of the broad lobe on skin, all of the tight one on nails.
    """
    row, before = skin.row, image.alpha.flatten()[image.pixel].clamp(MIN_ALPHA, 1)
    coefficients = image.coefficients * (skin.coverage / before)[:, None]
    coefficients[row, SCATTERED.start : DIFFUSE.stop] *= skin.albedo.repeat(1, 3)
    known, names = BumpMapping.smooth(image.normal), ("surface_normal", "blurred_normal", "alpha_squared", "nail")
    reported = {name: getattr(known, name).index_put((row,), getattr(skin, name)) for name in names}
    coefficients[:, GLOSS] = torch.stack([reported["nail"], 1 - reported["nail"]], 1) * skin.coverage[:, None]
    alpha = torch.zeros_like(image.alpha).flatten().index_put((image.pixel,), skin.coverage)
    depth = torch.full_like(image.depth, torch.inf).flatten().index_put((image.pixel,), skin.depth)
    return image._replace(
        normal=image.normal.index_put((row,), skin.normal),
        coefficients=coefficients,
        skin=BumpMapping(**reported, sharpness=skin.sharpness),
        alpha=alpha.reshape(image.alpha.shape),
        depth=depth.reshape(image.depth.shape),
    )


def log_albedo(maps: DetailMaps, uv: Float[Tensor, "P 2"], resolution: int) -> Float[Tensor, "P 3"]:
    """Compute the logarithm of what the maps multiply albedo by, of a straight hand, for texels of an atlas."""
    level = torch.full((len(uv),), math.log2(maps.resolution / resolution))
    values = maps.sample(uv, level)
    folded = values[:, 7:8] + DEEPENED_FROM * values[:, 8:9]
    found = values[:, 6:7] * values.new_tensor(maps.pigment_colour) + folded * values.new_tensor(FOLD_LOG_ALBEDO)
    if maps.ratio is None:
        return found
    return found + maps.ratio.sample(uv, level + math.log2(maps.ratio.resolution / maps.resolution))


class TexelDetail(NamedTuple):
    """The maps of a straight hand over P texels of an atlas.

    Attributes:
        log_albedo: [P, 3] logarithm of what albedo is multiplied by.
        slopes: [P, 2] along u and v, template metres per unit of u and v.
        alpha_squared: [P] of the gloss of skin.
        nail: [P] 1 on nails.
    """

    log_albedo: Tensor
    slopes: Tensor
    alpha_squared: Tensor
    nail: Tensor


def texel_detail(maps: DetailMaps, uv: Float[Tensor, "P 2"], resolution: int) -> TexelDetail:
    """Sample the maps of a straight hand at texels of an atlas of this resolution."""
    values = maps.sample(uv, torch.full((len(uv),), math.log2(maps.resolution / resolution)))
    slopes = values[:, 0:2] - values[:, 2:4] - DEEPENED_FROM * values[:, 4:6]
    return TexelDetail(
        log_albedo(maps, uv, resolution),
        BUMP * 1e-3 * maps.resolution * slopes,
        (values[:, SQUARED] + BUMP**2 * values[:, HIDDEN_FOLDS]).clamp(min=GLOSS_STEP),
        values[:, NAIL],
    )


def atlas_gradients(corners: Float[Tensor, "K 3 3"], uv: Float[Tensor, "K 3 2"]) -> Float[Tensor, "K 2 3"]:
    """Compute the gradients of the atlas coordinates u and v on faces, 1/m, world."""
    (a, b, c), (uv_a, uv_b, uv_c) = corners.unbind(1), uv.unbind(1)
    ab, ac = b - a, c - a
    normal = torch.linalg.cross(ab, ac)
    squared = (normal * normal).sum(-1, keepdim=True).clamp(min=_TINY**2)
    along_ab, along_ac = torch.linalg.cross(ac, normal) / squared, torch.linalg.cross(normal, ab) / squared
    return (uv_b - uv_a)[:, :, None] * along_ab[:, None] + (uv_c - uv_a)[:, :, None] * along_ac[:, None]


def _sampled(
    maps: DetailMaps,
    uv: Float[Tensor, "K 2"],
    gradients: Float[Tensor, "K 2 3"],
    view: Float[Tensor, "K 3"],
    pixel_m: Float[Tensor, " K"],
    scale: Tensor,
) -> tuple[Float[Tensor, "K 12"], Float[Tensor, "K 3"]]:
    """Sample the mean over what pixels show of faces; pixels are `pixel_m` wide where faces are seen straight on.

    Returns:
        values of the maps, and the logarithm of the person's factor on albedo.
    """
    normal = normalize(torch.linalg.cross(gradients[:, 0], gradients[:, 1]), dim=-1)
    facing = (normal * view).sum(-1, keepdim=True)
    cosine = facing[:, 0].abs().clamp(min=LEAST_COSINE)
    taps = (1 / cosine + ONE_TAP_MORE).floor().clamp(max=MOST_TAPS)
    step_m = pixel_m / (cosine * taps)
    tilt = normalize(view - facing * normal, dim=-1)
    step = step_m[:, None] * (gradients * tilt[:, None]).sum(-1)
    level = _level(maps, pixel_m, scale)
    ratio_level = level if maps.ratio is None else _level(maps.ratio, pixel_m, scale)
    total, log_ratio = uv.new_zeros(len(uv), CHANNELS), uv.new_zeros(len(uv), 3)
    for tap in range(MOST_TAPS):
        at = (tap < taps).nonzero()[:, 0]
        aside = (tap - (taps[at] - 1) / 2)[:, None] * step[at]
        total.index_add_(0, at, maps.sample(uv[at] + aside, level[at]) / taps[at, None])
        if maps.ratio is not None:
            log_ratio.index_add_(0, at, maps.ratio.sample(uv[at] + aside, ratio_level[at]) / taps[at, None])
    return total, log_ratio


def _level(maps: DetailMaps | AlbedoRatio, pixel_m: Float[Tensor, " K"], scale: Tensor) -> Float[Tensor, " K"]:
    return torch.log2(pixel_m / (scale * maps.texel_m)) - SHARPER
