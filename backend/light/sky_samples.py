"""A frame's sky as directions: cells of the sphere, and the parts of bright ones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache, lru_cache
from math import pi
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..records.light import ShadowQuality, Sky, sky_directions
from .prefiltered_environment import PrefilteredEnvironment
from .shadow_maps import FAR, ShadowViews
from .visibility import direction_frames

SKY_DIRECTIONS = 64
# As many directions on the whole sphere as bright cells of a sky are divided by, from a brightness against the mean on:
# a window in one of them would cast shadows as hard as a lamp's.
_DIVIDED_FROM: dict[ShadowQuality, tuple[tuple[float, int], ...]] = {
    "none": (),
    "coarse": ((4.0, 256),),
    "fine": ((5.0, 1024), (2.0, 256)),
}
Division = tuple[int, ...]
"""Of how many directions on the whole sphere each cell of the sky takes its share; `SKY_DIRECTIONS`: itself."""
UNDIVIDED: Division = (SKY_DIRECTIONS,) * SKY_DIRECTIONS
_LEAST_FLUX, _LEAST_SHARE = 1e-20, 1e-6
_LEAST_ROWS = 32  # of a sky's map
_SHARES_PX = (128, 256)  # of the map by which the parts' shares are found


class SkySamples(NamedTuple):
    """The sky as K directions: those of the `SKY_DIRECTIONS` cells, and then the parts of divided cells.

    Attributes:
        towards: [K, 3] unit, world.
        flux: [K, 3] radiance times solid angle of each direction's cell, divided by pi.
        share: [K] of the sphere; 0 for divided cells.
        mirrored: its specular light.
    """

    towards: Tensor
    flux: Tensor
    share: Tensor
    mirrored: PrefilteredEnvironment

    @classmethod
    def of(cls, sky: Sky | None, device: torch.device | str, division: Division = UNDIVIDED) -> SkySamples:
        """Sample a sky; None is black."""
        return _black(str(device)) if sky is None and division == UNDIVIDED else _sampled(sky, device, division)

    @classmethod
    def mixed(cls, skies: tuple[SkySamples, ...], weights: Float[Tensor, "G 3"]) -> SkySamples:
        """Compute the weighted sum of skies."""
        first = skies[0]
        flux = torch.einsum("gkc,gc->kc", torch.stack([sky.flux for sky in skies]), weights)
        around = torch.einsum("gnlc,gc->nlc", torch.stack([sky.mirrored.radiance for sky in skies]), weights)
        return first._replace(flux=flux, mirrored=first.mirrored._replace(radiance=around))

    @property
    def brightness(self) -> Float[Tensor, " K"]:
        """Light of the directions against that of a whole cell as bright as the brightest; 0 if all are black."""
        return self.flux.mean(1) / (self.brightest * (4 / SKY_DIRECTIONS)).clamp(min=_LEAST_FLUX)

    @property
    def brightest(self) -> Float[Tensor, ""]:
        """Radiance of the brightest cell, mean over colours."""
        return (self.flux.mean(1) / self.share.clamp(min=_LEAST_SHARE)).max() / 4

    def views(self) -> ShadowViews:
        """Return the views for shadow maps."""
        return _distant_views(self.towards)


class ShadowedSky(NamedTuple):
    """From where the light of the sky's cells is blocked.

    Attributes:
        views: M, for shadow maps.
        of_cell: [SKY_DIRECTIONS] the view whose shadows each cell has: the nearest.
    """

    views: ShadowViews
    of_cell: Tensor

    @classmethod
    def of(cls, count: int, device: torch.device | str) -> ShadowedSky:
        """Sample a sky of unknown light from this many directions."""
        return _shadowed(count, str(device))


@cache
@torch.inference_mode(False)  # trainings may take them, too
def _shadowed(count: int, device: str) -> ShadowedSky:
    towards = torch.tensor(_sphere(count), dtype=torch.float32, device=device)
    return ShadowedSky(_distant_views(towards), torch.tensor(_nearest_of_cells(count), device=device))


@cache
@torch.inference_mode(False)
def _black(device: str) -> SkySamples:
    return _sampled(None, device, UNDIVIDED)


def _sampled(sky: Sky | None, device: torch.device | str, division: Division) -> SkySamples:
    towards, share = (torch.tensor(values, dtype=torch.float32, device=device) for values in _layout(division))
    flux = torch.zeros(len(towards), 3, device=device)
    if sky is not None:
        cell, energy = _energies(sky, division)
        energies = torch.as_tensor(energy, dtype=torch.float32, device=device)
        flux = flux.index_add(0, torch.as_tensor(cell, device=device), energies)
    return SkySamples(towards, flux, share, PrefilteredEnvironment.of(sky, device))


def _distant_views(towards: Float[Tensor, "K 3"]) -> ShadowViews:
    return ShadowViews.along(towards, torch.full_like(towards[:, 0], FAR))


def division_of(skies: Iterable[Sky | None], shadow_quality: ShadowQuality) -> Division:
    """Choose how the cells of skies that shine together are divided for shadows of this fineness."""
    grey = np.zeros(SKY_DIRECTIONS)
    for sky in skies:
        if sky is not None:
            cell, energy = _energies(sky, UNDIVIDED)
            grey += np.bincount(cell, energy.mean(1), SKY_DIRECTIONS)
    levels = (*_DIVIDED_FROM[shadow_quality], (0.0, SKY_DIRECTIONS))
    brightness = grey / max(grey.mean(), _LEAST_FLUX)
    return tuple(next(count for least, count in levels if value >= least) for value in brightness)


def _energies(sky: Sky, division: Division) -> tuple[np.ndarray, np.ndarray]:
    """Find the direction [N] that stands for each of N small texels of a sky, and what it adds to its flux [N, 3]."""
    finely = _in_small_texels(sky)
    energy = (finely.radiance * finely.solid_angles[..., None] / pi).reshape(-1, 3)
    return _cells(*finely.radiance.shape[:2], division), energy


def _in_small_texels(sky: Sky) -> Sky:
    """Resample the sky in texels that are smaller than its cells."""
    times = -(-_LEAST_ROWS // len(sky.radiance))
    return sky if times == 1 else replace(sky, radiance=sky.radiance.repeat(times, 0).repeat(times, 1))


@cache
def _sphere(count: int) -> np.ndarray:
    """Spread directions [count, 3] over the sphere."""
    return direction_frames(count, "cpu")[:, 2].numpy().astype(np.float64)


@cache
def _nearest_of_cells(count: int) -> np.ndarray:
    """Find the nearest of so many directions to each cell [SKY_DIRECTIONS]."""
    return (_sphere(SKY_DIRECTIONS) @ _sphere(count).T).argmax(1)


@lru_cache(maxsize=64)
def _parts(division: Division) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions [M, 3] of the parts of divided cells, and the cell [M] of each."""
    found = [(np.zeros((0, 3)), np.zeros(0, np.int64))]
    for count in sorted({*division} - {SKY_DIRECTIONS}):
        towards = _sphere(count)
        cell = (towards @ _sphere(SKY_DIRECTIONS).T).argmax(1)
        is_part = np.array(division)[cell] == count
        found.append((towards[is_part], cell[is_part]))
    towards, cells = zip(*found, strict=True)
    return np.concatenate(towards), np.concatenate(cells)


