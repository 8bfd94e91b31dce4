"""From the rays of a relightable field to a picture in any light.

`shading_inputs` enlarges what does not depend on the light, once per pose and camera; `shade_image` multiplies it by
a light.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import conv2d, normalize

from ..field.rays import CameraTensors, HandInView, view_directions
from ..field.relightable import clamp_min
from ..field.volume import Composite
from ..light.lighting import COEFFICIENTS, GLOSS, SMOOTH, BumpMapping, LightFeatures, SurfacePoints, shaded_colour
from .depth_steps import RaysAround, coefficients_at_steps, neighbours, normals_at_steps
from .maps import enlarge_maps, low_resolution_maps
from .superres import enlarge

_OF_RAYS = (
    "lamp_vectors",
    "sky_vectors",
    "lobe_visibility",
    "near_field_specular",
    "scattered",
    "arriving",
    "reflected",
)
"""The fields of `LightFeatures` that differ from ray to ray."""
MIN_ALPHA = 0.02
"""Keeps what is divided by alpha finite beside the hand, where it does not count."""
# Of the rays that meet a pixel's surface; with less, they are none.
_LEAST_SHARE = 0.01
# Binomial, along both axes: it lets nothing of the pixel frequency through.
SMOOTHED = (0.25, 0.5, 0.25)
# Of a pixel and of the four beside it: soft edges.
_OF_PIXEL, _OF_NEXT = 0.5, 0.125


class ShadingInputs(NamedTuple):
    """P pixels of a hand at full size, in no light.

    Attributes:
        pixel: [P] row * width + column.
        coefficients: [P, 14] premultiplied.
        normal: [P, 3] unit, world, with all relief.
        view: [P, 3] unit, from the camera.
        share: [P, 4] of the four rays around each in its light: upper left, upper right, lower left, lower right.
        alpha: [H, W] not clamped; 0 at all other pixels.
        depth: [H, W] m; infinite where no ray meets the hand.
        skin: bump mapping of the avatar's surface; None: there is none.
    """

    pixel: Tensor
    coefficients: Tensor
    normal: Tensor
    view: Tensor
    share: Tensor
    alpha: Tensor
    depth: Tensor
    skin: BumpMapping | None = None


class SurfaceDepth(NamedTuple):
    """The skin in an image of P pixels.

    Attributes:
        depth: [P] m; infinite beside the hand.
        edge_m: [] rays whose depth differs by more are of another surface.
    """

    depth: Tensor
    edge_m: Tensor


class EnlargedRays(NamedTuple):
    """What `ShadingInputs` holds of the same names; alpha is flat."""

    coefficients: Tensor
    normal: Tensor
    alpha: Tensor


Enlarged = Callable[[Tensor, Tensor, Tensor, Tensor], EnlargedRays]
Shares = Callable[[Tensor, Tensor, CameraTensors, Tensor, SurfaceDepth], Tensor]
Normals = Callable[[Tensor, Tensor, RaysAround], Tensor]
Coefficients = Callable[[Tensor, Tensor, Tensor, RaysAround], Tensor]
Views = Callable[[CameraTensors, Tensor], Tensor]


def enlarged_rays(
    maps: Float[Tensor, "34 h w"], detail: Float[Tensor, "12 H W"], covered: Int[Tensor, " P"], world2cam: Tensor
) -> EnlargedRays:
    """Enlarge the rays' maps to full size with their detail, at the covered pixels; elsewhere alpha is 0."""
    image = detailed(maps, detail).flatten(1)
    alpha = torch.zeros_like(image[-1]).index_put((covered,), image[-1, covered])
    return EnlargedRays(
        coefficients=(image[:COEFFICIENTS, covered] * image[-1, covered].clamp(0, 1)).T,
        normal=normalize(image[COEFFICIENTS:-1, covered].T, dim=-1) @ world2cam[:3, :3],
        alpha=alpha,
    )


