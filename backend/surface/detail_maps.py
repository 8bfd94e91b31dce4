"""A person's skin as a pyramid of maps over the atlas: slopes, pigment, folds, nails and gloss, for images of any size.

Each level is half as wide as the one before. What it no longer shows of slopes widens the lobe of gloss, by their
variance (Toksvig 2005; Olano and Baker 2010); so do steep walls of one texel, which would glitter. In small images,
where rays lie farther apart than the planes of a field resolve, the colours that they pass over are added.

A bumped normal tells which way the skin of a furrow faces, but not that it lies between walls, which hide a part of a
sky from it and redden the rest: furrows are dark in any light (ambient occlusion of a height map). As all of the
detail, their shades are what is left after a blur: the tone of the skin stays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import avg_pool2d, conv2d, interpolate, pad

from .albedo_ratio import AlbedoRatio
from .detail_maps_file import ATLAS_MM, COARSEST_MM, SkinMaps, SurfaceDetail
from .map_pyramid import LEVELS, pyramid_levels, trilinear

DORSAL_MM, PALMAR_MM = 0.36, 0.55
"""Depth of folds and creases at their deepest, straight and half bent."""
DORSAL_SHADE, PALMAR_SHADE = 0.42, 0.45
"""Share of the colour of folds at their deepest."""
PIGMENT_COLOUR = (0.48, 1.16, 1.36), (0.80, 1.04, 1.16)
"""Logarithm of the colour of pigment over its mean, of a light and of a deep skin: of baked skins, by least squares."""
RESOLVED_PX = 1.5
"""Deviation of the blur beyond which the rays, two pixels apart, show all."""
NAIL_FROM = 0.8
"""Of the map of nails, whose texels are half a millimetre: where it is less, slopes of their rims would glitter."""
BUMP = 0.9
"""Share of the slopes that shows: light is scattered inside the skin and leaves beside where it entered."""
SLOPE_STEP_MM, SHADE_STEP, GLOSS_STEP = 0.001, 0.01, 0.002
"""What one step of the stored whole numbers is worth: slopes in mm a texel."""
CHANNELS = 12
"""Slopes along u and v of relief, dorsal folds and palmar creases; pigment; dorsal folds; palmar creases; nail; squared
alpha of the gloss of skin, without folds; the variance of their slopes."""
BLURRED_LEVEL = 2.0, 0.8
"""The level that is as blurred as red light shows relief, of a light and of a deep skin.

Of waves of 0.45, 0.9, 1.8 and 4 mm, Cycles' random walk with the radii and colours of the built-in skin shows these
shares in red: 0.13, 0.29, 0.55 and 0.81 on a light palm, and 0.41, 0.68, 0.88 and 0.96 on the back of a deep hand."""
SHARPNESS = (0.13, 0.65, 0.9), (0.0, 0.85, 0.97)
"""The share of relief that each colour shows as if nothing blurred it: of waves of 0.45 mm, green shows 0.6 and 0.89,
and blue 0.87 and 0.96. Light skin's blurred level shows none of these in red."""
RESOLVED_BETWEEN = 0.05
"""Of the variance of slopes from texel to texel: images show that of fine lines, not the walls of a nail's rim."""
REACH_MM = 0.26
"""From a furrow to the skin that it is compared with."""
TONE_MM = 1.05
"""Side of the squares over which shades come to nothing."""
SHADE_OF_SLOPE, DEEPEST = 1.8, 0.35
"""Logarithm of the pigment of a furrow whose depth is `REACH_MM`, were it not for the most of it."""
_HIGHEST = 0.02  # of a crest, in the same measure: those that are higher see no more of the sky
_STEPS = [SLOPE_STEP_MM] * 6 + [SHADE_STEP] * 4 + [GLOSS_STEP] * 2
_BLUR_REACH = 3  # deviations
_BESIDE = (0.125, 0.75, 0.125)
_HALVING = (0.125, 0.375, 0.375, 0.125)  # binomial: means of two would alias ridges of three texels


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
        table: [T, 12] int8: the texels of all levels, rows of the finest first, the smallest v first.
        resolution: of the finest level.
        texel_m: its texels' side, template metres.
        pigment_colour: as `PIGMENT_COLOUR`, of the person.
        blurred_level: as `BLURRED_LEVEL`, of the person.
        sharpness: as `SHARPNESS`, of the person.
        ratio: of the person's albedo over that of the avatar's networks; None: they are the person's own.
    """

    table: Tensor
    resolution: int
    texel_m: float
    pigment_colour: tuple[float, ...]
    blurred_level: float
    sharpness: tuple[float, ...]
    ratio: AlbedoRatio | None = None

    @classmethod
    def of(cls, detail: SurfaceDetail, look: SkinLook, device: torch.device | str = "cpu") -> DetailMaps:
        """Make the detail maps of a person.

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
        for axis, unresolved in enumerate(detail.unresolved):
            slopes[axis] = slopes[axis] + _widened(unresolved, resolution) * (ATLAS_MM / resolution / BUMP)
        columns = [_halvings(slope, SLOPE_STEP_MM) for slope in slopes]
        pigment, *folds = _shades(detail.fine, look)
        fine_shades = [pigment + furrow_shade(detail.fine.relief_mm, ATLAS_MM / resolution), *folds]
        for fine, coarse in zip(fine_shades, _shades(detail.coarse, look), strict=True):
            columns.append(_pyramid(fine, coarse, SHADE_STEP))
        nail = (_widened(detail.nail, resolution) - NAIL_FROM) / (1 - NAIL_FROM)
        columns.append(_halvings(nail.clip(min=0), SHADE_STEP))
        # Where a texel's mean slope is steep, slopes within it are from none to twice that.
        steep = sum(_widened(along, resolution) ** 2 for along in detail.unresolved)
        rough = _levels(_widened(detail.roughness, resolution) ** 4 + steep)
        hidden, of_folds = (_variances(slopes[at], resolution) for at in (slice(0, 2), slice(2, 4)))
        both = [base + variance for base, variance in zip(rough, hidden, strict=True)]
        columns += [torch.cat([_in_steps(level, GLOSS_STEP) for level in levels]) for levels in (both, of_folds)]
        colour, sharpness = (_by_melanin(pair, look) for pair in (PIGMENT_COLOUR, SHARPNESS))
        level = float(np.interp(look.melanin, (0, 1), BLURRED_LEVEL))
        texel_m = ATLAS_MM / 1000 / resolution
        return cls(torch.stack(columns, 1).to(device), resolution, texel_m, colour, level, sharpness)

    @property
    def levels(self) -> list[tuple[int, int]]:
        """(first row of the table, resolution) of each level."""
        return pyramid_levels(self.resolution)

    def sample(self, uv: Float[Tensor, "P 2"], level: Float[Tensor, " P"]) -> Float[Tensor, "P 12"]:
        """Sample the maps, trilinear, in mm a texel, logarithms, 1 on nails, and squares."""
        both = trilinear(self.table, self.resolution, uv, level)
        return both * both.new_tensor(_STEPS)


