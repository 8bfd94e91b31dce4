"""Extracts small bright suns from a map of the sky, so that they cast sharp shadows as lamps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...backend.records.light import Lamp, sky_directions

# A sun is smaller than this, and gives at least this share of all light.
_MAX_ANGLE_RAD, _MIN_SHARE = np.deg2rad(5.0), 0.01
# What is brighter than this share of the sun's peak belongs to it.
_EDGE = 0.02
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


class CloseUp(NamedTuple):
    """A pinhole view of a bright place.

    Attributes:
        radiance: [N, N, 3], top row first.
        axes: [3, 3] of the camera, which looks along its -Z.
        angle_rad: field of view.
    """

    radiance: np.ndarray
    axes: np.ndarray
    angle_rad: float


class _Spot(NamedTuple):
    """A bright spot: radiance around it [3], irradiance [3] beyond that, direction, angular radius and extent."""

    around: np.ndarray
    rgb: np.ndarray
    towards: np.ndarray
    radius_rad: float
    extent_rad: float


def extract_suns(radiance: np.ndarray, close_ups: Sequence[CloseUp]) -> tuple[np.ndarray, list[Lamp]]:
    """Split the map [H, W, 3] into one without its suns, and the suns; together they give as much light as before."""
    directions = sky_directions(*radiance.shape[:2])
    texel_rad = np.pi / radiance.shape[0]
    weight = np.linalg.norm(directions[..., :2], axis=-1) * texel_rad**2
    flux = (radiance @ _LUMINANCE * weight).sum()
    radiance, suns = radiance.copy(), []
    for close_up in close_ups:
        spot = _bright_spot(close_up, texel_rad)
        if 2 * spot.radius_rad < _MAX_ANGLE_RAD and spot.rgb @ _LUMINANCE > _MIN_SHARE * flux:
            is_sun = directions @ spot.towards > np.cos(spot.extent_rad)
            radiance[is_sun] = np.minimum(radiance[is_sun], spot.around)
            suns.append(_sun(spot))
    return radiance, suns


def _bright_spot(close_up: CloseUp, texel_rad: float) -> _Spot:
    rays, solid_angle = _rays(close_up)
    axis_rad = np.arccos(np.clip(-(rays @ close_up.axes[:, 2]), -1, 1))
    around = np.median(close_up.radiance[axis_rad > 0.44 * close_up.angle_rad], axis=0)
    excess = np.maximum(close_up.radiance - around, 0)
    brightness = excess @ _LUMINANCE * solid_angle
    brightness *= brightness > _EDGE * brightness.max()
    total = max(brightness.sum(), 1e-30)
    towards = (brightness[..., None] * rays).sum((0, 1)) / total
    towards /= max(np.linalg.norm(towards), 1e-30)
    distance_rad = np.arccos(np.clip(rays @ towards, -1, 1))
    # A uniform disc of radius a has the mean square distance a^2 / 2.
    radius_rad = float(np.sqrt(2 * (brightness * distance_rad**2).sum() / total))
    extent_rad = float(distance_rad[brightness > 0].max(initial=0)) + 0.71 * texel_rad
    is_near = (distance_rad < extent_rad)[..., None]
    return _Spot(around, (excess * is_near * solid_angle[..., None]).sum((0, 1)), towards, radius_rad, extent_rad)


def _rays(close_up: CloseUp) -> tuple[np.ndarray, np.ndarray]:
    """Compute unit directions [N, N, 3] of the pixels in the world, and their solid angles [N, N]."""
    count = len(close_up.radiance)
    side = 2 * np.tan(close_up.angle_rad / 2) / count
    across = (np.arange(count) + 0.5 - count / 2) * side
    x, y = np.meshgrid(across, -across)
    rays = np.stack([x, y, -np.ones_like(x)], -1)
    length = np.linalg.norm(rays, axis=-1)
    return rays / length[..., None] @ close_up.axes.T, side**2 / length**3


def _sun(spot: _Spot) -> Lamp:
    z = spot.towards
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z], 1)
    return Lamp("sun", spot.rgb, rotation=rotation, angle_rad=2 * spot.radius_rad)
