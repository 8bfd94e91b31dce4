"""Samples of a frame's light: directions of the sky, and points of every lamp."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache, lru_cache
from math import cos, pi, radians, tan
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..geometry.shadow_maps import FAR, Bounds, LightViews
from ..geometry.visibility import direction_frames
from ..records.light import Lamp, Light, Penumbra, Sky, sky_directions
from .mirrored_sky import MirroredSky

SKY_DIRECTIONS = 64
# As many directions on the whole sphere as bright cells of a sky are divided by, from a brightness against the mean on:
# a window in one of them would cast shadows as hard as a lamp's.
_DIVIDED_FROM: dict[Penumbra, tuple[tuple[float, int], ...]] = {
    "none": (),
    "coarse": ((4.0, 256),),
    "fine": ((5.0, 1024), (2.0, 256)),
}
Division = tuple[int, ...]
"""Of how many directions on the whole sphere each cell of the sky takes its share; `SKY_DIRECTIONS`: itself."""
UNDIVIDED: Division = (SKY_DIRECTIONS,) * SKY_DIRECTIONS
# Samples of a lamp by the angle under which the hand sees it: more where its shadows are softer, deg.
_SAMPLES_FROM_DEG: dict[Penumbra, tuple[tuple[float, int], ...]] = {
    "none": ((0.0, 1),),
    "coarse": ((25.0, 16), (8.0, 9), (1.5, 4), (0.0, 1)),
    "fine": ((20.0, 36), (8.0, 25), (3.0, 16), (1.0, 9), (0.0, 1)),
}
HARD_RAD = radians(3)
"""The angle of the lamps whose shadows are too soft to show what casts them."""
# Nearest distance of a lamp at which its light is computed, m: closer, it would grow without bound.
_LEAST_DISTANCE_M = 0.005
_LEAST_FLUX, _LEAST_SHARE = 1e-20, 1e-6
_LEAST_ROWS = 32  # of a sky's map
_SHARES_PX = (128, 256)  # of the map by which the parts' shares are found
_GOLDEN_ANGLE = pi * (3 - 5**0.5)


class SkySamples(NamedTuple):
    """The sky as K directions: those of the `SKY_DIRECTIONS` cells, and then the parts of divided cells.

    Attributes:
        towards: [K, 3] unit, world.
        flux: [K, 3] radiance times solid angle of each direction's cell, divided by pi.
        share: [K] of the sphere; 0 for divided cells.
        mirrored: its gloss.
    """

    towards: Tensor
    flux: Tensor
    share: Tensor
    mirrored: MirroredSky

    @classmethod
    def of(cls, sky: Sky | None, device: torch.device | str, division: Division = UNDIVIDED) -> SkySamples:
        """The samples of a sky; None is black."""
        towards, share = (torch.tensor(values, dtype=torch.float32, device=device) for values in _layout(division))
        flux = torch.zeros(len(towards), 3, device=device)
        if sky is not None:
            cell, energy = _energies(sky, division)
            energies = torch.as_tensor(energy, dtype=torch.float32, device=device)
            flux = flux.index_add(0, torch.as_tensor(cell, device=device), energies)
        return cls(towards, flux, share, MirroredSky.of(sky, device))

    @classmethod
    def mixed(cls, skies: tuple[SkySamples, ...], weights: Float[Tensor, "G 3"]) -> SkySamples:
        """The weighted sum of skies."""
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

    def views(self) -> LightViews:
        """Views for shadow maps."""
        return LightViews.along(self.towards, torch.full_like(self.towards[:, 0], FAR))


class LampSamples(NamedTuple):
    """L lamps as K points, or directions of suns.

    Attributes:
        lamp: [K] the lamp of each sample.
        position: [K, 3] m; of a sun: unit direction towards it.
        is_sun: [K].
        axis: [K, 3] unit direction in which the lamp shines.
        is_area: [K] whether the light falls off with the cosine to the axis.
        share: [K] of the lamp's light, divided by pi.
        tan_spread: [K] tangent of half an area lamp's beam; infinite: no limit.
        spread_share: [K] factor that keeps the beam's power.
        cos_cone: [K] cosine of half a spot's cone; -2: no cone.
        cone_edge: [K] steepness of the cone's edge, per unit of cosine.
        shadow: [K] 1, or 0 for lamps that cast none.
        rgb: [L, 3] as in `records.light.Lamp`.
        radius_rad: [L] half the angle under which the hand sees the lamp.
    """

    lamp: Tensor
    position: Tensor
    is_sun: Tensor
    axis: Tensor
    is_area: Tensor
    share: Tensor
    tan_spread: Tensor
    spread_share: Tensor
    cos_cone: Tensor
    cone_edge: Tensor
    shadow: Tensor
    rgb: Tensor
    radius_rad: Tensor

    @property
    def is_hard(self) -> Bool[Tensor, " K"]:
        """Which samples are of lamps whose shadows have edges."""
        return (2 * self.radius_rad < HARD_RAD)[self.lamp]

    @classmethod
    def of(cls, lamps: tuple[Lamp, ...], bounds: Bounds, penumbra: Penumbra = "coarse") -> LampSamples:
        """The samples of lamps around a hand; `penumbra` as in `Light`."""
        centre, device = bounds.centre.cpu().double().numpy(), bounds.centre.device
        angles = [_angle_rad(lamp, centre) for lamp in lamps]
        rows = [_rows_of(index, *one, centre, penumbra) for index, one in enumerate(zip(lamps, angles, strict=True))]
        none = tuple(column[:0] for column in _rows_of(0, Lamp("sun", np.zeros(3)), 0.0, centre))
        columns = zip(*(rows or [none]), strict=True)
        tensors = [_tensor(np.concatenate(column), device) for column in columns]
        rgb = np.array([lamp.rgb for lamp in lamps]).reshape(-1, 3)
        return cls(*tensors, rgb=_tensor(rgb, device), radius_rad=_tensor(np.array(angles).reshape(-1) / 2, device))

    def views(self, bounds: Bounds) -> LightViews:
        """Views for shadow maps."""
        offset = self.position - bounds.centre
        distance = offset.norm(dim=-1)
        towards = torch.where(self.is_sun[:, None], self.position, offset / distance.clamp(min=1e-6)[:, None])
        radii = (distance / bounds.radius).clamp(1e-3, FAR)
        return LightViews.along(towards, torch.where(self.is_sun, torch.full_like(radii, FAR), radii))

    def arriving(self, points: Float[Tensor, "P 3"]) -> tuple[Float[Tensor, "K P 3"], Float[Tensor, "K P"]]:
        """(unit directions towards the light, irradiance / pi of a surface that faces it for an rgb of 1)."""
        offset = self.position[:, None] - points
        squared = (offset * offset).sum(-1).clamp(min=_LEAST_DISTANCE_M**2)
        towards = torch.where(self.is_sun[:, None, None], self.position[:, None], offset / squared.sqrt()[..., None])
        along = -(towards * self.axis[:, None]).sum(-1)
        strength = torch.where(self.is_sun[:, None], torch.ones_like(along), self._emitted(along) / squared)
        return towards.expand(-1, len(points), -1), self.share[:, None] * strength

    def _emitted(self, along: Float[Tensor, "K P"]) -> Float[Tensor, "K P"]:
        """Intensity of each sample, per watt, in directions with this cosine to its axis."""
        edge = ((along - self.cos_cone[:, None]) * self.cone_edge[:, None]).clamp(0, 1)
        cone = torch.where(self.cos_cone[:, None] < -1, torch.ones_like(edge), edge * edge * (3 - 2 * edge))
        facing = along.clamp(min=1e-6)
        tangent = (1 / facing**2 - 1).clamp(min=0).sqrt()
        beam = ((self.tan_spread[:, None] - tangent) * self.spread_share[:, None]).clamp(min=0)
        beam = torch.where(self.tan_spread[:, None].isinf(), torch.ones_like(beam), beam)
        area = along.clamp(min=0) * beam / pi
        return torch.where(self.is_area[:, None], area, cone / (4 * pi))


class LightSamples(NamedTuple):
    """The light of a frame, sampled."""

    sky: SkySamples
    lamps: LampSamples

    @classmethod
    def of(cls, light: Light, bounds: Bounds) -> LightSamples:
        """The samples around a hand."""
        sky = SkySamples.of(light.sky, bounds.centre.device, division_of((light.sky,), light.penumbra))
        return cls(sky, LampSamples.of(light.lamps, bounds, light.penumbra))

    def unblocked(self, point: Float[Tensor, " 3"]) -> Float[Tensor, ""]:
        """What all of the light together would make of a white surface that faced all of it, mean over colours."""
        _, strength = self.lamps.arriving(point[None])
        of_lamps = (strength * self.lamps.rgb[self.lamps.lamp]).sum(0)
        return (self.sky.flux.sum(0) + of_lamps).mean()


def _rows_of(
    index: int, lamp: Lamp, angle_rad: float, centre: np.ndarray, penumbra: Penumbra = "coarse"
) -> tuple[np.ndarray, ...]:
    """The columns of `LampSamples` for one lamp's samples."""
    count = next(samples for least_deg, samples in _SAMPLES_FROM_DEG[penumbra] if np.rad2deg(angle_rad) >= least_deg)
    positions = _positions(lamp, centre, count)

    def column(value: float) -> np.ndarray:
        return np.full(count, value)

    half_spread = min(lamp.spread_rad, pi) / 2
    is_wide = lamp.kind != "area" or half_spread > pi / 2 - 1e-3
    half_cone = lamp.cone_rad / 2
    is_cone = lamp.kind == "spot"
    return (
        np.full(count, index),
        positions,
        np.full(count, lamp.kind == "sun"),
        np.tile(lamp.direction, (count, 1)),
        np.full(count, lamp.kind == "area"),
        column(1 / (count * pi)),
        column(np.inf if is_wide else tan(half_spread)),
        column(1.0 if is_wide else 1 / max(tan(half_spread) - half_spread, 1e-6)),
        column(cos(half_cone) if is_cone else -2.0),
        column(1 / max((1 - cos(half_cone)) * lamp.blend, 1e-4) if is_cone else 0.0),
        column(float(lamp.casts_shadow)),
    )