def shading_inputs(
    superres: Callable[[Tensor], Tensor],
    low: Composite,
    points: SurfacePoints,
    pixel: Int[Tensor, " R"],
    camera: CameraTensors,
    skin: SurfaceDepth,
    enlarged: Enlarged | None = None,
    shares: Shares | None = None,
    normals: Normals | None = None,
    views: Views = view_directions,
    at_steps: Coefficients = coefficients_at_steps,
) -> ShadingInputs:
    """Enlarge the decoded rays of a relightable field.

    Args:
        superres: `RelightableSuperRes`, in any precision; all else here is exact to fp32.
        low: as `RelightableField.decode` returns it.
        points: where the rays meet the skin.
        pixel: of the rays, in the low-resolution image.
        camera: of the low-resolution image.
        skin: in the full-size image.
        enlarged: as `smooth_enlarged_rays`, which stands for None.
        shares: as `shares_of_rays`, which stands for None.
        normals: as `normals_at_steps`, which stands for None.
        views: as `view_directions`.
        at_steps: as `coefficients_at_steps`.
    """
    maps, depth = relightable_maps(low, points, pixel, camera)
    covered, full = covered_pixels(pixel, camera.size_px), doubled(camera)
    detail = enlarge_maps(superres, maps).float()
    coefficients, normal, alpha = (enlarged or smooth_enlarged_rays)(maps, detail, covered, camera.world2cam)
    share = (shares or shares_of_rays)(points.position, pixel, camera, covered, skin)
    around = RaysAround(pixel, covered, share, camera.size_px)
    normal = (normals or normals_at_steps)(normal, points.relief_normal, around)
    coefficients = at_steps(coefficients, alpha, maps, around)
    return ShadingInputs(
        pixel=covered,
        coefficients=coefficients,
        normal=normal,
        view=views(full, covered),
        share=share,
        alpha=alpha.reshape(full.size_px[1], full.size_px[0]),
        depth=depth.repeat_interleave(2, 0).repeat_interleave(2, 1),
    )


def smooth_enlarged_rays(
    maps: Float[Tensor, "34 h w"], detail: Float[Tensor, "12 H W"], covered: Int[Tensor, " P"], world2cam: Tensor
) -> EnlargedRays:
    """Enlarge the rays as `enlarged_rays` does, and smooth them as `smoothed_rays` does."""
    return smoothed_rays(enlarged_rays(maps, detail, covered, world2cam), covered, detail.shape[-1])


