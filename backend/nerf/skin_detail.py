"""A known skin on a lit image: outline and normals of its fine surface, with its detail (bump mapping, Blinn 1978).

The rays of a relightable field tell colour, normal and opacity at half the image's size and to the resolution of its
planes and mesh. Where the surface itself is known (`fine_mesh`), it tells the full-size image's coverage and the
normals in which lamps and gloss are evaluated; folds, lines and the rims of nails (`hand.skin_detail`) bend these and
darken coefficients. From afar, where rays lie farther apart than the planes resolve, the colours that they pass over
are added too. Nails shine in the narrower lobe alone: they are too small a part of a hand for training to see that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import avg_pool2d, conv2d, interpolate, normalize

from ..hand.skin_detail import ATLAS_MM, COARSEST_MM, SkinDetail, SkinMaps
from .fine_mesh import FineMesh, PixelSurface, barycentric, blend_corners
from .lighting import DIFFUSE, GLOSS, SCATTERED
from .rays import CameraTensors
from .relighting import MIN_ALPHA, LitImage

DORSAL_MM, PALMAR_MM = 0.36, 0.55
"""Depth of folds and creases at their deepest, straight and half bent."""
DORSAL_SHADE, PALMAR_SHADE = 0.42, 0.45
"""Share of the colour of folds at their deepest."""
FLATTENED, DEEPENED_FROM, DEEPENED_BY = 0.95, 0.75, 0.5
"""What bending a joint takes from the folds on its back, and what it makes of the creases below."""
FOLD_LOG_ALBEDO = (-0.45, -0.65, -0.60)
"""Logarithm of the colour of folds over that of the skin around them."""
BUMP = 0.9
"""Share of the slopes that shows: light is scattered inside the skin and leaves beside where it entered."""
FOLDS = 1.2
"""How much more shows of folds, which are wider than the way of light in the skin."""
PIGMENT_COLOUR = (0.48, 1.16, 1.36), (0.80, 1.04, 1.16)
"""Logarithm of the colour of pigment over its mean, of a light and of a deep skin: of baked skins, by least squares."""
RESOLVED_PX = 1.5
"""Deviation of the blur beyond which the rays, two pixels apart, show all."""
LEAST_COSINE = 0.25
"""Of face and view: flatter views are filtered as this one."""
MOST_TAPS = 4
"""Along what a pixel shows of a face that is seen from the side (anisotropic filtering)."""
ONE_TAP_MORE = 0.75
"""Of a pixel: a footprint of a quarter more than its taps gets another, so that they lie 1.25 pixels apart at most."""
SHARPER = 0.3
"""Levels finer than a pixel is wide: interpolation blurs, too."""
NAIL_FROM = 0.8
"""Of the map of nails, whose texels are half a millimetre: where it is less, slopes of their rims would glitter."""
SLOPE_STEP_MM, SHADE_STEP = 0.001, 0.01
"""What one step of the stored whole numbers is worth: slopes in mm a texel."""
CHANNELS = 10
"""Slopes along u and v of relief, dorsal folds and palmar creases; pigment; dorsal folds; palmar creases; nail."""
_STEPS = [SLOPE_STEP_MM] * 6 + [SHADE_STEP] * 4
_LEVELS = 6
_BLUR_REACH = 3  # deviations
_TINY = 1e-12


class SkinLook(NamedTuple):
    """A person's skin.

    Attributes:
        melanin: 0 light to 1 deep.
        folds: depth of folds; 1 is a young adult's.
        veins_mm: height of veins.
    """

    melanin: float
    folds: float
    veins_mm: float


class DetailMaps(NamedTuple):
    """A person's detail as a pyramid of maps, each level half as wide as the one before.

    Attributes:
        table: [T, 10] int8: the texels of all levels, rows of the finest first, the smallest v first.
        resolution: of the finest level.
        texel_m: its texels' side, template metres.
        pigment_colour: as `PIGMENT_COLOUR`, of the person.
    """

    table: Tensor
    resolution: int
    texel_m: float
    pigment_colour: tuple[float, ...]

    @classmethod
    def of(cls, detail: SkinDetail, look: SkinLook, device: torch.device | str = "cpu") -> DetailMaps:
        """The maps of a person.

        Args:
            detail: of the hand.
            look: of the person.
            device: of the table.
        """
        resolution = len(detail.fine.relief_mm)
        slopes = [
            fine + _widened(coarse, resolution)
            for fine, coarse in zip(
                _slopes(detail.fine, look, 1.0),
                _slopes(detail.coarse, look, len(detail.coarse.relief_mm) / resolution),
                strict=True,
            )
        ]
        columns = [_halvings(slope, SLOPE_STEP_MM) for slope in slopes]
        for fine, coarse in zip(_shades(detail.fine, look), _shades(detail.coarse, look), strict=True):
            columns.append(_pyramid(fine, coarse, SHADE_STEP))
        nail = (_widened(detail.nail, resolution) - NAIL_FROM) / (1 - NAIL_FROM)
        columns.append(_halvings(nail.clip(min=0), SHADE_STEP))
        light, deep = np.array(PIGMENT_COLOUR)
        colour = (1 - look.melanin) * light + look.melanin * deep
        return cls(torch.stack(columns, 1).to(device), resolution, ATLAS_MM / 1000 / resolution, tuple(colour.tolist()))

    @property
    def levels(self) -> list[tuple[int, int]]:
        """(first row of the table, resolution) of each level."""
        sizes = [self.resolution >> level for level in range(_LEVELS)]
        return [(sum(size**2 for size in sizes[:level]), sizes[level]) for level in range(_LEVELS)]

    def sample(self, uv: Float[Tensor, "P 2"], level: Float[Tensor, " P"]) -> Float[Tensor, "P 10"]:
        """Trilinear, in mm a texel, logarithms, and 1 on nails."""
        fine = level.clamp(0, _LEVELS - 1).floor().long()
        share = (level.clamp(0, _LEVELS - 1) - fine)[:, None]
        coarse = (fine + 1).clamp(max=_LEVELS - 1)
        both = self._bilinear(uv, fine) * (1 - share) + self._bilinear(uv, coarse) * share
        return both * both.new_tensor(_STEPS)

    def _bilinear(self, uv: Tensor, level: Int[Tensor, " P"]) -> Float[Tensor, "P 10"]:
        start, size = torch.tensor(self.levels, device=uv.device)[level].unbind(1)
        place = (uv * size[:, None] - 0.5).clamp(min=0).minimum(size[:, None] - 1.0)
        first = place.floor().minimum(size[:, None] - 2.0)
        (fu, fv), (u, v) = (place - first).unbind(1), first.long().unbind(1)
        corner = start + v * size + u
        rows = (corner, corner + 1, corner + size, corner + size + 1)
        weights = ((1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv)
        parts = [self.table[row].float() * weight[:, None] for row, weight in zip(rows, weights, strict=True)]
        return parts[0] + parts[1] + parts[2] + parts[3]


class PixelSkin(NamedTuple):
    """What a known skin tells of a lit image of P pixels, K of which see it in their centre.

    Attributes:
        coverage: [P] share of each pixel that shows the hand.
        depth: [P] m; infinite where none does.
        row: [K] of the pixels in the image.
        normal: [K, 3] unit, world, with the detail.
        surface_normal: [K, 3] the same without.
        albedo: [K, 3] factor of colours.
        nail: [K] 1 on nails, 0 on skin.
    """

    coverage: Tensor
    depth: Tensor
    row: Tensor
    normal: Tensor
    surface_normal: Tensor
    albedo: Tensor
    nail: Tensor


def detailed_image(
    image: LitImage, seen: PixelSurface, mesh: FineMesh, camera: CameraTensors, maps: DetailMaps
) -> LitImage:
    """The image with the known skin.

    Args:
        image: of the hand, at full size.
        seen: what the image shows of the surface.
        mesh: posed.
        camera: of the image.
        maps: of the person.
    """
    return with_skin(image, pixel_skin(image.pixel, image.view, seen, mesh, camera, maps))


def pixel_skin(
    pixel: Int[Tensor, " P"],
    view: Float[Tensor, "P 3"],
    seen: PixelSurface,
    mesh: FineMesh,
    camera: CameraTensors,
    maps: DetailMaps,
) -> PixelSkin:
    """What these pixels show; `view` as in `LitImage`, others as in `detailed_image`."""
    row = (seen.face[pixel] >= 0).nonzero()[:, 0]
    face, depth = seen.face[pixel[row]].long(), seen.depth[pixel[row]]
    corners, weights = mesh.faces[face], barycentric(mesh, camera, face, pixel[row])
    gradients = _gradients(mesh.vertices[corners], mesh.corner_uv[face])
    uv = blend_corners(mesh.corner_uv[face], weights)
    values = _sampled(maps, uv, gradients, view[row], depth / camera.focal_px, mesh.scale)
    flex = blend_corners(mesh.flex[corners][..., None], weights)
    dorsal, palmar = FOLDS * (1 - FLATTENED * flex).clamp(min=0), FOLDS * (DEEPENED_FROM + DEEPENED_BY * flex)
    slopes = values[:, 0:2] - dorsal * values[:, 2:4] - palmar * values[:, 4:6]
    bent = BUMP * 1e-3 * maps.resolution * mesh.scale * (slopes[:, :, None] * gradients).sum(1)
    folded = dorsal * values[:, 7:8] + palmar * values[:, 8:9]
    pigment = values[:, 6:7] * values.new_tensor(maps.pigment_colour)
    surface_normal = normalize(blend_corners(mesh.normals[corners], weights), dim=-1)
    return PixelSkin(
        coverage=seen.coverage[pixel],
        depth=seen.depth[pixel],
        row=row,
        normal=normalize(surface_normal - bent, dim=-1),
        surface_normal=surface_normal,
        albedo=torch.exp(pigment + folded * values.new_tensor(FOLD_LOG_ALBEDO)),
        nail=values[:, -1],
    )


def with_skin(image: LitImage, skin: PixelSkin) -> LitImage:
    """The image with this skin, with gradients to its colours; normals beside the surface stay.

    Its gloss is known as its shape is: all of the broad lobe on skin, all of the tight one on nails.
    """
    row, before = skin.row, image.alpha.flatten()[image.pixel].clamp(MIN_ALPHA, 1)
    coefficients = image.coefficients * (skin.coverage / before)[:, None]
    coefficients[row, SCATTERED.start : DIFFUSE.stop] *= skin.albedo.repeat(1, 3)
    nail = image.nail.index_put((row,), skin.nail)
    coefficients[:, GLOSS] = torch.stack([nail, 1 - nail], 1) * skin.coverage[:, None]
    alpha = torch.zeros_like(image.alpha).flatten().index_put((image.pixel,), skin.coverage)
    depth = torch.full_like(image.depth, torch.inf).flatten().index_put((image.pixel,), skin.depth)
    return image._replace(
        normal=image.normal.index_put((row,), skin.normal),
        surface_normal=image.surface_normal.index_put((row,), skin.surface_normal),
        coefficients=coefficients,
        nail=nail,
        alpha=alpha.reshape(image.alpha.shape),
        depth=depth.reshape(image.depth.shape),
    )


def _gradients(corners: Float[Tensor, "K 3 3"], uv: Float[Tensor, "K 3 2"]) -> Float[Tensor, "K 2 3"]:
    """Gradients of the atlas coordinates u and v on faces, 1/m, world."""
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
) -> Float[Tensor, "K 10"]:
    """The mean over what pixels show of faces, which are `pixel_m` wide where they are seen straight on."""
    normal = normalize(torch.linalg.cross(gradients[:, 0], gradients[:, 1]), dim=-1)
    facing = (normal * view).sum(-1, keepdim=True)
    cosine = facing[:, 0].abs().clamp(min=LEAST_COSINE)
    taps = (1 / cosine + ONE_TAP_MORE).floor().clamp(max=MOST_TAPS)
    step_m = pixel_m / (cosine * taps)
    tilt = normalize(view - facing * normal, dim=-1)
    step = step_m[:, None] * (gradients * tilt[:, None]).sum(-1)
    level = torch.log2(pixel_m / (scale * maps.texel_m)) - SHARPER
    total = uv.new_zeros(len(uv), CHANNELS)
    for tap in range(MOST_TAPS):
        at = (tap < taps).nonzero()[:, 0]
        aside = (tap - (taps[at] - 1) / 2)[:, None] * step[at]
        total.index_add_(0, at, maps.sample(uv[at] + aside, level[at]) / taps[at, None])
    return total


def _slopes(maps: SkinMaps, look: SkinLook, texels: float) -> list[np.ndarray]:
    """[N, N] each: along u and along v of relief, folds and creases, mm a texel of the finest level.

    That level's texel is as wide as `texels` of these.
    """
    heights = maps.relief_mm, maps.dorsal * (DORSAL_MM * look.folds), maps.palmar * (PALMAR_MM * look.folds)
    return [texels * _slope(height, axis) for height in heights for axis in (1, 0)]


def _slope(height: np.ndarray, axis: int) -> np.ndarray:
    """Differences of fourth order: those of second lose a third of waves of four texels, as ridges are."""
    slope, place = np.gradient(height, axis=axis), np.arange(height.shape[axis])
    before, after = (slope.take(at.clip(0, len(place) - 1), axis) for at in (place - 1, place + 1))
    return slope + (2 * slope - before - after) / 6


def _shades(maps: SkinMaps, look: SkinLook) -> list[np.ndarray]:
    """[N, N] each: pigment, folds, creases."""
    pigment = (1 - look.melanin) * maps.pigment_light + look.melanin * maps.pigment_deep
    return [pigment, maps.dorsal * DORSAL_SHADE, maps.palmar * PALMAR_SHADE]


def _widened(coarse: np.ndarray, resolution: int) -> np.ndarray:
    """A map at the finest level's resolution, by interpolation."""
    values = torch.as_tensor(np.ascontiguousarray(coarse), dtype=torch.float32)[None, None]
    return interpolate(values, size=(resolution, resolution), mode="bilinear")[0, 0].numpy()