def _positions(lamp: Lamp, centre: np.ndarray, count: int) -> np.ndarray:
    """[count, 3] points spread over the lamp as the hand sees it; of a sun, unit directions towards it."""
    if lamp.kind == "area":
        offsets = _disc(count) if lamp.is_ellipse else _square(count)
        width, height = lamp.size_m
        return lamp.position + offsets * (width / 2, height / 2) @ lamp.rotation[:, :2].T
    if lamp.kind == "sun":
        directions = -lamp.direction + np.tan(lamp.angle_rad / 2) * _disc(count) @ lamp.rotation[:, :2].T
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    towards = (lamp.position - centre) / max(np.linalg.norm(lamp.position - centre), 1e-9)
    across = np.linalg.svd(towards[None])[2][1:]
    return lamp.position + lamp.radius_m * _disc(count) @ across


def _disc(count: int) -> np.ndarray:
    """[count, 2] points spread over the unit disc (Vogel 1979); one point is its centre."""
    if count == 1:
        return np.zeros((1, 2))
    index = np.arange(count)
    radius, angle = np.sqrt((index + 0.5) / count), index * _GOLDEN_ANGLE
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)


def _square(count: int) -> np.ndarray:
    """[count, 2] points in the cells of [-1, 1]^2, one each; count is a square number.

    The grid of cells is sheared both ways, so that no two points share a coordinate: an edge along the square's sides
    hides one after the other, and a shadow has as many steps as there are points.
    """
    side = round(count**0.5)
    row, column = np.divmod(np.arange(count), side)
    ranks = np.stack([row * side + column, column * side + side - 1 - row], -1)
    return (2 * ranks + 1) / count - 1