def smoothed_rays(large: EnlargedRays, covered: Int[Tensor, " P"], width: int) -> EnlargedRays:
    """Remove from coefficients and normals what alternates from pixel to pixel, by means over 3 x 3 pixels of the hand.

    Super-resolution leaves such a pattern where coverage is partial: outlines against a rim light are dotted without.
    Alpha stays.
    """
    weight = large.alpha[covered].clamp(MIN_ALPHA, 1)
    values = torch.cat([large.coefficients, large.normal * weight[:, None], weight[:, None]], 1)
    image = values.new_zeros(len(large.alpha), values.shape[1]).index_put((covered,), values)
    planes = image.T.reshape(-1, 1, len(large.alpha) // width, width)
    kernel = values.new_tensor(SMOOTHED)
    planes = conv2d(planes, kernel.reshape(1, 1, 1, 3), padding=(0, 1))
    planes = conv2d(planes, kernel.reshape(1, 1, 3, 1), padding=(1, 0))
    mean = planes.flatten(1)[:, covered].T
    share = weight / mean[:, -1]
    return large._replace(
        coefficients=mean[:, :COEFFICIENTS] * share[:, None], normal=normalize(mean[:, COEFFICIENTS:-1], dim=-1)
    )


def relightable_maps(
    low: Composite, points: SurfacePoints, pixel: Int[Tensor, " R"], camera: CameraTensors
) -> tuple[Float[Tensor, "34 h w"], Float[Tensor, "h w"]]:
    """Make the maps that `RelightableSuperRes` takes, and depth."""
    normal = (points.relief_normal @ camera.world2cam[:3, :3].T) * low.alpha[:, None]
    stacked = low._replace(channels=torch.cat([low.channels.float(), normal], 1))
    return low_resolution_maps(stacked, pixel, camera.size_px)


def detailed(maps: Float[Tensor, "34 h w"], detail: Float[Tensor, "12 H W"]) -> Float[Tensor, "18 H W"]:
    """Make the full-size image: straight coefficients (not negative), normal in camera axes (of any length), alpha."""
    base = enlarge(torch.cat([maps[:COEFFICIENTS], maps[-4:]])[None])[0]
    alpha = base[-1:]
    straight = torch.cat([base[:-1] / alpha.clamp(min=MIN_ALPHA), alpha])
    fine = straight[SMOOTH:] + detail
    coefficients = torch.cat([straight[:SMOOTH], fine[: COEFFICIENTS - SMOOTH]])
    return torch.cat([clamp_min(coefficients, 0.0), fine[COEFFICIENTS - SMOOTH :]])


def diffuse_and_specular(image: ShadingInputs) -> tuple[ShadingInputs, ShadingInputs]:
    """Return two images whose colours in any light add up to this one's: of the skin's body, and of its surface."""
    is_gloss = torch.zeros(COEFFICIENTS, dtype=torch.bool, device=image.coefficients.device)
    is_gloss[GLOSS] = True
    diffuse, specular = (image.coefficients * wanted for wanted in (~is_gloss, is_gloss))
    return image._replace(coefficients=diffuse), image._replace(coefficients=specular)


def shade_image(
    image: ShadingInputs, features: LightFeatures, pixel: Int[Tensor, " R"], size_px: tuple[int, int]
) -> Float[Tensor, "3 H W"]:
    """Compute scene-linear colours, premultiplied by alpha, of an image at twice `size_px`.

    Args:
        image: of the hand.
        features: at its rays.
        pixel: of the rays.
        size_px: of the low-resolution image.
    """
    at_pixels = _enlarged(features, pixel, size_px, image)
    colours = shaded_colour(image.coefficients, image.normal, image.view, at_pixels, image.skin)
    width, height = size_px
    flat = colours.new_zeros(4 * width * height, 3).index_put((image.pixel,), colours)
    return flat.T.reshape(3, 2 * height, 2 * width)


def shade_rays(low: Composite, points: SurfacePoints, features: LightFeatures) -> Float[Tensor, "R 3"]:
    """Compute scene-linear colours of the low-resolution rays, premultiplied."""
    return shaded_colour(low.channels[:, :COEFFICIENTS], points.relief_normal, points.view, features)


def feature_maps(features: LightFeatures, pixel: Int[Tensor, " R"], size_px: tuple[int, int]) -> Float[Tensor, "P C"]:
    """Scatter the features over the low-resolution grid, zero where there is no ray."""
    rows, (width, height) = ray_rows(features), size_px
    return rows.new_zeros(width * height, rows.shape[1]).index_put_((pixel,), rows)


def ray_rows(features: LightFeatures) -> Float[Tensor, "R C"]:
    """Join all that differs from ray to ray, a row for each; it may share the features' memory."""
    parts = [getattr(features, name).flatten(1) for name in _OF_RAYS]
    return torch.cat(parts, 1) if (whole := _side_by_side(parts)) is None else whole


def ray_row_columns(lamps: int) -> dict[str, slice]:
    """Return where rows of `ray_rows` hold which features of a light of so many lamps."""
    counts = dict.fromkeys(_OF_RAYS, 3) | {"lamp_vectors": 3 * lamps, "sky_vectors": 9, "lobe_visibility": 2}
    counts |= {"near_field_specular": 6, "scattered": 6}
    ends = list(accumulate(counts.values()))
    return {name: slice(end - count, end) for (name, count), end in zip(counts.items(), ends, strict=True)}


def _side_by_side(parts: list[Tensor]) -> Float[Tensor, "R C"] | None:
    """Return the matrix whose columns are these, as `with_ray_rows` leaves them; None if they are not."""
    first, columns, rows = parts[0], sum(part.shape[1] for part in parts), len(parts[0])
    start, storage = first.storage_offset(), first.untyped_storage().data_ptr()
    for part in parts:
        is_next = part.storage_offset() == start and part.untyped_storage().data_ptr() == storage
        if not is_next or part.stride() != (columns, 1) or part.requires_grad:
            return None
        start += part.shape[1]
    return first.as_strided((rows, columns), (columns, 1))


def with_ray_rows(features: LightFeatures, rows: Float[Tensor, "P C"]) -> LightFeatures:
    """Return the same light at other points, whose rows are as `ray_rows` gives them."""
    shapes = [getattr(features, name).shape[1:] for name in _OF_RAYS]
    parts = rows.split([shape.numel() for shape in shapes], 1)
    named = zip(_OF_RAYS, shapes, parts, strict=True)
    return features._replace(**{name: part.reshape(len(rows), *shape) for name, shape, part in named})


def _enlarged(features: LightFeatures, pixel: Tensor, size_px: tuple[int, int], image: ShadingInputs) -> LightFeatures:
    """Interpolate the features at the pixels of the full-size image."""
    maps = feature_maps(features, pixel, size_px)
    around, _ = neighbours(image.pixel, size_px)
    return with_ray_rows(features, (maps[around] * image.share[..., None]).sum(1))


@torch.no_grad()
def shares_of_rays(
    position: Float[Tensor, "R 3"],
    pixel: Int[Tensor, " R"],
    camera: CameraTensors,
    at: Int[Tensor, " P"],
    skin: SurfaceDepth,
) -> Float[Tensor, "P 4"]:
    """Compute how much each ray around a pixel of the full-size image counts for the light there; they add up to 1.

    Bilinear among the rays that there are, and that meet the surface which the pixel shows: else a finger before the
    palm would have the palm's light in the steps of the rays. (Joint bilateral upsampling, Kopf et al. 2007.)

    Args:
        position: where the rays meet the skin, m, world.
        pixel: of the rays, in the low-resolution image.
        camera: of that image.
        at: pixels that at least one ray is beside.
        skin: in the full-size image.
    """
    around, share = neighbours(at, camera.size_px)
    depth_of, (width, height) = ray_depths(position, pixel, camera)[around], camera.size_px
    share = share * depth_of.isfinite()
    result = _guided(share, depth_of, skin.depth[at], skin.edge_m)
    beside = skin.depth[_beside(at, (2 * width, 2 * height))]
    at_edge = ((beside - skin.depth[at]).abs().nan_to_num() > skin.edge_m).any(0).nonzero()[:, 0]
    softened = [_guided(share[at_edge], depth_of[at_edge], one[at_edge], skin.edge_m) for one in beside]
    return result.index_put((at_edge,), _OF_PIXEL * result[at_edge] + _OF_NEXT * torch.stack(softened).sum(0))


def ray_depths(position: Float[Tensor, "R 3"], pixel: Int[Tensor, " R"], camera: CameraTensors) -> Float[Tensor, " P"]:
    """Compute the depth of the positions in the rays' image, m; infinite where there is no ray."""
    depth = position @ camera.world2cam[2, :3] + camera.world2cam[2, 3]
    width, height = camera.size_px
    return depth.new_full((width * height,), torch.inf).index_put((pixel,), depth)


def _guided(
    share: Float[Tensor, "P 4"], depth_of_rays: Float[Tensor, "P 4"], depth: Float[Tensor, " P"], edge_m: Tensor
) -> Float[Tensor, "P 4"]:
    """Keep the shares of the rays at a depth, or of all if none is there."""
    gap = (depth[:, None] - depth_of_rays) / edge_m
    guided = share * torch.exp(-gap.square().nan_to_num(torch.inf))
    chosen = torch.where(guided.sum(1, keepdim=True) > _LEAST_SHARE, guided, share)
    return chosen / chosen.sum(1, keepdim=True)


def _beside(at: Int[Tensor, " P"], size_px: tuple[int, int]) -> Int[Tensor, "4 P"]:
    """Find the pixels to the left, right, above and below, within the image."""
    width, height = size_px
    x, y = at % width, torch.div(at, width, rounding_mode="floor")
    rows = [y, y, (y - 1).clamp(min=0), (y + 1).clamp(max=height - 1)]
    columns = [(x - 1).clamp(min=0), (x + 1).clamp(max=width - 1), x, x]
    return torch.stack([row * width + column for row, column in zip(rows, columns, strict=True)])


def covered_pixels(pixel: Tensor, size_px: tuple[int, int]) -> Int[Tensor, " P"]:
    """Find the pixels of the full-size image that a bilinear enlargement of the rays reaches."""
    width, height = size_px
    has_ray = torch.zeros(1, 1, height, width, device=pixel.device)
    has_ray.view(-1)[pixel] = 1
    return (enlarge(has_ray).flatten() > 0).nonzero()[:, 0]


def at_full_size(hand: HandInView) -> HandInView:
    """Return the hand in an image of twice the size."""
    return hand._replace(camera=doubled(hand.camera), surface_depth=None)


def doubled(camera: CameraTensors) -> CameraTensors:
    """Return the camera of an image of twice the size."""
    width, height = camera.size_px
    scale = camera.K.new_tensor([2.0, 2.0, 1.0])
    return camera._replace(K=scale[:, None] * camera.K, size_px=(2 * width, 2 * height))