def furrow_shade(relief_mm: Float[np.ndarray, "N N"], texel_mm: float) -> Float[np.ndarray, "N N"]:
    """Compute the logarithm of pigment that darkens furrows: below 0 in them, above on the skin between.

    Args:
        relief_mm: heights over an atlas.
        texel_mm: side of its texels.
    """
    heights = torch.as_tensor(np.ascontiguousarray(relief_mm), dtype=torch.float32)[None, None]
    slope = (_mean_around(heights, _texels(REACH_MM / 2, texel_mm)) - heights) / REACH_MM
    shade = (SHADE_OF_SLOPE * slope.clamp(min=-_HIGHEST)).clamp(max=DEEPEST)
    tone = avg_pool2d(shade, _texels(TONE_MM, texel_mm))
    return (interpolate(tone, size=shade.shape[-2:], mode="bilinear") - shade)[0, 0].numpy()


def _mean_around(plane: Float[Tensor, "1 1 N N"], reach: int) -> Float[Tensor, "1 1 N N"]:
    """Average twice over so many texels to each side; what lies beyond the map does not count."""
    for _ in range(2):
        plane = avg_pool2d(plane, 2 * reach + 1, 1, reach, count_include_pad=False)
    return plane


def _texels(length_mm: float, texel_mm: float) -> int:
    return max(1, round(length_mm / texel_mm))


def _by_melanin(light_and_deep: tuple[tuple[float, ...], ...], look: SkinLook) -> tuple[float, ...]:
    """Interpolate between the values of a light and of a deep skin."""
    light, deep = np.array(light_and_deep)
    return tuple(((1 - look.melanin) * light + look.melanin * deep).tolist())


def _slopes(maps: SkinMaps, look: SkinLook, texels: float) -> list[np.ndarray]:
    """Compute slopes [N, N] along u and v of relief, folds and creases, mm a texel of the finest level.

    That level's texel is as wide as `texels` of these.
    """
    heights = maps.relief_mm, maps.dorsal * (DORSAL_MM * look.folds), maps.palmar * (PALMAR_MM * look.folds)
    return [texels * _slope(height, axis) for height in heights for axis in (1, 0)]


def _slope(height: np.ndarray, axis: int) -> np.ndarray:
    """Compute differences of fourth order: those of second lose a third of waves of four texels, as ridges are."""
    slope, place = np.gradient(height, axis=axis), np.arange(height.shape[axis])
    before, after = (slope.take(at.clip(0, len(place) - 1), axis) for at in (place - 1, place + 1))
    return slope + (2 * slope - before - after) / 6