def _angle_rad(lamp: Lamp, centre: np.ndarray) -> float:
    """The largest angle under which the lamp is seen from a point."""
    if lamp.kind == "sun":
        return lamp.angle_rad
    size_m = max(lamp.size_m) if lamp.kind == "area" else 2 * lamp.radius_m
    return 2 * float(np.arctan2(size_m / 2, np.linalg.norm(lamp.position - centre)))


def _tensor(values: np.ndarray, device: torch.device) -> Tensor:
    kind = None if values.dtype in (bool, np.int64) else torch.float32
    return torch.as_tensor(values, dtype=kind, device=device)


def division_of(skies: Iterable[Sky | None], penumbra: Penumbra) -> Division:
    """By which the cells of skies that shine together are divided for shadows of this fineness."""
    grey = np.zeros(SKY_DIRECTIONS)
    for sky in skies:
        if sky is not None:
            cell, energy = _energies(sky, UNDIVIDED)
            grey += np.bincount(cell, energy.mean(1), SKY_DIRECTIONS)
    levels = (*_DIVIDED_FROM[penumbra], (0.0, SKY_DIRECTIONS))
    brightness = grey / max(grey.mean(), _LEAST_FLUX)
    return tuple(next(count for least, count in levels if value >= least) for value in brightness)