@lru_cache(maxsize=64)
def _layout(division: Division) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions [K, 3] of the cells and parts, and the share [K] of the sphere that each stands for."""
    whole, (towards, of_cell) = _sphere(SKY_DIRECTIONS), _parts(division)
    share = np.where(np.array(division) == SKY_DIRECTIONS, 1 / SKY_DIRECTIONS, 0.0)
    if not len(towards):
        return whole, share
    even = Sky(np.ones((*_SHARES_PX, 3)))
    area = np.bincount(_cells(*_SHARES_PX, division), even.solid_angles.ravel(), SKY_DIRECTIONS + len(towards))
    area = area[SKY_DIRECTIONS:]
    in_cell = np.bincount(of_cell, area, SKY_DIRECTIONS)[of_cell]
    return np.concatenate([whole, towards]), np.concatenate([share, area / in_cell / SKY_DIRECTIONS])


@lru_cache(maxsize=64)
def _cells(height: int, width: int, division: Division) -> np.ndarray:
    """Find the sky direction [H * W] that stands for each texel of an equirectangular map: the nearest of its cell."""
    directions = sky_directions(height, width).reshape(-1, 3)
    nearest = (directions @ _sphere(SKY_DIRECTIONS).T).argmax(1)
    found, (towards, of_cell) = nearest.copy(), _parts(division)
    for cell in np.unique(of_cell):
        texels, parts = np.flatnonzero(nearest == cell), np.flatnonzero(of_cell == cell)
        found[texels] = SKY_DIRECTIONS + parts[(directions[texels] @ towards[parts].T).argmax(1)]
    return found