def _shades(maps: SkinMaps, look: SkinLook) -> list[np.ndarray]:
    """Return the shades [N, N] of pigment, folds and creases."""
    pigment = (1 - look.melanin) * maps.pigment_light + look.melanin * maps.pigment_deep
    return [pigment, maps.dorsal * DORSAL_SHADE, maps.palmar * PALMAR_SHADE]


def _widened(coarse: np.ndarray, resolution: int) -> np.ndarray:
    """Interpolate a map to the finest level's resolution."""
    values = torch.as_tensor(np.ascontiguousarray(coarse), dtype=torch.float32)[None, None]
    return interpolate(values, size=(resolution, resolution), mode="bilinear")[0, 0].numpy()


def _variances(along: list[np.ndarray], resolution: int) -> list[Tensor]:
    """Compute, by level, the variance of slopes along u and v that images do not show, in mm a texel of the finest."""
    u, v = (_levels(slope * (resolution / ATLAS_MM)) for slope in along)
    squares = _levels((u[0] ** 2 + v[0] ** 2)[0, 0].numpy())
    within = [square - a * a - b * b for square, a, b in zip(squares, u, v, strict=True)]
    between = [_around(a * a + b * b) - _around(a) ** 2 - _around(b) ** 2 for a, b in zip(u, v, strict=True)]
    return [hidden + (walls - RESOLVED_BETWEEN).clamp(min=0) for hidden, walls in zip(within, between, strict=True)]


def _halvings(fine: np.ndarray, step: float) -> Tensor:
    """Store a map level after level: [T] int8."""
    return torch.cat([_in_steps(values, step) for values in _levels(fine)])


def _pyramid(fine: np.ndarray, coarse: np.ndarray, step: float) -> Tensor:
    """Store a map by level, with what rays pass over: [T] int8. One at a time: all together take half a gigabyte."""
    coarse_map = _plane(coarse)
    return torch.cat([_in_steps(_level(kept, coarse_map), step) for kept in _levels(fine)])


def _plane(values: np.ndarray) -> Float[Tensor, "1 1 N N"]:
    return torch.as_tensor(np.ascontiguousarray(values), dtype=torch.float32)[None, None]


def _in_steps(values: Tensor, step: float) -> Tensor:
    return (values / step).round().clamp(-127, 127).to(torch.int8).flatten()


def _level(kept: Float[Tensor, "1 1 m m"], coarse: Float[Tensor, "1 1 n n"]) -> Float[Tensor, "1 1 m m"]:
    """Make a level of the pyramid: for images whose pixels are its texels, with what their rays pass over.

    Args:
        kept: of the fine map, as wide as the level.
        coarse: the coarse map.
    """
    resolution, widest = kept.shape[-1], coarse.shape[-1]
    if resolution > widest or RESOLVED_PX * ATLAS_MM / resolution <= COARSEST_MM:
        return kept  # rays resolve more than the planes
    passed_over = coarse - _blurred(coarse, RESOLVED_PX * widest / resolution)
    while passed_over.shape[-1] > resolution:
        passed_over = _halved(passed_over)
    return kept + passed_over


def _levels(fine: np.ndarray) -> list[Tensor]:
    """Return the levels [1, 1, n, n] of a map, each half as wide as the one before."""
    levels = [_plane(fine)]
    while len(levels) < LEVELS:
        levels.append(_halved(levels[-1]))
    return levels


def _halved(plane: Float[Tensor, "1 1 N N"]) -> Float[Tensor, "1 1 n n"]:
    """Halve the width."""
    return _means(plane, _HALVING, 2)


def _around(plane: Float[Tensor, "1 1 N N"]) -> Float[Tensor, "1 1 N N"]:
    """Average each texel and those beside it."""
    return _means(plane, _BESIDE, 1)


def _means(plane: Float[Tensor, "1 1 N N"], weights: tuple[float, ...], step: int) -> Float[Tensor, "1 1 n n"]:
    """Average with weights, from one texel before every `step` on; border values repeat. A convolution is slower."""
    values = pad(plane, (1, 1, 1, 1), mode="replicate")
    for axis in (-2, -1):
        reach = values.shape[axis] - len(weights) + 1
        first, *others = (values.narrow(axis, at, reach).movedim(axis, -1)[..., ::step] for at in range(len(weights)))
        total = first * weights[0]
        for weight, other in zip(weights[1:], others, strict=True):
            total = total.add_(other, alpha=weight)
        values = total.movedim(-1, axis)
    return values


def _blurred(plane: Float[Tensor, "1 1 N N"], deviation: float) -> Float[Tensor, "1 1 N N"]:
    """Blur with a Gaussian; 0 lies around the maps."""
    reach = int(_BLUR_REACH * deviation + 0.5)
    weight = torch.exp(-0.5 * (torch.arange(-reach, reach + 1) / deviation) ** 2)
    weight = weight / weight.sum()
    along_u = conv2d(plane, weight.reshape(1, 1, 1, -1), padding=(0, reach))
    return conv2d(along_u, weight.reshape(1, 1, -1, 1), padding=(reach, 0))