def _energies(sky: Sky, division: Division) -> tuple[np.ndarray, np.ndarray]:
    """Of N small texels of a sky: the direction [N] that stands for each, and what each adds to its flux [N, 3]."""
    finely = _in_small_texels(sky)
    energy = (finely.radiance * finely.solid_angles[..., None] / pi).reshape(-1, 3)
    return _cells(*finely.radiance.shape[:2], division), energy


def _in_small_texels(sky: Sky) -> Sky:
    """The same sky in texels that are smaller than its cells."""
    times = -(-_LEAST_ROWS // len(sky.radiance))
    return sky if times == 1 else replace(sky, radiance=sky.radiance.repeat(times, 0).repeat(times, 1))


@cache
def _sphere(count: int) -> np.ndarray:
    """[count, 3] directions."""
    return direction_frames(count, "cpu")[:, 2].numpy().astype(np.float64)


@lru_cache(maxsize=32)
def _parts(division: Division) -> tuple[np.ndarray, np.ndarray]:
    """[M, 3] directions of the parts of divided cells, and [M] the cell of each."""
    found = [(np.zeros((0, 3)), np.zeros(0, np.int64))]
    for count in sorted({*division} - {SKY_DIRECTIONS}):
        towards = _sphere(count)
        cell = (towards @ _sphere(SKY_DIRECTIONS).T).argmax(1)
        is_part = np.array(division)[cell] == count
        found.append((towards[is_part], cell[is_part]))
    towards, cells = zip(*found, strict=True)
    return np.concatenate(towards), np.concatenate(cells)


@lru_cache(maxsize=32)
def _layout(division: Division) -> tuple[np.ndarray, np.ndarray]:
    """[K, 3] directions of the cells and of the parts, and the share [K] of the sphere that each stands for."""
    whole, (towards, of_cell) = _sphere(SKY_DIRECTIONS), _parts(division)
    share = np.where(np.array(division) == SKY_DIRECTIONS, 1 / SKY_DIRECTIONS, 0.0)
    if not len(towards):
        return whole, share
    even = Sky(np.ones((*_SHARES_PX, 3)))
    area = np.bincount(_cells(*_SHARES_PX, division), even.solid_angles.ravel(), SKY_DIRECTIONS + len(towards))
    area = area[SKY_DIRECTIONS:]
    in_cell = np.bincount(of_cell, area, SKY_DIRECTIONS)[of_cell]
    return np.concatenate([whole, towards]), np.concatenate([share, area / in_cell / SKY_DIRECTIONS])


@lru_cache(maxsize=32)
def _cells(height: int, width: int, division: Division) -> np.ndarray:
    """[H * W] the sky direction that stands for each texel of an equirectangular map: the nearest of its cell."""
    directions = sky_directions(height, width).reshape(-1, 3)
    nearest = (directions @ _sphere(SKY_DIRECTIONS).T).argmax(1)
    found, (towards, of_cell) = nearest.copy(), _parts(division)
    for cell in np.unique(of_cell):
        texels, parts = np.flatnonzero(nearest == cell), np.flatnonzero(of_cell == cell)
        found[texels] = SKY_DIRECTIONS + parts[(directions[texels] @ towards[parts].T).argmax(1)]
    return found
