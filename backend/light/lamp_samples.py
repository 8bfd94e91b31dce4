"""A frame's lamps as points, and its suns as directions."""

from __future__ import annotations

from math import cos, pi, radians, tan
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..records.light import Lamp, ShadowQuality
from .shadow_maps import FAR, Bounds, ShadowViews

# Samples of a lamp by the angle under which the hand sees it: more where its shadows are softer, deg.
_SAMPLES_FROM_DEG: dict[ShadowQuality, tuple[tuple[float, int], ...]] = {
    "none": ((0.0, 1),),
    "coarse": ((25.0, 16), (8.0, 9), (1.5, 4), (0.0, 1)),
    "fine": ((20.0, 36), (8.0, 25), (3.0, 16), (1.0, 9), (0.0, 1)),
}
HARD_RAD = radians(3)
"""The angle of the lamps whose shadows are too soft to show what casts them."""
# Nearest distance of a lamp at which its light is computed, m: closer, it would grow without bound.
_LEAST_DISTANCE_M = 0.005
_GOLDEN_ANGLE = pi * (3 - 5**0.5)


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
    def of(cls, lamps: tuple[Lamp, ...], bounds: Bounds, shadow_quality: ShadowQuality = "coarse") -> LampSamples:
        """Sample lamps around a hand; `shadow_quality` as in `Light`."""
        centre, device = bounds.centre.cpu().double().numpy(), bounds.centre.device
        angles = [_angle_rad(lamp, centre) for lamp in lamps]
        rows = [
            _rows_of(index, *one, centre, shadow_quality) for index, one in enumerate(zip(lamps, angles, strict=True))
        ]
        columns = zip(*(rows or [_no_rows(centre)]), strict=True)
        tensors = [_tensor(np.concatenate(column), device) for column in columns]
        rgb = np.array([lamp.rgb for lamp in lamps]).reshape(-1, 3)
        return cls(*tensors, rgb=_tensor(rgb, device), radius_rad=_tensor(np.array(angles).reshape(-1) / 2, device))

    def around(self, lamps: tuple[Lamp, ...], bounds: Bounds, shadow_quality: ShadowQuality) -> LampSamples | None:
        """Return the samples of the same lamps around another hand; None: they are others there."""
        centre = bounds.centre.cpu().double().numpy()
        if any(lamp.kind in ("point", "spot") for lamp in lamps):  # whose discs face the hand
            return None
        angles = [_angle_rad(lamp, centre) for lamp in lamps]
        counts = [_sample_count(angle, shadow_quality) for angle in angles]
        if counts != np.bincount(self.lamp.numpy(force=True), minlength=len(lamps)).tolist():
            return None
        return self._replace(radius_rad=_tensor(np.array(angles).reshape(-1) / 2, self.radius_rad.device))

    def views(self, bounds: Bounds) -> ShadowViews:
        """Return the views for shadow maps."""
        offset = self.position - bounds.centre
        distance = offset.norm(dim=-1)
        towards = torch.where(self.is_sun[:, None], self.position, offset / distance.clamp(min=1e-6)[:, None])
        radii = (distance / bounds.radius).clamp(1e-3, FAR)
        return ShadowViews.along(towards, torch.where(self.is_sun, torch.full_like(radii, FAR), radii))

    def arriving(self, points: Float[Tensor, "P 3"]) -> tuple[Float[Tensor, "K P 3"], Float[Tensor, "K P"]]:
        """Return (unit directions towards the light, irradiance / pi of a surface that faces it for an rgb of 1)."""
        offset = self.position[:, None] - points
        squared = (offset * offset).sum(-1).clamp(min=_LEAST_DISTANCE_M**2)
        towards = torch.where(self.is_sun[:, None, None], self.position[:, None], offset / squared.sqrt()[..., None])
        along = -(towards * self.axis[:, None]).sum(-1)
        strength = torch.where(self.is_sun[:, None], torch.ones_like(along), self._emitted(along) / squared)
        return towards.expand(-1, len(points), -1), self.share[:, None] * strength

    def _emitted(self, along: Float[Tensor, "K P"]) -> Float[Tensor, "K P"]:
        """Compute the intensity of each sample, per watt, in directions with this cosine to its axis."""
        edge = ((along - self.cos_cone[:, None]) * self.cone_edge[:, None]).clamp(0, 1)
        cone = torch.where(self.cos_cone[:, None] < -1, torch.ones_like(edge), edge * edge * (3 - 2 * edge))
        facing = along.clamp(min=1e-6)
        tangent = (1 / facing**2 - 1).clamp(min=0).sqrt()
        beam = ((self.tan_spread[:, None] - tangent) * self.spread_share[:, None]).clamp(min=0)
        beam = torch.where(self.tan_spread[:, None].isinf(), torch.ones_like(beam), beam)
        area = along.clamp(min=0) * beam / pi
        return torch.where(self.is_area[:, None], area, cone / (4 * pi))


def _rows_of(
    index: int, lamp: Lamp, angle_rad: float, centre: np.ndarray, shadow_quality: ShadowQuality = "coarse"
) -> tuple[np.ndarray, ...]:
    """Make the columns of `LampSamples` for one lamp's samples."""
    count = _sample_count(angle_rad, shadow_quality)
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


def _sample_count(angle_rad: float, shadow_quality: ShadowQuality) -> int:
    levels = _SAMPLES_FROM_DEG[shadow_quality]
    return next(samples for least_deg, samples in levels if np.rad2deg(angle_rad) >= least_deg)


def _no_rows(centre: np.ndarray) -> tuple[np.ndarray, ...]:
    """Make the columns of `LampSamples` for no lamp."""
    return tuple(column[:0] for column in _rows_of(0, Lamp("sun", np.zeros(3)), 0.0, centre))


def _positions(lamp: Lamp, centre: np.ndarray, count: int) -> np.ndarray:
    """Spread points [count, 3] over the lamp as the hand sees it; of a sun, unit directions towards it."""
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
    """Spread points [count, 2] over the unit disc (Vogel 1979); one point is its centre."""
    if count == 1:
        return np.zeros((1, 2))
    index = np.arange(count)
    radius, angle = np.sqrt((index + 0.5) / count), index * _GOLDEN_ANGLE
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)


def _square(count: int) -> np.ndarray:
    """Spread points [count, 2] over the cells of [-1, 1]^2, one each; count is a square number.

    The grid of cells is sheared both ways, so that no two points share a coordinate: an edge along the square's sides
    hides one after the other, and a shadow has as many steps as there are points.
    """
    side = round(count**0.5)
    row, column = np.divmod(np.arange(count), side)
    ranks = np.stack([row * side + column, column * side + side - 1 - row], -1)
    return (2 * ranks + 1) / count - 1


def _angle_rad(lamp: Lamp, centre: np.ndarray) -> float:
    """Compute the largest angle under which the lamp is seen from a point."""
    if lamp.kind == "sun":
        return lamp.angle_rad
    size_m = max(lamp.size_m) if lamp.kind == "area" else 2 * lamp.radius_m
    return 2 * float(np.arctan2(size_m / 2, np.linalg.norm(lamp.position - centre)))


def _tensor(values: np.ndarray, device: torch.device) -> Tensor:
    kind = None if values.dtype in (bool, np.int64) else torch.float32
    return torch.as_tensor(values, dtype=kind, device=device)