def _halvings(fine: np.ndarray, step: float) -> Tensor:
    """[T] int8: level after level of a map, as means over blocks."""
    values = torch.as_tensor(np.ascontiguousarray(fine), dtype=torch.float32)[None]
    return torch.cat([_in_steps(_halved(values, level), step) for level in range(_LEVELS)])


def _pyramid(fine: np.ndarray, coarse: np.ndarray, step: float) -> Tensor:
    """[T] int8: level after level. One map at a time, for all together take half a gigabyte."""
    fine_map, coarse_map = (torch.as_tensor(np.ascontiguousarray(x), dtype=torch.float32)[None] for x in (fine, coarse))
    return torch.cat([_in_steps(_level(fine_map, coarse_map, level), step) for level in range(_LEVELS)])


def _in_steps(values: Tensor, step: float) -> Tensor:
    return (values / step).round().clamp(-127, 127).to(torch.int8).flatten()


def _level(fine: Float[Tensor, "1 N N"], coarse: Float[Tensor, "1 n n"], level: int) -> Float[Tensor, "1 m m"]:
    """A level of the pyramid: for images whose pixels are its texels, with what their rays pass over."""
    kept = _halved(fine, level)
    resolution, widest = kept.shape[-1], coarse.shape[-1]
    if resolution > widest or RESOLVED_PX * ATLAS_MM / resolution <= COARSEST_MM:
        return kept  # rays resolve more than the planes
    passed_over = coarse - _blurred(coarse, RESOLVED_PX * widest / resolution)
    return kept + _halved(passed_over, (widest // resolution).bit_length() - 1)


def _halved(maps: Float[Tensor, "C N N"], times: int) -> Float[Tensor, "C n n"]:
    """Means over blocks."""
    return avg_pool2d(maps, 1 << times)


def _blurred(maps: Float[Tensor, "C N N"], deviation: float) -> Float[Tensor, "C N N"]:
    """Gaussian blur; 0 lies around the maps."""
    reach = int(_BLUR_REACH * deviation + 0.5)
    weight = torch.exp(-0.5 * (torch.arange(-reach, reach + 1) / deviation) ** 2)
    weight = weight / weight.sum()
    along_u = conv2d(maps[:, None], weight.reshape(1, 1, 1, -1), padding=(0, reach))
    return conv2d(along_u, weight.reshape(1, 1, -1, 1), padding=(reach, 0))[:, 0]
